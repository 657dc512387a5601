"""Kinds of tests: what an experiment of each is described by, the sizes of its specimens, and what people
call tests that are of none."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np

from cutbench.base.errors import BadInput, in_short
from cutbench.base.toml import among, nearest, one_of
from cutbench.base.units import parse_quantity, unit_factor
from cutbench.data.experiment import HOMOGENEOUS, KINDS, area_of
from cutbench.mechanisms import Tool, registry

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
    "cut": ("blade", "fields", "zero", "force_zero", "measures", "depth"),
    **dict.fromkeys(HOMOGENEOUS, ("stress", "strain", "zero", "force_zero")),
    "sliding": ("pressure", "normal_force"),
    "separation": ("direction", "zero", "force_zero"),
}

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
#: A kind is a misspelt one above this likeness; below it, it is another test.
_LIKE = 0.85


def kind_of(table: Mapping[str, object]) -> str:
    """The kind of the experiment that ``table`` describes. Raises BadInput, also for keys of other kinds."""
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise BadInput(key="kind", value=in_short(kind), expected=_instead(kind))
    for key in table:
        if key not in (*_EVERY, *_EXTRA[kind]):
            owners = [k for k, keys in _EXTRA.items() if key in keys]
            expected = one_of(key, (*_EVERY, *_EXTRA[kind]))
            if owners:
                expected = f"it in a test of kind {' or '.join(owners)}, not {kind}"
            raise BadInput(key=key, value=in_short(table[key]), expected=expected)
    return kind


def _instead(kind: object) -> str:
    """What to write for a kind that is none."""
    word = re.sub(r"[^a-z]+", "_", str(kind).lower())
    if nearest(word, KINDS, _LIKE) is None:
        for names, meant in _MEANT.items():
            if any(name in word for name in names):
                return meant
    guess = nearest(word, KINDS, _LIKE)
    return f"one of {', '.join(KINDS)}" + (f"; did you mean '{guess}'?" if guess else "")


# -- sizes of specimens -------------------------------------------------------------------------------
#: A length, or one for each repetition, in their order or by name.
Size = float | list[float] | dict[str, float]
#: Strips are not often longer than wide by this, nor blocks that are cut in any way: in centimetres they are.
SLENDER, BLOCK = 10.0, 6.0
#: The same of any strip over the root of its area, which its small thickness is part of, or over its length.
WIDE = 25.0
#: A block that is pressed buckles where it is higher by more than this.
BUCKLES = 3.0


def blade_units() -> dict[str, str]:
    """The unit of each size that a blade may have, by name."""
    tools = (law for law in registry().values() if isinstance(law, Tool))
    return {q.name: q.unit for tool in tools for q in tool.parameters}


def written_sizes(table: Mapping, key: str, known: Collection[str], several: bool = False) -> dict[str, Size]:
    """The sizes of the section ``key`` in internal units, ``several`` by repetition too. Raises BadInput."""
    found: dict[str, Size] = {}
    for name, raw in section_of(table, key).items():
        among(f"{key}.{name}", name, known, value=str(raw)[:60])
        unit, full = "mm^2" if name == "area" else blade_units().get(name, "mm"), f"{key}.{name}"
        if isinstance(raw, dict) and several and raw:
            found[name] = {label: _size(one, unit, f"{full}.{label}") for label, one in raw.items()}
        elif isinstance(raw, list) and several and raw:
            found[name] = [_size(one, unit, full) for one in raw]
        elif isinstance(raw, (dict, list)):
            expected = f"one value, such as '… {unit}'" + (
                "" if several else ", as one body is computed for all"
            )
            raise BadInput(key=full, value=str(raw)[:60], expected=expected)
        else:
            found[name] = _size(raw, unit, full)
    if {"area", "diameter"} <= found.keys():
        expected = "the area or the diameter, not both"
        raise BadInput(key=f"{key}.diameter", value=str(table[key]["diameter"])[:60], expected=expected)
    return found


def _size(raw: object, unit: str, key: str) -> float:
    value = parse_quantity(raw, unit, key=key) * unit_factor(unit if unit == "deg" else "1")
    if not (np.isfinite(value) and value > 0):
        raise BadInput(key=key, value=str(raw), expected=f"more than 0 {unit}")
    return value


def section_of(table: Mapping, key: str) -> dict:
    """The section ``key`` of an experiment. Raises BadInput for what is none."""
    part = table.get(key, {})
    if not isinstance(part, dict):
        raise BadInput(key=key, value=str(part)[:60], expected=f"a table, such as {key} = {{ … }}")
    return part


def require_sizes(kind: str, sizes: Iterable[str], columns: Mapping) -> None:
    """Raise BadInput unless the ``sizes`` that a test of this kind needs are there."""
    there = dict.fromkeys(sizes, 1.0)
    if kind == "cut":
        needed = ["width", "length", "height"]
    else:
        needed = ["length"] if kind in HOMOGENEOUS and "displacement" in columns else []
        if ("force" in columns or "normal_force" in columns) and area_of(kind, there) is None:
            needed.append("area")
    for name in needed:
        if name not in there:
            unit = "mm^2" if name == "area" else "mm"
            expected = f"specimen = {{ {name} = '… {unit}' }}" + ", or its diameter" * (name == "area")
            raise BadInput(key=f"specimen.{name}", value="(missing)", expected=expected)


def by_repetition(key: str, raw: object, names: Sequence[str]) -> dict[str, object]:
    """What ``raw``, one value, a list in the order of the repetitions or a table by name, says of each."""
    if isinstance(raw, Mapping):
        for name in names:
            if name not in raw:
                expected = f"a value for each repetition; none is given for '{name}'"
                raise BadInput(key=key, value=", ".join(map(str, raw)), expected=expected)
        for name, one in raw.items():
            among(f"{key}.{name}", name, names, value=str(one)[:60])
        return {name: raw[name] for name in names}
    if isinstance(raw, list):
        if len(raw) != len(names):
            expected = f"a value for each of the {len(names)} repetitions: {', '.join(names[:12])}"
            raise BadInput(key=key, value=f"{len(raw)} values", expected=expected)
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
    """Sizes by repetition, and those that are not likely in a specimen, as a note each."""
    notes = []
    if several := [key for key, raw in sizes.items() if isinstance(raw, (list, dict))]:
        used = "each reading by its own specimen's; what else depends on them is computed with their means"
        notes.append(f"{' and '.join(several)} by repetition: {used}")
    sides = {key: mean[key] for key in ("length", "width", "height", "diameter") if key in mean}
    limit = BLOCK
    if kind in HOMOGENEOUS:
        area = area_of(kind, mean)
        if len(sides) == 1 and area is not None:
            sides["root of the area"] = area**0.5
        longest = sides.get("length") == max(sides.values(), default=0.0)
        limit = (
            BUCKLES
            if pressed and longest
            else SLENDER
            if longest and "root of the area" not in sides
            else WIDE
        )
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
