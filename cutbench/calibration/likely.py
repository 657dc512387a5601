"""How likely the data of cuts are: with what is computed, and with what is foreseen and how surely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cutbench.calibration import by_work, lm
from cutbench.calibration.emulated import Foreseeing
from cutbench.calibration.inverse import Inverse
from cutbench.data.covariance import Covariance
from cutbench.data.discrepancy import likeliest

#: So many values of a work along the travel tell as much as one.
ALIKE = 10


def likely(inverse: Inverse, noise: Covariance, q: np.ndarray) -> float:
    """Twice the log likelihood of the data of ``inverse`` at ``q``, but for a constant: of the forces in
    ``noise``, whatever smooth part of them the model misses, and of the works, which it is not to miss."""
    works, _ = by_work.difference(inverse, q)
    return likeliest(noise, inverse.residuals(q, noise)[0]) - float(works @ works) / ALIKE


def unsure(problem: Foreseeing, w: Covariance, q: np.ndarray) -> tuple[Covariance, np.ndarray, float]:
    """``w`` with what is not foreseen at ``q`` beside it, by how much that widens the works' noise (M,), and
    ``w`` (twice the logarithm)."""
    blocks, wider, price = {}, [], 0.0
    for e in problem.campaign.train:
        block, root = w.tests[e.id], problem.error(e, q)
        blocks[e.id] = wide = replace(block, total=block.total + root @ root.T)
        more = by_work.changed(problem.grids[e.id], problem.prediction(e, q), root)
        wider.append(np.sqrt(1 + np.sum(more**2, axis=1)))
        price += wide.volume - block.volume
    return replace(w, tests=blocks), np.concatenate(wider), price


def expected(problem: Foreseeing, noise: Covariance, q: np.ndarray) -> float:
    """How ``likely`` the data are at ``q``, by all that is known of what a run there would give."""
    wide, wider, price = unsure(problem, noise, q)
    works = by_work.difference(problem, q)[0] / wider
    return likeliest(wide, problem.residuals(q, noise)[0]) - price - float(works @ works) / ALIKE


def both(problem: Foreseeing, w: Covariance, wider: np.ndarray | None = None) -> lm.Residual:
    """Forces and works in one, these in a noise that is ``wider`` (M,)."""
    some = 1 / np.sqrt(ALIKE) / (1.0 if wider is None else wider)

    def residual(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (r, J), (works, by) = problem.whitened(q, w), by_work.difference(problem, q)
        return np.concatenate([r, some * works]), np.concatenate([J, np.reshape(some, (-1, 1)) * by])

    return residual
