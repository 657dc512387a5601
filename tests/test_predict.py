"""What happened some elements higher, as a guess at the next step."""

from __future__ import annotations

import numpy as np
import pytest
from coarse_runs import SOFT
from refusals import refused

from cutbench.case.case import load_case
from cutbench.run.build import build

COARSE = load_case(
    "gelatin",
    {
        "h": "0.6 mm",
        "corner": 0.5,
        "shallow": 1.0,
        "step": "0.1 mm",
        "slender": 1,
        "depth": "10 mm",
        "energy_step": 1,
        "normal": "material",
        "with_": "viscous",
        **SOFT,
    },
)


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
@pytest.mark.parametrize("symmetry", ["half", "full"])
def test_displacements_go_down_by_an_element(element, symmetry):
    built = build(COARSE.set(element=element, symmetry=symmetry))
    past, X = built.march.past, built.space.X
    field = np.zeros(built.problem.ndof)
    field[: built.space.ndof] = np.column_stack([np.where(X[0] < 0, -1.0, 1.0) + X[0], X[1]]).ravel()
    # Between two lengths of the cut the field grows by itself, then one step more.
    damage = np.zeros(built.form("cohesion").faces.w.size)
    for travel, cut in ((0.0, 0.0), (1.0, 2.0), (2.0, 3.0)):
        past.add(travel, travel * field, np.full_like(damage, cut * past.fall / COARSE.p.height))
    guess = next(past.guesses(0.5, 2 * field))
    moved = (guess - 2 * field)[: built.space.ndof].reshape(-1, 2) / 0.5
    inside = X[1] + past.fall < COARSE.p.height
    off = (X[0] != 0) | (symmetry == "half")
    x = X[0] + np.where(X[0] < 0, -1.0, 1.0)
    np.testing.assert_allclose(moved[inside & off, 0], x[inside & off], atol=1e-4)
    np.testing.assert_allclose(moved[inside, 1], X[1, inside] + past.fall, atol=1e-4)
    assert not (guess - 2 * field)[built.space.ndof :].any()


def test_nothing_is_foreseen_before_the_cut_is_an_element_long():
    built = build(COARSE)
    past, n = built.march.past, built.form("cohesion").faces.w.size
    assert not list(past.guesses(0.1, np.zeros(built.problem.ndof)))
    for travel in (1.0, 2.0):
        past.add(travel, np.zeros(built.problem.ndof), np.zeros(n))
    assert not list(past.guesses(0.1, np.zeros(built.problem.ndof)))
    # Nor with a cut as long that was there from the start.
    past.add(3.0, np.zeros(built.problem.ndof), np.ones(n))
    assert not list(past.guesses(1.0, np.zeros(built.problem.ndof)))


def test_a_long_step_is_foreseen_from_further_up():
    """The cut grows by an element a millimetre: only two elements up there is room for 1.5 mm."""
    built = build(COARSE)
    past, y = built.march.past, built.space.X[1]
    field = np.column_stack([0 * y, y]).ravel()
    damage = np.ones(built.form("cohesion").faces.w.size) * past.fall / COARSE.p.height
    for travel in range(6):
        past.add(float(travel), travel * field, travel * damage)
    assert [len(list(past.guesses(size, field))) for size in (0.5, 1.5, 2.5, 3.5)] == [3, 2, 1, 0]
    first = next(past.guesses(1.5, 5 * field)) - 5 * field
    # Not below large elements that reach to the top, above which nothing is known.
    inside = y < COARSE.p.height / 2
    np.testing.assert_allclose(first[1::2][inside], 1.5 * (y + 2 * past.fall)[inside], rtol=1e-5)
    # Where the blade has rested, what it came to counts; and the way back is another one.
    past.add(5.0, 7 * field, 5 * damage)
    assert past.travel == [2.0, 3.0, 4.0, 5.0]
    np.testing.assert_array_equal(past.at(5.0), 7 * field)
    past.add(4.5, field, 5 * damage)
    assert past.travel == [4.5]


def test_another_word_is_refused():
    with refused("predictor", value="spline"):
        COARSE.set(predictor="spline")
