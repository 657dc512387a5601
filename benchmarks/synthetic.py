"""Campaigns without a laboratory: computed curves, with specimens that differ and readings that err.

For finding out what a fit or a discovery is worth: the truth is known. Never to be shown as measured.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign, FitPlan
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.data.repetition import Repetition
from cutbench.homogeneous import LoadingHistory, respond
from cutbench.run.runner import run_case


@dataclass(frozen=True)
class Noise:
    """``scatter``: standard deviation of the factor by which the specimens of a test differ. ``reading``:
    of each reading, relative to the curve's maximum."""

    repetitions: int = 3
    scatter: float = 0.03
    reading: float = 0.01


@dataclass(frozen=True)
class Test:
    """One test to be made up. ``speed`` in mm/s (cut) or 1/s of stretch; ``reach``: mm, or the stretch;
    ``sizes`` (mm) change those of the case: ``width``, ``thickness``, …"""

    id: str
    kind: str = "cut"
    speed: float = 0.021
    reach: float = 6.0
    readings: int = 150
    role: str = "train"
    sizes: Mapping[str, float] | None = None

    #: pytest takes a class of this name for tests.
    __test__ = False


def clean(truth: Case, test: Test) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Abscissa, ordinate and time (n,) of a test without noise. Raises ComputationFailed."""
    if test.kind == "cut":
        values = {**truth.values, **(test.sizes or {}), "depth": test.reach, "speed": test.speed}
        result = run_case(case := replace(truth, values=values, motion=(), until="depth"))
        if not result.outcome.done:
            raise ComputationFailed(f"'{test.id}': {result.outcome}", result)
        course = np.stack([result.curve[name] for name in ("displacement_mm", "force_N", "time_s")])
        d, F, t = case.model.shown(course, case.p)
        # Where the zero was set before the blade touched, the record begins at contact.
        x = np.linspace(max(d[0], 0.0), d[-1], test.readings + 1)[1:]
        return x, np.interp(x, d, F), np.interp(x, d, t)
    rest = 1.0 if test.kind in HOMOGENEOUS else 0.0
    x = rest + (test.reach - rest) * np.arange(1, test.readings + 1) / test.readings
    time = np.abs(x - rest) / test.speed
    return x, respond(test.kind, LoadingHistory.along(x, time, rest), truth.model, truth.p), time


def experiment(
    truth: Case, test: Test, curve: tuple[np.ndarray, np.ndarray, np.ndarray], noise: Noise, rng
) -> Experiment:
    """What a laboratory would have recorded of ``curve``, by the random numbers of ``rng``."""
    x, y, time = curve
    size = noise.reading * np.abs(y).max()
    repetitions = []
    for i in range(noise.repetitions):
        read = y * (1 + noise.scatter * rng.standard_normal()) + size * rng.standard_normal(x.size)
        repetitions.append(Repetition(x, read, time, f"specimen {i + 1}"))
    known, cut = {**truth.values, **(test.sizes or {})}, test.kind == "cut"
    specimen = {name: known[name] for name in ("width", "length", "height")} if cut else {}
    blade = {"thickness": known["thickness"]} if cut else {}
    done, notes = tuple(repetitions), ("synthetic: computed, not measured",)
    return Experiment(test.id, test.kind, done, test.role, specimen, blade, test.speed, notes=notes)


def campaign(
    truth: Case,
    tests: Sequence[Test],
    start: Case,
    *,
    noise: Noise | None = None,
    seed: int = 0,
    plan: FitPlan | None = None,
    candidates: Sequence[str] = (),
    curves: Mapping[str, tuple] | None = None,
) -> Campaign:
    """A campaign whose readings ``truth`` made, to be fitted from ``start`` with the numerics of ``start``.

    ``curves``: ``clean`` curves by test id, where they are known already.
    """
    rng = np.random.default_rng(seed)
    made = []
    for test in tests:
        curve = (curves or {}).get(test.id) or clean(truth, test)
        made.append(experiment(truth, test, curve, noise or Noise(), rng))
    return Campaign(
        f"synthetic: {truth.name}", start, tuple(made), tuple(candidates), plan or FitPlan(),
        notes=("Synthetic readings: computed, not measured.",),
    )  # fmt: skip
