"""Measured fields beside a run, as a table to read and files to keep."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from cutbench.base.files import csv_text, replacing, write_text
from cutbench.cli.show import PLAIN, table
from cutbench.data.field_comparison import Comparison
from cutbench.run.files import save

_HEADER = (
    "travel_mm", "x_mm", "y_mm", "measured_u_x_mm", "measured_u_y_mm", "computed_u_x_mm", "computed_u_y_mm",
    "relative_error_u_x", "relative_error_u_y", "measured_E_xx", "measured_E_yy", "measured_E_xy",
    "computed_E_xx", "computed_E_yy", "computed_E_xy",
)  # fmt: skip


def field_table(found: Sequence[Comparison], title: str) -> Table:
    """A row for each field: how many points, and how far off."""
    heads = [f"{what} {name}" for what in ("mean error", "rms") for name in ("u_x", "u_y")]
    heads = ["travel", "points compared", *heads, "rms E_xx", "rms E_yy", "rms E_xy"]
    rows = []
    for c in found:
        n = c.numbers()
        rows.append((
            f"{c.measured.travel_mm:g} mm", f"{n['compared']:.0f} of {n['measured']:.0f}",
            *(f"{n[f'mean_error_{name}']:.1%}" for name in ("u_x", "u_y")),
            *(f"{n[f'rms_{name}_mm']:.3g} mm" for name in ("u_x", "u_y")),
            *(f"{n[f'rms_{name}']:.3g}" for name in ("E_xx", "E_yy", "E_xy")),
        ))  # fmt: skip
    return table(heads, rows, right=heads, title=Text(title), **PLAIN)


def write_comparisons(found: Sequence[Comparison], title: str, folder: Path) -> list[Path]:
    """``dic.csv`` (a row a point), ``dic.json`` (the numbers) and a picture for each field."""
    from cutbench.data.figure import plot_dic

    paths = [folder / "dic.csv", folder / "dic.json"]
    rows: list[list[float]] = []
    for c in found:
        parts = [c.measured.grid, c.measured.u, c.computed.u, c.relative_error]
        parts += [e[[0, 1, 0], [0, 1, 1]] for e in (c.measured.strain, c.computed.strain)]
        table_of = np.concatenate(parts).reshape(len(_HEADER) - 1, -1).T
        rows += [[c.measured.travel_mm, *row] for row in table_of]
    write_text(csv_text(_HEADER, rows), paths[0])
    numbers = [{"travel_mm": c.measured.travel_mm, **c.numbers()} for c in found]
    with replacing(paths[1]) as draft:
        draft.write_text(json.dumps({"fields": numbers}, indent=2) + "\n", encoding="utf-8")
    for c in found:
        paths += save(plot_dic(c, title), folder / f"dic_{c.measured.travel_mm:.3f}mm.png")
    return paths
