"""Where fits of cuts begin: the work finds a drop that the force does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cutbench.base.errors import ComputationFailed
from cutbench.calibration import by_work, lm
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.prediction import Prediction, Task
from cutbench.data.campaign import load_campaign

TRUE = {"G": 0.008, "G_c": 0.005}
X = np.linspace(0.05, 5, 100)
SPEEDS = {"slow": 0.005, "fast": 0.1}


def force(x: np.ndarray, G: float, G_c: float, speed: float) -> np.ndarray:
    """A blade that indents with a force ∝ G x^1.5, and at a depth ∝ (G_c/G)^½ falls to one ∝ G_c."""
    begins = 3.0 * np.sqrt((G_c / 0.005) / (G / 0.008)) * (speed / 0.02) ** 0.05
    before, after = 0.3 * G / 0.008 * x**1.5, 0.5 * G_c / 0.005 * np.ones_like(x)
    return np.where(x < begins, before, np.minimum(after, before))


class Formula:
    """Predicts by ``force``; exact derivatives, which know nothing of the drop's place. ``fails`` after so
    many places, with what it raises."""

    def __init__(self, fails: int = 10**6, error: type[BaseException] = KeyboardInterrupt):
        self.places, self.fails, self.error = 0, fails, error

    def __call__(self, tasks: list[Task]) -> list[Prediction]:
        self.places += 1
        if self.places > self.fails:
            raise self.error("no more")
        return [self._one(task) for task in tasks]

    @staticmethod
    def _one(task: Task) -> Prediction:
        values, x = task.case.values, task.grid.x
        given = {name: values[name] + 0j for name in TRUE} | {"speed": values["speed"]}
        y = force(x, **{name: np.real(value) for name, value in given.items()})
        columns = []
        for name in task.names:
            step = 1e-30
            moved = force(x, **{**given, name: given[name] + 1j * step})
            columns.append(moved.imag / step)
        return Prediction(y, np.array(columns).T.reshape(x.size, len(task.names)), task.names)


@pytest.fixture
def cuts(tmp_path):
    """A campaign whose start is 40 and 50 % away, so that drops are a millimetre from the measured ones."""
    text = ['material = "gelatin"', "[parameters]", 'G = "11.2 kPa"', 'G_c = "2.5 J/m^2"', "[fit]"]
    text += ['free = ["G", "G_c"]']
    for id, speed in SPEEDS.items():
        y = force(X, **TRUE, speed=speed)
        rows = [f"{x:.6g},{f:.6g}" for x, f in zip(X, y, strict=True)]
        (tmp_path / f"{id}.csv").write_text("\n".join(["u [mm],F [N]", *rows]) + "\n")
        text += [
            "[[experiment]]", f'id = "{id}"', 'kind = "cut"', f'data = "{id}.csv"', 'role = "train"',
            f'speed = "{speed} mm/s"', 'columns = { displacement = "u", force = "F" }',
            'blade = { thickness = "0.7 mm", tip = "1.05 mm" }',
            'specimen = { width = "20 mm", length = "30 mm", height = "14 mm" }',
        ]  # fmt: skip
    (tmp_path / "campaign.toml").write_text("\n".join(text) + "\n")
    return load_campaign(tmp_path / "campaign.toml")


def inverse_of(campaign, run: Formula, across: bool = True) -> Inverse:
    return Inverse(campaign, unknowns(campaign), run, across=across)


def farthest(inverse: Inverse, q: np.ndarray) -> float:
    """Of the values at ``q`` from the true ones, as a logarithm."""
    found = zip(inverse.unknowns, inverse.values(q), strict=True)
    return max(abs(np.log(value / TRUE[u.label])) for u, value in found)


def test_the_work_leads_to_drops_that_forces_do_not_find(cuts):
    inverse = inverse_of(cuts, Formula())
    found = by_work.nearby(inverse, np.zeros(2))
    assert farthest(inverse, np.zeros(2)) > 0.3
    assert farthest(inverse, found.q) < 0.04
    plain = inverse_of(cuts, Formula(), across=False)
    w = plain.guessed(np.zeros(2))
    by_force = lm.minimise(lambda q: plain.whitened(q, w), np.zeros(2), *plain.bounds)
    assert farthest(plain, by_force.q) > 0.1


def test_derivatives_of_the_difference_are_those_of_the_works(cuts):
    inverse, q = inverse_of(cuts, Formula()), np.zeros(2)
    r, J = by_work.difference(inverse, q)
    assert r.shape == (80,) and J.shape == (80, 2)
    # Beyond both drops the work changes in proportion to the parameters, over the step that was taken.
    for k, step in ((0, 0.1), (1, 0.1)):
        there = q.copy()
        there[k] = step
        change = by_work.difference(inverse, there)[0] - r
        assert np.linalg.norm(change - J[:, k] * step) < 0.35 * np.linalg.norm(change)


def test_an_interruption_leaves_the_best_place_so_far(cuts):
    inverse = inverse_of(cuts, Formula(fails=3))
    found = by_work.nearby(inverse, np.zeros(2))
    assert found.interrupted
    assert farthest(inverse, found.q) <= farthest(inverse, np.zeros(2))
    found.inverse.predictions(found.q)  # is known


def test_one_at_once_computes_nothing_more(cuts):
    run = Formula()
    inverse = inverse_of(cuts, run, across=False)
    inverse.predictions(np.zeros(2))
    run.fails = run.places
    found = by_work.nearby(inverse, np.zeros(2))
    assert found.interrupted
    assert not found.q.any()
    found.inverse.predictions(found.q)


def test_a_start_that_cannot_be_computed_is_said(cuts):
    with pytest.raises(ComputationFailed):
        by_work.nearby(inverse_of(cuts, Formula(0, ComputationFailed)), np.zeros(2))


def test_negative_forces_count_too(cuts):
    """Of a blade that is drawn out."""
    inverse = inverse_of(cuts, Formula())
    for id, grid in inverse.grids.items():
        inverse.grids[id] = replace(grid, mean=grid.mean - 1.0)
    r, J = by_work.difference(inverse, np.zeros(2))
    assert np.isfinite(r).all() and np.isfinite(J).all()
