"""Which parameters a run can be differentiated by, and a complex step in each at every place that knows it.

``run.run_case(case, sensitivities=names)`` gives dF/dθ along the run. For a mechanism that is not in the
model, ``extended`` adds it at the value that switches it off: the run stays what it was, and dF/dθ there
says what the mechanism would change first.
"""

from __future__ import annotations

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
from cutbench.solver.linearised_perturbation import LinearisedPerturbation
from cutbench.solver.sensitivity import Direction, Sensitivities

#: Sizes that move the mesh, and the travel itself: no derivative by them.
_FIXED = frozenset(q.name for q in SPECIMEN) | {"depth"}
#: Slots whose laws a stateless volume form does not see.
_FACES = frozenset({"cut", "blade", "rig"})


def differentiable(model: Model) -> tuple[str, ...]:
    """Names of the parameters that a run of ``model`` can be differentiated by."""
    return tuple(name for name in model.parameters() if name not in _FIXED)


def checked(case: Case, names: Sequence[str]) -> tuple[str, ...]:
    """``names`` without repetitions. Raises BadInput for one that the case cannot be differentiated by."""
    known = differentiable(case.model)
    for name in names:
        if name in _FIXED:
            expected = f"a parameter that leaves the mesh and the travel as they are: {', '.join(known)}"
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


def directions(built: Built, names: Sequence[str]) -> list[Direction]:
    """A complex step in each of ``names``, for a problem as ``build`` makes it."""
    return [_direction(built.case, name, built.blades) for name in names]


class Added(NamedTuple):
    """A model with laws that do nothing, and their strengths by name: its numbers put them at "off"."""

    case: Case
    names: tuple[str, ...]

    def shares_unknowns_with(self, base: Case) -> bool:
        """Whether its unknowns are those of ``base``, which lacks the laws: no run of its own is needed."""
        same = self.case.model.laws("support") == base.model.laws("support")
        return same and base.numerics.element != "P2P1"


class Following:
    """Derivatives along a march of ``built``: by ``names``, and by the strengths of what is ``added``."""

    def __init__(self, built: Built, names: Sequence[str], added: Sequence[Added] = ()):
        self._names, self._added = tuple(names), tuple(added)
        self._perturbations = [
            LinearisedPerturbation(_forms(built, each.case), each.case.p) for each in added
        ]
        self.sensitivities = Sensitivities(built.problem, built.march.speed, self._directions(built))

    def _directions(self, built: Built) -> list[Direction]:
        found = directions(built, self._names)
        for each, perturbation in zip(self._added, self._perturbations, strict=True):
            forms = (perturbation.forms.get(form.name, form) for form in built.blades)
            blades = [form for form in forms if isinstance(form, BladeForm)]
            for name in each.names:
                found.append(replace(_direction(each.case, name, blades), perturbation=perturbation))
        return found

    def go_on(self, built: Built, displacements, states) -> None:
        """On the mesh of ``built``; ``displacements`` and ``states`` as ``Sensitivities.go_on`` has them."""
        self._perturbations = [
            old.on(_forms(built, each.case))
            for each, old in zip(self._added, self._perturbations, strict=True)
        ]
        self.sensitivities.go_on(built.problem, self._directions(built), displacements, states)

    def split(self, columns: np.ndarray) -> tuple[dict[str, np.ndarray], list[dict[str, np.ndarray]]]:
        """Of columns (n, k), one a direction, those by ``names``, and those of each that is added."""
        columns, found = columns.T, []
        own = dict(zip(self._names, columns, strict=False))
        first = len(self._names)
        for each in self._added:
            found.append(dict(zip(each.names, columns[first:], strict=False)))
            first += len(each.names)
        return own, found


def start_sensitivities(built: Built, names: Sequence[str]) -> Sensitivities:
    """What takes in the accepted steps of ``built.march`` and gives dF/dθ for ``names``."""
    return Following(built, names).sensitivities


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
            contact = contact_numerics(model, case.p, n)
            found[form.name] = form.with_laws(model.laws("blade"), contact)
    if any(law.surfaces for law in added):
        faces = {name: built.space.faces(name, n.facet_degree) for name in built.geometry.blade_faces}
        cut = bool(model.laws("cut"))
        forms = surfaces_of(added, built.space, built.geometry, faces, cut, n.facet_degree)
        found |= {form.name: form for form in forms}
    return found


def _direction(case: Case, name: str, blades: Sequence[BladeForm]) -> Direction:
    p, n = case.p, case.numerics
    setattr(p, name, getattr(p, name) + 1j * STEP)
    contact = contact_numerics(case.model, p, n)
    moved = blades if isinstance(contact.stiffness, complex) else ()
    forms: dict[str, Form] = {form.name: form.with_numerics(contact) for form in moved}
    laws = [law for law in case.model.all if law.slot not in _FACES]
    known = [name for law in laws for name in (*law.reads, *(q.name for q in law.parameters))]
    viscosity = damping_viscosity(case.model, p, n)
    return Direction(name, p, complex(p.speed), forms, name in known, viscosity)
