"""One cutting test to compute: mechanisms, their numbers, numerical choices, and an identity.

A person writes a material's name or a TOML file and changes some values; a case is what comes of
it, complete, checked and in internal units (mm, N, s).
"""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

from cutbench.base.errors import BadInput, ComputationFailed, DoubtfulInput, require
from cutbench.base.sections import Entry, read_section
from cutbench.base.toml import TomlFile, among, read_toml, written
from cutbench.case import materials
from cutbench.case.computation import computation_of, mesh_digest
from cutbench.case.group_ranges import UntypicalGroup, untypical_groups
from cutbench.case.model import DEFAULT, Model
from cutbench.case.motion import DEPTH, Polyline, checked_motion, read_motion
from cutbench.case.numerics import ALIASES, KEYS, Numerics, Sizes, defaults, preset, unit_mm
from cutbench.case.outline import Points, checked_outline, read_outline, with_outline
from cutbench.case.tuning import Tuning
from cutbench.case.values import (
    SECTIONS,
    as_written,
    check_fit,
    completed,
    doubts,
    names,
    parse_overrides,
    resolve,
    rounded,
    section_changes,
    section_hint,
)
from cutbench.mechanisms.own_laws import folders_of, take_up

#: A section stands for what is longer than this part of its smaller side.
THICK = 0.5
#: What sets something of a case, in its file.
CASE_SECTIONS = (*SECTIONS, "numerics")
_FILE = (
    Entry("material", materials.ABOUT, default={}),
    Entry("base", str, "a material's name or a TOML file"),
    Entry("mechanisms", names),
    *(Entry(section, dict, default={}) for section in CASE_SECTIONS),
)


