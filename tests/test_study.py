"""Studies: what is read, and the order of points."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from study_texts import BOUNDARY, GOOD, SAMPLED

from cutbench.case.case import load_case
from cutbench.case.model import groups
from cutbench.maps.study import coarse_to_fine, load_study

TRANSITION = Path(__file__).parents[1] / "studies" / "transition.toml"


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_default_study_holds_the_materials_and_both_regimes_have_room():
    study = load_study(TRANSITION)
    assert study.mode == "boundary" and study.shape[2] == 3 and study.base.until == "transition"
    assert study.base.numerics == load_case("gelatin").numerics
    assert study.shape[2] * study.search.runs + len(study.plot.mark) <= 105  # minutes
    assert [mark.name for mark in study.marks()] == ["gelatin", "elastomer", "meat"]
    expected = {
        "gelatin": (10.1, 0.714, 0.0106),
        "elastomer": (1.79, 0.714, 0.187),
        "meat": (11.4, 2.86, 0.0),
    }
    for mark in study.marks():
        for axis, value in zip(study.axes, expected[mark.name], strict=True):
            assert mark.at[axis.name] == pytest.approx(value, rel=0.01, abs=1e-12)
            assert axis.values[0] <= value * 1.005 and value <= axis.values[-1] * 1.005


def test_each_point_has_the_groups_of_its_place():
    study = load_study(TRANSITION)
    for index in [(0, 0, 0), (64, 20, 1), (13, 64, 2)]:
        case = study.case_at([axis.values[i] for axis, i in zip(study.axes, index, strict=True)])
        for axis, i in zip(study.axes, index, strict=True):
            assert groups()[axis.name].value(case.p) == pytest.approx(axis.values[i], rel=1e-9, abs=1e-15)


def test_values_units_and_sections_arrive_in_the_cases(write):
    study = load_study(write(GOOD))
    assert study.shape == (3, 2)
    assert study.axes[0].values == (1.0, 10.0, 100.0)
    assert study.axes[1].values == pytest.approx((0.01, 0.02)) and study.axes[1].unit == "mm/s"
    assert {case.p.G for case in study.grid} == {0.01}
    assert {case.sizes.h_mm for case in study.grid} == {0.5}
    assert study.regime.drop == 0.2 and study.regime.surge_min is None
    assert (study.plot.x, study.plot.y, study.plot.panel) == ("cohesion", "speed", "")
    assert study.marks()[0].at["speed"] == pytest.approx(0.021)


def test_a_group_of_a_section_holds_along_the_axes(write):
    text = (
        'base = "gelatin"\n[parameters]\ncohesion = 5.0\n[[axis]]\nname = "G"\nvalues = ["5 kPa", "50 kPa"]\n'
    )
    cases = load_study(write(text)).grid
    assert [case.groups()["(G_c/delta_c)/G"] for case in cases] == pytest.approx([5.0, 5.0])
    assert cases[1].p.G_c == pytest.approx(10 * cases[0].p.G_c)


def test_a_case_file_beside_the_study_is_a_base(write, tmp_path):
    (tmp_path / "mine.toml").write_text('base = "meat"\n[parameters]\nG = "33 kPa"\n')
    study = load_study(
        write(GOOD.replace('base = "gelatin"', 'base = "mine.toml"').replace("G = ", "nu = 0.48 #"))
    )
    assert pytest.approx(0.033) == study.base.p.G


@pytest.mark.parametrize("shape", [(8, 5, 3), (7,), (1, 4), (2, 2)])
def test_the_order_takes_each_point_once_and_every_time_alike(shape):
    order = coarse_to_fine(shape)
    assert sorted(order) == list(range(math.prod(shape)))
    assert order == coarse_to_fine(shape)


def test_any_beginning_of_the_order_is_spread_over_the_map():
    shape = (8, 5, 3)
    index = np.stack(np.unravel_index(coarse_to_fine(shape), shape), axis=1) / (np.array(shape) - 1)
    everything = np.stack(np.unravel_index(np.arange(120), shape), axis=1) / (np.array(shape) - 1)

    def farthest_gap(points):
        return np.sqrt(((everything[:, None] - points[None]) ** 2).sum(-1)).min(axis=1).max()

    assert farthest_gap(index[:12]) < 0.7 < farthest_gap(everything[:12])
    assert farthest_gap(index[:40]) < 0.4 < farthest_gap(everything[:40])


def test_a_sobol_sequence_has_one_point_in_each_slice_and_all_levels_equally_often(write):
    study = load_study(write(SAMPLED))
    assert study.shape == (16,) and len(study.grid) == len(study.samples) == 16
    cohesion, speed, adhesion = np.array(study.samples).T
    assert sorted((np.log10(cohesion) / 2 * 16).astype(int)) == list(range(16))
    assert sorted(speed) == [0.01] * 8 + [0.02] * 8 and sorted(adhesion) == [0.0] * 8 + [1.0] * 8
    for (index, case), values in zip(study.points(), study.samples, strict=True):
        assert groups()["cohesion"].value(case.p) == pytest.approx(values[0], rel=1e-9)
        assert case.p.speed == pytest.approx(values[1]) and ("adhesion" in case.mechanisms) == bool(values[2])
        assert study.case_at(values).id == case.id and len(index) == 1
    again, other = load_study(write(SAMPLED)), load_study(write(SAMPLED.replace("seed = 3", "seed = 4")))
    assert again.samples == study.samples != other.samples
    # A design grows: what was computed stays of use.
    assert load_study(write(SAMPLED.replace("points = 16", "points = 21"))).samples[:16] == study.samples


def test_any_mechanism_can_be_switched_and_what_is_said_of_it_goes_with_it(write):
    study = load_study(
        write(
            'base = "gelatin"\n[parameters]\ntau_W = "2 kPa"\nmu = 0.3\n'
            '[[axis]]\nmechanism = "adhesion"\n[[axis]]\nmechanism = "viscous"\nvalues = [true, false]\n'
            '[[axis]]\nname = "G"\nvalues = ["5 kPa"]\n'
        )
    )
    assert study.shape == (2, 2, 1) and [axis.name for axis in study.axes[:2]] == [
        "with_adhesion",
        "with_viscous",
    ]
    off, on = study.grid[0], study.grid[2]
    assert "adhesion" not in off.mechanisms and "tau_W" not in off.values
    assert on.values["tau_W"] == 0.002 and off.values["mu"] == 0.3
    assert "viscous" not in off.mechanisms and "viscous_degraded" in off.mechanisms
    with_viscous = study.grid[1]
    assert "viscous" in with_viscous.mechanisms and "viscous_degraded" not in with_viscous.mechanisms


def test_a_search_has_a_lattice_of_half_its_tolerances_and_levels(write):
    study = load_study(write(BOUNDARY))
    assert study.shape == (33, 17, 2) and not study.grid and not list(study.points())
    assert (study.search.start, study.search.batch, study.search.runs) == (5, 8, 60)
    assert study.axes[0].values[16] == pytest.approx(4.0) and study.axes[1].values[8] == pytest.approx(0.055)
    case = study.case_at([4.0, 0.055, 0.1])
    assert groups()["cohesion"].value(case.p) == pytest.approx(4.0) and case.p.speed == 0.055
    rest = load_study(write(BOUNDARY.split("[boundary]")[0]))
    assert rest.search.runs == max(16 * 8 // 8, 25 + 4 * 8)
