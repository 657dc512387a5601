"""Traction of an interface, along its history: of two faces that part, and of one that slides on a blade."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from cutbench.case.model import Model
from cutbench.homogeneous.history import SLOW, LoadingHistory
from cutbench.mechanisms.base import Points, cut_answers

#: Steps to each reading: laws may take means over a step, which lag by half of it.
STEPS_TO_READING = 8
#: Slower than this part of the mean speed is rest.
REST_SPEED_FRACTION = 0.01


def separation(
    history: LoadingHistory, model: Model, p: SimpleNamespace, direction: str = "opening", *, count: int = 1
) -> np.ndarray:
    """Traction (n, count) in MPa along the jump of two faces that part or slide, by the cut laws.

    ``count``: length of array parameters; ``direction``: ``opening`` (normal) or ``sliding`` (tangential).
    """
    laws, axis = model.laws("cut"), 0 if direction == "opening" else 1
    state: dict[str, np.ndarray] = {}
    for law in laws:
        state |= law.start(count, p)
    old, out = np.zeros((3, count)), []
    for x, dt, reached in history.steps(np.inf, STEPS_TO_READING):
        jump = np.zeros((3, count), dtype=np.result_type(x, float))
        jump[axis] = x
        # The middle of a specimen: no skin.
        at = Points(X=np.zeros((3, count)), depth=np.full(count, 1e6), dt=dt, jump_old=old)
        T = np.zeros((3, count))
        for answer in cut_answers(laws, jump, p, state, at):
            T, state = T + answer.traction, state | answer.new
        old = jump
        if reached:
            out.append(T[axis])
    return np.array(out)


def sliding(history: LoadingHistory, model: Model, p: SimpleNamespace) -> np.ndarray:
    """Shear traction (n,) in MPa at each reading, positive along growing x; complex if ``p`` is.

    It is the strength of the blade laws at a given pressure and slip: the contact counts as touched, the
    material as rigid. While nothing slides it stays, as far as the strength allows.
    """
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
