"""Cuts of the default model by a formula, in place of runs: a whole search takes up to three minutes.

A force that rises with the travel until the cut begins, at a depth that grows with the toughness over the
modulus and with the speed; a drop that the viscosity takes away; adhesion that grows with the faces. Where
the cut begins and the force jag from place to place, as runs do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from cutbench.calibration.cut_runs import COURSE, ComputedCut
from cutbench.case.case import Case
from cutbench.case.model import Model
from cutbench.run.result import Outcome, Result
from cutbench.run.store.runs import Store

#: Parts of a run's beginning and of its force that jag.
JAGS, WAVES = 0.004, 0.003


def course(case: Case, values: Mapping[str, float] | None = None) -> tuple[np.ndarray, float]:
    """Travel, force and time (3, n), and where the cut begins, nan where it does not. With laws of the rate
    as another value, in their own words."""
    v = dict(case.values if values is None else values)
    for law in Model(case.mechanisms).all:
        if law.resembles:
            v |= law.like(SimpleNamespace(**v))
    G, G_c, tau_W, t, length = (v[name] for name in ("G", "G_c", "tau_W", "thickness", "length"))
    rate, blunt = v["eta_reg"] * v["speed"] / v["delta_c"], 1.05 / v["tip"]
    x = np.linspace(0, v["depth"], int(v["depth"] / 0.03) + 2)
    begins = 2 * t * math.sqrt(G_c / (G * t)) * (1 + 0.35 * rate / (1 + 0.4 * rate))
    begins *= blunt**0.25 * (1 + 0.2 * tau_W / G)
    begins *= 1 + JAGS * math.sin(400 * math.log(1.7 * G + G_c) + 900 * tau_W / G + 50 * rate)
    rising = 0.18 * G * length * t * (x / t) ** 1.25 * blunt**0.35 * (1 + 0.6 * tau_W / G * x / t)
    top, cut = float(np.interp(begins, x, rising)), np.maximum(x - begins, 0.0)
    after = 0.75 * top * (1 - 0.25 / (1 + 2 * rate)) + (0.6 * tau_W + 0.01 * G_c / t) * length * cut
    after += (top - after) * np.exp(-cut / (0.15 * t * (1 + rate)))
    force = np.where(x <= begins, rising, np.minimum(rising, after))
    force *= 1 + WAVES * np.sin(2 * np.pi * x / 0.2 + 1e3 * G)
    return np.stack([x, force, x / v["speed"]]), begins if begins < v["depth"] else math.nan


class Counted:
    """Stands in for ``cutbench.calibration.cut_runs.compute_cut``, and leaves runs in the store as that does;
    ``count``: how many were asked for."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(
        self, case: Case, names: Sequence[str], added, folder: Path | None = None, effort=0.0
    ) -> ComputedCut:
        self.count += 1
        made, begins = course(case)
        by_added = [{name: _slope(a.case, name) for name in a.names} for a in added]
        outcome = Outcome("done", "", reached_mm=case.values["depth"])
        if folder is not None:
            curve = dict(zip(COURSE, made, strict=True))
            Store(folder).put(Result(case, curve, outcome, measures={"onset_mm": begins}))
        return ComputedCut(made, outcome, begins, {name: _slope(case, name) for name in names}, by_added)


def _slope(case: Case, name: str) -> np.ndarray:
    """Of the force (n,) by a parameter."""
    q = case.model.parameters()[name]
    value = case.values.get(name, q.off_value if q.off is not None else 0.0)
    step = 1e-3 * (abs(value) or abs(q.typical * q.factor) or 1.0)
    (before, _), (after, _) = (course(case, {**case.values, name: value + d}) for d in (0.0, step))
    return (after[1] - before[1]) / step


def run_case(case: Case) -> SimpleNamespace:
    """Stands in for ``cutbench.run.run_case`` where a truth is computed: not quite the same formula."""
    (x, force, _), _ = course(case)
    curve = {"displacement_mm": 1.01 * x, "force_N": force * (1 + 0.01 * x)}
    return SimpleNamespace(curve=curve, outcome=SimpleNamespace(done=True))
