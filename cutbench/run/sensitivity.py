"""Which parameters a run can be differentiated by, and a complex step in each at every place that knows it.

``run.run_case(case, sensitivities=names)`` gives dF/dθ along the run. For a mechanism that is not in the
model, ``extended`` adds it at the value that switches it off: the run stays what it was, and dF/dθ there
says what the mechanism would change first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from cutbench.base.errors import BadInput
from cutbench.base.toml import among
from cutbench.case.case import Case
from cutbench.case.model import SPECIMEN, Model
from cutbench.forms.base import Form
from cutbench.mechanisms.base import STEP
from cutbench.run.build import Built, contact_numerics, damping_viscosity
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
    return [_direction(built, name) for name in names]


def start_sensitivities(built: Built, names: Sequence[str]) -> Sensitivities:
    """What takes in the accepted steps of ``built.march`` and gives dF/dθ for ``names``."""
    march = built.march
    return Sensitivities(built.problem, march.speed, directions(built, names))


def _direction(built: Built, name: str) -> Direction:
    case, n = built.case, built.case.numerics
    p = case.p
    setattr(p, name, getattr(p, name) + 1j * STEP)
    contact = contact_numerics(case.model, p, n)
    blades = built.blades if isinstance(contact.stiffness, complex) else ()
    forms: dict[str, Form] = {form.name: form.with_numerics(contact) for form in blades}
    laws = [law for law in case.model.all if law.slot not in _FACES]
    known = [name for law in laws for name in (*law.reads, *(q.name for q in law.parameters))]
    viscosity = damping_viscosity(case.model, p, n)
    return Direction(name, p, complex(p.speed), forms, name in known, viscosity)
