"""Levenberg–Marquardt with bounds, for functions that take seconds and bring their derivatives along.

Minimises |r(q)|² / 2 in whitened residuals, so that a change of 1 in |r|² is one of noise: it ends when the
next step promises less than ``Settings.promise`` of that a parameter, not at some number of digits. A step
that cannot be computed (``ComputationFailed``) counts as one that does not help. After a step in vain the
next is shorter, and the derivatives are the mean of those at both its ends: a computed curve is a little
jagged, and what counts is its slope over the length of a step. Marquardt (1963), 10.1137/0111030; damping
as Nielsen (1999), "Damping parameter in Marquardt's method".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import OnProgress, silent

#: Length of the step after one in vain, relative to that, and what a good step adds to the length allowed.
SHORTER, LONGER = 0.5, 3.0

#: The message of what a KeyboardInterrupt has ended.
INTERRUPTED = "interrupted"

Residual = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Settings:
    """``reach``: largest change of one q in one step. ``damping``: at the start, relative. ``jags``: after a
    step in vain no longer than ``short`` a promise this many times larger is enough; what fails over a longer
    way, or cannot be computed, are no jags. ``enough``: |r|² per residual that ends it, too."""

    promise: float = 0.05
    jags: float = 20.0
    short: float = 0.15
    evaluations: int = 30
    failures: int = 3
    reach: float = 0.7
    damping: float = 1e-3
    enough: float = 0.0


@dataclass
class Minimum:
    """Where it ended: q (k,), residual (m,), J (m, k), whether the promise was kept, and why if not."""

    q: np.ndarray
    r: np.ndarray
    J: np.ndarray
    converged: bool
    message: str
    evaluations: int
    history: list[float] = field(default_factory=list)
    #: The undamped step (k,) that was left to do.
    outstanding: np.ndarray = field(kw_only=True)

    @property
    def chi2(self) -> float:
        return float(self.r @ self.r)

    @property
    def excess(self) -> float:
        """χ² per degree of freedom where it is above 1: the model's error, counted as noise."""
        return max(self.chi2 / max(self.r.size - self.q.size, 1), 1.0)


def minimise(
    residual: Residual,
    q: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    settings: Settings | None = None,
    on_progress: OnProgress = silent,
    first: tuple[np.ndarray, np.ndarray] | None = None,
) -> Minimum:
    """From ``q`` within ``low`` and ``high`` (k,). ``on_progress`` counts evaluations up to the most that are
    allowed; ``first`` saves the evaluation at the start. Raises ComputationFailed if the start itself cannot
    be computed; a KeyboardInterrupt ends with the best so far."""
    settings = settings or Settings()
    q = np.clip(np.asarray(q, dtype=float), low, high)
    r, J = first if first is not None else residual(q)
    best = Minimum(q, r, J, False, "", 1 if first is None else 0, outstanding=np.zeros(q.size))
    best.history.append(best.chi2)
    damping, growth, failed = settings.damping, 2.0, 0
    reach, reason, jagged = settings.reach, "", False
    diagonal = np.zeros(q.size)
    try:
        on_progress(best.evaluations, settings.evaluations, f"χ² {best.chi2:.5g}")
        while True:
            A, g = best.J.T @ best.J, best.J.T @ best.r
            diagonal = np.maximum(diagonal, np.diag(A))
            floor = 1e-12 * max(diagonal.max(initial=0.0), 1e-300)
            best.outstanding = _step(A, g, np.zeros(q.size), best.q, low, high, settings.reach)
            left = -(2 * g @ best.outstanding + best.outstanding @ A @ best.outstanding)
            # What the model cannot describe counts as noise.
            noise = max(best.chi2 / max(best.r.size - q.size, 1), 1.0)
            if left <= settings.promise * q.size * noise * (settings.jags if jagged else 1.0):
                best.converged = True
                best.message = "converged" + (", as far as the jags of the curves let it" if jagged else "")
                return best
            if best.chi2 <= settings.enough * best.r.size:
                best.converged, best.message = True, "converged to within noise"
                return best
            if failed >= settings.failures:
                best.message = f"stopped after {failed} steps in vain: {reason}"
                return best
            if best.evaluations >= settings.evaluations:
                best.message = f"stopped after {best.evaluations} evaluations"
                return best
            step = _step(A, g, damping * np.maximum(diagonal, floor), best.q, low, high, reach)
            predicted = -(2 * g @ step + step @ A @ step)
            J_mean = None
            try:
                best.evaluations += 1
                r, J = residual(best.q + step)
            except ComputationFailed as error:
                gained, reason = -np.inf, str(error)
            else:
                reason = "the misfit does not fall as the derivatives promise"
                gained = best.chi2 - float(r @ r)
                if np.isfinite(J).all():
                    J_mean = (best.J + J) / 2
            if J_mean is not None and gained > 0:
                best.q, best.r, best.J = best.q + step, r, J
                best.history.append(best.chi2)
                ratio = min(gained / max(predicted, 1e-300), 10.0)
                damping = max(damping * max(1 / 5, 1 - (2 * ratio - 1) ** 3), 1e-9)
                growth, failed, jagged = 2.0, 0, False
                reach = min(LONGER * reach, settings.reach)
                on_progress(best.evaluations, settings.evaluations, f"χ² {best.chi2:.5g}")
                continue
            failed, jagged = failed + 1, J_mean is not None and bool(np.abs(step).max() <= settings.short)
            if J_mean is not None:
                best.J = J_mean
            damping, growth = damping * growth, growth * 2
            reach = SHORTER * np.abs(step).max()
    except KeyboardInterrupt:
        best.message = INTERRUPTED
    return best


def _free(g: np.ndarray, q: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Parameters that are not held at a bound by the gradient."""
    return ~(((q <= low) & (g > 0)) | ((q >= high) & (g < 0)))


def _step(A, g, shift, q, low, high, reach) -> np.ndarray:
    """The damped step; what would cross a bound is set onto it and the rest solved again."""
    step = np.zeros(q.size)
    free = _free(g, q, low, high)
    for _ in range(q.size + 1):
        if not free.any():
            break
        i = np.flatnonzero(free)
        rest = g[i] + A[np.ix_(i, ~free)] @ step[~free]
        step[i] = np.linalg.lstsq(A[np.ix_(i, i)] + np.diag(shift[i]), -rest, rcond=None)[0]
        over = free & ((q + step < low) | (q + step > high))
        if not over.any():
            break
        step[over] = np.clip(q + step, low, high)[over] - q[over]
        free &= ~over
    largest = np.abs(step).max(initial=0.0)
    return step * min(1.0, reach / largest) if largest > 0 else step
