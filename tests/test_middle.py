"""The curve of a block's middle: what a blade without ends would feel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coarse_runs import SOFT

from cutbench.case.case import load_case
from cutbench.run.build import build, geometry_of
from cutbench.run.checkpoint import Checkpoint
from cutbench.run.front import MIDDLE, Front, Middle
from cutbench.run.result import Outcome, run_sentence
from cutbench.run.runner import run_case

SMALL = {
    "width": "6 mm", "height": "6 mm", "length": "8 mm", "depth": "0.3 mm", "h": "0.6 mm", "corner": 0.25,
    "layers": 2, "mu": 0.2,
}  # fmt: skip


def curves(case, **geometry):
    """Force of the whole block and of one that is all as its middle, N."""
    built = build(case, replace(geometry_of(case), **geometry))
    middle = Middle(built, Front(built))
    force = [0.0]
    for step in built.march.steps():
        middle.add(step)
        force.append(step.force * built.geometry.multiplicity)
    return np.array(force), middle.columns()["middle_force_N"]


@pytest.mark.parametrize(
    "symmetry", ["quarter", *(pytest.param(s, marks=pytest.mark.slow) for s in ("half", "full"))]
)
def test_where_nothing_varies_along_the_blade_the_middle_is_the_whole(symmetry):
    case = load_case("gelatin", {**SMALL, "symmetry": symmetry, "layers": 1}, dim=3)
    ends = (("middle", 2), ("end", 2)) if symmetry == "quarter" else (("end", 2),)
    force, middle = curves(case, held=ends)
    assert middle == pytest.approx(force, rel=1e-6, abs=1e-9)


def test_of_tetrahedra_it_is_the_innermost_strip():
    case = load_case("gelatin", {**SMALL, "numerics": "tetrahedra", "h": "1.5 mm"}, dim=3)
    force, middle = curves(case, held=(("middle", 2), ("end", 2)))
    # Strips of tetrahedra differ as their elements do.
    assert middle[-1] == pytest.approx(force[-1], rel=0.1)


def test_a_run_has_the_curve_and_the_numbers_of_its_middle(tmp_path):
    case = load_case("gelatin", {**SMALL, "layers": 1}, dim=3)
    result = run_case(case)
    # The free end gives way: the middle carries more than its part.
    assert result.curve["middle_force_N"][-1] > 1.02 * result.force_N[-1]
    assert result.curve["middle_force_N"].shape == result.force_N.shape
    assert result.measures["middle_max_N"] == result.curve["middle_force_N"].max()
    assert MIDDLE.keys() <= result.measures.keys()


def test_what_is_cut_before_is_not_the_run_s():
    values = {"element": "P1", "h": "1.2 mm", "precut": "1 mm", "depth": "1.5 mm", "G_c": "0.5 J/m^2"}
    result = run_case(load_case("gelatin", {**SMALL, **SOFT, **values, "layers": 1}, dim=3))
    found = result.measures
    for column in ("middle_cut_length_mm", "cut_length_mm"):
        assert result.curve[column][0] == pytest.approx(1.0, abs=0.3), column
    assert found["middle_onset_mm"] == pytest.approx(found["front_centre_mm"], abs=1e-6)
    last = max(found["front_centre_mm"], found["front_edge_mm"])
    assert 0.1 < found["front_start_mm"] <= found["front_half_mm"] <= last


@pytest.mark.slow
def test_a_run_that_goes_on_has_all_of_its_middle(tmp_path):
    case = load_case("gelatin", {**SMALL, "layers": 1}, dim=3)
    whole = run_case(case).curve["middle_force_N"]

    def stop(row, picture):
        if row["displacement_mm"] > 0.15:
            raise KeyboardInterrupt

    path = tmp_path / "checkpoint.npz"
    first = run_case(case, on_step=stop, checkpoint=Checkpoint(path, case.id, every_s=0.0))
    assert first.outcome.kind == "interrupted"
    second = run_case(case, checkpoint=Checkpoint(path, case.id, every_s=0.0))
    assert second.curve["middle_force_N"] == pytest.approx(whole, rel=1e-6)


@pytest.mark.slow
def test_what_the_ends_take_away_fades_along_the_blade_as_in_a_bar_held_by_its_base():
    """Shear lag: with E = 2 (1 + ν) G along the blade, and the top free, in proportion to cosh(k z), with
    k = π/(2 H) · √(G/E)."""
    values = {**SMALL, "element": "P1", "h": "1.2 mm", "mu": 0.0}

    def per_length(length, layers, **geometry):
        case = load_case("gelatin", {**values, "length": f"{length} mm", "layers": layers}, dim=3)
        return np.array([force[-1] for force in curves(case, **geometry)]) / length

    section = per_length(8, 1, held=(("middle", 2), ("end", 2)))[0]
    (whole, middle), (longer, inner) = (1 - per_length(*of) / section for of in ((24, 4), (48, 6)))
    case = load_case("gelatin", values, dim=3)
    k = np.pi / (2 * case.p.height) / np.sqrt(2 * (1 + case.p.nu))
    # One mode alone says how the middle's part fades to a sixth, and what is left of the whole's.
    assert np.log(middle / inner) / 12 == pytest.approx(k, rel=0.15)
    assert whole / longer == pytest.approx(2 * np.tanh(12 * k) / np.tanh(24 * k), rel=0.05)
    assert longer < 0.05 and inner < 0.01


def test_a_block_whose_layers_leave_ligaments_is_not_said_to_be_smooth():
    case, ended = load_case("gelatin", {"depth": "6 mm"}, dim=3), Outcome("done", "", "", 6.0)

    def said(drop: float, bridged: float) -> str:
        found = {"drop_rel": drop, "onset_mm": 3.0, "front_bridged": bridged}
        return run_sentence(case, ended, found).split(":")[0]

    assert [said(0.02, 0.0), said(0.02, 0.5), said(0.3, 0.5)] == ["smooth", "undecided", "abrupt"]
