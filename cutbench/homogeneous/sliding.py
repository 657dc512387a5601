"""Traction of an interface that slides: the strengths of the blade laws at a given pressure and slip.

The contact counts as touched, the material as rigid: the traction is the strength in the direction
of the slip, and while nothing slides it stays, as far as the strength allows.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from cutbench.case.model import Model
from cutbench.homogeneous.history import SLOW, LoadingHistory
from cutbench.mechanisms.base import Points

#: Slower than this part of the mean speed is rest.
REST_SPEED_FRACTION = 0.01


def traction(history: LoadingHistory, model: Model, p: SimpleNamespace) -> np.ndarray:
    """Shear traction (n,) in MPa at each reading, positive along growing x; complex if ``p`` is."""
    way = np.diff(np.append(history.rest, history.x))
    # Without times nothing is known of the rate but the model's speed.
    rate = np.where(history.dt >= SLOW, np.real(p.speed), history.rate)
    n = way.size
    at = Points(
        X=np.zeros((3, n)),
        touched=np.ones(n),
        slid=np.cumsum(np.abs(way)),
        slip_rate=rate,
        speed=float(np.mean(rate)),
        dt=history.dt,
    )
    strength = np.zeros(n)
    for law in model.laws("blade"):
        strength = strength + law.strength(history.pressure_MPa, p, {}, at)
    moving = np.abs(way) > REST_SPEED_FRACTION * np.abs(way).mean()
    latest = np.maximum.accumulate(np.where(moving, np.arange(n), np.argmax(moving)))
    return np.sign(way[latest]) * strength
