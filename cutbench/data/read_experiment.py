"""One [[experiment]] of a campaign file: from what a person wrote and a machine recorded to an Experiment."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from glob import glob
from itertools import pairwise
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.base.toml import path_hint, written
from cutbench.data.columns import LABEL, did_you_mean
from cutbench.data.contact import TAKEN_OFF, contact_notes, direction, zeros_taken_off
from cutbench.data.experiment import HOMOGENEOUS, ROLES, Experiment, area_of
from cutbench.data.experiment_section import (
    SIZES,
    blade_of,
    by_repetition,
    choice,
    columns_of,
    factors_of,
    kind_of,
    mean_sizes,
    parse_either,
    pressure_of,
    require_sizes,
    size_notes,
    sizes_by_repetition,
    speed_of,
    units_of,
    ways_of,
    written_sizes,
)
from cutbench.data.fields import read_fields_of
from cutbench.data.measures import MeasuredCut, read_measures
from cutbench.data.plausible import check_steps, refuse_misread, travel_fits
from cutbench.data.repetition import SAME_SPEED, Repetition, by_speed, first_return
from cutbench.data.table import BLOCKS, Table, joined_files, read_table, with_blocks_read

#: What a cut has of which measures are known.
_KEYS_OF_MEASURES = (
    "id", "kind", "role", "source", "measures", "depth", "data", "columns", "units", "specimen", "blade",
    "speed", "angle", "slice_push",
)  # fmt: skip


def read_experiments(table: Mapping[str, object], folder: Path) -> list[Experiment]:
    """The experiment that ``table`` describes, with its data from files beside ``folder``; one for each speed
    where specimens were tested at speeds far apart.

    Raises BadInput; where the fault is in a data file, the error names that file and its line.
    """
    kind = kind_of(table)
    raw = table.get("id")
    name = written("id", raw, "a name, such as id = 'slow'")
    role = choice(table, "role", ROLES, "train")
    sizes = written_sizes(table, "specimen", SIZES[kind], several=kind != "cut")
    source = table.get("source", "")
    require(isinstance(source, str), "source", source, "a text in quotes")
    notes = [f"source: {source}"] if source else []
    if "measures" in table:
        return [_measured(table, folder, name, role, sizes, notes)]
    columns = columns_of(table, kind)
    require_sizes(kind, sizes, columns)
    angle, slice_push = ways_of(table)
    blade, factors = blade_of(table, kind), factors_of(table, columns)
    tables = _tables(table, columns, folder)
    titles = [title for read in tables for title in read.names]
    for title, count in Counter(titles).items():
        require(count == 1, LABEL, title, "each repetition in one file only")
    own = sizes_by_repetition(sizes, titles)
    specimen = mean_sizes(list(own.values()))
    speed = speed_of(table, kind, specimen)
    pressure = pressure_of(table, columns, specimen) if kind == "sliding" else 0.0
    zeros = {key: by_repetition(key, table[key], titles) for key in TAKEN_OFF if key in table}
    repetitions = []
    for read in tables:
        for title in read.names:
            asked = {**table, **{key: values[title] for key, values in zeros.items()}}
            rows = read.rows(read.labels == title)
            repetitions.append(_repetition(rows, kind, title, asked, own[title], speed, factors))
    stress = choice(table, "stress", ("nominal", "cauchy"), "nominal")
    strain = choice(table, "strain", ("engineering", "true"), "engineering")
    free = kind == "sliding" and not pressure and not {"pressure", "normal_force"} & columns.keys()
    said = {
        "Cauchy stress turned into nominal stress at constant volume, P = σ/λ": stress == "cauchy",
        "true strain turned into stretch, λ = exp(ε)": strain == "true",
        **dict.fromkeys((note for read in tables for note in read.notes), True),
        "no pressure given: 0, so that only adhesion resists": free,
    }
    notes += [note for note, holds in said.items() if holds]
    fields, noise_mm = read_fields_of(table["fields"], folder) if "fields" in table else ((), 0.0)
    notes += dict.fromkeys(note for field in fields for note in field.notes)
    refuse_misread(kind, repetitions, table)
    direction = choice(table, "direction", ("opening", "sliding"), "opening")
    groups = [repetitions] if "speed" in table else by_speed(repetitions)
    if len(groups) > 1:
        expected = "an experiment of one speed beside it"
        require(not fields, "fields", f"tests at {len(groups)} speeds", expected)
        notes.append(f"specimens went at speeds far apart, and '{name}' is read as {len(groups)} tests")

    def experiment(group: Sequence[Repetition]) -> Experiment:
        mean = mean_sizes([own[r.name] for r in group])
        pressed = all(r.x.max() <= 1.01 for r in group)
        every = (*notes, *contact_notes(group), *size_notes(kind, sizes, mean, pressed))
        unit = "1/s" if kind in HOMOGENEOUS else "mm/s"
        id = name if len(groups) == 1 else f"{name} at {group[0].speed:.3g} {unit}"
        e = Experiment(
            id, kind, tuple(group), role, mean, blade, speed, pressure, direction, every, fields, noise_mm,
            angle=angle, slice_push=slice_push,
        )  # fmt: skip
        if kind == "cut":
            travel_fits(e)
        # A factor of 60 is a minute taken for a second.
        expected = (
            f"the speed of the readings, {e.travel_speed:.4g} {unit}; with a time column it may be left out"
        )
        agrees = speed is None or not e.timed or 1 / 3 < e.travel_speed / speed < 3
        require(agrees, "speed", f"{speed or 0.0:.4g} {unit}", expected)
        return e

    return [experiment(group) for group in groups]


def _measured(
    table: Mapping, folder: Path, name: str, role: str, sizes: Mapping, notes: Sequence[str]
) -> MeasuredCut:
    """A cut of which no curve is known."""
    for key, raw in table.items():
        require(key in _KEYS_OF_MEASURES, key, raw, "it beside a curve, not beside measures")
    require_sizes("cut", sizes, {})
    measures, depth_mm, more = read_measures(table, folder)
    speed, blade = speed_of(table, "cut", {}), blade_of(table, "cut")
    made = MeasuredCut.of(name, measures, depth_mm, sizes, blade, speed, role, (*notes, *more))
    angle, slice_push = ways_of(table)
    return replace(made, angle=angle, slice_push=slice_push)


# -- the files of the readings ------------------------------------------------------------------------
def _tables(table: Mapping, columns: Mapping, folder: Path) -> list[Table]:
    """The readings of each file, or of several that follow one another, labelled by repetition. Raises
    BadInput."""
    units, blocks, skip = units_of(table, columns), choice(table, "blocks", BLOCKS, ""), table.get("skip", [])
    skip = [skip] if isinstance(skip, str) else skip
    good = isinstance(skip, list) and all(isinstance(text, str) and text.strip() for text in skip)
    require(good, "skip", skip, "how lines that are no readings begin, such as skip = ['Mean', 'Maximum']")
    files = _files(table, folder)
    tables = []
    for paths in files:
        parts = [read_table(path, columns, units, wide=True, skip=skip) for path in paths]
        tables.append(joined_files([with_blocks_read(part, blocks) for part in parts]))
    _refuse_consecutive_files(tables)
    several = len(files) > 1
    return [read.called(paths[0].stem if several else "") for read, paths in zip(tables, files, strict=True)]


def _files(table: Mapping, folder: Path) -> list[list[Path]]:
    """The files of each specimen, one or several that follow one another."""
    data = table.get("data")
    specimens: list[list[str]] = []
    for entry in data if isinstance(data, list) else [data]:
        parts = entry if isinstance(entry, list) else [entry]
        expected = (
            "a file beside this one, such as data = 'slow.csv', a list of files, one a specimen, or, for"
            " files of one specimen that follow one another, data = [['ramp.csv', 'hold.csv']]"
        )
        good = parts and all(isinstance(name, str) and name.strip() for name in parts)
        require(good, "data", data, expected)
        files = [file for name in parts for file in _matching(str(name), folder)]
        specimens += [files] if isinstance(entry, list) else [[file] for file in files]
    every = [file for files in specimens for file in files]
    require(len(set(every)) == len(every), "data", every, "each file once")
    return [[folder / name for name in files] for files in specimens]


def _refuse_consecutive_files(tables: list[Table]) -> None:
    """Raise BadInput where a file begins at the travel at which the one before it ends: they follow one
    another, and are no specimens."""
    names = [read.path.name for read in tables]
    for role in ("displacement", "stretch", "strain"):
        for one, other in pairwise(tables):
            if role not in one.columns or one.labelled or one.lines.size < 2:
                continue
            x, begins = one.columns[role], other.columns[role][0]
            expected = (
                f"data = [{names}], files of one specimen that follow one another: {other.path.name}"
                f" begins where {one.path.name} ends; a plain list is a specimen a file"
            )
            follows = abs(begins - x[0]) > 0.5 * np.ptp(x) and abs(begins - x[-1]) < 0.02 * np.ptp(x)
            require(not follows, "data", names, expected)


def _matching(name: str, folder: Path) -> list[str]:
    """The file called ``name``, or those that match it as a pattern such as cut_*.csv, by their numbers."""
    if (folder / name).is_file():
        return [name]
    files = [file for file in glob(name, root_dir=folder) if (folder / file).is_file()]
    if not files:
        others = sorted(path.name for path in folder.iterdir() if path.is_file() and path.suffix != ".toml")
        listed = ", ".join(others[:12]) + ", …" * (len(others) > 12)
        beside = f"; there are {listed}" if others else ", which has none"
        hint = path_hint(name) or did_you_mean(name, others)
        raise BadInput("data", name, f"a file that exists in {folder}{beside}{hint}")
    return sorted(files, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file)])


# -- from recorded columns to readings -----------------------------------------------------------------
def _repetition(
    table: Table, kind: str, title: str, written: Mapping, specimen: Mapping[str, float],
    speed: float | None, factors: Mapping[str, float],
) -> Repetition:  # fmt: skip
    """The readings of one specimen."""
    if table.clock:
        table = table.having(time=table.columns["time"] - table.columns["time"][0])
    check_steps(table.columns, table.files, table.lines)
    length = specimen.get("length", 1.0) if kind in HOMOGENEOUS else 1.0
    area = (area_of(kind, specimen) or 1.0) if kind != "cut" else 1.0
    if "speed" in table.columns:
        speeds = np.abs(table.columns["speed"])
        value, line = f"{speeds.max():g} mm/s", int(table.lines[speeds.argmax()])
        expected = "one speed in each repetition; a column of time says more"
        require(speeds.max() <= SAME_SPEED * speeds.min(), "speed", value, expected, table.files[0], line)
        speed = speeds.mean() / length
    table, contact = zeros_taken_off(table, written, factors, title)
    here = table.columns
    rest = float(kind in HOMOGENEOUS)
    abscissa: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "stretch": lambda stretch: stretch,
        "strain": lambda strain: 1 + strain,
        "displacement": lambda u: rest + u / length,
        "time": lambda t: (speed or 0.0) * (t - t[0]),
    }
    role = next(role for role in abscissa if role in here)
    expected = "the sliding speed, or a column of displacement"
    require(role != "time" or speed is not None, "speed", None, expected)
    x = abscissa[role](here[role])
    y = here["stress"] if "stress" in here else here["force"] / area
    if written.get("strain") == "true":
        x = np.exp(x - 1)
    if written.get("stress") == "cauchy":
        y = y / np.where(x > 0, x, np.nan)
    if "normal_force" in here:
        table = table.having(pressure=here["normal_force"] / area)
    first = contact.first if contact is not None and "zero" in written else 0
    keep = _selected_readings(written, kind, x, first, length if "displacement" in here else None)
    table = table.having(x=x, y=y).rows(keep)
    x, time = table.columns["x"], table.columns.get("time")
    if time is None and speed is not None and not (kind == "cut" and first_return(x) is not None):
        way = np.cumsum(np.append(abs(x[0] - rest), np.abs(np.diff(x))))
        # Equal abscissas, as coarse sensors give them, need times that differ.
        time = (way + 1e-9 * way[-1] * np.arange(x.size)) / speed
    scales = {"displacement": length, "force": area}
    channels = {
        role: replace(channel, factor=factors.get(role), scale=scales.get(role, 1.0))
        for role, channel in table.channels.items()
    }
    y, pressure = table.columns["y"], table.columns.get("pressure")
    file = table.files[0] if len(set(table.files)) == 1 else tuple(table.files)
    return Repetition(x, y, time, title, pressure, file, table.lines, contact, channels)


def _selected_readings(
    written: Mapping, kind: str, x: np.ndarray, first: int, length: float | None
) -> np.ndarray:
    """The readings (k,) that count: from contact on, on the way out that begins with reading ``first``, where
    that is known, from ``from`` up to the first beyond ``until``, which is ``return`` for the farthest.
    Raises BadInput if none are left, or ``until`` is far from all."""
    way, strained = direction(x[first:]), kind in HOMOGENEOUS
    out = way * (x - strained)
    far = f"they go to {x[np.argmax(out)]:.4g}{'' if strained else ' mm'}"
    if strained and length is not None:
        far += f", a displacement of {length * out.max():.4g} mm"
    far += " from contact" * ("zero" in written)

    def place(key: str) -> float:
        """How far from rest; in a test whose file has displacements these, too."""
        moved = "1" if strained and length is None else "mm"
        value, unit = parse_either(written[key], moved, "1" if strained else "mm", key)
        return abs(value) / length if strained and length and unit == "mm" else way * (value - strained)

    keep = np.arange(x.size)
    if written.get("until") == "return":
        keep = keep[: first + int(np.argmax(out[first:])) + 1]
    elif "until" in written:
        end = place("until")
        near = end <= 1.5 * out.max()
        require(near, "until", written["until"], f"a place that the readings reach; {far}")
        keep = keep[: int(np.argmax(out > end)) if out.max() > end else x.size]
    if "from" in written:
        reached = out[keep] >= place("from")
        keep = keep[int(np.argmax(reached)) :] if reached.any() else keep[:0]
    if "zero" in written:
        keep = keep[(out[keep] >= 0) & (keep >= first)]
    for key in (key for key in ("from", "until", "zero") if key in written):
        require(keep.size, key, written[key], f"a place that leaves readings; {far}")
    return keep
