"""One [[experiment]] of a campaign file: from what a person wrote and a machine recorded to an Experiment."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.toml import among, located, one_of, written
from cutbench.base.units import parse_quantity
from cutbench.data.contact import contact_notes
from cutbench.data.conversion import TAKEN_OFF, repetitions_of
from cutbench.data.experiment import HOMOGENEOUS, KINDS, ROLES, Experiment, area_of
from cutbench.data.fields import read_fields_of
from cutbench.data.layout import LABEL
from cutbench.data.plausible import travel_fits
from cutbench.data.table import read_table
from cutbench.data.titles import UNITS

#: Other names under which a column may be given.
_ALIASES = {"opening": "displacement", "slip": "displacement", "traction": "stress"}
#: Columns that give the abscissa and the ordinate, by kind: exactly one of each.
_ABSCISSA = {
    **dict.fromkeys(HOMOGENEOUS, ("displacement", "stretch", "strain")),
    **dict.fromkeys(("cut", "sliding", "separation"), ("displacement",)),
}
_ORDINATE = {"cut": ("force",), **dict.fromkeys((*HOMOGENEOUS, "sliding", "separation"), ("force", "stress"))}
_SPECIMEN = {
    "cut": ("width", "length", "height", "precut"),
    **dict.fromkeys(HOMOGENEOUS, ("length", "area", "diameter", "width", "thickness")),
    "sliding": ("area", "diameter", "length", "width"),
    "separation": ("area", "diameter", "length", "width"),
}
#: What tests are called elsewhere, and what they are here.
_MEANT = {
    "cutting": "cut",
    **dict.fromkeys(("tension", "tensile"), "uniaxial"),
    **dict.fromkeys(
        ("compression", "compressive"),
        "uniaxial, with factors = { displacement = -1, force = -1 } if the machine counts down as positive",
    ),
    "biaxial": "equibiaxial",
    "friction": "sliding",
    "planar": "pure_shear",
}
_EVERY = (
    "id", "kind", "data", "columns", "units", "factors", "specimen", "speed", "role", "from", "until",
    "source",
)  # fmt: skip
_EXTRA = {
    "cut": ("blade", "fields", "zero", "force_zero"),
    **dict.fromkeys(HOMOGENEOUS, ("stress", "zero", "force_zero")),
    "sliding": ("pressure", "normal_force"),
    "separation": ("direction", "zero", "force_zero"),
}


@contextmanager
def placed(file: Path, text: str, number: int) -> Iterator[None]:
    """Errors inside without a file get this one and the line of their key in the ``number``-th experiment."""
    with located(file, text, find=lambda key: _line(text, key, number)):
        yield


def _line(text: str, key: str, number: int) -> int | None:
    """Line of ``key`` within the ``number``-th [[experiment]] (from 0); else of its opening."""
    lines = text.splitlines()
    heads = [i for i, line in enumerate(lines) if re.match(r"\s*\[\[\s*[\"']?experiment[\"']?\s*\]\]", line)]
    if number >= len(heads):
        return None
    end = heads[number + 1] if number + 1 < len(heads) else len(lines)
    section, _, name = key.rpartition(".")

    def first(word: str, begin: int, stop: int) -> int | None:
        pattern = re.compile(rf"(^|[\s{{,.\[]){re.escape(word)}[\"']?\s*(=|\.|\])")
        return next((i for i in range(begin, stop) if pattern.search(lines[i].split("#")[0])), None)

    opened = first(section, heads[number] + 1, end) if section else heads[number]
    if opened is None:
        return heads[number] + 1
    # A table in one line, or its own section up to the next.
    stop = end if lines[opened].lstrip().startswith("[") else opened + 1
    found = first(name, opened, stop)
    return (opened if found is None else found) + 1


def read_experiment(table: Mapping[str, object], folder: Path) -> Experiment:
    """The experiment that ``table`` describes, with its data from files beside ``folder``.

    Raises BadInput; where the fault is in a data file, the error names that file and its line.
    """
    if (meant := _MEANT.get(str(table.get("kind")).lower())) is not None:
        raise BadInput(key="kind", value=str(table["kind"]), expected=meant)
    kind = _choice(table, "kind", KINDS)
    for key in table:
        if key not in (*_EVERY, *_EXTRA[kind]):
            owners = [k for k, keys in _EXTRA.items() if key in keys]
            expected = one_of(key, (*_EVERY, *_EXTRA[kind]))
            if owners:
                expected = f"it in a test of kind {' or '.join(owners)}, not {kind}"
            raise BadInput(key=key, value=str(table[key])[:60], expected=expected)
    name = table.get("id")
    name = written("id", name, "a name, such as id = 'slow'", value=_shown(name))
    role = _choice(table, "role", ROLES, "train")
    specimen = _lengths(table, "specimen", _SPECIMEN[kind])
    if {"area", "diameter"} <= specimen.keys():
        expected = "the area or the diameter, not both"
        raise BadInput(key="specimen.diameter", value=f"{specimen['diameter']:g} mm", expected=expected)
    columns = _columns(table, kind)
    _need_specimen(kind, specimen, columns)
    blade = _lengths(table, "blade", ("thickness", "tip", "edge_radius", "shoulder")) if kind == "cut" else {}
    if kind == "cut" and "thickness" not in blade:
        raise BadInput(key="blade.thickness", value="(missing)", expected="blade = { thickness = '0.7 mm' }")
    speed = _speed(table, kind, specimen)
    units, factors = _units(table, columns), _factors(table, columns)
    pressure = _pressure(table, columns, specimen) if kind == "sliding" else 0.0
    tables = [(read_table(path, columns, units, wide=True), label) for path, label in _files(table, folder)]
    repetitions = [
        r
        for read, label in tables
        for r in repetitions_of(read, kind, label, table, specimen, speed, factors)
    ]
    for label, count in Counter(r.name for r in repetitions).items():
        if count > 1:
            raise BadInput(key=LABEL, value=label, expected="each repetition in one file only")
    for key in TAKEN_OFF:
        if isinstance(given := table.get(key), dict):
            for label, raw in given.items():
                among(f"{key}.{label}", label, [r.name for r in repetitions], value=str(raw)[:60])
    source = table.get("source", "")
    if not isinstance(source, str):
        raise BadInput(key="source", value=str(source)[:60], expected="a text in quotes")
    notes: tuple[str, ...] = (f"source: {source}",) if source else ()
    if table.get("stress") == "cauchy":
        notes += ("Cauchy stress turned into nominal stress at constant volume, P = σ/λ",)
    for read, _ in tables:
        if len(read.specimens) > 1:
            notes += (f"{read.path.name} holds specimens side by side: {', '.join(read.specimens)}",)
    notes += contact_notes(repetitions)
    if kind == "sliding" and not pressure and not {"pressure", "normal_force"} & columns.keys():
        notes += ("no pressure given: 0, so that only adhesion resists",)
    fields, noise_mm = read_fields_of(table["fields"], folder) if "fields" in table else ((), 0.0)
    made = Experiment(
        name, kind, tuple(repetitions), role, specimen, blade, speed, pressure,
        _choice(table, "direction", ("opening", "sliding"), "opening") if kind == "separation" else "opening",
        notes, fields, noise_mm,
    )  # fmt: skip
    if kind == "cut":
        travel_fits(made)
    _same_speed(made)
    return made


# -- what a person wrote ----------------------------------------------------------------------------
def _shown(value: object) -> str:
    return "(missing)" if value is None else str(value)[:60]


def _choice(table: Mapping, key: str, known: tuple[str, ...], default: str | None = None) -> str:
    value = table.get(key, default)
    if value not in known or not isinstance(value, str):
        raise BadInput(key=key, value=_shown(value), expected=one_of(str(value), known))
    return value


def _section(table: Mapping, key: str) -> dict:
    part = table.get(key, {})
    if not isinstance(part, dict):
        raise BadInput(key=key, value=str(part)[:60], expected=f"a table, such as {key} = {{ … }}")
    return part


def _lengths(table: Mapping, key: str, known: tuple[str, ...]) -> dict[str, float]:
    found = {}
    for name, raw in _section(table, key).items():
        among(f"{key}.{name}", name, known, value=str(raw)[:60])
        unit = "mm^2" if name == "area" else "mm"
        found[name] = parse_quantity(raw, unit, key=f"{key}.{name}")
        if not (np.isfinite(found[name]) and found[name] > 0):
            raise BadInput(key=f"{key}.{name}", value=str(raw), expected=f"more than 0 {unit}")
    return found


def _columns(table: Mapping, kind: str) -> dict[str, str | int | list[str | int]]:
    """Column by role, or one for each specimen; without ``columns`` they are looked for by their roles."""
    optional = ("time", LABEL) + (("pressure", "normal_force") if kind == "sliding" else ())
    known = (*_ABSCISSA[kind], *_ORDINATE[kind], *optional)
    given = _section(table, "columns")
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
        found = {_ABSCISSA[kind][0]: _ABSCISSA[kind][0], _ORDINATE[kind][0]: _ORDINATE[kind][0]}
    for what, choices in (("x", _ABSCISSA[kind]), ("y", _ORDINATE[kind])):
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


def _need_specimen(kind: str, specimen: Mapping[str, float], columns: Mapping) -> None:
    if kind == "cut":
        needed = ["width", "length", "height"]
    else:
        needed = ["length"] if kind in HOMOGENEOUS and "displacement" in columns else []
        if ("force" in columns or "normal_force" in columns) and area_of(kind, specimen) is None:
            needed.append("area")
    for name in needed:
        if name not in specimen:
            unit = "mm^2" if name == "area" else "mm"
            expected = f"specimen = {{ {name} = '… {unit}' }}" + ", or its diameter" * (name == "area")
            raise BadInput(key=f"specimen.{name}", value="(missing)", expected=expected)


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
    for key, raw in _section(table, section).items():
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


def _files(table: Mapping, folder: Path) -> list[tuple[Path, str | None]]:
    """Data files, each with the repetition that it is if there are several."""
    data = table.get("data")
    given = data if isinstance(data, list) else [data]
    listed = [name for name in given if isinstance(name, str) and name.strip()]
    if not listed or len(listed) < len(given):
        expected = "a file beside this one, such as data = 'slow.csv'"
        raise BadInput(key="data", value=_shown(data), expected=expected)
    if len(set(listed)) < len(listed):
        raise BadInput(key="data", value=str(listed), expected="each file once")
    for name in listed:
        if not (folder / name).is_file():
            raise BadInput(key="data", value=name, expected=f"a file that exists in {folder}")
    return [(folder / name, Path(name).stem if len(listed) > 1 else None) for name in listed]


def _same_speed(e: Experiment) -> None:
    """The written speed against that of the time column: a factor of 60 is a minute taken for a second."""
    if e.speed is None or not e.timed:
        return
    moved = e.travel_speed
    if not 1 / 3 < moved / e.speed < 3:
        unit = "1/s" if e.kind in HOMOGENEOUS else "mm/s"
        expected = f"the speed of the readings, {moved:.4g} {unit}; with a time column it may be left out"
        raise BadInput(key="speed", value=f"{e.speed:.4g} {unit}", expected=expected)
