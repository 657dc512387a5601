"""``python -m benchmarks.refined MAP.nc [--random N] [--near N] [--columns N]``: a map against refined runs.

Runs of the map, N drawn at random and the N nearest to its line, are computed again with elements and steps
half as large: how far is each drop off, and which labels turn that the map does not call undecided? And in N
columns the line is sought by bisection with refined runs: how far off is it, in parts of the axis and in
octaves? Exit status 1 where a drop is more than 0.02 off, a label is wrong, or the line is off by more than
1/32 of its axis.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.tools import check_json, facts, here
from cutbench.base.errors import BadInput
from cutbench.base.files import write_json
from cutbench.maps.axes import Axis
from cutbench.maps.dataset import LABELS, axes_of, axis_of, case_on, load_map, places_of, regime_of, row_of
from cutbench.maps.uncertainty import refined
from cutbench.run.cutting import run2d
from cutbench.run.measures import ABRUPT, SMOOTH

#: Largest error of a drop, and of the line as part of its axis.
DROP, LINE = 0.02, 1 / 32
#: Halvings of the bracket by which the line is sought.
ROUNDS = 5


def again(job: tuple) -> dict:
    """A refined run at a place of a map: its label and drop as the map's regime has them."""
    data, place = job
    row = row_of(run2d(refined(case_on(data, place))), regime_of(data))
    return {"label": row.label, "drop": row.measures["drop_rel"], "message": row.message}


def chosen(data: xr.Dataset, drawn: int, near: int, seed: int) -> list[tuple[int, ...]]:
    """Runs of a map with a regime: some at random, and those nearest to the line."""
    at = np.argwhere(np.isin(data["label"].values, [LABELS.index(name) for name in LABELS[1:]]))
    known = [tuple(map(int, index)) for index in at if np.isfinite(data["drop_rel"].values[tuple(index)])]
    drop = np.array([max(float(data["drop_rel"].values[index]), 1e-4) for index in known])
    order = np.argsort(np.abs(np.log(drop / data.attrs["drop_threshold"])), kind="stable")
    some = np.random.default_rng(seed).permutation(len(known))[:drawn]
    return [known[k] for k in dict.fromkeys([*some.tolist(), *order[:near].tolist()])]


def crossings(data: xr.Dataset, axis: Axis) -> list[tuple[dict[str, float], float]]:
    """Columns along ``axis`` that the line crosses once: their place, and where it is drawn."""
    values = data[axis.name].values
    x = np.array([axis.place(v) for v in values])
    if "margin" in data:
        z = data["margin"]
    else:
        z = np.log(np.maximum(data["drop_rel"], 1e-3) / data.attrs["drop_threshold"])
    others = [name for name in axes_of(data) if name != axis.name]
    found = []
    for column in z.transpose(*others, axis.name).stack(column=others).transpose("column", axis.name):
        m = column.values
        turns = np.flatnonzero((m[:-1] >= 0) != (m[1:] >= 0))
        if len(turns) == 1 and np.isfinite(m).all():
            k = turns[0]
            place = {name: float(column[name].values) for name in others}
            found.append((place, float(x[k] + (x[k + 1] - x[k]) * m[k] / (m[k] - m[k + 1]))))
    return found


def line_error(data: xr.Dataset, axis: Axis, place: dict[str, float], at: float) -> dict:
    """Where refined runs have the line in a column, less where the map has it, in parts of the axis."""
    tried: dict[float, float] = {}

    def drop(x: float) -> float:
        x = min(max(x, 0.0), 1.0)
        if x not in tried:
            tried[x] = again((data, {**place, axis.name: axis.value(x)}))["drop"]
        return math.log(max(tried[x], 1e-3) / data.attrs["drop_threshold"])

    low, high = max(at - LINE, 0.0), min(at + LINE, 1.0)
    a, b = drop(low), drop(high)
    for _ in range(ROUNDS):  # until the bracket holds it
        if (a >= 0) != (b >= 0):
            break
        width = 2 * (high - low)
        middle = (low + high) / 2
        low, high = max(middle - width / 2, 0.0), min(middle + width / 2, 1.0)
        a, b = drop(low), drop(high)
    if (a >= 0) == (b >= 0):
        return {**place, "map": axis.value(at), "refined": math.nan, "off": math.inf, "runs": len(tried)}
    x = low + (high - low) * a / (a - b)
    return {**place, "map": axis.value(at), "refined": axis.value(x), "off": x - at, "runs": len(tried)}


def _column(job: tuple) -> dict:
    return line_error(*job)


def compared(data: xr.Dataset, indices: Sequence[tuple[int, ...]], workers: int) -> Iterator[dict]:
    """Each run beside its refined one."""
    places = places_of(data)
    jobs = [(data, {name: float(values[index]) for name, values in places.items()}) for index in indices]
    with ProcessPoolExecutor(workers) as pool:
        for index, (_, place), fine in zip(indices, jobs, pool.map(again, jobs), strict=True):
            label, drop = LABELS[int(data["label"].values[index])], float(data["drop_rel"].values[index])
            wrong = label in (ABRUPT, SMOOTH) and fine["label"] != label
            row = {**place, "label": label, "drop": drop, "fine": fine["drop"], "fine_label": fine["label"]}
            yield {**row, "off": drop - fine["drop"], "wrong": wrong}


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.refined", description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    for name, default in (("random", 20), ("near", 10), ("columns", 3), ("seed", 1), ("workers", 2)):
        parser.add_argument(f"--{name}", type=int, default=default, metavar="N")
    parser.add_argument("--axis", default="viscosity", help="along which columns run (default viscosity)")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    check_json(parser, asked.json)
    try:
        data = load_map(asked.map)
        if asked.axis not in axes_of(data):
            raise BadInput(key="--axis", value=asked.axis, expected=f"one of {', '.join(axes_of(data))}")
    except BadInput as error:
        parser.error(str(error))
    rows = []
    for row in compared(data, chosen(data, asked.random, asked.near, asked.seed), asked.workers):
        rows.append(row)
        print(
            "  ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()),
            flush=True,
        )
    axis = axis_of(data, asked.axis)
    columns = crossings(data, axis)
    spread = np.linspace(0, len(columns) - 1, min(asked.columns, len(columns))).round().astype(int)
    jobs = [(data, axis, *columns[k]) for k in dict.fromkeys(spread.tolist())]
    with ProcessPoolExecutor(asked.workers) as pool:
        lines = list(pool.map(_column, jobs))
    for line in lines:
        print("line:", "  ".join(f"{k} {v:.4g}" for k, v in line.items()), flush=True)
    off = max((abs(row["off"]) for row in rows), default=0.0)
    wrong = sum(row["wrong"] for row in rows)
    away = max((abs(line["off"]) for line in lines), default=0.0)
    print(
        f"{len(rows)} runs: drops within {off:.3f}, {wrong} labels wrong; {len(lines)} columns: line within"
        f" {away:.4f} of the axis ({away * octaves(axis):.2f} octaves)"
    )
    if asked.json is not None:
        write_json(
            {**here(), "machine": facts(), "map": data.attrs["title"], "runs": rows, "lines": lines},
            asked.json,
        )
    return 0 if off <= DROP and not wrong and away <= LINE else 1


def octaves(axis: Axis) -> float:
    """Length of an axis in octaves; nan where it is none of ratios."""
    low, high = axis.values[0], axis.values[-1]
    return math.log2(high / low) if low > 0 else math.nan


if __name__ == "__main__":
    sys.exit(main())
