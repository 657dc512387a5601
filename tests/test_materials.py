"""The materials: numbers as the literature has them, once the units are put right."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from looped import over
from typer.testing import CliRunner

from cutbench import __version__
from cutbench.case import materials
from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.data.campaign import load_campaign
from cutbench.mechanisms import registry
from cutbench.run.runner import run_case

STUDIES = Path(__file__).parents[1] / "studies"
# (G_c/delta_c)/G, tau_W/(G_c/delta_c), eta_reg v in mm, G kPa, G_c J/m², mu, width mm
EXPECTED = {
    "gelatin": (10.1, 0.0106, 0.05, 7.5, 5.3, 0.0, 30),
    "elastomer": (1.79, 0.187, 0.05, 120, 15, 0.35, 30),
    "meat": (11.4, 0.0, 0.2, 25, 20, 0.0, 25),
}


def said(*args: str) -> str:
    result = CliRunner().invoke(app, list(args))
    assert result.exit_code == 0, result.output
    return result.output


def test_names():
    assert materials.names() == sorted([*EXPECTED, *(f"{name}_recalibrated" for name in EXPECTED)])


@pytest.mark.parametrize("name", EXPECTED)
def test_recalibrated_materials_keep_what_was_not_calibrated(name):
    published, made = load_case(name), load_case(f"{name}_recalibrated")
    kept = ("G", "nu", "delta_c", "mu", "tau_W", "thickness", "width", "length", "height", "speed")
    assert all(made.values[n] == published.values[n] for n in kept)
    assert "wedge" in made.mechanisms and "contact" not in made.mechanisms
    about = materials.about(f"{name}_recalibrated")
    assert "Calibrated on" in about["note"] and about["doi"].startswith("10.")


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_recalibrated_materials_behave_as_published(name):
    """What was fitted, and gelatin twice as wide, which was not."""
    for e in load_campaign(STUDIES / "published" / f"{name}.toml").experiments:
        case = load_case(
            f"{name}_recalibrated", {"depth": f"{e.depth_mm} mm", "width": f"{e.specimen['width']} mm"}
        )
        run = run_case(case)
        found = e.read_off(run.curve["displacement_mm"], run.curve["force_N"])
        for m, value in zip(e.measures, found, strict=True):
            assert abs(m.deviation(value)) < 2, (e.id, m.name, value)


@pytest.mark.parametrize("name", EXPECTED)
def test_numbers(name):
    cohesion, adhesion, eta_v, G, G_c, mu, width = EXPECTED[name]
    case = load_case(name)
    p, groups = case.p, case.groups()
    assert groups["(G_c/delta_c)/G"] == pytest.approx(cohesion, rel=5e-3)
    assert groups["tau_W/(G_c/delta_c)"] == pytest.approx(adhesion, rel=5e-3)
    assert p.eta_reg * p.speed == pytest.approx(eta_v, rel=5e-3)
    assert groups["eta_reg v/delta_c"] == pytest.approx(eta_v / 0.07, rel=5e-3)
    assert (p.G, p.G_c, p.mu, p.width) == pytest.approx((G * 1e-3, G_c * 1e-3, mu, width))
    assert (p.nu, p.delta_c, p.thickness, p.tip) == (0.49, 0.07, 0.7, 1.05)
    assert (p.length, p.height, p.depth, p.speed) == (30, 21, 18.2, 0.021)


def test_strength_of_gelatin_is_where_its_cut_was_seen_to_start():
    p = load_case("gelatin").p
    assert p.G_c / (math.e * p.delta_c) == pytest.approx(0.0278, rel=5e-3)


@pytest.mark.parametrize("name", EXPECTED)
def test_every_material_says_where_its_numbers_come_from(name):
    about = materials.about(name)
    assert about["doi"].startswith("10.")
    assert "printed" in said("materials", name)
    rows = {row["quantity"]: row for row in about["corrections"]}
    assert {"G_c/delta_c", "tau_W", "eta_reg", "tip", "beta"} <= set(rows)
    assert all(row["why"] for row in rows.values())
    assert about["doi"] in said("materials", name)


@pytest.mark.parametrize("name", EXPECTED)
def test_corrections_agree_with_the_values(name):
    from cutbench.base.units import parse_quantity

    p = load_case(name).p
    read = {row["quantity"]: row["read"] for row in materials.about(name)["corrections"]}
    assert parse_quantity(read["G_c/delta_c"], "MPa") == pytest.approx(p.G_c / p.delta_c, rel=1e-3)
    assert parse_quantity(read["tau_W"], "MPa") == pytest.approx(p.tau_W)
    assert parse_quantity(read["eta_reg"], "s") == pytest.approx(p.eta_reg)
    assert parse_quantity(read["tip"], "mm") == pytest.approx(p.tip)


def test_table_shows_materials_and_groups():
    text = said("materials")
    for part in (*EXPECTED, "(G_c/δ_c)/G", "τ_W/(G_c/δ_c)", "η_reg v/δ_c", "G_c/(G a)"):
        assert part in text
    for part in ("10.1", "1.79", "11.4", "0.0106", "0.187", "0.714", "2.85", "7.5 kPa", "15 J/m^2"):
        assert part in text


def test_mechanisms_are_listed_with_units():
    text = said("mechanisms")
    for name in registry():
        assert name in text
    assert "G_c (J/m^2)" in text


@over("name", list(registry()))
def test_every_mechanism_can_be_shown(name):
    m, text = registry()[name], said("mechanisms", name)
    for q in m.parameters:
        assert q.symbol in text
        assert q.unit in text
    assert f"slot: {m.slot}" in text


def test_version():
    assert said("--version").strip() == f"cutbench {__version__}"
