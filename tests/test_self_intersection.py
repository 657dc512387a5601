"""Where the surface beside the blade passes through itself, a run says so, and since when."""

import math
from dataclasses import replace

import analytic_runs
import numpy as np
import pytest
from coarse_runs import BRIEF

from cutbench.case.case import load_case
from cutbench.forms.surface_lines import crossings, overlap
from cutbench.maps.dataset import row_of
from cutbench.maps.study_sections import Regime
from cutbench.run.build import build
from cutbench.run.self_intersection import ADVICE, crossed_area


@pytest.mark.parametrize(
    ("points", "meant"),
    [
        ([(2, 0), (1, 0), (0, 0), (0, -1), (0, -2)], False),  # a corner
        ([(2, 0), (1, 0), (1, -1), (0, -1), (0, -2)], False),  # one that is turned in
        ([(2, 0), (0, 0), (0, -1), (1, 1), (1, 2)], True),  # a loop through the first segment
        ([(2, 0), (0, 0), (0, -1), (1, -0.1), (0, -2)], False),  # that does not reach it
        ([(0, 0), (0, -1), (0, -2), (0, -3)], False),  # what is closed yet
    ],
)
@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_lines_that_cross_themselves(points, meant, turn):
    c, s = np.cos(turn), np.sin(turn)
    assert bool(crossings(np.array([[c, -s], [s, c]]) @ np.array(points, float).T).size) is meant


@pytest.mark.parametrize(
    ("points", "area"),
    [
        ([(0, 0), (2, 0), (2, 2), (0, 2)], 0.0),
        ([(0, 0), (0, 2), (2, 2), (2, 0)], 4.0),  # inside out
        ([(0, 0), (2, 2), (2, 0), (0, 2)], 1.0),  # half of it
        # A tongue of the top that comes down beside itself, and one that goes through what is there.
        ([(0, 0), (9, 0), (9, 2), (5, 2), (5, 5), (2, 5), (2, 3), (3, 3), (3, 4), (4, 4), (4, 2), (0, 2)], 0),
        ([(0, 0), (9, 0), (9, 2), (5, 2), (5, 5), (2, 5), (2, 1), (3, 1), (3, 4), (4, 4), (4, 2), (0, 2)], 1),
    ],
)
@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_the_area_that_is_there_twice(points, area, turn):
    c, s = np.cos(turn), np.sin(turn)
    assert overlap(np.array([[c, -s], [s, c]]) @ np.array(points, float).T) == pytest.approx(area, abs=1e-9)


@pytest.mark.parametrize("symmetry", ["half", "full"])
@pytest.mark.parametrize("side", [1, -1])
def test_a_section_is_looked_at_where_the_top_meets_the_cut(symmetry, side):
    if symmetry == "half" and side < 0:
        return
    built = build(BRIEF.set(symmetry=symmetry))
    X, u = built.space.X, np.zeros(built.problem.ndof)
    assert crossed_area(built, u) == 0
    faces = built.form("blade").faces
    cut = np.unique(faces.nodes[:, faces.parts["cut" if side > 0 else "cut_minus"]])
    cut = cut[np.argsort(-X[1, cut])]
    u[2 * cut[1] : 2 * cut[1] + 2] = 0.3 * side, 0.3  # above the top
    tall, deep = 0.3 + X[1, cut[1]] - X[1, cut[0]], X[1, cut[0]] - X[1, cut[2]]
    assert crossed_area(built, u) == pytest.approx(0.5 * tall * 0.3 * deep / (tall + deep))


def test_a_run_of_which_nothing_crosses_says_nothing(quick):
    assert ADVICE not in str(quick.outcome)
    assert math.isnan(quick.measures["crossed_mm"]) and quick.measures["crossed_mm2"] == 0


def test_a_map_keeps_it():
    crossed = {"crossed_mm": 2.5, "crossed_mm2": 0.1}
    result = analytic_runs.computed(load_case("gelatin"))
    row = row_of(replace(result, measures=result.measures | crossed), Regime(0.1, None, 0.1))
    assert crossed.items() <= row.measures.items()


def test_solids_are_not_looked_at():
    solid = load_case("gelatin", {"h": "2 mm", "element": "P1"}, dim=3)
    built = build(solid)
    assert crossed_area(built, np.random.default_rng(1).normal(size=built.problem.ndof)) == 0
