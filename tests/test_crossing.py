"""Where the surface beside the blade passes through itself, a run says so."""

import numpy as np
import pytest
from coarse_runs import BRIEF

from cutbench.case.case import load_case
from cutbench.run.build import build
from cutbench.run.crossing import crosses, crosses_itself
from cutbench.run.runner import CROSSED, run_case


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
    assert crosses_itself(np.array([[c, -s], [s, c]]) @ np.array(points, float).T) is meant


@pytest.mark.parametrize("symmetry", ["half", "full"])
def test_a_section_is_looked_at_where_the_top_meets_the_cut(symmetry):
    built = build(BRIEF.set(symmetry=symmetry))
    X, u = built.space.X, np.zeros(built.problem.ndof)
    assert not crosses(built, u)
    faces = built.form("blade").faces
    cut = np.unique(faces.nodes[:, faces.parts["cut"]])
    second = cut[np.argsort(-X[1, cut])[1]]
    u[2 * second : 2 * second + 2] = 0.3, 0.3  # above the top
    assert crosses(built, u)


def test_a_run_says_so(quick, monkeypatch):
    assert CROSSED not in str(quick.outcome)
    monkeypatch.setattr("cutbench.run.runner.crosses", lambda built, u: True)
    outcome = run_case(BRIEF.set(depth="0.1 mm", element="P1")).outcome
    assert outcome.done and CROSSED in str(outcome)


def test_solids_are_not_looked_at():
    solid = load_case("gelatin", {"h": "2 mm", "element": "P1"}, dim=3)
    built = build(solid)
    assert not crosses(built, np.random.default_rng(1).normal(size=built.problem.ndof))
