"""From what a person writes to the numbers of a model: parse, solve groups, check that they fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from types import SimpleNamespace

from cutbench.base.errors import BadInput, require
from cutbench.base.sections import Entry, read_section
from cutbench.base.toml import TomlFile, one_of
from cutbench.case.mesh_sizes import chosen, under_tip
from cutbench.case.model import PROTOCOL, SPECIMEN, Model, apply_groups, groups, owners, section_of, tools
from cutbench.case.numerics import KEYS, Numerics, Sizes, unit_mm
from cutbench.mechanisms import Group, Tool, Volumetric, registry
from cutbench.mechanisms.base import MODULUS

#: Sharpest tip that an element resolves: its radius of curvature a²/b in element sizes.
TIP_PER_ELEMENT = 1 / 20

#: Longest side of a specimen in its shortest: meshes are as coarse as that one, and a slip of a unit is more.
SLIMMEST = 500.0

#: Within this many thicknesses of the blade above the base the clamp takes over: in the last one the force
#: rises to several times its peak, and cutting is no longer steady in any of them.
CLAMP = 4.0

#: Contact stiffness times the edge's radius from which on it counts little: under an edge of 50 µm gelatin's
#: cut begins 4 % too early at 800, and 43 % at 200.
STIFF_AT_EDGE = 800.0

#: How many times as large as asked for the finest length may be without a word.
COARSE_DETAIL = 1.5

SECTIONS = ("parameters", "specimen", "blade", "protocol")


def rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}") + 0.0  # + 0.0 turns -0.0 into 0.0


def as_written(entries: Mapping[str, Mapping]) -> dict[str, object]:
    """The values of ``Case.to_dict`` as a person writes them."""
    texts = {key: f"{entry['value']!r} {entry['unit']}" for key, entry in entries.items()}
    return {key: entry["value"] if entry["unit"] == "1" else texts[key] for key, entry in entries.items()}


def settable(model: Model) -> list[str]:
    """Every name that sets a number of the physics in ``model``."""
    known = model.parameters()
    return [*known, *(g for g in model.settable_groups() if g not in known)]


def parameter_of(name: str) -> str:
    """The parameter that ``name`` sets: its own, or that of a group."""
    known = groups()
    return known[name].parameter if name in known else name


def meant(key: str, model: Model) -> str:
    """What would be right for a name that this model does not have: where it belongs, or the nearest."""
    target = parameter_of(key)
    if text := next((law.meant[key] for law in registry().values() if key in law.meant), ""):
        return text
    if target == MODULUS and model.derives_modulus:
        laws = [law for law in model.laws("bulk") if not isinstance(law, Volumetric) and law.parameters]
        own = "; ".join(f"{', '.join(q.name for q in law.parameters)} of {law.name}" for law in laws)
        return f"{own}: in this model {MODULUS} is the shear modulus at small strain that they come to"
    if target not in model.parameters() and (laws_ := " or ".join(owners(target))):
        here = ", ".join(model.mechanisms)
        return f"a parameter of this model ({here}); add the mechanism {laws_} that has it"
    return one_of(key, [*settable(model), *KEYS])


def parse_values(raw: Mapping[str, object], model: Model) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters and groups, both in internal units. Raises BadInput.

    Two names that set the same parameter are refused.
    """
    known, by_group = model.parameters(), model.settable_groups()
    values: dict[str, float] = {}
    asked: dict[str, float] = {}
    setter: dict[str, str] = {}
    for key, text in raw.items():
        if key in known:
            target, values[key] = key, known[key].parse(text, key=key)
        elif key in by_group:
            target, asked[key] = by_group[key].parameter, by_group[key].quantity.parse(text, key=key)
        else:
            raise BadInput(key, text, meant(key, model))
        other = setter.setdefault(target, key)
        require(other == key, key, text, f"either '{other}' or '{key}', not both: each sets {target}")
    return values, asked


