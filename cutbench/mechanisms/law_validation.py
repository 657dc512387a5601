"""What a law must have to be taken up: names, answers of its slot, a state that is handed over in full."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.units import Parameter
from cutbench.mechanisms.base import (
    PROTOCOL,
    SPECIMEN,
    Blade,
    Bulk,
    Cut,
    Mechanism,
    Points,
    Rig,
    Skin,
    Support,
    cut_answers,
)

#: The base of each slot and the methods that a law of it must have.
BASES: dict[str, tuple[type[Mechanism], tuple[str, ...]]] = {
    "bulk": (Bulk, ("stress", "energy")),
    "cut": (Cut, ("traction",)),
    "blade": (Blade, ("strength",)),
    "skin": (Skin, ()),
    "support": (Support, ("compliance",)),
    "rig": (Rig, ("record",)),
}
#: What a law is tried with in place of 1.
LIKE_ONE = 0.8
#: Points of the trial evaluation.
_N = 2


def declared(known: Mapping[str, Mechanism]) -> dict[str, Parameter]:
    """Every quantity that some law of ``known`` or the test declares, by name."""
    laws = (q for law in known.values() for q in law.parameters)
    return {q.name: q for q in (*laws, *SPECIMEN, *PROTOCOL)}


def typical(law: Mechanism, known: Mapping[str, Mechanism]) -> SimpleNamespace:
    """Typical values, internal units, of what the law declares and reads, and of nothing else."""
    every = declared(known)
    wanted = {name: every[name] for name in law.reads} | {q.name: q for q in law.parameters}
    return SimpleNamespace(**{name: _telling(q) * q.factor for name, q in wanted.items()})


def _telling(q: Parameter) -> float:
    """The typical value; in place of a 1, which is its own square, another if it may be that."""
    low, high = q.bounds
    return LIKE_ONE if q.unit == "1" and q.typical == 1.0 and low <= LIKE_ONE <= high else q.typical


def refuse_incomplete(law: Mechanism, known: Mapping[str, Mechanism]) -> None:
    """Raises BadInput, which names the law, its file and what is missing; ``known`` has all laws by name."""
    try:
        fault = next(_missing(law, known), None)
    except Exception as error:  # whatever a law does wrong
        fault = f"fails with {type(error).__name__}: {error}", "a law that answers at typical values"
    if fault:
        file = inspect.getsourcefile(type(law))
        raise BadInput(file=file, key=law.name, value=fault[0], expected=fault[1])


def _missing(law: Mechanism, known: Mapping[str, Mechanism]) -> Iterator[tuple[str, str]]:
    """What is wrong and what would be right, if anything."""
    base, methods = BASES[law.slot]
    if not re.fullmatch(r"[a-z][a-z0-9_]*", law.name):
        yield f"name = {law.name!r}", "a name of small letters, digits and underscores"
    if not getattr(law, "title", ""):
        yield "no title", "a title of a word or two, for legends"
    for name in methods:
        if getattr(type(law), name) is getattr(base, name):
            yield f"no {name}()", f"the method {name}() that every law of the slot '{law.slot}' has"
    every = declared(known)
    for name in law.reads:
        if name not in every:
            yield f"reads '{name}'", "names of parameters that some mechanism declares"
    roles = {other.role for other in known.values() if other.slot == law.slot}
    for role in law.follows:
        if role not in roles:
            yield f"follows '{role}'", f"roles of mechanisms of the slot '{law.slot}'"
    if not isinstance(law, Cut):
        return
    if law.role is None:
        yield "no role", "role = 'cohesive' of the law that parts the faces, or a role of its own"
    begun, ended = _states(law, known)
    damage = "it in the state, 0 where the interface is whole and 1 where it is cut: start() gives that of"
    for name, state in (("start", begun), ("traction", ended)):
        if law.role == "cohesive" and "damage" not in state:
            yield f"no 'damage' from {name}()", f"{damage} virgin points, traction() the new one"
    for name in sorted(begun ^ ended):
        one, other = ("start", "traction") if name in begun else ("traction", "start")
        yield f"'{name}' from {one}() only", f"it from {other}() too: what is not returned is not kept"
    if law.role == "cohesive":
        estimate = law.estimate(typical(law, known), 0.0, 0.0)
        for name in ("strength", "opening"):
            if not getattr(estimate, name):
                yield f"no '{name}' from estimate()", f"the cohesion's {name} at its peak"


def _states(law: Cut, known: Mapping[str, Mechanism]) -> tuple[set[str], set[str]]:
    """Names in the law's virgin state, and in that after a first step beside laws that it may follow."""
    laws: dict[str | None, Cut] = {}
    for other in known.values():
        if isinstance(other, Cut) and other.rank < law.rank and other.role != law.role:
            laws.setdefault(other.role, other)
    together = [*laws.values(), law]
    p = SimpleNamespace(**{k: v for each in together for k, v in vars(typical(each, known)).items()})
    state = {k: v for each in together for k, v in each.start(_N, p).items()}
    none = np.zeros((3, _N))
    at = Points(X=none, depth=none[0], dt=1.0, speed=1.0, jump_old=none)
    return set(law.start(_N, p)), set(cut_answers(together, none + 1e-3, p, state, at)[-1].new)
