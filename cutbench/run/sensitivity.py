"""Which parameters a run can be differentiated by, and a complex step in each at every place that knows it.

``run.run_case(case, sensitivities=names)`` gives dF/dθ along the run. For a mechanism that is not in the
model, ``extended`` adds it at the value that switches it off: the run stays what it was, and dF/dθ there
says what the mechanism would change first.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.toml import among
from cutbench.case.case import Case
from cutbench.case.model import SPECIMEN, Model
from cutbench.forms.base import Form
from cutbench.forms.blade import BladeForm
from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.mechanisms.base import STEP
from cutbench.run.build import Built, contact_numerics, damping_viscosity, surfaces_of
from cutbench.run.observer import Observer
from cutbench.run.remeshing import Transfer
from cutbench.solver.linearised_perturbation import LinearisedPerturbation
from cutbench.solver.march import Accepted
from cutbench.solver.sensitivity import Direction, Sensitivities

#: Sizes that move the mesh, and the blade's way itself: no derivative by them.
_FIXED = frozenset(q.name for q in SPECIMEN) | {"depth", "slice_push"}
#: Slots whose laws a stateless volume form does not see.
_FACES = frozenset({"cut", "blade", "rig"})


def differentiable(model: Model, angles: bool = False) -> tuple[str, ...]:
    """Names of the parameters that a run of ``model`` can be differentiated by; no angle that says how much
    of the specimen is meshed, unless none is: then ``angles``, too."""
    directed = [law for law in model.all if law.directed]
    turned = {q.name for law in directed for q in law.parameters if q.unit == "deg"}
    left_out = _FIXED | ({law.directed for law in directed} if angles else turned)
    return tuple(name for name in model.parameters() if name not in left_out)


def checked(case: Case, names: Sequence[str]) -> tuple[str, ...]:
    """``names`` without repetitions. Raises BadInput for one that the case cannot be differentiated by."""
    known = differentiable(case.model)
    for name in names:
        if name in _FIXED:
            expected = f"a parameter that leaves the mesh and the blade's way as they are: {', '.join(known)}"
            raise BadInput("sensitivities", name, expected)
        among("sensitivities", name, known)
        if name == "speed" and case.motion:
            raise BadInput("sensitivities", name, "a blade without a motion of its own")
    return tuple(dict.fromkeys(names))


def extended(case: Case, mechanisms: Sequence[str], values: Mapping[str, float] | None = None) -> Case:
    """``case`` with ``mechanisms`` added where they have no effect.

    Parameters that the case lacks take their off value; those without one what ``values`` has (internal
    units), else the default, else the typical value. A mechanism may take the place of one that it has as
    a special case. Raises BadInput for a mechanism that no value of its own switches off.
    """
    model, new = case.model.extended(*mechanisms)
    for q in model.parameters().values():
        if q.name in new and q.off is None:
            new[q.name] = (values or {}).get(q.name, new[q.name])
    return replace(case, mechanisms=model.mechanisms, values={**case.values, **new})


class Added(NamedTuple):
    """A model with laws that do nothing, and their strengths by name: its numbers put them at "off"."""

    case: Case
    names: tuple[str, ...]

    def shares_unknowns_with(self, base: Case) -> bool:
        """Whether its unknowns are those of ``base``, which lacks the laws: no run of its own is needed."""
        own = self.case.model.parameters()
        acting = {name: own[name].typical * own[name].factor for name in self.names}
        model, p = self.case.model, replace(self.case, values={**self.case.values, **acting}).p
        same = model.laws("support") == base.model.laws("support")
        # What is oblique, once it acts, takes more than the part that stands for the whole without it.
        same = same and model.mirrored(p) == base.model.mirrored(base.p)
        return same and base.numerics.element != "P2P1"


class Following(Observer):
    """Derivatives along a march of ``built``: by ``names``, and by the strengths of what is ``added``."""

    def __init__(self, built: Built, names: Sequence[str], added: Sequence[Added] = ()):
        self.names, self._added = tuple(names), tuple(added)
        self._timer, self._scale = built.problem.timer, built.geometry.multiplicity
        self._perturbations = [
            LinearisedPerturbation(_forms(built, each.case), each.case.p) for each in added
        ]
        self.sensitivities = Sensitivities(built.problem, built.march.speed, self._directions(built))
        self._slopes = [np.zeros(len(self.names) + sum(len(each.names) for each in added))]

    def add(self, step: Accepted) -> None:
        since = time.perf_counter()
        slope = self.sensitivities.add(step)
        self._timer.add("sensitivities", since)
        if not step.between:
            self._slopes.append(slope)

    def renewed(self, transfer: Transfer) -> None:
        new = transfer.new
        self._perturbations = [
            old.on(_forms(new, each.case)) for each, old in zip(self._added, self._perturbations, strict=True)
        ]
        self.sensitivities.go_on(new.problem, self._directions(new), transfer.displacements, transfer.states)

    def slopes(self, steps: int) -> tuple[dict[str, np.ndarray], list[dict[str, np.ndarray]]]:
        """dF/dθ (steps,) of the whole specimen by ``names``, and by those of each law that is added."""
        columns = iter(np.array(self._slopes)[:steps].T * self._scale)
        groups = [{name: next(columns) for name in names}
                  for names in (self.names, *(each.names for each in self._added))]  # fmt: skip
        return groups[0], groups[1:]

    def _directions(self, built: Built) -> list[Direction]:
        found = [_direction(built.case, built.case, name, built.blades) for name in self.names]
        for each, perturbation in zip(self._added, self._perturbations, strict=True):
            forms = (perturbation.forms.get(form.name, form) for form in built.blades)
            blades = [form for form in forms if isinstance(form, BladeForm)]
            for name in each.names:
                found.append(
                    replace(_direction(built.case, each.case, name, blades), perturbation=perturbation)
                )
        return found


def _forms(built: Built, case: Case) -> dict[str, Form]:
    """The forms of ``case`` that those of ``built``, which lacks some of its laws, are not."""
    model, base, n = case.model, built.case.model, case.numerics
    skins = model.laws("skin")
    found: dict[str, Form] = {}
    added = [law for law in skins if law not in base.laws("skin")]
    differ = {slot: bool(added) or model.laws(slot) != base.laws(slot) for slot in ("bulk", "cut")}
    for form in built.problem.forms:
        if isinstance(form, BulkForm) and differ["bulk"]:
            found[form.name] = form.with_laws(model.laws("bulk"), skins)
        elif isinstance(form, CutForm) and differ["cut"]:
            found[form.name] = form.with_laws(model.laws("cut"), skins)
        elif isinstance(form, BladeForm) and model.laws("blade") != base.laws("blade"):
            contact = contact_numerics(built.case, model, case.p)
            found[form.name] = form.with_laws(model.laws("blade"), contact)
    if any(law.surfaces for law in added):
        faces = {name: built.space.faces(name, n.facet_degree) for name in built.geometry.blade_faces}
        cut = bool(model.laws("cut"))
        forms = surfaces_of(added, built.space, built.geometry, faces, cut, n.facet_degree)
        found |= {form.name: form for form in forms}
    return found


def _direction(held: Case, case: Case, name: str, blades: Sequence[BladeForm]) -> Direction:
    """By ``name`` of ``case``, with the sizes of the case that is ``held``."""
    moved_to = {**vars(case.p), name: getattr(case.p, name) + 1j * STEP}
    p = case.model.namespace(moved_to)
    contact = contact_numerics(held, case.model, p)
    moved = blades if isinstance(contact.stiffness, complex) else ()
    forms: dict[str, Form] = {form.name: form.with_numerics(contact) for form in moved}
    laws = [law for law in case.model.all if law.slot not in _FACES]
    known = [name for law in laws for name in (*law.reads, *(q.name for q in law.parameters))]
    viscosity = damping_viscosity(held, p)
    return Direction(name, p, complex(p.speed), forms, name in known, viscosity)
