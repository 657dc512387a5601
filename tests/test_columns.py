"""What candidates would change in a cut: one run with all beside it, and differences at finite strengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.prediction import Task, predict
from cutbench.case.case import load_case
from cutbench.data.campaign import FitPlan
from cutbench.discovery.candidates import candidates
from cutbench.discovery.columns import sense
from cutbench.discovery.synthetic import Test, campaign


def test_columns_of_a_cut_are_what_the_laws_do():
    case = load_case("gelatin", {"numerics": "fast", "depth": "0.4 mm"})
    made = campaign(case, [Test("cut", reach=0.4, readings=8)], case, seed=1, plan=FitPlan(free=("G",)))
    made = replace(made, candidates=("maxwell", "adhesion_speed", "machine_compliance"))
    asked: list[Task] = []

    def run(tasks):
        asked.extend(tasks)
        return [predict(task) for task in tasks]

    inverse, q = Inverse(made, unknowns(made), run, 8, across=True), np.zeros(1)
    chosen = [c for c in candidates(inverse, made.base)[0] if c.name in made.candidates]
    (e,) = made.train
    found = sense(inverse, q, chosen, run)
    # The model's own run, that with more G, one that has both laws beside it, and one for each that is felt.
    assert [len(task.added) for task in asked[:3]] == [0, 0, 2] and len(asked) > 3
    by_name = {c.candidate.name: c for c in found.columns if c.candidate.slot != "rig"}
    assert set(by_name) == {"maxwell", "adhesion_speed"}
    beside = next(task for task in asked if task.added)
    exact = {
        task.case.mechanisms: by for task, by in zip(beside.added, predict(beside).by_added, strict=True)
    }
    for mechanisms, by in exact.items():
        (name,) = set(mechanisms) & set(by_name)
        column = by_name[name].by[e.id]
        assert np.abs(by).max() > 0
        np.testing.assert_allclose(column, by, atol=0.15 * np.abs(by).max())
    # Nothing breaks in so short a cut: the force is in proportion to G.
    np.testing.assert_allclose(found.J[e.id][:, 0], found.y[e.id], rtol=0.1)