def section_changes(
    file: TomlFile, sections: Mapping[str, Mapping[str, object]], model: Model
) -> tuple[dict[str, object], dict[str, str]]:
    """What the sections of a file set, as ``Case.set`` takes it, and the section of each. Raises BadInput for
    a key that is not in its own."""
    own = {key: section_of(key) for key in settable(model)} | dict.fromkeys(KEYS, "numerics")
    own |= {"motion": "protocol", "until": "protocol", "outline": "blade"}
    right = {key: f"it in the section [{section}]" for key, section in own.items()}
    changes: dict[str, object] = {}
    for section, part in sections.items():
        entries = [Entry(key, object) for key, place in own.items() if place == section]
        with file.at(section):
            read_section(part, entries, instead=lambda key: right.get(key) or meant(key, model))
        changes |= part
    return changes, {key: own[key] for key in changes}


def parse_overrides(texts: Iterable[str]) -> dict[str, object]:
    """Read texts such as ``"eta_reg=0.5 s"`` into changes as ``Case.set`` takes them. Raises BadInput."""
    changes: dict[str, object] = {}
    for text in [texts] if isinstance(texts, str) else texts:
        key, sign, raw = (part.strip() for part in text.partition("="))
        require(key and sign and raw, "--set", text, "name=value, such as --set eta_reg='0.5 s'")
        require(key not in changes, key, raw, f"to be set once; it is also set to '{changes.get(key)}'")
        changes[key] = raw
    return changes


def resolve(start: Mapping[str, float], changes: Mapping[str, object], model: Model) -> dict[str, float]:
    """Values of ``model`` (internal units): ``start``, with ``changes`` as a person wrote them.

    Order: parameters, defaults for what is still missing, groups. A value that nothing gives is left out,
    for the case to name.
    """
    known = model.parameters()
    parsed, asked = parse_values(changes, model)
    values = {n: v for n, v in start.items() if n in known}
    resized = {"height", "thickness"} & parsed.keys() and "depth" not in parsed and "height" in values
    if resized and values.get("depth") == rounded(full_depth(values), 14):
        values.pop("depth")  # the blade went as far as it does by default: it still does
    values |= parsed
    values = {n: q.default * q.factor for n, q in known.items() if q.default is not None} | values
    set_too = values.keys() | {parameter_of(name) for name in asked}
    for name, value in asked.items():
        for need in _needed(groups()[name], model):
            require(need in set_too, name, value, f"{need} beside it, from which it is solved")
    return apply_groups(values, asked, model)


def _needed(group: Group, model: Model) -> tuple[str, ...]:
    """Parameters that a group is solved from; in place of a modulus that follows, those of the bulk laws."""
    if MODULUS not in group.needs or not model.derives_modulus:
        return group.needs
    bulk = [q.name for law in model.laws("bulk") for q in law.parameters]
    return (*bulk, *(name for name in group.needs if name != MODULUS))


def completed(values: Mapping[str, float], model: Model) -> dict[str, float]:
    """All values of ``model``, checked one by one: those of ``values``, and defaults. Raises BadInput."""
    known = model.parameters()
    for key in values:
        if key not in known:
            raise BadInput(key, values[key], meant(key, model))
    full: dict[str, float] = {}
    for name, q in known.items():
        if name in values:
            value = float(values[name])
        elif q.default is not None:
            value = q.default * q.factor
        elif name == "depth":
            value = full_depth(full)
        else:
            users = [m.name for m in model.all if name in (*m.reads, *(o.name for o in m.parameters))]
            example = f"{name} = '{q.typical:g} {q.unit}' ({q.doc}; needed by {', '.join(users)})"
            raise BadInput(name, "(missing)", f"a value in [{section_of(name)}], such as {example}")
        q.check(rounded(value / q.factor, 15))
        # Fourteen digits, so that a value is the same number in whatever unit it was written.
        full[name] = rounded(value, 14)
    return full


def section_hint(key: str) -> str | None:
    """What to write instead of a ``key`` that stands above the sections of a case file and is in one."""
    physics = [q.name for q in SPECIMEN + PROTOCOL] + list(groups())
    if key not in KEYS and key not in physics and not owners(key):
        return None
    section = "numerics" if key in KEYS else section_of(key)
    return f"it in the section [{section}], '{key}' is not a section"


def names(raw: object, *, key: str) -> tuple[str, ...]:
    """One name, several separated by commas, or a list of names."""
    parts = raw.split(",") if isinstance(raw, str) else raw
    if not isinstance(parts, (list, tuple)) or not parts or not all(isinstance(n, str) for n in parts):
        raise BadInput(key, raw, 'names of mechanisms, such as ["coulomb", "adhesion"]')
    return tuple(n.strip() for n in parts)


