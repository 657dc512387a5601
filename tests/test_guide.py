"""The guide and the classical estimates: what they say holds for the runs they speak of."""

from __future__ import annotations

import math

import analytic_runs
import numpy as np
import pytest
from refusals import refused
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.emulator import estimate
from cutbench.maps import guidance as guides
from cutbench.maps.closed_form_estimates import classical, compare
from cutbench.maps.dataset import LABELS, build_map, row_of
from cutbench.maps.study import load_study
from cutbench.maps.study_sections import Regime
from cutbench.maps.sweep import run_study
from cutbench.run.store.runs import Store

GRID = """base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 30.0
points = 9
scale = "log"
[[axis]]
name = "viscosity"
from = 0.05
to = 10.0
points = 9
scale = "log"
[[axis]]
name = "adhesion"
values = [0.0, 0.0106, 0.06, 0.187, 0.5]
"""


def map_of(text, folder):
    path = folder / "study.toml"
    path.write_text(text)
    study = load_study(path)
    return build_map(
        study, {case.id: row_of(analytic_runs.computed(case), study.regime) for case in study.grid}
    )


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return map_of(GRID, tmp_path_factory.mktemp("guide"))


@pytest.mark.parametrize("material", ["gelatin", "elastomer", "meat"])
def test_each_change_crosses_where_it_says(data, material):
    """The stand-in's drop is known everywhere: solve for the lever's value and compare."""
    found = guides.guide(data, material)
    case = load_case(material)
    abrupt = analytic_runs.drop_of(case) >= 0.1
    assert found.changes
    if material == "elastomer":  # with friction, of which the map knows nothing
        assert "μ = 0.35" in found.doubt and not found.sure
    else:
        assert found.regime == ("abrupt" if abrupt else "smooth")
    for change in found.changes:
        unit = "" if change.unit == "1" else f" {change.unit}"
        beyond = change.to * (1.1 if change.to > change.now else 1 / 1.1)
        moved = case.set(**{change.parameter: f"{beyond!r}{unit}"})
        assert (analytic_runs.drop_of(moved) >= 0.1) != abrupt, change.text()
        before = change.to / (1.1 if change.to > change.now else 1 / 1.1)
        kept = case.set(**{change.parameter: f"{before!r}{unit}"})
        assert (analytic_runs.drop_of(kept) >= 0.1) == abrupt, change.text()
        assert (
            min(change.near, change.far) <= change.to * 1.001
            and change.to <= max(change.near, change.far) * 1.001
        )
    efforts = [change.effort for change in found.changes]
    assert efforts == sorted(efforts)


def test_the_words_have_place_regime_numbers_and_what_does_not_help(data):
    found = guides.guide(data, "gelatin")
    text = found.text()
    assert "cohesion 10.1" in text and "abrupt" in text and "1. " in text and "95 %:" in text
    assert f"tip: {found.still['tip']}" in text
    assert {c.lever for c in found.changes} >= {"speed", "coating"}


def test_a_change_from_nothing_has_no_factor(data):
    study = GRID.replace("to = 10.0", "to = 2.0")
    meat = {c.lever: c for c in guides.guide(data, "meat").changes}
    assert all(math.isfinite(c.factor) for c in meat.values()) and "2.0" in study
    bare = guides.LeverChange("coating", "tau_W", "kPa", 0.0, 5.0, 4.0, None, {})
    assert bare.factor == bare.effort == math.inf and "5 kPa" in bare.text() and "x" not in bare.text()[:30]


def test_the_recommended_change_is_checked_by_runs_of_the_map(data, tmp_path):
    found = guides.guide(data, "gelatin")
    store = Store(tmp_path / "runs")
    tried = guides.check(data, found, store.root, analytic_runs.computed)
    assert tried.crosses and tried.before.label == "abrupt" and tried.after.label == "smooth"
    assert len(store) == 2
    guides.check(data, found, store.root, run=None)  # both are in the store: nothing is computed


def test_a_check_that_fails_says_so():
    row = row_of(analytic_runs.computed(load_case("gelatin")), Regime(0.1, None, onset_length_mm=0.1))
    assert not guides.CheckedChange(row, row).crosses and row.label in guides.CheckedChange(row, row).text()


def test_a_material_outside_or_without_the_axes_is_refused(data, tmp_path):
    (tmp_path / "hard.toml").write_text('base = "gelatin"\n[parameters]\nG = "2000 kPa"\n')
    with refused("--material") as caught:
        guides.guide(data, str(tmp_path / "hard.toml"))
    assert "cohesion 1 to 30" in caught.value.expected
    (tmp_path / "bare.toml").write_text(
        'base = "gelatin"\nmechanisms = ["neo_hookean", "volumetric", "contact", "smith_ferrante"]\n'
    )
    with refused("--material", hint="viscosity, adhesion"):
        guides.guide(data, str(tmp_path / "bare.toml"))
    empty = map_of(GRID, tmp_path)
    empty["label"][:] = 0
    with refused("map", value="study"):
        guides.guide(empty, "gelatin")


@pytest.mark.parametrize(("material", "regime"), [("elastomer", "abrupt"), ("meat", "smooth")])
def test_without_a_map_the_atlas_says_what_crosses(material, regime):
    found = guides.guide_by_atlas(material)
    assert found.regime == regime and found.sure and found.changes
    for change in found.changes:
        value = change.far or change.to
        unit = "" if change.unit == "1" else f" {change.unit}"
        there = estimate(load_case(material).set(**{change.parameter: f"{value!r}{unit}"}))
        assert there.chances[regime] < (0.1 if change.far else 0.55), change.text()


