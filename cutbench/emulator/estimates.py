"""What runs would give, asked by people: of one case in words and pictures, of many at once as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cutbench.base.errors import require
from cutbench.base.units import parse_quantity
from cutbench.case.case import Case, case_of, warn_of_doubts
from cutbench.case.model import Model, apply_groups
from cutbench.case.numerics import KEYS
from cutbench.case.values import settable
from cutbench.emulator.atlas import MAX_DEPTH, Estimate, row_of, shipped, space_of

#: Changes that may be sequences, and are no points.
NO_NUMBERS = (
    *KEYS,
    "with",
    "with_",
    "without",
    "mechanisms",
    "motion",
    "outline",
    "numerics",
    "name",
    "until",
)


def estimate(
    source: Case | str | Path | Sequence[Case | str | Path],
    *,
    at_mm: Iterable[float] | None = None,
    derivatives_by: Iterable[str] = (),
    **changes: object,
) -> Estimate | xr.Dataset:
    """Estimate what runs would give from an atlas of earlier runs, without computing them.

    The atlas comes with the package; its runs are of the default model with ellipses, wedges and wires.

    Parameters
    ----------
    source : Case, str, Path or a sequence of these
        A case, a material's name, or a case file; several of one model.
    at_mm : array_like, shape (k,), mm, optional
        Travels at which the force is asked.
    derivatives_by : iterable of str, optional
        Parameters by which the numbers are differentiated.
    **changes : object
        What differs from the source, as ``run2d`` takes it. An array of plain numbers, a sequence of texts,
        or an array with its unit such as ``(speeds, "mm/s")`` makes a point of each of its values.

    Returns
    -------
    Estimate or xarray.Dataset
        Of one case its force, measures and regime with their intervals. Of several, or where travels or
        derivatives are asked, a table with a row a ``point``: ``onset_mm``, ``peak_N``, ``drop`` and
        ``steady_N`` with the ends of their 90 % intervals (``onset_low_mm`` and so on), the probabilities
        ``abrupt``, ``smooth`` and ``uncut``, ``verdict``; ``force_N`` at travels; ``onset_mm_by_G`` and so
        on, per unit in which the parameter is written. A point outside the atlas has nan, and ``outside``
        says of which groups.

    Raises
    ------
    BadInput
        For a source or a change that cannot be used.
    NotInAtlas
        If the atlas does not say.

    Examples
    --------
    >>> import cutbench
    >>> found = cutbench.estimate("gelatin", eta_reg="10 s")
    >>> found.verdict
    'smooth'
    >>> table = cutbench.estimate("gelatin", speed=([0.005, 0.02, 0.08], "mm/s"), derivatives_by=["G_c"])
    >>> [str(verdict) for verdict in table.verdict.values]
    ['abrupt', 'abrupt', 'smooth']
    >>> bool((table.onset_mm_by_G_c > 0).all())
    True
    """
    arrays = {
        n: v for n, v in changes.items() if n not in NO_NUMBERS and not np.isscalar(v) and v is not None
    }
    fixed = {name: value for name, value in changes.items() if name not in arrays}
    several = isinstance(source, (list, tuple))
    cases = [case_of(each, fixed) for each in (source if isinstance(source, (list, tuple)) else [source])]
    for case in cases:
        warn_of_doubts(case, 2)
    asked = [*derivatives_by]
    if not (several or arrays or asked) and at_mm is None:
        return shipped().estimate(cases[0])
    require(cases, "source", source, "at least one case")
    first, model = cases[0], cases[0].model
    for case in cases:
        require(case.mechanisms == model.mechanisms, "source", case.name, f"the model of {first.name}")
        space_of(case)  # its own groups are the atlas', too
    values: dict[str, Any] = {n: np.array([case.values[n] for case in cases]) for n in first.values}
    if not several:
        values |= {n: v[0] for n, v in values.items()}
    values = _changed(values, arrays, model)
    table = _numbers(first, values, at_mm)
    for name in asked:
        table |= _derivatives(first, values, at_mm, name)
    along: dict[str, Any] = {n: ("point", values[n] / q.factor) for n, q in model.parameters().items()
                             if np.ndim(values[n])}  # fmt: skip
    if at_mm is not None:
        along["displacement_mm"] = np.asarray(at_mm, dtype=float)
    return xr.Dataset(table, along)


def _changed(values: dict[str, Any], arrays: Mapping[str, Any], model: Model) -> dict[str, Any]:
    """Values with arrays of parameters and of groups. Raises BadInput."""
    known, by_group = model.parameters(), model.settable_groups()
    asked: dict[str, Any] = {}
    sizes = {np.size(v) for v in values.values() if np.ndim(v)}
    for name, given in arrays.items():
        require(name in settable(model), name, str(given)[:40], f"one of {', '.join(settable(model))}")
        q = known[name] if name in known else by_group[name].quantity
        plain, unit = given if isinstance(given, tuple) and isinstance(given[-1], str) else (given, q.unit)
        column = np.asarray(plain)
        if column.dtype.kind in "US":
            column = np.array([q.parse(str(text), key=name) for text in column])
        else:
            one = parse_quantity(f"1 {unit}", q.unit, key=name) if unit != "1" else 1.0
            expected = f"texts, or numbers with their unit, such as ([…], '{q.unit}')"
            require(unit == "1" or isinstance(given, tuple), name, str(given)[:40], expected)
            column = column.astype(float) * one * q.factor
        require(column.ndim == 1, name, str(given)[:40], "an array of one dimension")
        sizes.add(column.size)
        (values if name in known else asked)[name] = column
    require(len(sizes) <= 1, ", ".join(arrays), sorted(sizes), "arrays of one length")
    return apply_groups(values, asked, model)


def _numbers(case: Case, values: Mapping[str, Any], at_mm: Iterable[float] | None) -> dict[str, Any]:
    """Columns of a table, nan outside the atlas."""
    atlas, (space, units) = shipped(), space_of(case)
    own = units.length(values), units.force(values), values["depth"]
    sizes = np.atleast_1d(*own, *space.of_values(units, case.model, values))
    half, force, depth, *sides = np.broadcast_arrays(*sizes)
    held = np.stack([side.holds(column) for side, column in zip(space.ranges, sides, strict=True)], axis=1)
    inside, names = np.asarray(held.all(axis=1)), np.array([side.name for side in space.ranges])
    # Where it says nothing it is asked for the nearest, which nobody sees.
    nearest = [np.clip(column, s.low, s.high) for s, column in zip(space.ranges, sides, strict=True)]
    rows = np.stack(np.broadcast_arrays(*row_of(space, nearest)), axis=1)
    end = np.minimum(depth / half, MAX_DEPTH)
    m = atlas.measures(rows, end)
    columns: dict[str, np.ndarray] = {}
    for name, each in m.intervals(end, half, force, values["precut"]).items():
        measure, mark, unit = name.partition("_")
        columns |= {f"{measure}{part}{mark}{unit}": column
                    for part, column in zip(("", "_low", "_high"), each, strict=True)}  # fmt: skip
    odds = m.chances(end)
    verdict = np.array([*odds])[np.argmax([*odds.values()], axis=0)]
    table: dict[str, Any] = {
        n: ("point", np.where(inside, column, np.nan)) for n, column in (columns | odds).items()
    }
    table["verdict"] = "point", np.where(inside, verdict, "")
    table["outside"] = "point", [", ".join(names[~row]) for row in held]
    if at_mm is not None:
        forces = force[:, None] * atlas.forces(rows, m, np.asarray(at_mm, dtype=float) / half[:, None])
        table["force_N"] = ("point", "displacement_mm"), np.where(inside[:, None], forces, np.nan)
    return table


def _derivatives(
    case: Case, values: Mapping[str, Any], at_mm: Iterable[float] | None, name: str
) -> dict[str, Any]:
    """Of all numbers by a parameter, by central differences."""
    known = case.model.parameters()
    require(name in known, "derivatives_by", name, f"one of {', '.join(known)}")
    q, now = known[name], values[name]
    # The emulator is smooth, and rounding is 1e-12 of its values.
    size = 1e-4 * np.where(now == 0, q.typical * q.factor, np.abs(now))
    # Of what is off the difference is to one side.
    ends = [np.clip(now + way * size, *q.bounds) for way in (1, -1)]
    up, down = (_numbers(case, {**values, name: end}, at_mm) for end in ends)
    return {
        f"{n}_by_{name}": (dims, ((column - down[n][1]).T * q.factor / (ends[0] - ends[1])).T)
        for n, (dims, column) in up.items()
        if np.asarray(column).dtype.kind == "f"
    }
