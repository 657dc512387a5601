"""Derivatives of cuts over the length of a step, in place of exact ones.

How far the front runs when a cut begins is decided within a few steps, and then stays: the force afterwards
answers to a parameter in small jumps, each a few tenths of a per cent, and is all but level between two. The
exact derivative is that of a level, and ends where a cut snaps. What tells one cause from another is the
slope across many jumps: differences over some per cent have it, and agree from one per cent to ten.

Forces are proportional to all that has the dimension of a stress at once (moduli, toughness, adhesion): of
these, one derivative follows from the others and the curve, and no run is made for it.

Broyden's update (1965, 10.1090/S0025-5718-1965-0198670-6) is the smallest change of the derivatives that
makes them give what the curve did over the last step.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.base.units import powers_of
from cutbench.calibration.looked_for import visible
from cutbench.calibration.prediction import Prediction, Predictor, Task
from cutbench.case.case import Case
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


def across(
    inverse: Inverse, q: np.ndarray, found: Mapping[str, Prediction], only: Collection[str] | None = None
) -> dict[str, Prediction]:
    """``found`` at ``q`` by id, with differences in place of the exact derivatives of cuts, by the names
    ``only`` where these are given.

    Those of a rig, which no run depends on, stay; so does what no step could be computed for.
    """
    made = {**found}
    rig = {p.name for law in inverse.start.model.laws("rig") for p in law.parameters}
    cuts = [e for e in inverse.campaign.train if e.kind == "cut"]
    spared = {e.id: _spared(inverse, e, q) if only is None else None for e in cuts}
    asked: list[tuple[int, Experiment, Task, float]] = []
    for e in cuts:
        for k, u in enumerate(inverse.unknowns):
            if u.name not in inverse.names(e) or u.experiment not in (None, e.id) or u.name in rig:
                continue
            if u.name == spared[e.id] or (only is not None and u.name not in only):
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
            spared[e.id] = None
            continue
        p = made[e.id]
        column = p.names.index(inverse.unknowns[k].name)
        slopes, fields = p.slopes.copy(), p.field_slopes.copy()
        slopes[:, column] = (moved.y - p.y) / change
        if p.fields.size:
            fields[:, column] = (moved.fields - p.fields) / change
        made[e.id] = replace(p, slopes=slopes, field_slopes=fields)
    for id, name in spared.items():
        if name is not None:
            e = next(e for e in inverse.campaign.train if e.id == id)
            made[id] = _proportional(made[id], name, inverse.case(e, q))
    return made


def _spared(inverse: Inverse, e: Experiment, q: np.ndarray) -> str | None:
    """The parameter whose derivative follows from the others': where all with a force in their dimension that
    a cut depends on are looked for, the first of them in which it has power 1."""
    case, names, seen = inverse.case(e, q), inverse.names(e), visible(e, inverse.start)
    powers = force_powers(case)
    if any(case.values[name] for name in powers if name in seen and name not in names):
        return None
    return next((name for name in names if powers.get(name) == 1 and case.values[name]), None)


def force_powers(case: Case) -> dict[str, float]:
    """Powers of force in the dimension of the model's parameters, by name, where they are not 0."""
    units = {name: quantity.unit for name, quantity in case.model.parameters().items()}
    powers = {name: powers_of(unit)[0] for name, unit in units.items()}
    return {name: power for name, power in powers.items() if power}


def _proportional(p: Prediction, name: str, case: Case) -> Prediction:
    """``p`` with the derivative by ``name`` that makes its forces (m,) proportional to all that has the
    dimension of a force, and its displacements independent of it."""
    powers = force_powers(case)
    weights = np.array([powers.get(n, 0.0) * case.values[n] for n in p.names])
    column, slopes, fields = p.names.index(name), p.slopes.copy(), p.field_slopes.copy()
    others = np.arange(len(p.names)) != column
    slopes[:, column] = (p.y - slopes[:, others] @ weights[others]) / weights[column]
    if p.fields.size:
        fields[:, column] = -fields[:, others] @ weights[others] / weights[column]
    return replace(p, slopes=slopes, field_slopes=fields)


def tried(inverse: Inverse, tasks: Sequence[Task]) -> list[Prediction | None]:
    """None for those that fall short."""
    if isinstance(inverse.run, Predictor):
        return [p if isinstance(p, Prediction) else None for p in inverse.run.each(tasks)]
    try:
        return [*inverse.run(tasks)]
    except ComputationFailed:
        found: list[Prediction | None] = []
        for task in tasks:
            found.append(None)
            with suppress(ComputationFailed):
                (found[-1],) = inverse.run([task])
        return found


#: Values (k,) of the unknowns where predictions, by id, are known.
_Near = tuple[np.ndarray, Mapping[str, Prediction]]


def _step(
    inverse: Inverse, e: Experiment, near: _Near, q: np.ndarray
) -> tuple[np.ndarray, list[int], np.ndarray]:
    """The scaled way from ``near`` to ``q`` in what a test depends on, where its parts stand among the old
    prediction's names, and the scales."""
    values, found = near
    names = inverse.names(e)
    mine = [
        next(k for k, u in enumerate(inverse.unknowns) if u.name == name and u.experiment in (None, e.id))
        for name in names
    ]
    size = inverse.sizes(q)[mine]
    order = [found[e.id].names.index(name) for name in names]
    return (inverse.values(q) - values)[mine] / size, order, size


def carried(inverse: Inverse, e: Experiment, near: _Near, q: np.ndarray) -> Prediction:
    """What the derivatives of the ``near`` place say of ``q``."""
    step, order, size = _step(inverse, e, near, q)
    old = near[1][e.id]
    slopes, fields = old.slopes[:, order], old.field_slopes
    y, u = old.y + np.nan_to_num(slopes * size) @ step, old.fields
    if old.fields.size:
        fields = fields[:, order]
        u = u + np.nan_to_num(fields * size) @ step
    return replace(old, y=y, slopes=slopes, names=inverse.names(e), fields=u, field_slopes=fields)


def updated(inverse: Inverse, e: Experiment, plain: Prediction, near: _Near, q: np.ndarray) -> Prediction:
    """``plain`` at ``q`` with the slopes of the ``near`` place, changed so that they give what is new."""
    step, order, size = _step(inverse, e, near, q)
    old, names = near[1][e.id], inverse.names(e)

    def changed(slopes: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        scaled = slopes[:, order] * size
        if not step @ step > 0:
            return slopes[:, order]
        missed = after - before - scaled @ step
        return (scaled + np.outer(missed, step) / (step @ step)) / size

    fields = changed(old.field_slopes, old.fields, plain.fields) if plain.fields.size else old.field_slopes
    return replace(plain, slopes=changed(old.slopes, old.y, plain.y), names=names, field_slopes=fields)
