"""Numerical causes beside the physical ones: would another mesh or contact normal explain the residual?

The change of a computed curve by a numerical choice is one more column for the score test. The mesh and the
steps have been halved, roughly, by the fit already, which corrects for what that changes and allows for what
it leaves open (``cutbench.calibration.mesh_error``); what is scored here is what remains along that change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress
from cutbench.base.units import Parameter
from cutbench.calibration.mesh_error import ADDED
from cutbench.calibration.prediction import Predictor, Task
from cutbench.case.case import Case
from cutbench.discovery.candidates import Candidate
from cutbench.discovery.columns import Column, Sensed
from cutbench.discovery.outcome import CHANCE, SHARE, NumericalCauses, Round
from cutbench.discovery.point import Point
from cutbench.discovery.score import score
from cutbench.discovery.yardstick import Yardstick

#: By chance so often, a numerical choice is named where no candidate convinces: it is to be settled before
#: physics is looked for, and naming it wrongly costs a finer run.
LIKELY = 0.05
#: Name, what it is, and the choices that differ.
CHOICES = {
    "element size and step": "elements and steps about half as large",
    "contact normal": "another direction of the contact pressure",
}


def numerical_columns(point: Point, run: Predictor) -> tuple[list[Column], dict[str, str]]:
    """A column for each numerical choice of the cuts, and why others are missing; none without a mesh."""
    cuts = [e for e in point.campaign.train if e.kind == "cut"]
    if not cuts:
        return [], {}
    columns = []
    by = {e.id: point.w.tests[e.id].shift / ADDED for e in cuts}
    if any(np.any(v) for v in by.values()):
        columns.append(_column("element size and step", by, point))
    name = "contact normal"
    try:
        cases = [_turned(point.inverse.case(e, point.q)) for e in cuts]
        answers = run([Task(e, c, point.inverse.grids[e.id]) for e, c in zip(cuts, cases, strict=True)])
    except (ComputationFailed, BadInput) as error:
        return columns, {name: str(error)}
    moved = {e.id: p.y + point.w.tests[e.id].shift for e, p in zip(cuts, answers, strict=True)}
    columns.append(_column(name, {id: y - point.y[id] for id, y in moved.items()}, point))
    return columns, {}


def _turned(case: Case) -> Case:
    """The run with the contact pressure in its other direction."""
    return case.set(normal="tool" if case.numerics.normal == "material" else "material")


def _column(name: str, by: Mapping[str, np.ndarray], point: Point) -> Column:
    share = Parameter("share", "1", "s", "part of the change that is taken", off=0.0)
    c = Candidate(name, CHOICES[name], "numerics", (share,), (), ({},))
    return Column(c, {}, {id: by.get(id, np.zeros(y.size))[:, None] for id, y in point.y.items()})


def numerical_causes(this: Round, run: Predictor, seed: int, on_progress: OnProgress) -> NumericalCauses:
    """Of cuts whose baseline fails: what another mesh, element or normal would change."""
    promising = any(t.p_any < CHANCE for t in this.tried)
    if this.scores.p_residual > CHANCE and not promising:
        return NumericalCauses()
    columns, missing = numerical_columns(this.point, run)
    if not columns:
        return NumericalCauses(missing=missing)
    on_progress(math.nan, math.nan, "numerical causes: " + ", ".join(c.candidate.name for c in columns))
    sensed = Sensed(dict(this.point.y), dict(this.point.J), columns)
    scores = score(sensed, this.point.w.noise, this.point.residual, seed=seed)
    wrong = Yardstick(this.point, scores.expected)
    shares = {s.name: max(1 - wrong.after(sensed, s), 0.0) for s in scores.scores}
    best = scores.scores[0]
    rival = max((t.gain for t in this.tried), default=0.0)
    chance = CHANCE if any(t.convincing for t in this.tried) else LIKELY
    explains = best.name if best.p < chance and shares[best.name] >= SHARE and best.gain >= rival else None
    return NumericalCauses(tuple(scores.scores), shares, explains, missing)
