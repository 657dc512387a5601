"""Sliding past the blade: the strengths of friction and adhesion.

What a law's strength depends on — pressure and Θ — is known before the step: the pressure foreseen from
those of the last two, and Θ of the last one, as in the paper. So friction does not feed back on contact
within a step, and runs with Coulomb friction get through onsets at which they stall otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import is_
from typing import Any

import numpy as np

from cutbench.forms.contact_assembly import way
from cutbench.mechanisms.base import STEP, Points


class Rubbed(Points):
    """Points whose ``slip_rate`` is found when a law asks for it, which is noted in ``asked``."""

    asked = False
    _slides: tuple[np.ndarray, np.ndarray]

    @property
    def slip_rate(self) -> np.ndarray:
        self.asked = True
        n, slip = self._slides
        return way(range(len(n)), n, slip) / self.dt


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
        known = tuple(state[key] for key in ("foreseen", "touched", "slid"))
        given = (place, p, step.dt, *known)
        if len(given) == len(self._given) and all(map(is_, given, self._given)):
            return self._parts, np.zeros(0)
        t_N, touched, slid = (np.take(value, place.near, axis=-1).ravel() for value in known)
        t_N = np.where(np.real(t_N) > 0, t_N, 0.0)
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