def _below(value: float) -> float:
    """``value`` in two digits, rounded down: an advice must hold when it is followed."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return rounded(math.floor(value / digit) * digit, 2)


def full_depth(v: Mapping[str, float]) -> float:
    """Travel of a blade that is not told how far: to where the clamp takes over, half the height at least.

    A strip, which no blade meets, is pulled to twice its length.
    """
    return max(v["height"] - CLAMP * v.get("thickness", 0.0), v["height"] / 2)


def check_driven(model: Model) -> None:
    """Raise BadInput for a cut in which nothing meets the blade: it would move and nothing would happen."""
    laws = " or ".join(law.name for law in tools())
    expected = (
        f"a law by which the blade meets the specimen, {laws}: without one nothing drives the cut, and"
        " friction and adhesion have no surface"
    )
    require(model.tool, "mechanisms", ", ".join(model.mechanisms), expected)


def check_fit(p: SimpleNamespace, numerics: Numerics, dim: int, model: Model) -> None:
    """Raise BadInput where one value rules out another: travel, blade in block, tip on mesh, symmetry.

    Without a blade the specimen is a strip, which may be pulled further than it is high.
    """
    for key, value, expected in _misfits(p, numerics, dim, model):
        raise BadInput(key, value, expected)


def _misfits(
    p: SimpleNamespace, numerics: Numerics, dim: int, model: Model
) -> Iterator[tuple[str, str, str]]:
    """The key of what does not fit, its value, and what would be right."""
    yield from _mismatched(vars(p), numerics, dim, bool(model.laws("blade")))
    if model.derives_modulus and not getattr(p, MODULUS) > 0:
        key = next(law.name for law in model.laws("bulk") if not isinstance(law, Volumetric))
        expected = "values with which it resists shear; a law with a state answers shear_modulus(p) itself"
        yield key, f"a shear modulus of {getattr(p, MODULUS):g} MPa", expected
    if p.precut and not any(law.role == "cohesive" for law in model.laws("cut")):
        expected = "0 mm in a model without a cohesive law: its cut plane never opens"
        yield "precut", f"{p.precut:g} mm", expected
    for axis, parts, expected in (
        (0, ("quarter", "half"), "'full' or 'auto': the material's direction is oblique to the cut plane"),
        (2, ("quarter",), "'half', 'full' or 'auto': the material's direction is oblique to the edge"),
    ):
        if numerics.symmetry in parts and not model.mirrored(p)[axis]:
            yield "symmetry", numerics.symmetry, expected
    if model.tool is not None:
        yield from _misshapen(model.tool, p, numerics)


def _mismatched(
    v: Mapping[str, float], numerics: Numerics, dim: int, blade: bool
) -> Iterator[tuple[str, str, str]]:
    """The same of lengths and angles against one another."""
    most = v["height"] * (1.0 if blade else 1.5)
    if v["depth"] > most:
        why = "the height: below it is the clamp" if blade else "1.5 times the height"
        yield "depth", f"{v['depth']:g} mm", f"at most {most:g} mm, {why}"
    if v["precut"] >= v["height"]:
        yield "precut", f"{v['precut']:g} mm", f"less than the height, {v['height']:g} mm"
    if "thickness" not in v:
        return
    yield from numerics.misfits(unit_mm(v))
    thickness, tilt, overhang = v["thickness"], v.get("tilt", 0.0), v.get("overhang", 0.0)
    incline = v.get("incline", 0.0)
    if dim == 2:
        turned = {"tilt": math.degrees(tilt), "incline": math.degrees(incline)}
        unit, alone = (
            dict.fromkeys(turned, "deg") | {"overhang": "mm"},
            turned | {"overhang": min(overhang, 0.0)},
        )
        for key, value in alone.items():
            if value:
                yield key, f"{value:g} {unit[key]}", "0 in plane strain: it needs three dimensions"
    if overhang <= -v["length"] / 2:
        least = f"a blade that is not shorter than nothing: more than {-v['length'] / 2:g} mm"
        yield "overhang", f"{overhang:g} mm", least
    if tilt and numerics.symmetry in ("quarter", "half"):
        whole = "'full' or 'auto' with a tilted blade: it has no plane of symmetry"
        yield "symmetry", numerics.symmetry, whole
    sliced = v["slice_push"]
    if (incline or sliced) and numerics.symmetry == "quarter":
        ends = "with a blade that is inclined or slices: its ends are not alike"
        yield "symmetry", "quarter", f"'half', 'full' or 'auto' {ends}"
    if sliced and (tilt or incline or overhang < 0):
        yield "slice_push", f"{sliced:g}", "0 with tilt, incline or a blade that is shorter than the specimen"
    sides = {name: v[name] for name in ("width", "length", "height")}
    longest, shortest = max(sides, key=lambda name: sides[name]), min(sides.values())
    if sides[longest] > SLIMMEST * shortest:
        slim = f"at most {SLIMMEST:g} times the shortest side of the specimen, {shortest:g} mm"
        yield longest, f"{sides[longest]:g} mm", slim
    if thickness >= v["width"]:
        thinner = f"a blade thinner than the specimen is wide ({v['width']:g} mm)"
        yield "thickness", f"{thickness:g} mm", thinner


def _misshapen(tool: Tool, p: SimpleNamespace, numerics: Numerics) -> Iterator[tuple[str, str, str]]:
    """The same of the tool's profile."""
    yield from tool.misfits(p)
    if numerics.gap == "ellipse" and not hasattr(tool, "number"):
        expected = f"'distance': the paper's gap is that of an ellipse, and this is a {tool.name}"
        yield "gap", "ellipse", expected
    if numerics.symmetry in ("quarter", "half") and not tool.alike(p):
        expected = f"'full' or 'auto': the flanks of this {tool.name} are not alike"
        yield "symmetry", numerics.symmetry, expected
    (key, formula), least = tool.edge, numerics.sizes(p.thickness).h_mm * TIP_PER_ELEMENT
    if (radius := tool.edge_radius(p)) < least:
        now, fit = getattr(p, key), tool.edge_for(p, least)
        article = "an" if key[0] in "aeiou" else "a"
        q = {each.name: each for each in tool.parameters}[key]
        best, unit = fit / q.factor, "" if q.unit == "1" else f" {q.unit}"
        other = f"most {_below(best):g}" if fit < now else f"least {_below(1.1 * best):g}"
        yield (
            key,
            q.show(now),
            f"a tip that the mesh resolves: {formula} is {radius:.3g} mm, less than h/20 = {least:.3g} mm;"
            f" h = '{_below(radius / TIP_PER_ELEMENT):g} mm' would do,"
            f" or {article} {key} of at {other}{unit}",
        )


