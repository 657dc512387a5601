"""Which further experiment would tell two explanations apart: both models at tests that nobody has done yet.

Each proposal changes one thing about a test of the campaign: speed, hold, unloading, reach, kind; of a cut
width, tip, lubricant. What the two fitted models say of it differs by d; with scatter and noise as in the
tests there are, |L⁻¹ d| standard errors would be seen. Cuts are taken to first order, from the derivatives
of one run for each proposal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration.homogeneous import LoadingHistory, respond
from cutbench.calibration.prediction import Predictor, Task
from cutbench.case.case import Case
from cutbench.data.covariance import deviating
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.discovery.candidates import duration
from cutbench.discovery.point import Point
from cutbench.discovery.score import Score
from cutbench.run.sensitivity import extended

READINGS = 40
#: From so many standard errors on a further test is worth its trouble.
ENOUGH = 4.0
#: A proposal must tell this much more than the same test as it was.
MORE = 1.3


@dataclass(frozen=True)
class Proposal:
    """``text`` names the test; ``apart``: standard errors between the two predictions; ``part``: their
    largest difference over the largest value."""

    text: str
    apart: float
    part: float


def proposals(point: Point, first: Point, second: Point) -> list[Proposal]:
    """For two models fitted to the same tests without a mesh; the one that tells most comes first."""
    found = []
    for e in _templates(point):
        known = 0.0
        for text, kind, history in _histories(e):
            try:
                a, b = (
                    respond(
                        kind, history, p.case.model, SimpleNamespace(**p.case.values), direction=e.direction
                    )
                    for p in (first, second)
                )
            except (ComputationFailed, BadInput):
                continue
            made = _judged(point, e, text, a, b, np.arange(a.size, dtype=float))
            if text is None:
                known = made.apart
            elif made.apart > MORE * known:
                found.append(made)
    return sorted(found, key=lambda p: -p.apart)


def _templates(point: Point) -> list[Experiment]:
    """One experiment of each kind without a mesh."""
    return list({e.kind: e for e in point.campaign.train if e.kind != "cut"}.values())


def _histories(e: Experiment):
    """Text, kind and history of each proposal; first, without text, the way there and nothing else."""
    time = duration(e) or 100.0
    rest, reach = e.rest, e.repetitions[0].x[np.argmax(np.abs(e.repetitions[0].x - e.rest))]
    up = rest + (reach - rest) * np.arange(1, READINGS + 1) / READINGS
    t = time * np.arange(1, READINGS + 1) / READINGS

    def history(x, times, pressure=e.pressure_MPa):
        return LoadingHistory.along(np.asarray(x), np.asarray(times), rest, pressure)

    yield None, e.kind, history(up, t)
    far = rest + 1.25 * (reach - rest)
    longer = rest + (far - rest) * np.arange(1, READINGS + 1) / READINGS
    yield f"'{e.id}' ten times as fast", e.kind, history(up, t / 10)
    yield f"'{e.id}' ten times as slowly", e.kind, history(up, t * 10)
    hold = np.append(up, np.full(READINGS, reach))
    yield f"'{e.id}' with a hold of ten times its duration at the end", e.kind, history(
        hold, np.append(t, time + np.geomspace(0.02, 10, READINGS) * time))  # fmt: skip
    yield f"'{e.id}' to 1.25 times the {'strain' if e.kind in HOMOGENEOUS else 'distance'}", e.kind, history(
        longer, 1.25 * t)  # fmt: skip
    if e.kind != "sliding":
        back = np.append(up, up[-2::-1])
        yield f"'{e.id}' with unloading", e.kind, history(back, np.append(t, time + t[:-1]))
    if e.kind == "sliding":
        yield f"'{e.id}' at five times the pressure", e.kind, history(up, t, 5 * e.pressure_MPa)
    if e.kind in HOMOGENEOUS:
        for kind, name in (
            ("uniaxial", "tension"),
            ("pure_shear", "pure shear"),
            ("equibiaxial", "equibiaxial tension"),
        ):
            if kind != e.kind:
                part = 0.6 if kind == "equibiaxial" else 1.0
                x = 1 + part * (up - 1)
                yield f"{name} to a stretch of {x[-1]:.2g}", kind, history(x, t)


def _judged(point: Point, e: Experiment, text: str, a: np.ndarray, b: np.ndarray, x: np.ndarray) -> Proposal:
    grid = point.inverse.grids[e.id]
    noise = float(np.median(grid.reading) / np.abs(grid.mean).max())
    pooled = point.w.factors[e.kind]
    count = max(grid.repetitions, 3)
    top = np.abs(a).max()
    C = pooled.variance / count * np.outer(a, a) + deviating(x, a, 0.01) / count
    C += np.diag(np.full(a.size, (max(noise, 1e-3) * top) ** 2 / count))
    away = solve_triangular(cholesky(C, lower=True), b - a, lower=True)
    return Proposal(text, float(np.linalg.norm(away)), float(np.abs(b - a).max() / top))


def cut_proposals(point: Point, one: Score, other: Score, run: Predictor) -> list[Proposal]:
    """The same for cuts, by the steps that the score test proposes for two candidates."""
    e = next(e for e in point.campaign.train if e.kind == "cut")
    case = point.inverse.case(e, point.q)
    made: dict[str, dict[str, float]] = {}
    for q in case.model.parameters().values():
        if q.trial and case.values[q.name]:
            text, factor = q.trial
            made.setdefault(f"'{e.id}' {text}", {})[q.name] = factor * case.values[q.name]
    free = tuple(dict.fromkeys(u.name for u in point.inverse.unknowns if u.experiment in (None, e.id)))
    found = []
    for text, changes in made.items():
        try:
            there = replace(case, values={**case.values, **changes})
            answers = run([_task(point, s, there, e, free) for s in (one, other)])
        except (BadInput, ComputationFailed):
            continue
        a, b = (_step(point, s, p, e) for s, p in zip((one, other), answers, strict=True))
        found.append(_judged(point, e, text, a, b, point.inverse.grids[e.id].x))
    return sorted(found, key=lambda p: -p.apart)


def _task(point: Point, s: Score, case: Case, e: Experiment, free: tuple[str, ...]) -> Task:
    """A run with a candidate at off, differentiated by the free parameters and its strengths."""
    c = s.column.candidate
    there = extended(case, [c.name], s.column.shapes)
    return Task(e, there, point.inverse.grids[e.id], (*free, *(q.name for q in c.strengths)))


def _step(point: Point, s: Score, p, e: Experiment) -> np.ndarray:
    """Prediction (m,) after the score's step."""
    y = p.y + point.inverse.slopes(e, p, point.q) @ s.free
    for q, value in zip(s.column.candidate.strengths, s.strengths, strict=True):
        y = y + p.slopes[:, p.names.index(q.name)] * value
    return y


def sentence(names: Sequence[str], found: Sequence[Proposal]) -> str:
    """What to do next, in words."""
    pair = " and ".join(names)
    if not found:
        return f"No further test was found that would tell {pair} apart."
    best = found[0]
    if best.apart < ENOUGH:
        return (
            f"None of the tests tried would tell {pair} apart with three specimens; most would {best.text}:"
            f" the two differ by {best.apart:.1f} standard errors there."
        )
    others = [p.text for p in found[1:3] if p.apart > ENOUGH]
    more = f" (next best: {'; '.join(others)})" if others else ""
    return (
        f"{best.text[0].upper()}{best.text[1:]} would tell {pair} apart: they differ by up to"
        f" {100 * best.part:.0f} % of the maximum there, {best.apart:.0f} standard errors with three"
        f" specimens{more}."
    )
