"""Does the extended model predict better what neither fit has seen? By how much, and how sure is that?

What is held out: tests of role test where there are any that both models predict; else one fifth of the
readings of each fitted test after the other, with fits that are one Gauss–Newton step away from the fit to
all. The gain is the fall of the root mean square error; its standard error is that of a difference which is
linear in the readings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.posterior import Estimated
from cutbench.calibration.settings import SETTINGS
from cutbench.data.covariance import Block, Factors
from cutbench.data.experiment import Experiment

#: What is held out where tests are.
TESTS = "test experiments"


@dataclass(frozen=True)
class HeldOut:
    """How two models predict what was not fitted.

    Attributes
    ----------
    how : str
        What was held out.
    gain, gain_se : float
        Fall of the root mean square error, relative, and its standard error.
    gain_of_shape : float
        The same with the factor that fits each test best taken out of both predictions.
    baseline_rmse, extended_rmse, noise_floor : float
        Both errors, and what scatter and noise make.
    unit : str
        Of these three; ``1``: parts of each test's largest value.
    tells : bool
        Whether the two differ at all in what they predict.
    error_se : float
        Standard error of the gain by errors of the predictions, as where no cut was computed.
    """

    how: str
    gain: float
    gain_se: float
    gain_of_shape: float
    baseline_rmse: float
    extended_rmse: float
    noise_floor: float
    unit: str
    tells: bool
    error_se: float = 0.0

    @property
    def better(self) -> bool:
        """Whether the extended model predicts better, or but for a factor between specimens, which is no
        larger than theirs may be."""
        but_for_factor = self.gain_of_shape > 0 and self.gain > -2 * self.gain_se
        return not self.tells or self.gain > -2 * self.error_se or but_for_factor

    @property
    def gains_much(self) -> bool:
        """Whether much of the error of tests that were not fitted goes, as it is and but for a factor."""
        return self.how == TESTS and self.tells and min(self.gain, self.gain_of_shape) > SETTINGS.share

    @property
    def percent(self) -> str:
        """``+61 ± 5 %``."""
        return f"{100 * self.gain:+.0f} ± {100 * self.gain_se:.0f} %"


@dataclass(frozen=True)
class _Part:
    """Readings (m,) that are held out, both predictions, the covariance (m, m) of the readings, their
    standard deviation (m,), and the covariance (m, m) of the predictions' error."""

    e: Experiment
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    noise: np.ndarray
    deviation: np.ndarray
    size: float
    error: np.ndarray


def held_out(before: Estimated, after: Estimated) -> HeldOut:
    """How two fitted models predict what was not fitted."""
    parts, how = list(_tests(before, after)), TESTS
    if not parts:
        parts, how = list(_cross_validated(before, after)), "one fifth of the readings after the other"
    units = {p.e.y_unit for p in parts}
    relative, squares, shape, spread = len(units) > 1, np.zeros(4), np.zeros(2), np.zeros(2)
    for p in parts:
        scale, d = p.size if relative else 1.0, p.after - p.before
        off = p.before - p.measured, p.after - p.measured, p.deviation, d
        squares += [(each**2).sum() / scale**2 for each in off]
        shape += [_error_up_to_factor(y, p.measured) / scale**2 for y in (p.before, p.after)]
        spread += [4 * d @ C @ d / scale**4 for C in (p.noise, p.error)]
    e0, e1, floor = np.sqrt(squares[:3] / sum(p.measured.size for p in parts))
    gain = 1 - e1 / e0 if e0 > 0 else 0.0
    se, error_se = np.sqrt(spread) / squares[0] / (2 * max(1 - gain, 0.2)) if e0 > 0 else np.zeros(2)
    of_shape = 1 - np.sqrt(shape[1] / shape[0]) if shape[0] > 0 else 0.0
    # Two models whose predictions differ by less than a tenth of the error say the same.
    return HeldOut(
        how, float(gain), float(se), float(of_shape), float(e0), float(e1), float(floor),
        "1" if relative else units.pop(), bool(squares[3] > 0.01 * squares[0]), float(error_se),
    )  # fmt: skip


def _error_up_to_factor(y: np.ndarray, measured: np.ndarray) -> float:
    """Squared error of the prediction ``y`` (m,) times the factor that makes it least."""
    return float(((measured - y * (y @ measured) / max(y @ y, 1e-300)) ** 2).sum())


def predictive_covariance(fitted: Estimated, e: Experiment) -> Block:
    """Covariance of the mean of a predicted test's readings about what a right model says."""
    p = fitted.posterior.predictions
    alike = [p.grids[other.id] for other in p.campaign.experiments if other.kind == e.kind]
    return Block.of(p.grids[e.id], Factors.of(alike).usual, p.grids[e.id].mean)


def _tests(before: Estimated, after: Estimated) -> Iterator[_Part]:
    for e in before.posterior.predictions.campaign.test:
        try:
            one, both = before.predicted(e).y, after.predicted(e)
            other, error = both.y, both.root @ both.root.T
            if not _is_changed(before, after, e, other):
                continue
        except ComputationFailed:
            continue
        block, mean = predictive_covariance(before, e), before.posterior.predictions.grids[e.id].mean
        yield _Part(e, mean, one, other, block.noise, block.deviation, float(np.abs(mean).max()), error)


def _is_changed(before: Estimated, after: Estimated, e: Experiment, y: np.ndarray) -> bool:
    """Whether what the extended model has more changes its prediction ``y`` of a test at all: where it does
    not, only the other parameters' values differ."""
    known = {u.label for u in before.posterior.parameters}
    new = [u for u in after.posterior.parameters if u.label not in known and u.quantity.off is not None]
    if not new:
        return True
    values = after.posterior.values(e, after.q) | {u.name: u.quantity.off_value for u in new}
    off = after.posterior.predictions.predict(e, values).y
    return bool(np.abs(y - off).max() > 1e-3 * np.abs(y).max())


def _cross_validated(before: Estimated, after: Estimated) -> Iterator[_Part]:
    for e in before.posterior.tests:
        mean, block = before.w.grids[e.id].mean, before.w.tests[e.id]
        for out in np.array_split(np.arange(mean.size), 5):
            one, other = (_prediction_without(fitted, e.id, out)[out] for fitted in (before, after))
            noise, size = block.noise[np.ix_(out, out)], float(np.abs(mean).max())
            yield _Part(
                e, mean[out], one, other, noise, block.deviation[out], size, np.zeros((out.size, out.size))
            )


def _prediction_without(fitted: Estimated, id: str, out: np.ndarray) -> np.ndarray:
    """Prediction (m,) of a test by a fit that has not seen its readings ``out``."""
    w, J, r = fitted.w.tests[id], fitted.at.J[id], fitted.at.residual[id]
    kept = np.setdiff1d(np.arange(r.size), out)
    both = np.column_stack([J, r])
    all_, L = w.white(both), cholesky(w.total[np.ix_(kept, kept)], lower=True)
    some = solve_triangular(L, both[kept], lower=True)
    A = np.linalg.inv(fitted.covariance) - all_[:, :-1].T @ all_[:, :-1] + some[:, :-1].T @ some[:, :-1]
    g = some[:, :-1].T @ some[:, -1] - all_[:, :-1].T @ all_[:, -1]
    low, high = (bound - fitted.q for bound in fitted.posterior.bounds)
    return fitted.at.y[id] + J @ np.clip(-np.linalg.solve(A, g), low, high)
