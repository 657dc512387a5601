"""Which further experiment would tell two explanations apart: both models at tests that nobody has done yet.

Each proposal changes one thing about a test of the campaign: speed, hold, unloading, reach, kind; of a cut
width, tip, lubricant. What the two fitted models say of it differs by d; with scatter and noise as in the
tests there are, |L⁻¹ d| standard errors would be seen. Cuts take a run of each model for each proposal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration.parameters import duration
from cutbench.calibration.posterior import Estimated
from cutbench.data.covariance import smooth_deviation
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.homogeneous import LoadingHistory, predict, respond

Reading = Callable[[Estimated], np.ndarray]


@dataclass(frozen=True)
class Proposal:
    """``text`` names the test; ``standard_errors`` lie between the two predictions; ``part``: their largest
    difference over the largest value."""

    text: str
    standard_errors: float
    part: float

    @property
    def tells(self) -> bool:
        """Whether it is worth the trouble of a further test."""
        return self.standard_errors >= 4.0


def next_tests(first: Estimated, second: Estimated) -> list[Proposal]:
    """Tests that would tell two fitted models apart, the one that tells most first."""
    found, tests = [], first.posterior.tests
    # One test of each kind that has a formula, and one cut.
    for e in (*{e.kind: e for e in tests if e.kind != "cut"}.values(), *first.posterior.cuts[:1]):
        known = 0.0
        for text, reading in _trials(first, e):
            try:
                a, b = reading(first), reading(second)
            except (ComputationFailed, BadInput):
                continue
            made = _proposal(first, e, text, a, b)
            if not text:
                known = made.standard_errors
            elif made.standard_errors > 1.3 * known:  # much more than the same test as it was
                found.append(made)
    return sorted(found, key=lambda p: -p.standard_errors)


def _trials(fitted: Estimated, e: Experiment) -> Iterator[tuple[str, Reading]]:
    """The text of each proposal, with what a model reads of it. Without text: the way there and nothing else,
    beside which those that follow are seen."""
    if e.kind == "cut":
        case = fitted.posterior.predictions.case(e, fitted.posterior.values(e, fitted.q))
        changes: dict[str, dict[str, float]] = {}
        for q in case.model.parameters().values():
            if q.trial and case.values[q.name]:
                changes.setdefault(q.trial[0], {})[q.name] = q.trial[1]
        for text, factors in changes.items():
            yield f"'{e.id}' {text}", partial(_of_cut, e=e, factors=factors)
        return
    if e.kind in HOMOGENEOUS and e.mounted:
        # Machines, grips and plates act otherwise on it.
        half = replace(e, specimen={**e.specimen, "length": e.specimen["length"] / 2})
        yield f"'{e.id}' on a specimen half as long", partial(_of_specimen, e=half)
    for text, kind, history in _histories(e):
        yield text, partial(_of_history, e=e, kind=kind, history=history)


def _of_history(fitted: Estimated, e: Experiment, kind: str, history: LoadingHistory) -> np.ndarray:
    """What a test of a ``kind`` would read (m,) along a history. Raises ComputationFailed, BadInput."""
    case = replace(fitted.case, values={**fitted.case.values, **fitted.case.model.turned(e.angle)})
    return respond(kind, history, case.model, case.p, direction=e.direction)


def _of_specimen(fitted: Estimated, e: Experiment) -> np.ndarray:
    """The same of another specimen, on the grid of the test. Raises ComputationFailed, BadInput."""
    return predict(e, fitted.case.model, fitted.case.p, fitted.posterior.predictions.grids[e.id])


def _of_cut(fitted: Estimated, e: Experiment, factors: Mapping[str, float]) -> np.ndarray:
    """The same of a cut like ``e`` with other values of its own. Raises ComputationFailed."""
    p, values = fitted.posterior.predictions, fitted.posterior.values(e, fitted.q)
    there = {n: v * factors.get(n, 1.0) for n, v in p.case(e, values).values.items()}
    p.compute(e, there)
    x, force = p.curve(e, there)
    return p.read(e, values, np.stack([x, force, x / there["speed"]]))


def _histories(e: Experiment) -> Iterator[tuple[str, str, LoadingHistory]]:
    """Text, kind and history of each proposal."""
    time = duration(e) or 100.0
    rest, reach = e.rest, e.repetitions[0].x[np.argmax(np.abs(e.repetitions[0].x - e.rest))]
    part = np.arange(1, 41) / 40
    up, longer, t = rest + (reach - rest) * part, rest + 1.25 * (reach - rest) * part, time * part

    def history(x, times, pressure=e.pressure_MPa):
        return LoadingHistory.along(x, times, rest, pressure)

    yield "", e.kind, history(up, t)
    changes: dict[str, tuple] = {
        "ten times as fast": (up, t / 10),
        "ten times as slowly": (up, t * 10),
        "with a hold of ten times its duration at the end": (
            np.append(up, np.full(up.size, reach)),
            np.append(t, time + np.geomspace(0.02, 10, up.size) * time),
        ),
        f"to 1.25 times the {'strain' if e.kind in HOMOGENEOUS else 'distance'}": (longer, 1.25 * t),
    }
    if e.kind == "sliding":
        changes["at five times the pressure"] = (up, t, 5 * e.pressure_MPa)
    else:
        changes["with unloading"] = (np.append(up, up[-2::-1]), np.append(t, time + t[:-1]))
    for text, change in changes.items():
        yield f"'{e.id}' {text}", e.kind, history(*change)
    # What a stretch of each kind is called, and the part of the test's own that is proposed for it.
    for kind, name, size in (
        ("uniaxial", "tension", 1.0), ("pure_shear", "pure shear", 1.0),
        ("equibiaxial", "equibiaxial tension", 0.6),
    ):  # fmt: skip
        if e.kind in HOMOGENEOUS and kind != e.kind:
            x = 1 + size * (up - 1)
            yield f"{name} to a stretch of {x[-1]:.2g}", kind, history(x, t)


def _proposal(fitted: Estimated, e: Experiment, text: str, a: np.ndarray, b: np.ndarray) -> Proposal:
    grid, top, away = fitted.posterior.predictions.grids[e.id], np.abs(a).max(), b - a
    if not grid.independent:
        x = grid.x if e.kind == "cut" else np.arange(a.size, dtype=float)
        noise, count = float(np.median(grid.reading) / np.abs(grid.mean).max()), max(grid.repetitions, 3)
        C = fitted.w.factors[e.kind].variance / count * np.outer(a, a) + smooth_deviation(x, a, 0.01) / count
        C += np.diag(np.full(a.size, (max(noise, 1e-3) * top) ** 2 / count))
        away = solve_triangular(cholesky(C, lower=True), away, lower=True)
    return Proposal(text, float(np.linalg.norm(away)), float(np.abs(b - a).max() / top))


def sentence(names: Sequence[str], found: Sequence[Proposal]) -> str:
    """What to do next, in words."""
    pair = " and ".join(names)
    if not found:
        return f"No further test was found that would tell {pair} apart."
    best = found[0]
    if not best.tells:
        return (
            f"None of the tests tried would tell {pair} apart with three specimens; most would {best.text}:"
            f" the two differ by {best.standard_errors:.1f} standard errors there."
        )
    others = [p.text for p in found[1:3] if p.tells]
    more = f" (next best: {'; '.join(others)})" if others else ""
    return (
        f"{best.text[0].upper()}{best.text[1:]} would tell {pair} apart: they differ by up to"
        f" {100 * best.part:.0f} % of the maximum there, {best.standard_errors:.0f} standard errors with"
        f" three specimens{more}."
    )
