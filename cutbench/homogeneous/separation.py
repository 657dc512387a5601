"""Traction between two faces that part or slide: the cut laws at a given jump, step by step."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from cutbench.case.model import Model
from cutbench.homogeneous.history import LoadingHistory
from cutbench.mechanisms.base import Points, cut_answers

#: Steps to each reading: laws may take means over a step, which lag by half of it.
STEPS_TO_READING = 8


def traction(
    history: LoadingHistory, model: Model, p: SimpleNamespace, direction: str = "opening", *, count: int = 1
) -> np.ndarray:
    """Traction (n, count) in MPa along the jump; ``count`` is the length of array parameters.

    ``direction``: ``opening`` (normal) or ``sliding`` (tangential).
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
