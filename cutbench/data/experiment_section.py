"""What a person writes of an [[experiment]]: its kind, with what people call tests that are of none, its
columns, units and factors, the sizes of its specimens and its blade, its speed and pressure."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.base.toml import among, one_of, written
from cutbench.base.units import Parameter, parse_quantity, unit_factor
from cutbench.data.columns import LABEL, UNITS, Column, did_you_mean
from cutbench.data.experiment import HOMOGENEOUS, KINDS, area_of
from cutbench.mechanisms import Tool, registry
from cutbench.mechanisms.base import PROTOCOL

#: Other names under which a column may be given.
_ALIASES = {"opening": "displacement", "slip": "displacement", "traction": "stress"}
#: Columns that give the abscissa and the ordinate, by kind: exactly one of each.
ABSCISSA = {
    **dict.fromkeys(HOMOGENEOUS, ("displacement", "stretch", "strain")),
    **dict.fromkeys(("cut", "sliding", "separation"), ("displacement",)),
}
ORDINATE = {"cut": ("force",), **dict.fromkeys((*HOMOGENEOUS, "sliding", "separation"), ("force", "stress"))}
SIZES = {
    "cut": ("width", "length", "height", "precut"),
    **dict.fromkeys(HOMOGENEOUS, ("length", "area", "diameter", "width", "thickness")),
    "sliding": ("area", "diameter", "length", "width"),
    "separation": ("area", "diameter", "length", "width"),
}
_EVERY = (
    "id", "kind", "data", "columns", "units", "factors", "specimen", "speed", "role", "from", "until",
    "source", "blocks", "skip",
)  # fmt: skip
_EXTRA = {
    "cut": ("blade", "fields", "zero", "force_zero", "measures", "depth", "angle", "slice_push"),
    **dict.fromkeys(HOMOGENEOUS, ("stress", "strain", "zero", "force_zero", "angle")),
    "sliding": ("pressure", "normal_force"),
    "separation": ("direction", "zero", "force_zero", "angle"),
}
#: At which angle a specimen was cut out of its body, and how a blade is drawn.
_WAYS = (
    Parameter("angle", "deg", "α", "of the specimen's axis to where fibre_angle counts from", -180.0, 180.0),
    *(q for q in PROTOCOL if q.name == "slice_push"),
)

_TIMED = (
    "how the specimen is loaded, such as 'uniaxial', with a column of time: holds and cycles follow from it"
)
_NONE = f"one of {', '.join(KINDS)}: none of these is "
#: What to write for what people call tests, by words in the name; the first that is in it counts.
_MEANT = {
    ("cutting", "slicing"): "'cut'",
    ("planar", "pure"): "'pure_shear', a wide strip that is pulled",
    ("biaxial", "inflation", "bulge"): "'equibiaxial', if both directions are stretched alike",
    ("compress", "press", "tpa"): (
        "'uniaxial', with factors = { displacement = -1, force = -1 } if the machine counts down as positive"
    ),
    ("tension", "tensile", "pull_test", "traction", "elongation", "uni_axial"): "'uniaxial'",
    ("relax", "creep", "hold", "cycl", "hysteresis", "fatigue", "load"): _TIMED,
    ("indent", "punct", "needle", "hardness", "penetr"): (
        _NONE + "a body pressed in; between plates it is 'uniaxial', and a modulus is G in [parameters]"
    ),
    ("peel", "tear", "trouser", "fracture", "notch"): (
        _NONE
        + "this; its energy of fracture or adhesion is a value in [parameters], such as G_c = '10 J/m^2'"
    ),
    ("tack", "probe", "pull_off", "adhes", "cohesi", "debond"): (
        "'separation', where the traction over the opening was measured, with direction = 'opening'"
    ),
    ("friction", "tribo", "rub"): "'sliding'",
    ("shear", "torsion", "rheo", "oscill", "dma", "bend", "flex", "impact"): (
        _NONE + "this; a modulus that it gives is G in [parameters], and 'pure_shear' is a wide strip, pulled"
    ),
}


def kind_of(table: Mapping[str, object]) -> str:
    """The kind of the experiment that ``table`` describes. Raises BadInput, also for keys of other kinds."""
    raw = table.get("kind")
    kind = str(raw)
    require(isinstance(raw, str) and kind in KINDS, "kind", raw, _instead(kind))
    known = (*_EVERY, *_EXTRA[kind])
    for key in (key for key in table if key not in known):
        owners = [k for k, keys in _EXTRA.items() if key in keys]
        expected = f"it in a test of kind {' or '.join(owners)}, not {kind}" if owners else one_of(key, known)
        raise BadInput(key, table[key], expected)
    return kind


def _instead(kind: str) -> str:
    """What to write for a kind that is none; one is a misspelt one where it is very like it, else another
    test."""
    word = re.sub(r"[^a-z]+", "_", kind.lower())
    misspelt = did_you_mean(word, KINDS, 0.85)
    meant = [text for names, text in _MEANT.items() if any(name in word for name in names)]
    return meant[0] if meant and not misspelt else f"one of {', '.join(KINDS)}{misspelt}"


def section_of(table: Mapping, key: str) -> dict:
    """The section ``key`` of an experiment. Raises BadInput for what is none."""
    part = table.get(key, {})
    require(isinstance(part, dict), key, part, f"a table, such as {key} = {{ … }}")
    return part


def choice(table: Mapping, key: str, known: Sequence[str], default: str) -> str:
    """One of the ``known``; the ``default``, where nothing is written."""
    if key in table:
        among(key, table[key], known)
    return str(table.get(key, default))


def parse_either(raw: object, unit: str, other: str, key: str) -> tuple[float, str]:
    """The value in the one ``unit`` or the ``other``, and in which. Raises BadInput as for the other."""
    with suppress(BadInput):
        return parse_quantity(raw, unit, key=key), unit
    return parse_quantity(raw, other, key=key), other


# -- columns ------------------------------------------------------------------------------------------
def columns_of(table: Mapping, kind: str) -> dict[str, Column | list[Column]]:
    """Column by role, or one for each specimen; without ``columns`` they are looked for by their roles."""
    optional = ("time", "speed", LABEL) + (("pressure", "normal_force") if kind == "sliding" else ())
    known = (*ABSCISSA[kind], *ORDINATE[kind], *optional)
    section = section_of(table, "columns")
    lists = {key: columns for key, columns in section.items() if isinstance(columns, list)}
    columns: dict[str, Column | list[Column]] = {}
    for key, raw in section.items():
        role = _ALIASES.get(key, key) if kind not in ("cut", *HOMOGENEOUS) else key
        among(f"columns.{key}", role, known, value=raw)
        each = raw if key in lists and role != LABEL else [raw]
        good = each and all(c.strip() if isinstance(c, str) else type(c) is int and c >= 1 for c in each)
        require(good, f"columns.{key}", raw, "the column's name in the header, or its number from 1")
        columns[role] = raw
    most = max(map(len, lists.values()), default=0)
    for key, raw in lists.items():
        expected = f"a column for each specimen, {most} in every list, and no repetition"
        require(LABEL not in columns and len(raw) == most, f"columns.{key}", raw, expected)
    columns = columns or {roles[kind][0]: roles[kind][0] for roles in (ABSCISSA, ORDINATE)}
    for choices in (ABSCISSA[kind], ORDINATE[kind]):
        named = [role for role in choices if role in columns]
        for other in named[1:]:
            raise BadInput(f"columns.{other}", str(columns[other]), f"it or {named[0]}, not both")
        slid = kind == "sliding" and choices is ABSCISSA[kind] and "time" in columns
        require(named or slid, f"columns.{choices[0]}", None, f"a column of {' or '.join(choices)}")
    return columns


def _by_role(table: Mapping, section: str, columns: Mapping) -> Iterator[tuple[str, str, object]]:
    """Full key, role of the column and what is written, for each entry of ``section``. Raises BadInput."""
    known = [name for name in columns if name != LABEL]
    for name, raw in section_of(table, section).items():
        role = _ALIASES[name] if _ALIASES.get(name) in columns else name
        among(f"{section}.{name}", role, known, value=raw)
        yield f"{section}.{name}", role, raw


def units_of(table: Mapping, columns: Mapping) -> dict[str, str]:
    """The units of columns by role, where they are written."""
    expected = "a unit in quotes, such as '{}'"
    return {
        role: written(key, raw, expected.format(UNITS[role]))
        for key, role, raw in _by_role(table, "units", columns)
    }


def factors_of(table: Mapping, columns: Mapping) -> dict[str, float]:
    """The factors of columns by role, where they are written."""
    factors = {}
    for key, role, raw in _by_role(table, "factors", columns):
        factors[role] = parse_quantity(raw, "1", key=key)
        good = np.isfinite(factors[role]) and factors[role] != 0
        require(good, key, raw, "a factor other than 0, such as -1")
    return factors


# -- sizes of specimens, and of the blade -------------------------------------------------------------
#: A length, or one for each repetition, in their order or by name.
Size = float | list[float] | dict[str, float]


def blade_units() -> dict[str, str]:
    """The unit of each size that a blade may have, by name."""
    tools = (law for law in registry().values() if isinstance(law, Tool))
    return {q.name: q.unit for tool in tools for q in tool.parameters}


def blade_of(table: Mapping, kind: str) -> dict[str, float]:
    """The sizes of the blade, of a cut."""
    sizes = written_sizes(table, "blade", blade_units().keys() if kind == "cut" else ())
    thick = kind != "cut" or "thickness" in sizes
    require(thick, "blade.thickness", None, "blade = { thickness = '0.7 mm' }")
    return {key: size for key, size in sizes.items() if isinstance(size, float)}


def written_sizes(table: Mapping, key: str, known: Collection[str], several: bool = False) -> dict[str, Size]:
    """The sizes of the section ``key`` in internal units, ``several`` by repetition too. Raises BadInput."""
    sizes: dict[str, Size] = {}
    for name, raw in section_of(table, key).items():
        full, unit = f"{key}.{name}", "mm^2" if name == "area" else blade_units().get(name, "mm")
        among(full, name, known, value=raw)
        one = not isinstance(raw, (dict, list))
        expected = f"one value, such as '… {unit}'" + ", as one body is computed for all" * (not several)
        require(one or (several and raw), full, raw, expected)
        if isinstance(raw, dict):
            sizes[name] = {label: _size(size, unit, f"{full}.{label}") for label, size in raw.items()}
        else:
            sizes[name] = _size(raw, unit, full) if one else [_size(size, unit, full) for size in raw]
    both, raw = {"area", "diameter"} <= sizes.keys(), section_of(table, key).get("diameter")
    require(not both, f"{key}.diameter", raw, "the area or the diameter, not both")
    return sizes


def _size(raw: object, unit: str, key: str) -> float:
    value = parse_quantity(raw, unit, key=key) * unit_factor(unit if unit == "deg" else "1")
    require(np.isfinite(value) and value > 0, key, raw, f"more than 0 {unit}")
    return value


def require_sizes(kind: str, sizes: Iterable[str], columns: Mapping) -> None:
    """Raise BadInput unless the ``sizes`` that a test of this kind needs are there."""
    named = dict.fromkeys(sizes, 1.0)
    needed = ["width", "length", "height"]
    if kind != "cut":
        needed = ["length"] * (kind in HOMOGENEOUS and "displacement" in columns)
        needed += ["area"] * (("force" in columns or "normal_force" in columns) and not area_of(kind, named))
    for name in needed:
        unit, instead = ("mm^2", ", or its diameter") if name == "area" else ("mm", "")
        require(name in named, f"specimen.{name}", None, f"specimen = {{ {name} = '… {unit}' }}{instead}")


def by_repetition(key: str, raw: object, names: Sequence[str]) -> dict[str, object]:
    """What ``raw``, one value, a list in the order of the repetitions or a table by name, says of each."""
    if isinstance(raw, Mapping):
        lacking = ", ".join(f"'{name}'" for name in names if name not in raw)
        expected = f"a value for each repetition; none is given for {lacking}"
        require(not lacking, key, ", ".join(map(str, raw)), expected)
        for name, one in raw.items():
            among(f"{key}.{name}", name, names, value=one)
        return {name: raw[name] for name in names}
    if isinstance(raw, list):
        expected = f"a value for each of the {len(names)} repetitions: {', '.join(names[:12])}"
        require(len(raw) == len(names), key, f"{len(raw)} values", expected)
        return dict(zip(names, raw, strict=True))
    return dict.fromkeys(names, raw)


def sizes_by_repetition(sizes: Mapping[str, Size], names: Sequence[str]) -> dict[str, dict]:
    """The sizes of each repetition."""
    spread = {key: by_repetition(f"specimen.{key}", raw, names) for key, raw in sizes.items()}
    return {name: {key: values[name] for key, values in spread.items()} for name in names}


def mean_sizes(own: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The means of the sizes of specimens."""
    return {key: float(np.mean([one[key] for one in own])) for key in own[0]}


