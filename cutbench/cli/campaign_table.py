"""What a campaign holds, as a table to read and as a file of the averages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.table import Table
from rich.text import Text

from cutbench.base.files import csv_text, write_text
from cutbench.cli.show import PLAIN, table
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import Experiment

_HEADER = (
    "experiment", "kind", "role", "abscissa", "abscissa_unit", "x", "time_s", "ordinate_unit", "mean",
    "sd_of_mean", "sd_specimens", "sd_reading", "repetitions", "noise_estimated",
)  # fmt: skip


_COLUMNS = (
    "experiment", "kind", "role", "repetitions", "readings", "from", "to", "largest", "time",
    "between specimens", "noise on the grid",
)  # fmt: skip


def data_table(campaign: Campaign) -> Table:
    """A row for each experiment: what was done, how often, how far, and how far it scatters."""
    rows = []
    for e in campaign.experiments:
        if not e.curve:
            count, none = f"{e.readings} measures", ("–",) * 4
            rows.append((e.id, e.kind, e.role, "–", count, "0 mm", f"{e.reach:.4g} mm", *none))
            continue
        averaged = e.on_grid()
        unit = "" if e.x_unit == "1" else f" {e.x_unit}"
        low = min(float(r.x.min()) for r in e.repetitions)
        largest = max(float(np.abs(r.y).max()) for r in e.repetitions)
        size = float(np.sqrt(np.mean(averaged.mean**2)))
        scatter = f"{np.sqrt(np.mean(averaged.scatter**2)) / size:.1%}" if averaged.dof else "not known"
        reading = f"{np.sqrt(np.mean(averaged.reading**2)) / size:.2%}"
        rows.append((
            e.id, e.kind, e.role, str(len(e.repetitions)), str(e.readings), f"{low:.4g}{unit}",
            f"{e.reach:.4g}{unit}", f"{e.shown[0] * largest:.4g} {e.shown[1]}",
            _time(e), scatter, f"{reading} (estimated)" if averaged.estimated else reading,
        ))  # fmt: skip
    return table(_COLUMNS, rows, right=("repetitions", "readings"), title=Text(campaign.title), **PLAIN)


def _time(e: Experiment) -> str:
    if not e.timed:
        return "not known"
    unit = "1/s" if e.x_unit == "1" else "mm/s"
    history = "" if e.monotone else ", holds or returns"
    return f"{e.repetitions[0].duration_s:.4g} s at {e.travel_speed:.3g} {unit}{history}"


def write_data(campaign: Campaign, path: Path) -> Path:
    """The averages of all experiments on their grids as CSV, units in the columns."""
    rows: list[list[object]] = []
    for e in campaign.experiments:
        a = e.on_grid()
        for i, x in enumerate(a.x):
            time, scatter = None if a.time_s is None else a.time_s[i], a.scatter[i] if a.dof else None
            rows.append([
                e.id, e.kind, e.role, e.x_name, e.x_unit, x, time, e.y_unit, a.mean[i], a.deviation[i],
                scatter, a.reading[i], a.repetitions, int(a.estimated),
            ])  # fmt: skip
    return write_text(csv_text(_HEADER, rows), path)
