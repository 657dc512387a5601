"""One [[experiment]] of a campaign file: from what a person wrote and a machine recorded to an Experiment."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from glob import glob
from itertools import pairwise
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput, in_short
from cutbench.base.toml import among, nearest, one_of, path_hint, written
from cutbench.base.units import parse_quantity
from cutbench.data.contact import contact_notes
from cutbench.data.conversion import TAKEN_OFF, repetitions_of, titles_of
from cutbench.data.experiment import HOMOGENEOUS, ROLES, Experiment, area_of
from cutbench.data.experiment_kinds import (
    ABSCISSA,
    ORDINATE,
    SIZES,
    blade_units,
    by_repetition,
    kind_of,
    mean_sizes,
    require_sizes,
    section_of,
    size_notes,
    sizes_by_repetition,
    written_sizes,
)
from cutbench.data.fields import read_fields_of
from cutbench.data.layout import LABEL, UNITS
from cutbench.data.measured import MeasuredCut, read_measured
from cutbench.data.plausible import refuse_misread, travel_fits
from cutbench.data.repetition import by_speed
from cutbench.data.table import BLOCKS, Table, joined_files, read_table, with_blocks_read

#: Other names under which a column may be given.
_ALIASES = {"opening": "displacement", "slip": "displacement", "traction": "stress"}
#: What a cut has of which measures are known.
_KEYS_OF_MEASURES = (
    "id", "kind", "role", "source", "measures", "depth", "data", "columns", "units", "specimen", "blade",
    "speed",
)  # fmt: skip
#: Files of a folder that a message names.
_MAX_FILES_SHOWN = 12


def read_experiments(table: Mapping[str, object], folder: Path) -> list[Experiment]:
    """The experiment that ``table`` describes, with its data from files beside ``folder``; one for each speed
    where specimens were tested at speeds far apart.

    Raises BadInput; where the fault is in a data file, the error names that file and its line.
    """
    kind = kind_of(table)
    name = table.get("id")
    name = written("id", name, "a name, such as id = 'slow'", value=in_short(name))
    role = _choice(table, "role", ROLES, "train")
    sizes = written_sizes(table, "specimen", SIZES[kind], several=kind != "cut")
    if "measures" in table:
        return [_measured(table, folder, name, role, sizes)]
    columns = _columns(table, kind)
    require_sizes(kind, sizes, columns)
    blade = _blade(table, kind)
    units, factors = _units(table, columns), _factors(table, columns)
    blocks = _choice(table, "blocks", BLOCKS) if "blocks" in table else None
    skip = table.get("skip", [])
    skip = [skip] if isinstance(skip, str) else skip
    if not isinstance(skip, list) or not all(isinstance(text, str) and text.strip() for text in skip):
        expected = "how lines that are no readings begin, such as skip = ['Mean', 'Maximum']"
        raise BadInput(key="skip", value=str(skip)[:60], expected=expected)
    tables = [
        (
            joined_files(
                [with_blocks_read(read_table(p, columns, units, wide=True, skip=skip), blocks) for p in paths]
            ),
            label,
        )
        for paths, label in _files(table, folder)
    ]
    _refuse_consecutive_files([read for read, _ in tables])
    titles = [title for read, label in tables for title in titles_of(read, label).values()]
    for label, count in Counter(titles).items():
        if count > 1:
            raise BadInput(key=LABEL, value=label, expected="each repetition in one file only")
    own = sizes_by_repetition(sizes, titles)
    specimen = mean_sizes(list(own.values()))
    speed = _speed(table, kind, specimen)
    pressure = _pressure(table, columns, specimen) if kind == "sliding" else 0.0
    zeros = {key: by_repetition(key, table[key], titles) for key in TAKEN_OFF if key in table}
    repetitions = [
        r
        for read, label in tables
        for r in repetitions_of(read, kind, label, table, own, speed, factors, zeros)
    ]
    source = table.get("source", "")
    if not isinstance(source, str):
        raise BadInput(key="source", value=str(source)[:60], expected="a text in quotes")
    notes: tuple[str, ...] = (f"source: {source}",) if source else ()
    if _choice(table, "stress", ("nominal", "cauchy"), "nominal") == "cauchy":
        notes += ("Cauchy stress turned into nominal stress at constant volume, P = σ/λ",)
    if _choice(table, "strain", ("engineering", "true"), "engineering") == "true":
        notes += ("true strain turned into stretch, λ = exp(ε)",)
    for read, _ in tables:
        if len(read.specimens) > 1:
            notes += (f"{read.path.name} holds specimens side by side: {', '.join(read.specimens)}",)
        notes += read.notes
    if kind == "sliding" and not pressure and not {"pressure", "normal_force"} & columns.keys():
        notes += ("no pressure given: 0, so that only adhesion resists",)
    fields, noise_mm = read_fields_of(table["fields"], folder) if "fields" in table else ((), 0.0)
    notes += tuple(dict.fromkeys(note for field in fields for note in field.notes))
    refuse_misread(kind, repetitions, table)
    direction = _choice(table, "direction", ("opening", "sliding"), "opening")
    groups = [repetitions] if "speed" in table else by_speed(repetitions)
    if len(groups) > 1:
        if fields:
            expected = "an experiment of one speed beside it"
            raise BadInput(key="fields", value=f"tests at {len(groups)} speeds", expected=expected)
        notes += (f"specimens went at speeds far apart, and '{name}' is read as {len(groups)} tests",)
    made = []
    for group in groups:
        sized = mean_sizes([own[r.name] for r in group])
        its_own = contact_notes(group) + size_notes(kind, sizes, sized, all(r.x.max() <= 1.01 for r in group))
        unit = "1/s" if kind in HOMOGENEOUS else "mm/s"
        called = name if len(groups) == 1 else f"{name} at {group[0].speed:.3g} {unit}"
        made.append(
            Experiment(
                called, kind, tuple(group), role, sized, blade, speed, pressure, direction, notes + its_own,
                fields, noise_mm,
            )
        )  # fmt: skip
        if kind == "cut":
            travel_fits(made[-1])
        _check_speed(made[-1])
    return made


def _measured(table: Mapping, folder: Path, name: str, role: str, sizes: Mapping) -> MeasuredCut:
    """A cut of which no curve is known."""
    for key in table:
        if key not in _KEYS_OF_MEASURES:
            expected = "it beside a curve, not beside measures"
            raise BadInput(key=key, value=in_short(table[key]), expected=expected)
    require_sizes("cut", sizes, {})
    measures, depth_mm, notes = read_measured(table, folder)
    speed = _speed(table, "cut", {})
    source = table.get("source", "")
    notes = ((f"source: {source}",) if source else ()) + notes
    return MeasuredCut.of(name, measures, depth_mm, sizes, _blade(table, "cut"), speed, role, notes)


# -- what a person wrote ----------------------------------------------------------------------------
def _blade(table: Mapping, kind: str) -> dict[str, float]:
    sharp = written_sizes(table, "blade", blade_units().keys() if kind == "cut" else ())
    blade = {key: size for key, size in sharp.items() if isinstance(size, float)}
    if kind == "cut" and "thickness" not in blade:
        raise BadInput(key="blade.thickness", value="(missing)", expected="blade = { thickness = '0.7 mm' }")
    return blade


def _choice(table: Mapping, key: str, known: tuple[str, ...], default: str | None = None) -> str:
    value = table.get(key, default)
    among(key, value, known, value=in_short(value))
    return str(value)


def _columns(table: Mapping, kind: str) -> dict[str, str | int | list[str | int]]:
    """Column by role, or one for each specimen; without ``columns`` they are looked for by their roles."""
    optional = ("time", "speed", LABEL) + (("pressure", "normal_force") if kind == "sliding" else ())
    known = (*ABSCISSA[kind], *ORDINATE[kind], *optional)
    given = section_of(table, "columns")
    found: dict[str, str | int | list[str | int]] = {}
    for key, name in given.items():
        role = _ALIASES.get(key, key) if kind not in ("cut", *HOMOGENEOUS) else key
        if role not in known:
            raise BadInput(key=f"columns.{key}", value=str(name)[:60], expected=one_of(key, known))
        listed = name if isinstance(name, list) and role != LABEL else [name]
        if not listed or not all(_is_column(one) for one in listed):
            expected = "the column's name in the header, or its number from 1"
            raise BadInput(key=f"columns.{key}", value=str(name)[:60], expected=expected)
        found[role] = name
    counts = {key: len(name) for key, name in given.items() if isinstance(name, list)}
    for key, count in counts.items():
        if LABEL in found or count != max(counts.values()):
            expected = f"a column for each specimen, {max(counts.values())} in every list, and no repetition"
            raise BadInput(key=f"columns.{key}", value=str(given[key])[:60], expected=expected)
    if not given:
        found = {ABSCISSA[kind][0]: ABSCISSA[kind][0], ORDINATE[kind][0]: ORDINATE[kind][0]}
    for what, choices in (("x", ABSCISSA[kind]), ("y", ORDINATE[kind])):
        named = [role for role in choices if role in found]
        if len(named) > 1:
            expected = f"it or {named[0]}, not both"
            raise BadInput(key=f"columns.{named[1]}", value=str(found[named[1]]), expected=expected)
        if not named and not (what == "x" and kind == "sliding" and "time" in found):
            expected = f"a column of {' or '.join(choices)}"
            raise BadInput(key=f"columns.{choices[0]}", value="(missing)", expected=expected)
    return found


def _is_column(name: object) -> bool:
    return bool(name.strip()) if isinstance(name, str) else type(name) is int and name >= 1


def _speed(table: Mapping, kind: str, specimen: Mapping[str, float]) -> float | None:
    """mm/s; for a homogeneous test 1/s of stretch, for which a speed is divided by the length."""
    if "speed" not in table:
        return None
    raw, rate = table["speed"], None
    if kind in HOMOGENEOUS:
        with suppress(BadInput):
            rate = parse_quantity(raw, "1/s", key="speed")
    if rate is None:
        rate = parse_quantity(raw, "mm/s", key="speed")
        if kind in HOMOGENEOUS:
            if "length" not in specimen:
                expected = "specimen.length beside it, or a rate such as '0.1 1/s'"
                raise BadInput(key="speed", value=str(raw), expected=expected)
            rate /= specimen["length"]
    if not (np.isfinite(rate) and rate > 0):
        raise BadInput(key="speed", value=str(raw), expected="a speed above 0, such as '0.02 mm/s'")
    return rate


def _by_role(table: Mapping, section: str, columns: Mapping) -> Iterator[tuple[str, str, object]]:
    """Full key, role of the column and what is written, for each entry of ``section``. Raises BadInput."""
    known = [name for name in columns if name != LABEL]
    for key, raw in section_of(table, section).items():
        role = _ALIASES[key] if _ALIASES.get(key) in columns else key
        among(f"{section}.{key}", role, known, value=str(raw)[:60])
        yield f"{section}.{key}", role, raw


def _units(table: Mapping, columns: Mapping) -> dict[str, str]:
    found = {}
    for key, role, unit in _by_role(table, "units", columns):
        expected = f"a unit in quotes, such as '{UNITS[role]}'"
        found[role] = written(key, unit, expected, value=str(unit)[:60])
    return found


def _factors(table: Mapping, columns: Mapping) -> dict[str, float]:
    found = {}
    for key, role, raw in _by_role(table, "factors", columns):
        found[role] = parse_quantity(raw, "1", key=key)
        if not np.isfinite(found[role]) or found[role] == 0:
            raise BadInput(key=key, value=str(raw), expected="a factor other than 0, such as -1")
    return found


def _pressure(table: Mapping, columns: Mapping, specimen: Mapping[str, float]) -> float:
    given = [k for k in ("pressure", "normal_force") if k in table or k in columns]
    if len(given) > 1 or any(k in table and k in columns for k in given):
        expected = "the pressure once: as value or as column"
        raise BadInput(key=given[-1], value="given twice", expected=expected)
    if "pressure" in table:
        value = parse_quantity(table["pressure"], "MPa", key="pressure")
    elif "normal_force" in table:
        area = area_of("sliding", specimen)
        if area is None:
            raise BadInput(key="specimen.area", value="(missing)", expected="specimen = { area = '… mm^2' }")
        value = parse_quantity(table["normal_force"], "N", key="normal_force") / area
    else:
        return 0.0
    if not (np.isfinite(value) and value >= 0):
        raise BadInput(key=given[0], value=str(table[given[0]]), expected="0 or more")
    return value


def _files(table: Mapping, folder: Path) -> list[tuple[list[Path], str | None]]:
    """The files of each specimen, one or several that follow one another, and its name if there are several
    specimens."""
    data = table.get("data")
    entries = data if isinstance(data, list) else [data]
    found: list[list[str]] = []
    for entry in entries:
        parts = entry if isinstance(entry, list) else [entry]
        if not parts or not all(isinstance(name, str) and name.strip() for name in parts):
            expected = (
                "a file beside this one, such as data = 'slow.csv', a list of files, one a specimen, or, for"
                " files of one specimen that follow one another, data = [['ramp.csv', 'hold.csv']]"
            )
            raise BadInput(key="data", value=in_short(data), expected=expected)
        files = [file for name in parts for file in _matching(str(name), folder)]
        found += [files] if isinstance(entry, list) else [[file] for file in files]
    every = [file for files in found for file in files]
    if len(set(every)) < len(every):
        raise BadInput(key="data", value=str(every)[:200], expected="each file once")
    several = len(found) > 1
    return [([folder / name for name in files], Path(files[0]).stem if several else None) for files in found]


def _refuse_consecutive_files(tables: list[Table]) -> None:
    """Raise BadInput where a file begins at the travel at which the one before it ends: they follow one
    another, and are no specimens."""
    for role in ("displacement", "stretch", "strain"):
        for one, other in pairwise(tables):
            if role not in one.columns or one.labels is not None or one.lines.size < 2:
                continue
            x, begins = one.columns[role], other.columns[role][0]
            if abs(begins - x[0]) > 0.5 * np.ptp(x) and abs(begins - x[-1]) < 0.02 * np.ptp(x):
                names = [read.path.name for read in tables]
                expected = (
                    f"data = [{names}], files of one specimen that follow one another: {other.path.name}"
                    f" begins where {one.path.name} ends; a plain list is a specimen a file"
                )
                raise BadInput(key="data", value=str(names)[:60], expected=expected)


def _matching(name: str, folder: Path) -> list[str]:
    """The file called ``name``, or those that match it as a pattern such as cut_*.csv, by their numbers."""
    if (folder / name).is_file():
        return [name]
    found = [file for file in glob(name, root_dir=folder) if (folder / file).is_file()]
    if not found:
        there = sorted(path.name for path in folder.iterdir() if path.is_file() and path.suffix != ".toml")
        shown = ", ".join(there[:_MAX_FILES_SHOWN]) + (", …" if len(there) > _MAX_FILES_SHOWN else "")
        guess = nearest(name, there)
        expected = (
            f"a file that exists in {folder}" + (f"; there are {shown}" if there else ", which has none")
        ) + (path_hint(name) or f"; did you mean '{guess}'?" * bool(guess))
        raise BadInput(key="data", value=name, expected=expected)
    return sorted(found, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file)])


def _check_speed(e: Experiment) -> None:
    """The written speed against that of the time column: a factor of 60 is a minute taken for a second."""
    if e.speed is None or not e.timed:
        return
    moved = e.travel_speed
    if not 1 / 3 < moved / e.speed < 3:
        unit = "1/s" if e.kind in HOMOGENEOUS else "mm/s"
        expected = f"the speed of the readings, {moved:.4g} {unit}; with a time column it may be left out"
        raise BadInput(key="speed", value=f"{e.speed:.4g} {unit}", expected=expected)
