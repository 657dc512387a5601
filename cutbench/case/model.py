"""A model is a set of mechanisms: add one, take one out, ask what numbers it needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from graphlib import TopologicalSorter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.base.toml import among, one_of
from cutbench.base.units import Parameter
from cutbench.mechanisms import Group, Mechanism, Tool, Volumetric, registry
from cutbench.mechanisms.base import MODULUS, PROTOCOL, SPECIMEN, Bulk, Rig
from cutbench.mechanisms.own_laws import folders_of, take_up


def _built_in(flag: str) -> tuple[str, ...]:
    laws = [m for m in registry().values() if type(m).__module__.startswith("cutbench.mechanisms.")]
    return tuple(m.name for m in laws if getattr(m, flag))


#: Names of the mechanisms of the default model, and of the model as the paper states it. They differ in the
#: cohesive law, in a viscous term that converges, and in the gradient of the surface.
DEFAULT, PAPER = _built_in("standard"), _built_in("published")
#: Models by a name of their own.
SETS = {"default": DEFAULT, "paper": PAPER}


def groups() -> dict[str, Group]:
    """All that may be set in place of a parameter, by name, in the order in which it is applied: a later one
    uses what an earlier one has set."""
    return dict(_ordered(tuple(registry().values())))


@lru_cache(maxsize=4)
def _ordered(laws: tuple[Mechanism, ...]) -> dict[str, Group]:
    known = {g.name: g for m in laws for g in m.settable}
    setters = {g.parameter: g.name for g in known.values()}
    order = {name: [setters[need] for need in g.needs if need in setters] for name, g in known.items()}
    return {name: known[name] for name in TopologicalSorter(order).static_order()}


def levers() -> dict[str, str]:
    """What a designer can change, and the parameter that does it."""
    declared = [*PROTOCOL, *SPECIMEN, *(q for m in registry().values() for q in m.parameters)]
    return {q.lever: q.name for q in declared if q.lever}


def mechanism(name: object, *, key: str = "mechanisms") -> Mechanism:
    """The registered mechanism called ``name``; BadInput with the nearest name otherwise."""
    known = registry()
    own = "; the folder of a law of your own is named by --mechanisms DIR"
    if name not in list(known):
        raise BadInput(key, name, one_of(str(name), known) + own)
    return known[str(name)]


def owners(parameter: str) -> list[str]:
    """Names of the registered mechanisms that declare ``parameter``."""
    return [m.name for m in registry().values() if any(q.name == parameter for q in m.parameters)]


@dataclass(frozen=True)
class Model:
    """A model is the set of mechanisms of a run: its bulk, fracture, contact, friction and surface laws.

    They are kept in the registry's order so that equal sets are equal models.

    Attributes
    ----------
    mechanisms : tuple of str
        Names of the mechanisms; those of the default model unless given.

    Raises
    ------
    BadInput
        For an unknown name, two mechanisms of one role, no bulk law, or a parameter that a mechanism reads
        and that the one in the place of its owner does not declare.

    Examples
    --------
    >>> import cutbench
    >>> model = cutbench.Model().without("adhesion").with_("smith_ferrante")
    >>> "adhesion" in model.mechanisms, "smith_ferrante" in model.mechanisms
    (False, True)
    >>> model.parameters()["G_c"].unit
    'J/m^2'
    """

    mechanisms: tuple[str, ...] = DEFAULT

    def __post_init__(self) -> None:
        asked = [mechanism(name) for name in self.mechanisms]
        roles: dict[tuple[str, str], str] = {}
        listed = ", ".join(self.mechanisms)
        for m in asked:
            if m.role is not None:
                other = roles.setdefault((m.slot, m.role), m.name)
                expected = f"one mechanism of the role '{m.role}': take out {other} or {m.name}"
                require(other == m.name, "mechanisms", f"{other}, {m.name}", expected)
        for m in asked:
            for role in m.follows:
                able = ", ".join(o.name for o in registry().values() if (o.slot, o.role) == (m.slot, role))
                expected = f"a mechanism of the role '{role}' for {m.name}, such as {able}"
                require((m.slot, role) in roles, "mechanisms", listed, expected)
        shear = [m for m in registry().values() if m.slot == "bulk" and not isinstance(m, Volumetric)]
        expected = f"a bulk law that resists shear: {', '.join(m.name for m in shear)}"
        require(any(m in shear for m in asked), "mechanisms", listed, expected)
        self._refuse_orphans(asked, roles)
        names = {m.name for m in asked}
        object.__setattr__(self, "mechanisms", tuple(name for name in registry() if name in names))

    @staticmethod
    def _refuse_orphans(asked: list[Mechanism], roles: Mapping[tuple[str, str], str]) -> None:
        """Raise BadInput for a parameter that is read, and whose owner's place has a law without it: the
        reader would go on with a number that nothing in the model is made of."""
        declared = {q.name for m in asked for q in m.parameters}
        for reader in asked:
            for name in (name for name in reader.reads if name not in declared):
                who = owners(name)
                places = [(registry()[o].slot, registry()[o].role or "") for o in who]
                law = next((roles[place] for place in places if place in roles), "")
                if name == MODULUS:  # that of the bulk laws, which these laws add to
                    law = reader.name if isinstance(reader, Bulk) and reader.adds_stiffness else ""
                expected = (
                    f"a parameter that a mechanism of the model declares; {law}, in the place of"
                    f" {' or '.join(who)}, does not: let {law} declare {name}, or leave {reader.name}"
                )
                require(not law, f"{reader.name} reads", name, expected)

    def __reduce__(self):
        return _unpickled, (folders_of(self.mechanisms), self.mechanisms)

    @cached_property
    def all(self) -> tuple[Mechanism, ...]:
        """The mechanisms themselves, by slot, rank and name."""
        return tuple(registry()[name] for name in self.mechanisms)

    def laws(self, slot: str) -> tuple[Any, ...]:
        """Return the mechanisms of one slot in the order in which they are evaluated.

        Parameters
        ----------
        slot : str
            The part of the problem that laws belong to: ``bulk``, ``cut``, ``blade``, ``skin``, ``support``
            or ``rig``.

        Returns
        -------
        tuple of Mechanism
            None, one or several.
        """
        return tuple(m for m in self.all if m.slot == slot)

    def with_(self, *names: str) -> Model:
        """Return the model with mechanisms added; each replaces what had its role.

        Parameters
        ----------
        *names : str
            Names of known mechanisms.

        Returns
        -------
        Model
            A new one.

        Raises
        ------
        BadInput
            For a name that no mechanism has.
        """
        names_ = list(self.mechanisms)
        for name in names:
            new = mechanism(name, key="with")
            names_ = [
                old for old in names_
                if new.role is None or (registry()[old].slot, registry()[old].role) != (new.slot, new.role)
            ]  # fmt: skip
            names_.append(name)
        return Model(tuple(names_))

    def extended(self, *names: str) -> tuple[Model, dict[str, float]]:
        """Return the model with mechanisms added where they have no effect, and the values which that takes.

        Parameters
        ----------
        *names : str
            Names of known mechanisms.

        Returns
        -------
        model : Model
            With the mechanisms.
        values : dict of str to float
            The parameters that the model did not have, in internal units: the off value, else the default,
            else the typical one.

        Raises
        ------
        BadInput
            Where no new parameter switches a mechanism off, or where it would replace one that is not among
            its special cases.
        """
        model, values = self, {}
        for name in names:
            added, known = mechanism(name, key="with"), model.parameters()
            if name in model.mechanisms:
                continue
            new = [q for q in added.parameters if q.name not in known]
            replaced = [m for m in model.all if m.role and (m.slot, m.role) == (added.slot, added.role)]
            switched = any(q.off is not None for q in new)
            require(switched, "with", name, "a mechanism that a value of its own switches off")
            kin = [c for c in type(added).__mro__[1:] if any(type(m) is c for m in registry().values())]
            for old in replaced:
                special = set(old.parameters) <= set(added.parameters) and type(old) in (
                    kin[:1] or [type(old)]
                )
                require(special, "with", name, f"a mechanism that has {old.name} as a special case")
            model = model.with_(name)
            # With what it reads of a law that is not there.
            for q in (q for q in model.parameters().values() if q.name not in known):
                start = next(v for v in (q.off, q.default, q.typical) if v is not None)
                values[q.name] = start * q.factor
        return model, values

    @property
    def described(self) -> str:
        """The model in words: ``default: neo_hookean, …``, ``paper: …``, or the mechanisms alone."""
        name = next((f"{k}: " for k, each in SETS.items() if set(each) == set(self.mechanisms)), "")
        return name + ", ".join(self.mechanisms)

    @property
    def unrigged(self) -> Model:
        """The model without the testing machine and how it reads.

        What the specimen and the blade do is the same.
        """
        return self.without(*(law.name for law in self.laws("rig")))

    def without(self, *names: str) -> Model:
        """Return the model with mechanisms taken out.

        Parameters
        ----------
        *names : str
            Names of mechanisms of this model.

        Returns
        -------
        Model
            A new one.

        Raises
        ------
        BadInput
            For a name that the model does not have, or where no bulk law is left.
        """
        for name in names:
            among("without", name, self.mechanisms)
        return Model(tuple(m for m in self.mechanisms if m not in names))

    def parameters(self) -> dict[str, Parameter]:
        """Return every number the model needs, by name: of its mechanisms, the specimen and the protocol.

        A parameter that a law reads from a mechanism stays when that mechanism is taken out: the blade keeps
        its thickness without contact, and a viscous term scaled by G_c keeps G_c. The shear modulus alone
        does not, since bulk laws have one without declaring it.

        Returns
        -------
        dict of str to Parameter
            With units and bounds.

        Raises
        ------
        ValueError
            If two mechanisms declare a parameter differently, or one reads a parameter that none declares.
        """
        declared: dict[str, Parameter] = {}
        for m in self.all:
            for q in m.parameters:
                if declared.setdefault(q.name, q) != q:
                    raise ValueError(
                        f"{m.name} declares {q.name} otherwise than another mechanism of the model"
                    )
        declared |= {q.name: q for q in SPECIMEN + PROTOCOL}
        for m in self.all:
            for name in m.reads:
                if name not in declared and name != MODULUS:
                    owned = (q for law in registry().values() for q in law.parameters if q.name == name)
                    if (first := next(owned, None)) is None:
                        raise ValueError(f"{m.name} reads {name}, which no mechanism declares")
                    declared[name] = first
        return declared

    @cached_property
    def derives_modulus(self) -> bool:
        """Whether its shear modulus follows from its bulk laws, and is no parameter."""
        return not any(q.name == MODULUS for m in self.all for q in m.parameters)

    def namespace(
        self, values: Mapping[str, Any], outline: Sequence[tuple[float, float]] = ()
    ) -> SimpleNamespace:
        """Return the parameters as laws read them.

        Parameters
        ----------
        values : mapping of str to float
            All values, internal units.
        outline : sequence of (float, float)
            A measured profile of the blade, mm.

        Returns
        -------
        SimpleNamespace
            Values by attribute, with the shear modulus that they come to where no law declares one.
        """
        p = SimpleNamespace(**values, **({"outline": np.array(outline)} if outline else {}))
        if self.derives_modulus:
            setattr(p, MODULUS, self.shear_modulus(p))
        return p

    def groups(self, p: SimpleNamespace) -> dict[str, float]:
        """Compute all dimensionless groups of its mechanisms.

        Parameters
        ----------
        p : SimpleNamespace
            The parameters by attribute, internal units; a case has them as ``case.p``.

        Returns
        -------
        dict of str to float
            Values by the formula of the group.
        """
        return {text: float(value) for m in self.all for text, value in m.groups(p).items()}

    def cohesive_zone(self, p: SimpleNamespace) -> float:
        """Compute the length of the zone at a front in which cohesion acts.

        It is E′ G_c/σ_c² (Hillerborg, Modéer & Petersson 1976), with E′ = 4 G of a solid that hardly changes
        its volume.

        Parameters
        ----------
        p : SimpleNamespace
            The parameters by attribute, internal units.

        Returns
        -------
        float
            The length, mm; infinite without cohesion.
        """
        of = [law.estimate(p, 0.0, 0.0) for law in self.laws("cut")]
        strength, work = sum(each.strength for each in of), sum(each.work for each in of)
        if not strength:
            return math.inf
        return 4 * self.shear_modulus(p) * work / strength**2

    def shear_modulus(self, p: SimpleNamespace) -> float:
        """Compute the shear modulus of slow loading at small strain.

        Parameters
        ----------
        p : SimpleNamespace
            The parameters by attribute, internal units.

        Returns
        -------
        float
            The modulus, MPa.
        """
        return sum(law.shear_modulus(p) for law in self.all if isinstance(law, Bulk))

    def mirrored(self, p: SimpleNamespace) -> tuple[bool, ...]:
        """Find whether its bulk is the same where x, y or z is reversed.

        Parameters
        ----------
        p : SimpleNamespace
            The parameters by attribute, internal units.

        Returns
        -------
        tuple of bool
            Of x across the cut plane, y along the blade's way and z along its edge.
        """
        return tuple(map(all, zip(*(law.mirrored(p) for law in self.laws("bulk")), strict=True)))

    def turned(self, angle: float) -> dict[str, float]:
        """Say what laws with a direction read of a specimen that was cut out of its body at an angle.

        Parameters
        ----------
        angle : float, rad
            That of the specimen.

        Returns
        -------
        dict of str to float
            Values by parameter; none where no law has a direction.
        """
        return {law.directed: angle for law in self.all if law.directed}

    @property
    def tool(self) -> Tool | None:
        """The law by which the blade meets the specimen, None where there is none."""
        return next((law for law in self.all if isinstance(law, Tool)), None)

    def as_published(self) -> Model:
        """Return the model with laws of the default model as the paper has them, where the two differ.

        Returns
        -------
        Model
            A new one; the other laws stay.
        """
        own = {(m.slot, m.role): m.name for m in self.all if m.standard and not m.published}
        theirs = {(registry()[name].slot, registry()[name].role): name for name in PAPER}
        bare = self.without(*(name for place, name in own.items() if place not in theirs))
        return bare.with_(*(name for place, name in theirs.items() if place in own))

    def record(self, displacement, force, time, p: SimpleNamespace):
        """Compute what the testing machine records of a true displacement and force.

        Parameters
        ----------
        displacement : ndarray, shape (n,), mm
            How far the blade has truly gone.
        force : ndarray, shape (n,), N
            The true force on it.
        time : ndarray, shape (n,), s
            When.
        p : SimpleNamespace
            The parameters by attribute, internal units.

        Returns
        -------
        displacement : ndarray, shape (n,), mm
            As recorded.
        force : ndarray, shape (n,), N
            As recorded.
        """
        for law in self.all:
            if isinstance(law, Rig):
                displacement, force = law.record(displacement, force, time, p)
        return displacement, force

    def shown(self, course: np.ndarray, p: SimpleNamespace) -> np.ndarray:
        """Compute what the testing machine shows of a blade that is driven on.

        Where the machine's compliance would take the record back, while the force falls faster than the blade
        moves, it stands still until the record is beyond where it was: the specimen has snapped meanwhile.

        Parameters
        ----------
        course : ndarray, shape (3, n)
            True displacement in mm, force in N and time in s.
        p : SimpleNamespace
            The parameters by attribute, internal units.

        Returns
        -------
        ndarray, shape (3, k)
            Recorded displacement in mm, force in N and time in s, with k ≤ n.
        """
        displacement, force, time = course
        x, force = self.record(displacement, force, time, p)
        on = np.real(x) > np.append(-np.inf, np.maximum.accumulate(np.real(x))[:-1])
        return np.stack([x[on], force[on], time[on]])

    def settable_groups(self) -> dict[str, Group]:
        """Return the groups that can be set in this model, in the order in which they are applied.

        Returns
        -------
        dict of str to Group
            By the name that ``Case.set`` takes.
        """
        here = self.parameters()
        read = {*here, MODULUS}
        return {n: g for n, g in groups().items() if g.parameter in here and read.issuperset(g.needs)}


def _unpickled(folders: tuple[Path, ...], names: tuple[str, ...]) -> Model:
    take_up(folders)
    return Model(names)


def apply_groups(values: Mapping[str, float], asked: Mapping[str, float], model: Model) -> dict[str, float]:
    """``values`` (internal units) with each group of ``asked`` solved for its parameter."""
    solved = dict(values)
    for name, group in groups().items():
        if name in asked:
            solved[group.parameter] = group.solve(model.namespace(solved), asked[name])
    return solved


def section_of(parameter: str) -> str:
    """The section of a case file in which ``parameter`` is written."""
    if any(q.name == parameter for q in SPECIMEN):
        return "specimen"
    if any(q.name == parameter for q in PROTOCOL):
        return "protocol"
    return "blade" if any(q.name == parameter for m in tools() for q in m.parameters) else "parameters"


def tools() -> list[Tool]:
    """The registered laws by which a blade meets the specimen."""
    return [m for m in registry().values() if isinstance(m, Tool)]
