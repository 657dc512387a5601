"""Curves of cuts at places that were not computed, by where the cut begins in them.

A force rises until the cut begins, and drops: between two curves that drop at different depths lies one that
drops at a depth between, not half of each. So curves are laid over each other with their beginnings at one
place (registration: Ramsay, Li 1998, 10.1111/1467-9868.00129): until then along parts of the way to it, from
then on along millimetres beyond. Where the cut begins, what is before and what is beyond are foreseen each
for itself, see ``kriging``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutbench.calibration.kriging import Kriging

#: A part of the usual largest force: a force below is taken as it is, one above by its logarithm. No force is
#: foreseen to be e to ``WIDE`` times that part.
SMALL, WIDE = 0.05, 50.0
#: A cut that did not begin begins beyond the end by this part, at the least; so often that is asked of those
#: that did.
BEYOND, TURNS = 0.01, 2
#: More curves than unknown coordinates, at the least.
SPARE = 3


class Registered:
    """Of ``curves`` (travel (n,), force (n,)) at places ``X`` (m, d), in which the cut begins at the travels
    ``begins`` (m,), nan where it does not; foreseen along ``x`` (k,)."""

    def __init__(
        self,
        X: np.ndarray,
        curves: Sequence[tuple[np.ndarray, np.ndarray]],
        begins: np.ndarray,
        x: np.ndarray,
    ):
        self.x, cut = x, np.isfinite(begins)
        self.small = SMALL * float(np.median([np.abs(force).max() for _, force in curves]))
        self._begins: Kriging | None = None
        at = np.full(len(X), x[-1])
        if cut.sum() >= X.shape[1] + 1 + SPARE:
            known, last = np.log(begins[cut]), np.log([(1 + BEYOND) * way[-1] for way, _ in curves])
            self._begins, all_of_them = Kriging(X[cut], known[:, None]), np.zeros(len(X))
            all_of_them[cut] = known
            for _ in range(TURNS if not cut.all() else 0):
                all_of_them[~cut] = np.maximum(self._begins(X)[~cut, 0], last[~cut])
                self._begins = Kriging(X, all_of_them[:, None])
            at = np.exp(all_of_them)
        #: Parts of the way to the beginning, and mm beyond it.
        self.part, self.beyond = np.linspace(0, 1, x.size), np.linspace(0, x[-1], x.size)
        before = [_read(self.part[1:] * o, *curve) for o, curve in zip(at, curves, strict=True)]
        self._before = Kriging(X, np.arcsinh(np.array(before) / self.small))
        if self._begins is not None:
            begun = [(o, curve) for o, curve, did in zip(at, curves, cut, strict=True) if did]
            after = [_read(self.beyond + o, *curve) for o, curve in begun]
            self._after = Kriging(X[cut], np.arcsinh(np.array(after) / self.small))

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """Forces (p, k) at ``places`` (p, d)."""
        at, before = self._at(places), self._force(self._before(places))
        before = np.concatenate([np.zeros((len(places), 1)), before], axis=1)
        found = np.stack([np.interp(self.x, self.part * o, f) for o, f in zip(at, before, strict=True)])
        if self._begins is not None and (at < self.x[-1]).any():
            after = self._force(self._after(places))
            for i, o in enumerate(at):
                there = self.x > o
                found[i, there] = np.interp(self.x[there] - o, self.beyond, after[i])
        return found

    def error(self, place: np.ndarray) -> np.ndarray:
        """Root (k, r) of the covariance of the force that a computation at ``place`` (d,) has and is not
        foreseen."""
        (o,), (force,) = self._at(place[None]), self(place[None])
        there = self.x > o
        roots = [_over(self.part[1:] * o, self._before.error(place), np.where(there, np.nan, self.x))]
        if self._begins is not None:
            if there.any():
                beyond = np.where(there, self.x, np.nan)
                roots.append(_over(self.beyond + o, self._after.error(place), beyond))
            shift = np.gradient(force, self.x) * np.minimum(self.x, o)
            roots.append(shift[:, None] * self._begins.error(place) / np.hypot(force, self.small)[:, None])
        return np.hypot(force, self.small)[:, None] * np.hstack(roots)

    def _at(self, places: np.ndarray) -> np.ndarray:
        if self._begins is None:
            return np.full(len(places), self.x[-1])
        return np.exp(np.clip(self._begins(places)[:, 0], -WIDE, WIDE))

    def _force(self, values: np.ndarray) -> np.ndarray:
        return np.sinh(np.clip(values, -WIDE, WIDE)) * self.small


def _read(at: np.ndarray, x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """The curve at places, nan beyond its end."""
    return np.where(at <= x[-1] * (1 + 1e-9), np.interp(at, x, force), np.nan)


def _over(way: np.ndarray, root: np.ndarray, at: np.ndarray) -> np.ndarray:
    """``root`` (n, r), along ``way`` (n,), at the places ``at`` (k,); 0 where these are nan."""
    read = np.stack([np.interp(at, way, column) for column in root.T], axis=1)
    return np.where(np.isnan(at)[:, None], 0.0, read)