@dataclass(frozen=True, kw_only=True, repr=False)
class Case:
    """A case describes one cutting test to compute, completely, with everything checked.

    It holds the mechanisms, their numbers, the numerical choices and the motion of the blade. A case never
    changes: ``set`` returns a new one. People rarely build one by hand: ``load_case`` makes it from a
    material's name or a TOML file.

    Attributes
    ----------
    name : str
        What it is called in tables and pictures; it is no part of the identity.
    dim : int
        2 for plane strain, 3 for a block.
    mechanisms : tuple of str
        Names of the mechanisms of its model.
    values : mapping of str to float
        The value of every parameter by name, in internal units (mm, N, s, so MPa and mJ).
    numerics : Numerics
        Mesh, elements, contact, steps and tolerances.
    motion : tuple of (float, float)
        Times (s) and travels (mm) from (0, 0) of a blade that holds, returns or changes its speed; without
        any it goes down to ``depth`` at ``speed``.
    outline : tuple of (float, float)
        Measured points (mm) of the blade's profile, where the blade is a mechanism that takes them.
    until : str
        ``"depth"``: the run ends at its depth. ``"transition"``: it ends where its transition is known, if
        that is before the depth.

    Raises
    ------
    BadInput
        If a value is missing, out of its bounds, or does not fit another.

    Examples
    --------
    >>> import cutbench
    >>> case = cutbench.load_case("gelatin").set(G="8 kPa", h="0.2 mm")
    >>> case.values["G"]  # MPa
    0.008
    >>> case.shown()["G"], case.sizes.h_mm
    ('8 kPa', 0.2)
    >>> case.id == case.set(name="another name").id
    True
    """

    name: str
    dim: int
    mechanisms: tuple[str, ...]
    values: Mapping[str, float]
    numerics: Numerics = field(default_factory=Numerics)
    motion: Polyline = ()
    outline: Points = ()
    until: str = DEPTH

    def __post_init__(self) -> None:
        require(self.dim in (2, 3), "dim", self.dim, "2 or 3")
        written("name", self.name, "a name, such as 'gelatin'")
        model = Model(tuple(self.mechanisms))
        full = completed(self.values, model)
        object.__setattr__(self, "mechanisms", model.mechanisms)
        object.__setattr__(self, "values", MappingProxyType(full))
        object.__setattr__(self, "outline", checked_outline(self.outline, model.tool))
        check_fit(self.p, self.numerics, self.dim, model)
        object.__setattr__(self, "motion", checked_motion(self.motion, full["depth"], self.until))

    def __reduce__(self):
        state = self._fields | {"values": dict(self.values)}  # a MappingProxyType has no pickle
        return _unpickled, (folders_of(self.mechanisms), state), {"_asked": self.computation}

    def __hash__(self) -> int:
        return hash(self.id)

    def __repr__(self) -> str:
        values = ", ".join(f"{name} {text}" for name, text in self.shown().items())
        return f"Case: {self.name}, {self.dim}D\n  model   {self.model.described}\n  values  {values}"

    @property
    def _fields(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @cached_property
    def model(self) -> Model:
        """The mechanisms as a ``Model``, which knows their parameters and groups."""
        return Model(self.mechanisms)

    @property
    def p(self) -> SimpleNamespace:
        """The values by attribute, in internal units, as laws read them."""
        return self.model.namespace(self.values, self.outline)

    @property
    def _lines(self) -> list[tuple[str, Points]]:
        return [(name, line) for name in ("motion", "outline") if (line := getattr(self, name))]

    @cached_property
    def computation(self) -> str:
        """The 12 hex digits that stand for the source which computes this model.

        See ``cutbench.case.computation``. Raises ComputationFailed in a process that has other code than the
        one that sent the case.
        """
        own = computation_of(self.model)
        if (asked := vars(self).get("_asked", own)) != own:
            raise ComputationFailed(
                f"'{self.name}' is to be computed by computation {asked}, this process has {own}: install"
                " one cutbench on all machines, and change no file of it while runs are computed"
            )
        return own

    @cached_property
    def id(self) -> str:
        """The 16 hex digits that stand for all that decides the outcome.

        The name and the order of writing do not count. The computation counts by its source, a mesh file by
        its content; BadInput if that cannot be read.
        """
        numerics = self.numerics.digits()
        if self.numerics.mesh is not None:
            numerics["mesh"] = mesh_digest(self.numerics.mesh)
        content = {
            "computation": self.computation,
            "dim": self.dim,
            "mechanisms": self.mechanisms,
            "values": {name: f"{value:.14g}" for name, value in self.values.items()},
            "numerics": numerics,
        }
        if self.until != DEPTH:
            content["until"] = self.until
        for name, line in self._lines:
            content[name] = [[f"{number:.14g}" for number in point] for point in line]
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences to know before its run is believed; for most cases there are none."""
        return (*self.cautions, *map(str, self.far))

    def __getitem__(self, name: str) -> str:
        """The value of a parameter as a person reads it, with its unit."""
        texts = self.shown()
        among("parameter", name, texts)
        return texts[name]

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.shown())

    @property
    def _sheet(self) -> tuple[str, ...]:
        """A doubt about a section whose length is not far above its other sizes."""
        if self.dim == 3 or self.model.tool is None:
            return ()
        length, least = self.values["length"], min(self.values["width"], self.values["height"])
        if length >= THICK * least:
            return ()
        return (
            f"a section is in plane strain, as with a length far above the other sizes; {length:g} mm beside"
            f" {least:g} mm is a sheet, nearer to plane stress: its force is computed too high",
        )

    @property
    def cautions(self) -> tuple[str, ...]:
        """The doubts that are about elements, or about the section."""
        return (*self._sheet, *doubts(self.p, self.model.tool, self.numerics, self.sizes, self._finest_mm))

    @property
    def far(self) -> list[UntypicalGroup]:
        """The dimensionless groups that are far from all that the known materials have."""
        return untypical_groups(self.model, self.values)

    @property
    def unit_mm(self) -> float:
        """The length that numerics are in, mm: the blade's thickness; of a strip a part of its width."""
        return unit_mm(self.values)

    @cached_property
    def sizes(self) -> Sizes:
        """Lengths and stiffnesses that its numerics come to, in mm and G per mm."""
        return self.numerics.sizes(self.unit_mm, self._finest_mm)

    @property
    def _finest_mm(self) -> float:
        """The finest length that the cut asks for, mm."""
        model, p, (edges, zones) = self.model, self.p, self.numerics.tuning.mesh.detail
        edge = math.inf if model.tool is None else edges * model.tool.edge_radius(p)
        return float(min(edge, zones * model.cohesive_zone(p)))

    def groups(self) -> dict[str, float]:
        """Compute the dimensionless groups of all its mechanisms.

        Returns
        -------
        dict of str to float
            Values by the formula of the group, such as ``"(G_c/delta_c)/G"``.
        """
        return self.model.groups(self.p)

    def shown(self) -> dict[str, str]:
        """Write every value with its unit, as a person reads it.

        Returns
        -------
        dict of str to str
            Text such as ``"7.5 kPa"`` by parameter.
        """
        return {name: q.show(self.values[name]) for name, q in self.model.parameters().items()}

    def set(self, **changes: object) -> Case:
        """Return a new case with changes as a person writes them.

        Groups are solved after the parameters.

        Parameters
        ----------
        **changes : object
            By keyword: parameters with their unit (``G="8 kPa"``, ``eta_v="0.05 mm"``), groups
            (``cohesion=9.0``), numerics (``h="0.2 mm"``, ``element="P1"``); ``numerics="paper"`` (all of them
            as the paper has them, and its viscous term); ``with_``, ``without`` and ``mechanisms`` (a name or
            several); ``motion`` (pairs of time and travel of a blade that holds, returns or changes its
            speed); ``until`` (``"depth"``, or ``"transition"``: no further than that needs to be known);
            ``outline`` (a CSV file); ``name``.

        Returns
        -------
        Case
            Complete and checked, as every case.

        Raises
        ------
        BadInput
            For an unknown name, a value that cannot be used, or values that do not fit one another.
        """
        return _case(_changed(self._fields | {"model": self.model}, changes))

    def to_dict(self) -> dict:
        """Describe the case as plain data with units, for JSON; ``from_dict`` gives the same case.

        Returns
        -------
        dict
            Name, dimension, mechanisms, values with their units, numerics, tuning, and what else it has.
        """
        known = self.model.parameters()
        return {
            "name": self.name,
            "dim": self.dim,
            "mechanisms": list(self.mechanisms),
            "until": self.until,
            "values": {
                name: {"value": rounded(value / known[name].factor, 15), "unit": known[name].unit}
                for name, value in self.values.items()
            },
            "numerics": self.numerics.written(),
            "sizes": vars(self.sizes),
            "tuning": asdict(self.numerics.tuning),
        } | {name: [list(point) for point in line] for name, line in self._lines}

    @classmethod
    def from_dict(cls, data: Mapping) -> Case:
        """Make the case that ``to_dict`` described.

        Parameters
        ----------
        data : mapping
            What ``to_dict`` returned, or JSON has kept of it.

        Returns
        -------
        Case
            The same case.

        Raises
        ------
        BadInput
            For what is missing or wrong.
        """
        try:
            model = Model(tuple(data["mechanisms"]))
            changes = as_written(data["values"]) | data["numerics"]
            changes |= {name: data[name] for name in ("motion", "outline", "until") if name in data}
            numerics = Numerics(tuning=Tuning.of(data["tuning"]) if "tuning" in data else Tuning())
            start = _start(data["name"], model, numerics, data["dim"])
            return _case(_changed(start, changes))
        except (KeyError, TypeError, AttributeError) as error:
            raise BadInput("case", str(error), "a case as Case.to_dict() writes it") from error


# A case in the making is a dictionary: values may still be missing, and are not yet checked to fit.


def _start(name: object, model: Model, numerics: Numerics, dim: int) -> dict[str, Any]:
    return {
        "name": name, "model": model, "values": {}, "numerics": numerics, "dim": dim, "motion": (),
        "outline": (), "until": DEPTH,
    }  # fmt: skip


def _case(fields_: Mapping[str, Any]) -> Case:
    model = fields_["model"]
    return Case(**{k: v for k, v in fields_.items() if k != "model"} | {"mechanisms": model.mechanisms})


def _changed(start: Mapping[str, Any], changes: Mapping[str, object]) -> dict[str, Any]:
    """``start`` with ``changes`` as ``Case.set`` takes them. Raises BadInput."""
    rest, model = dict(changes), start["model"]
    if "mechanisms" in rest:
        model = Model(names(rest.pop("mechanisms"), key="mechanisms"))
    for key in ("with", "with_"):
        if key in rest:
            model = model.with_(*names(rest.pop(key), key="with"))
    if "without" in rest:
        model = model.without(*names(rest.pop("without"), key="without"))
    motion = read_motion(rest.pop("motion")) if "motion" in rest else start["motion"]
    outline, rest = with_outline(rest, start["outline"], model.tool)
    name, word = rest.pop("name", start["name"]), rest.pop("numerics", None)
    until = str(rest.pop("until", start["until"]))
    if word == "paper":
        model = model.as_published()
    values = resolve(start["values"], {k: v for k, v in rest.items() if k not in KEYS}, model)
    numerics, dim = start["numerics"], start["dim"]
    if word is None and dim == 3 and rest.get("mesh") and numerics == defaults(3):
        word = "tetrahedra"  # a mesh file has such elements, and needs their contact
    if word is not None:
        # What is still missing is named later; until then it is the typical value.
        full = {n: q.typical * q.factor for n, q in model.parameters().items()} | values
        modulus = model.shear_modulus(SimpleNamespace(**full))
        numerics = preset(word, dim, modulus, full.get("thickness", 1.0))
    numerics = numerics.set({k: v for k, v in rest.items() if k in KEYS})
    if numerics.mesh is not None:
        mesh_digest(numerics.mesh)  # what cannot be read is refused here, not in the middle of a run
    return {
        "name": name, "model": model, "values": values, "numerics": numerics, "dim": dim, "motion": motion,
        "outline": outline, "until": until,
    }  # fmt: skip


def _unpickled(folders: tuple[Path, ...], state: dict) -> Case:
    take_up(folders)  # another process does not know a user's own laws yet
    return Case(**state)


def load_case(
    source: str | Path, overrides: Mapping[str, object] | Iterable[str] = (), *, dim: int = 2
) -> Case:
    """Make a case from a material's name or a TOML file, with changes.

    Parameters
    ----------
    source : str or Path
        The name of a known material, or a TOML file of a material or a case.
    overrides : mapping, or iterable of str
        Changes as ``Case.set`` takes them, or texts such as ``"eta_reg=0.5 s"``. They may give what the file
        leaves out.
    dim : int
        2 for plane strain, 3 for a block. The defaults of the numerics depend on it.

    Returns
    -------
    Case
        Complete and checked.

    Raises
    ------
    BadInput
        For a source that is not there, and for what is missing or wrong in it or in the changes.

    Examples
    --------
    >>> import cutbench
    >>> case = cutbench.load_case("gelatin", ["eta_reg=0.5 s", "G=8 kPa"])
    >>> case.shown()["eta_reg"], case.shown()["G"]
    ('0.5 s', '8 kPa')
    """
    changes = dict(overrides) if isinstance(overrides, Mapping) else parse_overrides(overrides)
    start, file = _load(source, (), dim)
    draft = _changed(start, changes)
    changed = {ALIASES.get(key, key) for key in changes}
    try:
        return _case(draft)
    except BadInput as error:
        if ALIASES.get(error.key, error.key) in changed:
            raise
        with file.at():
            raise


def case_of(source: object, changes: Mapping[str, object], *, dim: int | None = None) -> Case:
    """A case from whatever a function takes as its source, with changes; in as many dimensions as are asked
    for. Raises BadInput."""
    if isinstance(source, Case):
        return replace(source.set(**changes), dim=source.dim if dim is None else dim)
    named: Any = source
    require(isinstance(named, (str, Path)), "source", named, "a case, a material's name or a TOML file")
    return load_case(named, changes, dim=dim or 2)


def warn_of_doubts(case: Case, stacklevel: int) -> None:
    """What a command says on its way: a warning for each doubt, so many calls above."""
    for sentence in case.doubts:
        warnings.warn(sentence, DoubtfulInput, stacklevel=stacklevel + 1)


def known_materials() -> dict[str, Case]:
    """Return the known materials by name, each as the case that ``run2d`` computes.

    Returns
    -------
    dict of str to Case
        A case for each name that ``load_case`` and ``run2d`` take.

    Examples
    --------
    >>> import cutbench
    >>> materials = cutbench.known_materials()
    >>> materials["gelatin"].shown()["G"]
    '7.5 kPa'
    """
    return {name: load_case(name) for name in materials.names()}


def _load(source: str | Path, before: tuple[Path, ...], dim: int) -> tuple[dict[str, Any], TomlFile]:
    """What a file describes, and the file; those ``before`` led to it by their ``base``."""
    file = read_toml(materials.find(source), "case")
    before = (*before, file.path.resolve())
    with file.at():
        top = read_section(file.table, _FILE, instead=section_hint)
        start = _start(file.path.stem, Model(DEFAULT), defaults(dim), dim)
        if top["base"] is not None:
            origin = file.beside(top["base"])
            again = materials.find(origin, key="base").resolve() in before
            require(not again, "base", top["base"], "a file that does not lead back here")
            start, _ = _load(origin, before, dim)
        model = Model(top["mechanisms"]) if top["mechanisms"] else start["model"]
    changes, places = section_changes(file, {section: top[section] for section in CASE_SECTIONS}, model)
    changes |= {"name": top["material"].get("name") or file.path.stem, "mechanisms": model.mechanisms}
    with file.at(places):
        if "outline" in changes:
            changes["outline"] = read_outline(changes["outline"], file.path.parent)
        if isinstance(mesh := changes.get("mesh"), str):
            changes["mesh"] = str(file.path.parent / mesh)
        return _changed(start, changes), file
