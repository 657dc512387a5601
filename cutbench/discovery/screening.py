"""What each candidate would change first: the derivatives of all readings by its strengths, at off.

Homogeneous tests are differentiated at all values of the shapes in one pass. Of cuts the emulator says what a
machine or another value of a parameter does; what another law does is evaluated beside the runs at the place
that was found, with shapes from the middle of their grid.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.calibration.posterior import Estimated
from cutbench.data.experiment import Experiment
from cutbench.discovery.candidates import Candidate
from cutbench.homogeneous import scan
from cutbench.run.sensitivity import Added, extended

SensitivityParts = dict[tuple[str, int, str], np.ndarray]


@dataclass(frozen=True)
class CandidateSensitivity:
    """Derivatives (m, p) of each fitted test's readings by a candidate's p strengths, by id, at ``shapes``
    (internal units); ``by_runs``: whether only runs of its own say more."""

    candidate: Candidate
    shapes: Mapping[str, float]
    by: Mapping[str, np.ndarray]
    by_runs: bool = False


@dataclass(frozen=True)
class Sensitivities:
    """Computed curves (m,) and their derivatives by the free parameters (m, k), by id; the
    sensitivities to all candidates."""

    y: Mapping[str, np.ndarray]
    J: Mapping[str, np.ndarray]
    by_candidate: Sequence[CandidateSensitivity]


def sensitivities(null: Estimated, chosen: Sequence[Candidate]) -> Sensitivities:
    """Of all candidates that can be evaluated."""
    post, parts = null.posterior, SensitivityParts()
    for c in chosen:
        seen = [e for e in post.tests if c.acts_on(e)]
        cuts = [e for e in seen if e.kind == "cut"]
        for e in (e for e in seen if e not in cuts):
            parts.update({(c.name, k, e.id): by for k, by in enumerate(_by_formula(null, e, c))})
        for k in range(len(c.grid)) if cuts else ():
            parts.update(_by_emulator(null, c, k, cuts))
    known = {(name, k) for name, k, id in parts if id in {e.id for e in post.cuts}}
    asked = [c for c in chosen if (c.name, len(c.grid) // 2) not in known]
    parts.update(_by_runs(null, asked))
    run = {c.name for c in asked if any(c.acts_on(e) for e in post.tests_with_runs)}
    columns = []
    for c in chosen:
        nothing = {id: np.zeros((y.size, len(c.strengths))) for id, y in null.at.y.items()}
        for k, shapes in enumerate(c.grid):
            if all((c.name, k, e.id) in parts for e in post.tests if c.acts_on(e)):
                by = {id: np.nan_to_num(parts.get((c.name, k, id), none)) for id, none in nothing.items()}
                columns.append(CandidateSensitivity(c, shapes, by, c.name in run))
    inside = post.inside(null.q)
    return Sensitivities(null.at.y, {id: J * inside for id, J in null.at.J.items()}, columns)


def _by_formula(null: Estimated, e: Experiment, c: Candidate) -> list[np.ndarray]:
    """Derivatives (m, p) of a test with a formula by a candidate's strengths, with each of its shapes; none
    where they are not known."""
    post = null.posterior
    case, strengths = post.predictions.case(e, post.values(e, null.q)), [s.name for s in c.strengths]
    try:
        more = extended(case, c.added) if c.added else case
        return list(scan(e, more.model, more.p, strengths, c.grid, post.predictions.grids[e.id]))
    except (ComputationFailed, BadInput):
        return []


def _by_emulator(null: Estimated, c: Candidate, k: int, cuts: Sequence[Experiment]) -> SensitivityParts:
    """The same of cuts, where those that are known say it."""
    post = null.posterior
    try:
        base = extended(null.case, c.added, c.grid[k]) if c.added else null.case
        names = [*(u.name for u in post.parameters), *(q.name for q in c.parameters)]
        more, strengths = post.predictions.extended(base, names), [s.name for s in c.strengths]
        return {(c.name, k, e.id): more.predict(e, post.values(e, null.q), strengths).slopes for e in cuts}
    except (BadInput, ComputationFailed):
        return {}


def _by_runs(null: Estimated, asked: Sequence[Candidate]) -> SensitivityParts:
    """The same by the exact derivatives of the cuts at the place that was found, with shapes in the middle of
    their grids."""
    post, p, parts = null.posterior, null.posterior.predictions, SensitivityParts()
    for e in (e for e in post.tests_with_runs if any(c.acts_on(e) for c in asked)):
        values, beside = post.values(e, null.q), list[tuple[Candidate, Added]]()
        case = p.case(e, values)
        for c in asked:
            with suppress(BadInput):
                more = extended(case, c.added, c.grid[len(c.grid) // 2])
                more = replace(more, values={**more.values, **more.model.turned(e.angle)})
                if (added := Added(more, tuple(s.name for s in c.strengths))).shares_unknowns_with(case):
                    beside.append((c, added))
        # The pool has one list of laws a call, and each test's hold the sizes of its own specimen.
        (run,) = p.runs([case], (), [added for _, added in beside])
        if run is None:
            continue
        top = float(np.abs(null.at.y[e.id]).max())
        for (c, _), by in zip(beside, run.by_added, strict=True):
            # A derivative counts no more than what would change the largest force by twice itself.
            most = {s.name: 2.0 * top / max(abs(s.typical * s.factor), 1e-12) for s in c.strengths}
            parts[c.name, len(c.grid) // 2, e.id] = p.read_slopes(e, values, run.course, by, most)
    return parts
