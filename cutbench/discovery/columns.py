"""What each candidate would change first, at the fitted point: the derivatives of all readings at "off".

Homogeneous tests are differentiated at all values of the shapes in one pass. A cut is run with all
candidates at off at once; a second run takes further values of the shapes and those candidates that exclude
one another. What a rig would make of a run is known for any strength without another run: where
a curve drops, the change by a finite strength is no multiple of the derivative, so some are tried as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration.homogeneous import scan
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction, Predictor, Task, recorded
from cutbench.data.experiment import Experiment
from cutbench.discovery.candidates import Candidate
from cutbench.run.sensitivity import extended

#: Runs of a cut, at the most, for its candidates.
RUNS = 2
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


def sense(inverse: Inverse, q: np.ndarray, chosen: Sequence[Candidate], run: Predictor) -> Sensed:
    """At ``q`` of ``inverse``. Raises ComputationFailed."""
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
    asked = [(group, _task(inverse, e, q, group)) for group in plan for e in cuts]
    rigs: dict[str, tuple[Candidate, list[tuple[Task, Prediction]]]] = {}
    for (group, task), p in zip(asked, run([task for _, task in asked]), strict=True):
        e = task.experiment
        if group is plan[0]:
            y[e.id], J[e.id] = p.y, inverse.slopes(e, p, q)
        for c, k in group:
            parts[c.name, k, e.id] = p.by([s.name for s in c.strengths])
            if c.slot == "rig" and len(c.strengths) == 1:
                rigs.setdefault(c.name, (c, []))[1].append((task, p))
    columns = []
    for c in chosen:
        none = {id: np.zeros((v.size, len(c.strengths))) for id, v in y.items()}
        for k, shapes in enumerate(c.grid):
            if all((c.name, k, e.id) in parts for e in train if c.seen_by(e)):
                columns.append(Column(c, shapes, {id: parts.get((c.name, k, id), none[id]) for id in none}))
        if c.name in rigs:
            columns += [Column(c, c.grid[0], {**none, **by}) for by in _secants(*rigs[c.name])]
    return Sensed(y, J, columns)


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


def _runs(
    inverse: Inverse, e: Experiment, q: np.ndarray, chosen: Sequence[Candidate]
) -> list[list[tuple[Candidate, int]]]:
    """Which candidates go into which run, each with which of its shapes' values."""
    case = inverse.case(e, q)
    runs: list[list[tuple[Candidate, int]]] = [[] for _ in range(RUNS)]
    for c in (c for c in chosen if c.seen_by(e)):
        # The middle of the grid first, then its ends.
        order = sorted(range(len(c.grid)), key=lambda k: abs(k - (len(c.grid) - 1) / 2))
        if len(order) > RUNS:
            order = [order[0], *order[:-RUNS:-1]]
        for group in runs:
            with suppress(BadInput):
                if order:
                    extended(case, [*(name for o, _ in group for name in o.added), *c.added])
                    group.append((c, order.pop(0)))
    return [runs[0], *(g for g in runs[1:] if g)]


def _task(inverse: Inverse, e: Experiment, q: np.ndarray, group: Sequence[tuple[Candidate, int]]) -> Task:
    values = {name: v for c, k in group for name, v in c.grid[k].items()}
    case = extended(inverse.case(e, q), [name for c, _ in group for name in c.added], values)
    names = (*inverse.names(e), *(s.name for c, _ in group for s in c.strengths))
    return Task(e, case, inverse.grids[e.id], names)
