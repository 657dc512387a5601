"""Derivatives of cuts over the length of a step, in place of exact ones.

How far the front runs when a cut begins is decided within a few steps, and then stays: the force afterwards
answers to a parameter in small jumps, each a few tenths of a per cent, and is all but level between two. The
exact derivative is that of a level, and ends where a cut snaps. What tells one cause from another is the
slope across many jumps: differences over some per cent have it, and agree from one per cent to ten.

Broyden's update (1965, 10.1090/S0025-5718-1965-0198670-6) is the smallest change of the derivatives that
makes them give what the curve did over the last step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.prediction import Prediction, Task
from cutbench.data.experiment import Experiment

if TYPE_CHECKING:
    from cutbench.calibration.inverse import Inverse

#: A step changes the readings by about this part of the largest, where the exact derivative says so; in q it
#: is no shorter and no longer than this, and where that derivative ends, at a snap, no longer than ``BLIND``.
PART, LEAST, MOST, BLIND = 0.1, 0.04, 0.25, 0.1


def length(y: np.ndarray, slope: np.ndarray, most: float, blind: float) -> float:
    """Of a step that changes ``y`` (m,) as wanted, by its exact derivative (m,), nan beyond a snap."""
    steepest = float(np.abs(np.nan_to_num(slope)).max(initial=0.0))
    whole = bool(np.isfinite(slope).all())
    return min(PART * float(np.abs(y).max()) / max(steepest, 1e-300), most if whole else blind)


def across(inverse: Inverse, q: np.ndarray, found: Mapping[str, Prediction]) -> dict[str, Prediction]:
    """``found`` at ``q`` by id, with differences in place of the exact derivatives of cuts.

    Those of a rig, which no run depends on, stay; so does what no step could be computed for.
    """
    made = {**found}
    rig = {p.name for law in inverse.start.model.laws("rig") for p in law.parameters}
    asked: list[tuple[int, Experiment, Task, float]] = []
    for e in (e for e in inverse.campaign.train if e.kind == "cut"):
        for k, u in enumerate(inverse.unknowns):
            if u.name not in inverse.names(e) or u.experiment not in (None, e.id) or u.name in rig:
                continue
            p = found[e.id]
            slope = p.slopes[:, p.names.index(u.name)] * u.slope(q[k])
            step, (low, high) = max(length(p.y, slope, MOST, BLIND), LEAST), u.reach
            there = q.copy()
            # Away from the nearer bound.
            there[k] += step if high - q[k] >= min(step, q[k] - low) else -step
            there[k] = np.clip(there[k], low, high)
            change = u.value(there[k]) - u.value(q[k])
            if change:
                with suppress(ComputationFailed):
                    case = inverse.checked_case(e, there)
                    asked.append((k, e, Task(e, case, inverse.grids[e.id]), change))
    for (k, e, _, change), moved in zip(
        asked, tried(inverse, [task for _, _, task, _ in asked]), strict=True
    ):
        if moved is None:
            continue
        p = made[e.id]
        column = p.names.index(inverse.unknowns[k].name)
        slopes, fields = p.slopes.copy(), p.field_slopes.copy()
        slopes[:, column] = (moved.y - p.y) / change
        if p.fields.size:
            fields[:, column] = (moved.fields - p.fields) / change
        made[e.id] = replace(p, slopes=slopes, field_slopes=fields)
    return made


def tried(inverse: Inverse, tasks: Sequence[Task]) -> list[Prediction | None]:
    """None for those that fall short."""
    try:
        return [*inverse.run(tasks)]
    except ComputationFailed:
        found: list[Prediction | None] = []
        for task in tasks:
            found.append(None)
            with suppress(ComputationFailed):
                (found[-1],) = inverse.run([task])
        return found


def updated(
    inverse: Inverse, e: Experiment, plain: Prediction, near: tuple[np.ndarray, Mapping[str, Prediction]],
    q: np.ndarray,
) -> Prediction:  # fmt: skip
    """``plain`` at ``q`` with the slopes of the ``near`` place, its values (k,) and predictions by id,
    changed so that they give what is new since."""
    values, found = near
    old, names = found[e.id], inverse.names(e)
    mine = [
        next(k for k, u in enumerate(inverse.unknowns) if u.name == name and u.experiment in (None, e.id))
        for name in names
    ]
    size = inverse.sizes(q)[mine]
    step = (inverse.values(q) - values)[mine] / size
    order = [old.names.index(name) for name in names]

    def changed(slopes: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        scaled = slopes[:, order] * size
        if not step @ step > 0:
            return slopes[:, order]
        missed = after - before - scaled @ step
        return (scaled + np.outer(missed, step) / (step @ step)) / size

    fields = changed(old.field_slopes, old.fields, plain.fields) if plain.fields.size else old.field_slopes
    return replace(plain, slopes=changed(old.slopes, old.y, plain.y), names=names, field_slopes=fields)