def size_notes(
    kind: str, sizes: Mapping[str, Size], mean: Mapping[str, float], pressed: bool
) -> tuple[str, ...]:
    """Sizes by repetition, and those that are not likely in a specimen, as a note each.

    Strips are not often longer than wide by 10, nor blocks that are cut in any way by 6: in centimetres they
    are. Of any strip over the root of its area, which its small thickness is part of, or over its length, it
    is 25; a block that is pressed buckles where it is higher by more than 3.
    """
    notes = []
    if several := [key for key, raw in sizes.items() if isinstance(raw, (list, dict))]:
        used = "each reading by its own specimen's; what else depends on them is computed with their means"
        notes.append(f"{' and '.join(several)} by repetition: {used}")
    sides = {key: mean[key] for key in ("length", "width", "height", "diameter") if key in mean}
    area, limit = area_of(kind, mean) if kind in HOMOGENEOUS else None, 6.0
    if kind in HOMOGENEOUS:
        by_area = len(sides) == 1 and area is not None
        sides |= {"root of the area": (area or 0.0) ** 0.5} if by_area else {}
        longest = sides.get("length") == max(sides.values(), default=0.0)
        limit = 25.0 if not longest or (by_area and not pressed) else 3.0 if pressed else 10.0
    if len(sides) > 1:
        (low, least), *_, (high, most) = sorted(sides.items(), key=lambda item: item[1])
        if most >= limit * least:
            times = f"{most:.4g} mm, is {most / least:.3g} times its {low}, {least:.4g} mm"
            notes.append(f"the specimen's {high}, {times}: is a size in another unit?")
    if pressed and kind == "uniaxial" and area is not None and "length" in mean:
        shape = np.sqrt(area / np.pi) / (2 * mean["length"])
        notes.append(
            "its ends are taken to slide on the plates. If they hold it, as dry ones do, it is"
            f" {1 + 2 * shape**2:.3g} times as stiff at small strain, and more as it is pressed (Gent and"
            " Lindley 1959, 10.1243/PIME_PROC_1959_173_022_02): a lubricant, or another height, tells"
        )
    return tuple(notes)


