"""Where a fit of cuts begins: at the work that the blade has done, instead of its force.

A computed drop that comes too late leaves a block between itself and the measured one, and how large that is
says nothing of how far they are apart: forces have many minima, and a fit ends in the nearest. The work
beyond both drops differs in proportion to their distance. Its logarithm is nearly linear in those of
stiffness, toughness and adhesion, so a few steps of Gauss and Newton get near, with derivatives over a step
(``secant``): exact ones do not know that a drop moves. Works that agree to within their noise are near.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import cumulative_trapezoid

from cutbench.base.progress import OnProgress, silent
from cutbench.calibration import lm
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.prediction import Prediction
from cutbench.calibration.sparing import Sparing
from cutbench.data.repetition import Averaged

#: Part of the work that counts as noise, and part of the whole work below which it is compared as it is.
NOISE, SMALL = 0.02, 0.01
#: Steps with derivatives that are only updated; then they are computed again, so often at the most.
STEPS, ROUNDS = lm.Settings(promise=0.5, evaluations=12, failures=2), 5
#: In q: what moves no farther ends near enough for a fit of the forces; so does what gains a smaller part.
CLOSE, PAYS = 0.1, 0.1


@dataclass(frozen=True)
class Nearby:
    """Where to begin, ``q`` (k,); ``inverse`` has computed it, after so many ``evaluations``."""

    q: np.ndarray
    inverse: Inverse
    evaluations: int
    interrupted: bool = False


def nearby(inverse: Inverse, q: np.ndarray, on_progress: OnProgress = silent) -> Nearby:
    """Where the works agree best, from ``q`` on, where ``inverse`` has been computed.

    Raises ComputationFailed if it cannot be.
    """
    low, high = inverse.bounds
    evaluations, known, stepwise = 0, inverse, inverse.differenced()

    def told(done: float, total: float, text: str) -> None:
        on_progress(evaluations + done, total, text)

    for _ in range(ROUNDS):
        problem = Sparing(stepwise)
        try:
            here = difference(stepwise, q)
        except KeyboardInterrupt:
            return Nearby(q, known, evaluations, interrupted=True)
        best = lm.minimise(partial(difference, problem), q, low, high, STEPS, told, first=here)
        evaluations += best.evaluations
        gained = 1 - best.chi2 / max(best.history[0], 1e-300)
        near = best.chi2 <= best.r.size or gained < PAYS or bool(np.abs(best.q - q).max() <= CLOSE)
        q, known = best.q, problem
        if near or best.message == lm.INTERRUPTED:
            return Nearby(q, known, evaluations, best.message == lm.INTERRUPTED)
        # How long a step may be, updated derivatives tell as well as exact ones.
        stepwise.sketch(q, problem.predictions(q))
    return Nearby(q, known, evaluations)


def difference(inverse: Inverse, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the works (M,) of all train experiments along their ways, computed less measured, in units of the
    noise, with derivatives (M, k) by the scaled unknowns."""
    return compared(inverse, inverse.predictions(q), q)


def compared(
    inverse: Inverse, found: Mapping[str, Prediction], q: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same of what is ``found`` at ``q``, by id."""
    r, J = [], []
    for e in inverse.campaign.train:
        grid, p = inverse.grids[e.id], found[e.id]
        measured, computed = _work(grid.along, grid.mean), _work(grid.along, p.y)
        slopes = inverse.scaled(e, p, np.nan_to_num(p.slopes), q)
        small = SMALL * np.abs(measured).max()
        r.append((np.arcsinh(computed / small) - np.arcsinh(measured / small)) / NOISE)
        J.append(_work(grid.along, slopes) / np.hypot(computed, small)[:, None] / NOISE)
    return np.concatenate(r), np.concatenate(J)


def changed(grid: Averaged, found: Prediction, by: np.ndarray) -> np.ndarray:
    """By how much (m, …) works change, in units of their noise, by what changes readings ``by`` (m, …)."""
    computed = _work(grid.along, found.y)
    size = np.hypot(computed, SMALL * np.abs(computed).max()) * NOISE
    return (_work(grid.along, by).T / size).T


def _work(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """∫ y dx (m, …) along ``x`` (m,), from half a step before the first reading."""
    return cumulative_trapezoid(y, x, axis=0, initial=0.0) + 0.5 * (x[1] - x[0]) * y[:1]
