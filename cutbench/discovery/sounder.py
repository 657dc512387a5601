"""Whether a candidate's gain is its own, or that of the other values that its fit came across.

A fit to cuts ends where no likelier place is foreseen, from few cuts. The fit of a candidate begins there and
knows more; should it lead the others to values with which the model is likelier without the candidate, too,
that is where the model is to be asked.
"""

from __future__ import annotations

import math

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress
from cutbench.calibration.fitted import Fit
from cutbench.calibration.likely import likely
from cutbench.calibration.prediction import Predictor
from cutbench.calibration.survey import ERRS, Survey
from cutbench.discovery.extending import NOTHING
from cutbench.discovery.point import Point, fit_again, new_strengths, point_of

#: Where so much of a candidate's gain is to be had without it, the gain is not its own.
MOST = 0.5


class Elsewhere(Exception):
    """The model is likelier elsewhere, without the candidate that led there."""


def does_nothing(point: Point, after: Point) -> bool:
    """Whether the candidate that ``after`` has and ``point`` has not does nothing at the strengths that make
    the data likeliest: what is gained there the other values gain."""
    new = [u for u, is_new in zip(after.inverse.unknowns, new_strengths(point, after), strict=True) if is_new]
    typical = [abs(u.quantity.typical * u.quantity.factor) for u in new]
    far = [abs(after.values[u.label] - u.quantity.off_value) for u in new]
    return bool(new) and all(d < NOTHING * size for d, size in zip(far, typical, strict=True))


def without(point: Point, after: Point) -> tuple[np.ndarray, float] | None:
    """Where (k,) the model of ``point`` is likelier, of what is foreseen from its cuts with a candidate,
    ``after``, and what part of the candidate's gain it has there; None where nothing likelier is foreseen.

    Raises KeyboardInterrupt.
    """
    if not point.meshed:
        return None  # such fits end at the bottom
    values, (low, high) = after.values, point.inverse.bounds
    here = zip(point.inverse.unknowns, point.q, strict=True)
    q = np.array([u.q(values.get(u.label, u.value(x))) for u, x in here])
    q, before = np.clip(q, low, high), _likely(point)
    if does_nothing(point, after):
        return (q, 1.0) if _likely(after, point) - before >= ERRS else None
    survey = Survey(point.inverse, [q, point.q])
    if not survey.problem.able:
        return None
    foreseen, there = survey.foreseen_likeliest(point.w.noise)
    if foreseen - before < ERRS:
        return None
    try:
        found = likely(survey.problem, point.w.noise, there)
    except (ComputationFailed, BadInput):
        return None
    gain = max(_likely(after, point) - before, ERRS)
    return (there, (found - before) / gain) if found - before >= ERRS else None


def moved(
    point: Point, q: np.ndarray, run: Predictor, refine: bool, on_progress: OnProgress
) -> tuple[Fit, Point] | None:
    """The model of ``point`` fitted again from ``q`` (k,) on; None where that ends no better.

    Raises KeyboardInterrupt.
    """
    on_progress(math.nan, math.nan, "fitting the model again where the search has led")
    inverse = point.inverse
    try:
        fitted = fit_again(point, inverse.at(q), inverse.base(q), run, refine, on_progress, near=True)
        there = point_of(fitted, run)
    except (ComputationFailed, BadInput):
        return None
    return (fitted, there) if _likely(there, point) > _likely(point) else None


def _likely(one: Point, point: Point | None = None) -> float:
    """As likely as ``point`` would have it."""
    return likely(one.inverse, (point or one).w.noise, one.q)
