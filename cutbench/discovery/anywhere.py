"""What a law of the specimen or the blade would explain, wherever the model that lacks it has ended.

A model that lacks a law bends its values, far at times, until what the law would change there says nothing of
what it does where the specimen is. But cuts that were computed without it are known all about, and a law that
does nothing changes none of them. So a few cuts with the law, between where the model began and where it
ended, tell what it does, and where it makes the data likeliest is foreseen, see ``calibration.survey``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cutbench.base.progress import OnProgress
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.survey import BEYOND, FARTHEST, Survey
from cutbench.data.covariance import Covariance
from cutbench.discovery.candidates import Candidate, family_of
from cutbench.discovery.causes import PRICE
from cutbench.discovery.point import Point

#: Cuts of each test with the law; how far, in q, beyond where the model began and ended, and how far from
#: the law's typical values.
PLACES, BESIDE, SHAPED = 1, 0.3, 1.5
#: One that takes so many times the steps that cuts usually do tells nothing that would be worth them.
LONG = 2.0
#: Laws that gain this part of the most are fitted.
NEARLY = 0.3


class Shape(Unknown):
    """A shape parameter: positive, and looked for by its logarithm."""

    @property
    def logarithmic(self) -> bool:
        return self.start > 0 and (self.quantity.low or 0) >= 0


@dataclass(frozen=True)
class Looked:
    """A law, and where it is foreseen to make the data likeliest: ``q`` (k,) of the ``survey``'s problem;
    ``gain`` in twice the log likelihood over the model without it, likewise foreseen."""

    candidate: Candidate
    survey: Survey
    q: np.ndarray
    gain: float

    @property
    def paid(self) -> float:
        """The gain less the price of its parameters."""
        return self.gain - PRICE * len(self.candidate.parameters)

    def extended(self, noise: Covariance) -> tuple[Inverse, np.ndarray]:
        """Computed from there on, to where the data are likeliest. Raises ComputationFailed."""
        return self.survey.problem, self.survey.likeliest(noise, self.q)


def looked(
    point: Point, chosen: Sequence[Candidate], every: Sequence[Candidate], on_progress: OnProgress
) -> tuple[list[Looked], list[str]]:
    """Those of the laws ``chosen``, and of ``every`` formula of the best one's class, that are foreseen to
    gain nearly as much as the best, in that order; and names of those that are foreseen to gain nothing.
    Raises KeyboardInterrupt."""
    survey = _between_known(Survey(point.inverse, [point.q]))
    if not (chosen and survey.problem.able):
        return [], []
    likelihood, q = survey.foreseen_likeliest(point.w.noise)
    found: list[Looked] = []

    def look_at(some: Sequence[Candidate]) -> None:
        if some:
            on_progress(math.nan, math.nan, f"looking at {len(some)} laws")
        looks = [partial(_look, point, c, q, likelihood) for c in some]
        found.extend(one for one in point.inverse.run.side_by_side(looks) if isinstance(one, Looked))
        found.sort(key=lambda one: -one.paid)

    look_at(chosen)
    if not found or found[0].paid <= 0:
        return [], [one.candidate.name for one in found]
    known, best = {one.candidate.name for one in found}, found[0].candidate
    alike = [c for c in every if c.name not in known and family_of(c.name) == family_of(best.name)]
    look_at([c for c in alike if len(c.parameters) <= len(best.parameters)])
    vain = [one.candidate.name for one in found if one.paid <= 0]
    return [one for one in found if one.paid >= NEARLY * found[0].paid], vain


def _look(point: Point, c: Candidate, best: np.ndarray, without: float) -> Looked | None:
    """Computes cuts with the law; the data are foreseen to be likeliest ``without`` it at the ``best`` (k,).
    None where others cannot be foreseen from them."""
    here = point.inverse.at(point.q)
    new = [_typical(q, c) for q in c.parameters]
    model, idle = point.case.model.extended(*c.added)
    values = {**point.case.values, **idle, **{u.name: u.start for u in new}}
    case = replace(point.case, mechanisms=model.mechanisms, values=values)
    inverse = point.inverse.other([*here, *new], case)
    began = point.campaign.base.values
    middle = [_middle(u, began.get(u.name, u.start) if u.experiment is None else u.start) for u in here]
    q, reach = np.array([*middle, *[(0.0, SHAPED)] * len(new)]).T
    survey = Survey(inverse, [q])
    reach[~survey.free] = 0.0
    steps = [run.x.size for run in point.inverse.run.memory.runs]
    if not survey.around(q, reach, PLACES, int(LONG * np.median(steps))):
        return None
    off = [u.q(u.quantity.off_value) if u.quantity in c.strengths else 0.0 for u in new]
    starts = [q, *(np.append(best, law) for law in (off, np.zeros(len(new))))]
    survey = _between_known(Survey(inverse, starts), off)
    if not survey.problem.able:
        return None
    likelihood, there = survey.foreseen_likeliest(point.w.noise)
    return Looked(c, survey, there, likelihood - without)


def _typical(q, c: Candidate) -> Unknown:
    start, (low, high) = q.typical * q.factor, q.bounds
    if q in c.shapes and low > 0:
        return Shape(q, start, low, high)
    return Unknown(q, (q.off_value if q.off is not None else 0.0) + start, low, high)


def _middle(u: Unknown, value: float) -> tuple[float, float]:
    """In q, the middle between where ``u`` is and a ``value``, and how far that is from either."""
    if u.start > 0 and value > 0 and (u.quantity.low or 0) >= 0:
        far = abs(math.log(value / u.start)) / 2
        middle = u.q(math.sqrt(u.start * value))
    else:
        middle = u.q(value) / 2
        far = abs(middle)
    if not math.isfinite(middle + far):
        middle = far = 0.0
    return float(np.clip(middle, *u.reach)), min(far, FARTHEST) + BESIDE


def _between_known(survey: Survey, off: Sequence[float] = ()) -> Survey:
    """Kept where cuts are known, and little beyond; of a law (the last unknowns) from where it is ``off``."""
    low, high = survey.inverse.bounds
    bottom, top = survey.low - BEYOND, survey.high + BEYOND
    if off:
        k = low.size - len(off)
        bottom[k:] = np.minimum(survey.low[k:], off) - BESIDE
        top[k:] = np.maximum(survey.high[k:], off) + BESIDE
    survey.within = np.maximum(bottom, low), np.minimum(top, high)
    return survey
