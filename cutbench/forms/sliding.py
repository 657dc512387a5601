"""Sliding past the blade: strengths of friction and adhesion, and the return mapping of their traction.

What a law's strength depends on — pressure and Θ — is that of the last converged step. The paper does so
with Θ; with the pressure too, friction no longer feeds back on contact within a step, and runs with
Coulomb friction get through onsets at which they stall otherwise. Refining the step removes the lag.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cutbench.base.compiled import choose, shared
from cutbench.mechanisms.base import STEP, Points


class Rubbed(Points):
    """Points whose ``slip_rate`` is found when a law asks for it, which is noted in ``asked``."""

    asked = False
    _slides: tuple[np.ndarray, np.ndarray]

    @property
    def slip_rate(self) -> np.ndarray:
        self.asked = True
        return way(*self._slides) / self.dt


class Strengths:
    """What the laws lend at the points of some faces; they are asked again where that may have changed."""

    def __init__(self, laws: Sequence[Any]):
        self._laws = tuple(laws)
        self._given: tuple = ()
        self._parts = np.zeros((0, 0))

    def at(self, place, n, slip, p, state, step, tangent) -> tuple[np.ndarray, np.ndarray]:
        """Shares (laws, N) of the strength at the points of ``place``, and the derivative (N,) of their sum
        by the slip rate, empty where it has none; for normals n and ways ``slip`` (dim, N) past the blade.

        States are never changed in place: the same arrays give the same strengths, but for the rate.
        """
        known = tuple(state[key] for key in ("pressure", "touched", "slid"))
        given = (place, p, step.dt, *known)
        if len(given) == len(self._given) and all(a is b for a, b in zip(given, self._given, strict=True)):
            return self._parts, np.zeros(0)
        t_N, touched, slid = (np.take(value, place.near, axis=-1).ravel() for value in known)
        about = {"X": place.X, "touched": touched, "slid": slid, "speed": p.speed, "dt": step.dt}
        at = Rubbed(_slides=(n, slip), **about)
        answers = [np.broadcast_to(law.strength(t_N, p, state, at), t_N.shape) for law in self._laws]
        parts = np.array(answers)
        self._given = () if at.asked else given
        self._parts = parts
        if not (tangent and at.asked):
            return parts, np.zeros(0)
        faster = Points(slip_rate=at.slip_rate + 1j * STEP, **about)
        return parts, sum(np.imag(law.strength(t_N, p, state, faster)) for law in self._laws) / STEP


@shared
def way(n, slip):
    """Length of what of ``slip`` is along the blade, whose normal is n, at one point or at many."""
    along = slip[0] * n[0]
    for i in range(1, len(n)):
        along = along + slip[i] * n[i]
    square = 0.0 * along
    for i in range(len(n)):
        part = slip[i] - n[i] * along
        square = square + part * part
    return np.sqrt(choose(square.real > 0, square, 0.0))


@shared
def returned(n, dn, shear, slip, stick, strength, by_rate, dt, traction, D, tangent, rated):
    """Return mapping at one point (compiled), or at many along the last axis of all.

    ``shear`` of the last step and ``slip`` (dim,) past the blade, whose normal n has the derivative dn;
    ``stick`` in MPa/mm. Fills ``traction`` (dim,) and, with ``tangent``, its derivative D (dim, dim), where
    ``rated`` with that of the strength ``by_rate``. The way slid is the answer.
    """
    dim = len(n)
    pulled, along = n[0] * (shear[0] - stick * slip[0]), n[0] * slip[0]
    for i in range(1, dim):
        pulled = pulled + n[i] * (shear[i] - stick * slip[i])
        along = along + n[i] * slip[i]
    square = 0.0 * pulled
    for i in range(dim):
        traction[i] = shear[i] - stick * slip[i] - n[i] * pulled  # the trial
        square = square + traction[i] * traction[i]
    moved = way(n, slip)
    size = np.sqrt(choose(square.real > 0, square, 1.0))
    slips = size.real > strength.real
    ratio = choose(square.real > 0, choose(slips, strength / size, 1.0), 0.0)
    if tangent:
        for k in range(dim):
            turned = (traction[0] + n[0] * pulled) * dn[0, k]
            for i in range(1, dim):
                turned = turned + (traction[i] + n[i] * pulled) * dn[i, k]
            for i in range(dim):
                D[i, k] = stick * n[i] * n[k] - dn[i, k] * pulled - n[i] * turned
            D[k, k] = D[k, k] - stick
            stretch = traction[0] * D[0, k]
            for i in range(1, dim):
                stretch = stretch + traction[i] * D[i, k]
            stretch = choose(slips, stretch, 0.0) / (size * size)
            for i in range(dim):
                D[i, k] = ratio * (D[i, k] - traction[i] * stretch)
        if rated:
            # In small steps this is what resists most: the strength grows with Δs/Δt.
            harder = choose(moved.real > 0, by_rate, 0.0) / (dt * choose(moved.real > 0, moved, 1.0) * size)
            harder = choose(slips, harder, 0.0)
            for k in range(dim):
                longer = slip[k] - n[k] * along
                for i in range(dim):
                    longer = longer - (slip[i] - n[i] * along) * dn[i, k] * along
                for i in range(dim):
                    D[i, k] = D[i, k] + traction[i] * harder * longer
    for i in range(dim):
        traction[i] = ratio * traction[i]
    return moved