def test_a_material_that_is_not_cut_or_not_in_the_atlas_is_refused(tmp_path):
    shallow = load_case("gelatin").set(depth="1 mm")
    with pytest.raises(BadInput, match="depth"):
        guides.guide_by_atlas(shallow)
    (tmp_path / "bevel.toml").write_text('base = "gelatin_recalibrated"\nwith = "bevel"\n')
    done = CliRunner().invoke(app, ["guide", str(tmp_path / "bevel.toml")])
    assert done.exit_code == 2 and "bevel" in done.output
    done = CliRunner().invoke(app, ["guide", str(tmp_path)])
    assert done.exit_code == 2 and "--material" in done.output


def test_a_switch_is_taken_as_the_material_has_it(tmp_path):
    text = GRID.replace(
        'name = "adhesion"\nvalues = [0.0, 0.0106, 0.06, 0.187, 0.5]', 'mechanism = "adhesion"'
    )
    data = map_of(text, tmp_path)
    with_it = guides.guide(data, "gelatin")
    (tmp_path / "bare.toml").write_text(
        'base = "gelatin"\nmechanisms = '
        '["neo_hookean", "volumetric", "contact", "smith_ferrante", "viscous_degraded", "coulomb"]\n'
    )
    without = guides.guide(data, str(tmp_path / "bare.toml"))
    speed = [next(c.to for c in g.changes if c.lever == "speed") for g in (with_it, without)]
    assert speed[1] > speed[0]  # less friction: more viscosity is needed to make it smooth
    assert "tau_W" in without.still["coating"]


@pytest.mark.slow
def test_the_command_says_it_and_checks_it(tmp_path, runs_by):
    path = tmp_path / "study.toml"
    path.write_text(GRID.replace("[0.0, 0.0106, 0.06, 0.187, 0.5]", "[0.0, 0.0106]"))
    run_study(path, tmp_path / "out", workers=0, run=analytic_runs.computed, pictures=False)
    runs_by(analytic_runs.computed)
    out = CliRunner().invoke(app, ["guide", str(tmp_path / "out"), "--material", "gelatin", "--check"])
    assert out.exit_code == 0, out.output
    assert "soonest first" in out.output and "it crosses" in out.output
    bad = CliRunner().invoke(app, ["guide", str(tmp_path / "out"), "--material", "gelatine"])
    assert bad.exit_code == 2 and "gelatin" in bad.output and "Traceback" not in bad.output


def test_the_classical_numbers_of_gelatin_by_hand():
    case = load_case("gelatin")
    found = classical(case)
    strength = 75.714e-3 / math.e  # MPa
    stiffness = 2 * math.pi / (math.log(4 * 21 / 0.7) - 0.5) * 7.5e-3 * 30
    assert found.onset_N == pytest.approx(0.7 * 30 * strength, rel=1e-4)
    assert found.onset_mm == pytest.approx(found.onset_N / stiffness, rel=1e-6)
    assert found.slope_N_per_mm == pytest.approx(2 * 0.8e-3 * 30)
    viscous = 2.38 * 0.021 / 0.07 * 0.7 / 1.05
    assert found.steady_at(0.0) == pytest.approx(30 * 5.3e-3 * (1 + viscous), rel=1e-6)
    assert found.stored_mJ == pytest.approx(found.onset_N**2 / (2 * stiffness), rel=1e-6)


def test_the_estimates_follow_what_they_are_made_of():
    gelatin = load_case("gelatin")
    here = classical(gelatin)
    assert here.margin(0.1) > 0 and here.drop_rel > 0.1
    assert classical(gelatin.set(viscosity=10.0)).margin(0.1) < 0
    assert classical(gelatin.set(cohesion=0.5)).drop_rel == 0.0  # too stiff: little is stored
    lasting = classical(gelatin.set(with_="viscous"))
    assert lasting.steady_N > here.steady_N
    assert classical(gelatin.set(without="stiff_cohesion", eta_reg="0 s", tau_W="0 kPa").set(
        mechanisms=("neo_hookean", "volumetric", "contact"))) is None  # fmt: skip


def test_every_run_is_held_against_its_estimate(data):
    compared = compare(data)
    n = compared.table["abrupt"].size
    assert n == 9 * 9 * 5 and 0 < compared.agreement < 1
    late = compared.table["abrupt_estimate"] & ~compared.table["abrupt"]
    assert f"smooth: {int(late.sum())}," in compared.text()
    k = 17
    case = load_case("gelatin").set(**{name: float(v[k]) for name, v in compared.axes.items()})
    assert compared.table["onset_N"][k] == pytest.approx(classical(case).onset_N, rel=1e-5)
    assert compared.table["drop"][k] == pytest.approx(analytic_runs.drop_of(case), rel=1e-5)
    assert np.isfinite(compared.table["steady_estimate_N"]).all()


def test_a_map_on_which_nothing_was_cut_has_nothing_to_compare(data):
    uncut = data.copy(deep=True)
    uncut["label"].values[:] = LABELS.index("uncut")
    assert compare(uncut).text().startswith("No run")
