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
from cutbench.calibration.prediction import Predictor
from cutbench.calibration.survey import Survey, likely
from cutbench.discovery.outcome import Round, Tried
from cutbench.discovery.point import Point, fit_again, point_of

#: So much of the candidate's gain is foreseen to be had without it.
MUCH = 0.3


def sounder(this: Round, run: Predictor, refine: bool, on_progress: OnProgress) -> tuple[Fit, Point] | None:
    """The model of ``this`` round with other values that explain a good part of what the accepted candidate
    does, and its fit; None where there are none. Without a mesh fits end at the bottom.

    Raises KeyboardInterrupt.
    """
    taken = next((t for t in this.tried if t.name == this.accepted), None)
    if taken is None or not this.point.meshed:
        return None
    q = _without(this.point, taken)
    if q is None:
        return None
    on_progress(math.nan, math.nan, f"fitting the model again where {taken.name} has led")
    point = this.point
    try:
        fitted = fit_again(
            point, point.inverse.at(q), point.inverse.base(q), run, refine, on_progress, near=True
        )
        there = point_of(fitted, run)
    except (ComputationFailed, BadInput):
        return None
    return (fitted, there) if _likely(there, there.q) > _likely(point, point.q) else None


def _without(point: Point, taken: Tried) -> np.ndarray | None:
    """Where (k,) the model is foreseen to be likelier by ``MUCH`` of what the candidate gains; None where it
    is not, or nothing can be foreseen."""
    values = taken.point.values
    q = np.array(
        [u.q(values.get(u.label, u.value(x))) for u, x in zip(point.inverse.unknowns, point.q, strict=True)]
    )
    survey = Survey(point.inverse, [np.clip(q, *point.inverse.bounds), point.q])
    if not survey.problem.able:
        return None
    likelihood, there = survey.foreseen_likeliest(point.w.noise)
    without = _likely(point, point.q)
    gain = _likely(taken.point, taken.point.q) - without
    return there if likelihood - without >= MUCH * gain > 0 else None


def _likely(point: Point, q: np.ndarray) -> float:
    return likely(point.inverse, point.w.noise, q)
