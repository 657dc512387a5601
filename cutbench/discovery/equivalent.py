"""Which strength of a law does what values of each cut's own do.

The derivative of a law that is switched off says little of how much of it a toughness that trebles takes. So
the law is computed, and each of its cuts held against those of the model without it: with which value of its
own would it have done the same work? That tells how the value grows with the law's strength, and so the
strength and the shared value that give each cut its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np
from scipy import optimize

from cutbench.calibration import by_work
from cutbench.calibration.emulated import Foreseeing
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.prediction import Prediction
from cutbench.mechanisms.base import Mechanism

#: Farthest that a value of a cut's own is looked for, in q.
FARTHEST = 3.0
#: A shared value is this part of the smallest at the least; a strength up to so many times the one computed.
SHARED, STRONGER = 0.1, 30.0
#: What a change of q by 1 costs in units of a value's relative error, so that shapes that nothing tells stay.
STAYS = 0.03


def equivalent(
    problem: Foreseeing, q: np.ndarray, own: Mapping[str, int], law: Mapping[str, Prediction]
) -> np.ndarray:
    """The values (t,) of the unknowns ``own``, by a test's id, with which cuts are foreseen to do the works
    of those by a ``law``; all others are as at ``q`` (k,)."""
    found = []
    for id, k in own.items():
        e = next(e for e in problem.campaign.train if e.id == id)
        grid, size = problem.grids[id], by_work.changed(problem.grids[id], law[id], law[id].y)

        def apart(x: float, e=e, k=k, grid=grid, wanted=law[id], size=size) -> float:
            there = q.copy()
            there[k] = x
            return float(np.sum((by_work.changed(grid, wanted, problem.prediction(e, there).y) - size) ** 2))

        low, high = np.clip([q[k] - FARTHEST, q[k] + FARTHEST], *problem.unknowns[k].reach)
        tried = np.linspace(low, high, 61)
        best = tried[int(np.argmin([apart(x) for x in tried]))]
        step = tried[1] - tried[0]
        ends = np.clip([best - step, best + step], low, high)
        found.append(
            problem.unknowns[k].value(optimize.minimize_scalar(apart, bounds=ends, method="bounded").x)
        )
    return np.array(found)


def strength_of(wanted: np.ndarray, equal: np.ndarray, shared: float, strength: float) -> tuple[float, float]:
    """The shared value and the strength that give each of t tests the value that is ``wanted`` (t,), where
    ``shared`` with a ``strength`` is ``equal`` to (t,): shared + strength × something of the test's own."""
    each = (equal - shared) / strength
    A = np.column_stack([np.ones(wanted.size), each]) / wanted[:, None]
    least = SHARED * float(wanted.min()), strength / STRONGER
    most = np.inf, strength * STRONGER
    found = optimize.lsq_linear(A, np.ones(wanted.size), (least, most)).x
    return float(found[0]), float(found[1])


def by_formula(
    law: Mechanism,
    wanted: np.ndarray,
    each: Sequence[SimpleNamespace],
    unknowns: Sequence[Unknown],
    q: np.ndarray,
) -> np.ndarray:
    """The same by the law's own word (``Mechanism.like``), without a run: values in q (k,) of ``unknowns``,
    the shared one first, with which the law gives t tests with the values ``each`` what is ``wanted`` (t,);
    from ``q`` on."""

    def apart(there: np.ndarray) -> np.ndarray:
        mine = {u.name: u.value(x) for u, x in zip(unknowns, there, strict=True)}
        like = [law.like(SimpleNamespace(**{**vars(p), **mine}))[unknowns[0].name] for p in each]
        return np.concatenate([np.log(np.array(like) / wanted), STAYS * (there - q)])

    low, high = np.array([u.reach for u in unknowns]).T
    return optimize.least_squares(apart, np.clip(q, low, high), bounds=(low - 1e-9, high + 1e-9)).x