def doubts(
    p: SimpleNamespace, tool: Tool | None, numerics: Numerics, sizes: Sizes, wanted: float
) -> Iterator[str]:
    """What can be computed, but says more of the elements or the contact than of the cut; sentences for a
    person. ``wanted``: the finest length that the cut asks for, mm."""
    if tool is None or numerics.normal != "tool" or numerics.mesh is not None:
        return
    thickness, radius = p.thickness, tool.edge_radius(p)
    h = sizes.h_mm
    shallow = h * chosen(numerics.shallow, h, thickness, numerics.tuning.mesh.shallow)
    under = min(under_tip(numerics, thickness, radius), shallow)
    if under > radius * (1 + 1e-12):
        yield (
            f"elements under the tip ({under:.3g} mm) are larger than it is round ({radius:.3g} mm):"
            " along the tool's normal it pushes them down and cuts too late;"
            f" corner = {_below(radius / h):g} or normal = 'material' would do"
        )
    if sizes.penalty_per_mm * radius < STIFF_AT_EDGE / 2:
        yield (
            f"the contact (penalty = {sizes.penalty_per_mm * sizes.detail_mm:g}) gives way by much of the"
            f" edge's radius ({radius:.3g} mm), as if that were sharper: the cut begins too early;"
            f" penalty = {STIFF_AT_EDGE * sizes.detail_mm / radius:.0f} would do"
        )
    if sizes.detail_mm > COARSE_DETAIL * wanted:
        yield (
            f"elements at the front are made for details of {sizes.detail_mm:.3g} mm, and the edge or the"
            f" cohesive zone asks for {wanted:.3g} mm: the front may jump from element to element;"
            f" detail = '{_below(wanted):g} mm' would do, at a price"
        )
