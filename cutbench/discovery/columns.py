"""What each candidate would change first, at the fitted point: the derivatives of all readings at "off".

Homogeneous tests are differentiated at all values of the shapes in one pass. A cut is run once: candidates
that do nothing are evaluated beside it, with shapes from the middle of their grid. Those that change the
unknowns (of the support) have a run of their own. What the exact derivative says is felt is asked again at a
finite strength, see ``calibration.secant``. What a rig would make of a run is known for any strength without
another run: where a curve drops, the change by a finite strength is no multiple of the derivative, so some
are tried as well.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration import secant
from cutbench.calibration.homogeneous import scan
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction, Predictor, Task, recorded
from cutbench.case.case import Case
from cutbench.data.experiment import Experiment
from cutbench.discovery.candidates import FIXED, Candidate
from cutbench.run.sensitivity import Added, extended

#: A strength's step, in typical strengths, at the most; what would have to be so many times that is not felt.
MOST, FELT = 1.0, 100.0
#: Finite strengths of a rig: such that its derivative would change the readings by this part (rms).
PARTS = (0.05, 0.1, 0.2, 0.4)


@dataclass(frozen=True)
class Column:
    """Derivatives (m, p) of each train experiment's readings by a candidate's p strengths, by id, at
    ``shapes`` (internal units)."""

    candidate: Candidate
    shapes: Mapping[str, float]
    by: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Sensed:
    """Computed curves (m,) and their derivatives by the free parameters (m, k), by id; all columns."""

    y: dict[str, np.ndarray]
    J: dict[str, np.ndarray]
    columns: list[Column]


def sense(
    inverse: Inverse,
    q: np.ndarray,
    chosen: Sequence[Candidate],
    run: Predictor,
    likely: Callable[[Sensed], Collection[str]] | None = None,
) -> Sensed:
    """At ``q`` of ``inverse``. ``likely``: names of those that cuts are computed with at a finite strength,
    by what exact derivatives say; without it all. Raises ComputationFailed."""
    train = inverse.campaign.train
    cuts = [e for e in train if e.kind == "cut"]
    y, J, parts = {}, {}, {}
    for e in (e for e in train if e.kind != "cut"):
        case, grid, names = inverse.case(e, q), inverse.grids[e.id], inverse.names(e)
        (p,) = run([Task(e, case, grid, names)])
        y[e.id], J[e.id] = p.y, inverse.slopes(e, p, q)
        for c in (c for c in chosen if c.seen_by(e)):
            more, strengths = extended(case, c.added), [s.name for s in c.strengths]
            with suppress(ComputationFailed):  # it is then one that could not be tried
                by = scan(e, more.model, more.p, strengths, c.grid, grid)
                parts.update({(c.name, k, e.id): by[k] for k in range(len(c.grid))})
    plan = _runs(inverse, cuts[0], q, chosen) if cuts else []
    asked = [(run_, _task(inverse, e, q, run_)) for run_ in plan for e in cuts]
    there = inverse.predictions(q) if cuts else {}
    rigs: dict[str, tuple[Candidate, list[tuple[Task, Prediction]]]] = {}
    for (planned, task), p in zip(asked, run([task for _, task in asked]), strict=True):
        e = task.experiment
        if planned is plan[0]:
            y[e.id], J[e.id] = p.y, inverse.slopes(e, there[e.id], q)
        for c, k in planned.within:
            parts[c.name, k, e.id] = p.by([s.name for s in c.strengths])
            if c.slot == "rig" and len(c.strengths) == 1:
                rigs.setdefault(c.name, (c, []))[1].append((task, p))
        for (c, k), by in zip(planned.beside, p.by_added, strict=True):
            parts[c.name, k, e.id] = by
    if cuts:
        named = None if likely is None else likely(Sensed(y, J, _columns(chosen, y, parts, rigs, train)))
        some = [c for c in chosen if named is None or c.name in named]
        _finite(inverse, q, some, y, parts)
    return Sensed(y, J, _columns(chosen, y, parts, rigs, train))


def _columns(
    chosen: Sequence[Candidate],
    y: Mapping[str, np.ndarray],
    parts: Mapping[tuple[str, int, str], np.ndarray],
    rigs: Mapping[str, tuple[Candidate, list[tuple[Task, Prediction]]]],
    train: Sequence[Experiment],
) -> list[Column]:
    """Of what was computed of all tests that show a candidate, ``parts`` by name, number of shapes and id."""
    columns = []
    for c in chosen:
        none = {id: np.zeros((v.size, len(c.strengths))) for id, v in y.items()}
        for k, shapes in enumerate(c.grid):
            if all((c.name, k, e.id) in parts for e in train if c.seen_by(e)):
                found = {id: np.nan_to_num(parts.get((c.name, k, id), none[id])) for id in none}
                columns.append(Column(c, shapes, found))
        if c.name in rigs:
            columns += [Column(c, c.grid[0], {**none, **by}) for by in _secants(*rigs[c.name])]
    return columns


def _finite(
    inverse: Inverse, q: np.ndarray, chosen: Sequence[Candidate], y: Mapping[str, np.ndarray], parts: dict
) -> None:
    """Differences in place of the exact derivatives in ``parts``, by a strength that changes cuts enough."""
    asked: list[tuple[Candidate, int, int, float, Task]] = []
    train = [e for e in inverse.campaign.train if e.kind == "cut"]
    for c in (c for c in chosen if c.slot != "rig" and c.slot != FIXED):
        seen = [e for e in train if c.seen_by(e)]
        k = len(c.grid) // 2
        if not seen or any((c.name, k, e.id) not in parts for e in seen):
            continue
        for i, s in enumerate(c.strengths):
            most = MOST * abs(s.typical * s.factor - s.off_value)
            up = s.bounds[1] - s.off_value > 0
            room = min(most, abs(s.bounds[up] - s.off_value) / 2)
            slopes = [parts[c.name, k, e.id][:, i] for e in seen]
            lengths = [secant.length(y[e.id], v, np.inf, room) for e, v in zip(seen, slopes, strict=True)]
            if min(lengths) > FELT * most:
                continue
            size = min(*lengths, room)
            value = s.off_value + (size if up else -size)
            for e in seen:
                case = extended(inverse.case(e, q), c.added, c.grid[k])
                case = replace(case, values={**case.values, s.name: value})
                asked.append((c, k, i, value - s.off_value, Task(e, case, inverse.grids[e.id])))
    for (c, k, i, change, task), p in zip(asked, secant.tried(inverse, [a[-1] for a in asked]), strict=True):
        if p is not None:
            id = task.experiment.id
            column = parts[c.name, k, id].copy()
            column[:, i] = (p.y - y[id]) / change
            parts[c.name, k, id] = column


def _secants(c: Candidate, seen: Sequence[tuple[Task, Prediction]]) -> list[dict[str, np.ndarray]]:
    """Changes (m, 1) of the readings of cuts per strength of a rig, by id, for finite strengths."""
    (q,) = c.strengths
    by_slope = [(p.y, p.by([q.name])) for _, p in seen]
    level = np.sqrt(np.mean([np.mean(y**2) for y, _ in by_slope]))
    steep = np.sqrt(np.mean([np.mean(slope**2) for _, slope in by_slope]))
    low, high = q.bounds
    off, found = q.off_value, []
    for size in (part * level / max(steep, 1e-300) for part in PARTS):
        for value in (off + size, off - size):
            if low <= value <= high:
                by = {t.experiment.id: (recorded(t, p, **{q.name: value}) - p.y) for t, p in seen}
                found.append({id: change[:, None] / (value - off) for id, change in by.items()})
    return found


@dataclass(frozen=True)
class _Run:
    """Candidates, each with a number of its shapes' values, that take part in a run, and that are evaluated
    beside it."""

    within: list[tuple[Candidate, int]]
    beside: list[tuple[Candidate, int]]


def _runs(inverse: Inverse, e: Experiment, q: np.ndarray, chosen: Sequence[Candidate]) -> list[_Run]:
    """The run that all others stand beside first."""
    case = inverse.case(e, q)
    runs = [_Run([], [])]
    for c in (c for c in chosen if c.seen_by(e)):
        k = len(c.grid) // 2
        with suppress(BadInput):  # it is then one that could not be tried
            if c.slot == "rig":
                _place_rig(case, c, k, runs)
            elif _added(case, c, k).beside(case):
                runs[0].beside.append((c, k))
            else:
                runs.append(_Run([(c, k)], []))
    return runs


def _place_rig(case: Case, c: Candidate, k: int, runs: list[_Run]) -> None:
    """Into the first run whose rigs it can stand beside."""
    for planned in runs:
        with suppress(BadInput):
            extended(case, [*(name for o, _ in planned.within for name in o.added), *c.added])
            planned.within.append((c, k))
            return
    extended(case, c.added)
    runs.append(_Run([(c, k)], []))


def _added(case: Case, c: Candidate, k: int) -> Added:
    return Added(extended(case, c.added, c.grid[k]), tuple(s.name for s in c.strengths))


def _task(inverse: Inverse, e: Experiment, q: np.ndarray, planned: _Run) -> Task:
    base = inverse.case(e, q)
    values = {name: v for c, k in planned.within for name, v in c.grid[k].items()}
    case = extended(base, [name for c, _ in planned.within for name in c.added], values)
    names = tuple(s.name for c, _ in planned.within for s in c.strengths)
    added = tuple(_added(base, c, k) for c, k in planned.beside)
    return Task(e, case, inverse.grids[e.id], names, added)