# -- angle, speed and pressure ------------------------------------------------------------------------
def ways_of(table: Mapping) -> tuple[float, float | None]:
    """The ``angle`` of a specimen in rad, and the ``slice_push`` of a cut, None where it is not written."""
    angle, slice_push = (q.parse(table[q.name]) if q.name in table else None for q in _WAYS)
    return angle or 0.0, slice_push


def speed_of(table: Mapping, kind: str, specimen: Mapping[str, float]) -> float | None:
    """mm/s; for a homogeneous test 1/s of stretch, for which a speed is divided by the length."""
    if "speed" not in table:
        return None
    raw, strained = table["speed"], kind in HOMOGENEOUS
    rate, unit = parse_either(raw, "1/s" if strained else "mm/s", "mm/s", key="speed")
    if strained and unit == "mm/s":
        expected = "specimen.length beside it, or a rate such as '0.1 1/s'"
        require("length" in specimen, "speed", raw, expected)
        rate /= specimen["length"]
    require(np.isfinite(rate) and rate > 0, "speed", raw, "a speed above 0, such as '0.02 mm/s'")
    return rate


def pressure_of(table: Mapping, columns: Mapping, specimen: Mapping[str, float]) -> float:
    """The pressure of a sliding test in MPa, 0 where it is not written."""
    keys = [key for part in (table, columns) for key in ("pressure", "normal_force") if key in part]
    for key in keys[1:]:
        raise BadInput(key, "given twice", "the pressure once: as value or as column")
    if not keys or keys[0] not in table:
        return 0.0
    key, raw = keys[0], table[keys[0]]
    value = parse_quantity(raw, "MPa" if key == "pressure" else "N", key=key)
    if key == "normal_force":
        area = area_of("sliding", specimen)
        if area is None:
            raise BadInput("specimen.area", "(missing)", "specimen = { area = '… mm^2' }")
        value /= area
    require(np.isfinite(value) and value >= 0, key, raw, "0 or more")
    return value
