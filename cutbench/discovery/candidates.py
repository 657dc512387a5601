"""Candidates: mechanisms that the model lacks, each where it is switched off, and what was held fixed.

What a mechanism file declares is all there is to know: parameters with an off value are strengths, whose
derivative at "off" says what the mechanism would change first; parameters without one (a relaxation time,
a depth, a wavelength) are shapes, which have no effect at "off" and are tried on a grid. A parameter of the
model that the fit holds is a strength whose "off" is the value that it is held at.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.units import Parameter, powers_of, ureg
from cutbench.calibration.parameters import duration, parameters_felt_by, size_of_tests
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import SLOTS, Experiment
from cutbench.mechanisms import registry
from cutbench.run.sensitivity import differentiable, extended

#: What is asked first, in the order in which an experimenter would.
CAUSES = ("reading", "rig", "parameter", "mechanism")
#: Slot of a candidate that is a parameter.
FIXED = "parameter"
#: Why a law with a time in its parameters is not asked of tests that have none.
NO_TIME_MEASURED = "no fitted test has a time or a speed"
#: The same of a law with a direction, of specimens that all have one.
ONE_ANGLE = "no fitted tests are of specimens at two angles"


@dataclass(frozen=True)
class Candidate:
    """One mechanism beside (or in place of one of) those of ``case``; ``strengths`` are at their off values.
    Or a parameter of the model, in the slot ``parameter``; ``cause`` is one of ``CAUSES``.

    ``grid``: values of the shapes that are tried, internal units; one empty mapping without shapes.
    """

    name: str
    title: str
    slot: str
    strengths: tuple[Parameter, ...]
    shapes: tuple[Parameter, ...]
    grid: tuple[Mapping[str, float], ...]
    cause: str = "mechanism"
    kinds: tuple[str, ...] = ()

    @property
    def added(self) -> tuple[str, ...]:
        """The mechanism that a model takes up for it, if any."""
        return () if self.slot == FIXED else (self.name,)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (*self.strengths, *self.shapes)

    def acts_on(self, experiment: Experiment) -> bool:
        if self.slot == FIXED:
            return experiment.kind in self.kinds
        if self.slot == "rig" and not experiment.mounted:
            return False
        return self.slot in SLOTS[experiment.kind] and (not self.kinds or experiment.kind in self.kinds)


def candidates(
    campaign: Campaign, base: Case, estimated: Collection[str]
) -> tuple[list[Candidate], dict[str, str]]:
    """What may explain what a model gets wrong."""
    found, left_out = _fixed_parameters(campaign, base, estimated), dict[str, str]()
    for name in (n for n in campaign.candidates if n not in base.mechanisms):
        made = _lacking_law(name, campaign, base)
        if isinstance(made, Candidate):
            found.append(made)
        else:
            left_out[name] = made
    return found, left_out


def _lacking_law(name: str, campaign: Campaign, base: Case) -> Candidate | str:
    """The candidate that a law is which the model lacks, or why it is none."""
    m, tests = registry()[name], campaign.train
    kinds = getattr(m, "kinds", ())
    asked = Candidate(name, m.title, m.slot, (), (), ({},), cause_of(name), kinds)
    if not any(asked.acts_on(e) for e in tests):
        mute = m.slot == "rig" and any(e.kind in kinds or not kinds for e in tests)
        return "no fitted test " + ("gives its length and area" if mute else "shows it")
    if m.directed and len(campaign.angles) < 2:
        return ONE_ANGLE
    if any(powers_of(q.unit)[1] for q in m.parameters) and not any(e.timed or e.speed for e in tests):
        return NO_TIME_MEASURED
    try:
        model, new = base.model.extended(name)
        extended(base, [name])
    except BadInput as error:
        return f"cannot be added: {error.expected}"
    size, free = size_of_tests(campaign), {*new} - {*campaign.plan.fixed}
    own = [q.in_tests(*size) for q in m.parameters if q.name in free]
    strengths = tuple(q for q in own if q.off is not None)
    if not strengths:
        return "its parameters are fixed by the campaign"
    sought = differentiable(model, campaign.finds_angles)
    shapes = tuple(q for q in own if q.off is None and q.sought and q.name in sought)
    return replace(asked, strengths=strengths, shapes=shapes, grid=_grid(shapes, campaign, base))


def baseline_of(campaign: Campaign) -> Campaign:
    """The campaign with what its plan says about candidates alone taken out of the baseline's fit."""
    plan, known = campaign.plan, campaign.base.model.parameters()
    free = plan.free and tuple(n for n in plan.free if n in known)
    own = tuple(n for n in plan.own if n in known)
    return replace(campaign, plan=replace(plan, free=free or None, own=own))


def cause_of(name: str) -> str:
    """``reading``, ``rig`` or ``mechanism``, as its file says; ``parameter`` of what is none."""
    law = registry().get(name)
    return "parameter" if law is None else getattr(law, "cause", "rig" if law.slot == "rig" else "mechanism")


def family_of(name: str) -> str:
    """The class of effects that a law is one formula of; of a parameter its own name."""
    law = registry().get(name)
    return name if law is None else law.family or law.title


def cause_title(name: str) -> str:
    """Class and formula of a cause: ``strain stiffening (gent)``, ``the fixed value of nu``; of a rig or a
    reading its title."""
    if name not in registry():
        return f"the fixed value of {name}"
    words = family_of(name) if cause_of(name) == "mechanism" else registry()[name].title
    return words if words.lower() == name.lower() else f"{words} ({name})"


def _fixed_parameters(campaign: Campaign, base: Case, estimated: Collection[str]) -> list[Candidate]:
    """Parameters that tests feel and no fit looks for, but for those that the campaign names as fixed; none
    where nothing is a candidate."""
    given = {n for e in campaign.train for n in (*e.blade, *e.specimen)}
    known, found = {*estimated, *campaign.plan.fixed, *given, "speed"}, []
    # What a cause that was found brings along has been fitted, or left where the data do not determine it.
    own = {*campaign.base.model.parameters()} - known if campaign.candidates else set()
    for name in (n for n in differentiable(base.model) if n in own):
        kinds = tuple(dict.fromkeys(e.kind for e in campaign.train if name in parameters_felt_by(e, base)))
        if kinds:
            q = base.model.parameters()[name]
            held = replace(q, off=base.values[name] / q.factor)
            found.append(Candidate(name, q.doc, FIXED, (held,), (), ({},), "parameter", kinds))
    return found


def _grid(shapes: Sequence[Parameter], campaign: Campaign, base: Case) -> tuple[dict[str, float], ...]:
    if not shapes:
        return ({},)
    count = 5 if len(shapes) == 1 else 4  # of each: together they are many
    axes, known = [], [o for o in base.model.parameters().values() if o.off is None]
    for q in shapes:
        # A relaxation time lies beside one that the model has already, not on it.
        taken = [base.values[o.name] for o in known if o.unit == q.unit and _differ_by_number(o, q)]
        axes.append(_values(q, campaign, count, taken))
    alike = len(shapes) > 1 and all(_differ_by_number(shapes[0], q) for q in shapes[1:])
    places = itertools.combinations(axes[0], len(shapes)) if alike else itertools.product(*axes)
    return tuple(dict(zip([q.name for q in shapes], place, strict=True)) for place in places)


def _differ_by_number(one: Parameter, other: Parameter) -> bool:
    """Whether two parameters' names differ by their numbers only: τ₁ and τ₂."""
    return one.name != other.name and one.name.rstrip("0123456789") == other.name.rstrip("0123456789")


def _values(q: Parameter, campaign: Campaign, count: int, taken: Sequence[float]) -> list[float]:
    """Values of one shape (internal units) within its bounds, in ascending order."""
    low, high = q.bounds
    if low < 0 < high:  # not a size: an angle, say
        reach = min(high, math.pi)
        # As many that none is half a turn from another; none a bound, nor where tests are their own mirror
        # images, so that no derivative says to which side it should turn.
        return list(reach * (2 * (np.arange(count | 1) + 1 / 8) / (count | 1) - 1))
    span = _span(q, campaign)
    # Around the typical value, where no scale of the tests is known.
    around = [q.typical * q.factor * part for part in (1.0, 0.2, 5.0, 0.04, 25.0)[:count]]
    values = around if span is None else np.geomspace(*span, count)
    values = sorted({float(np.clip(v, max(low, 1e-300), high)) for v in values})
    return [v * (1.6 if any(0.8 < v / t < 1.25 for t in taken) else 1.0) for v in values]


def _span(q: Parameter, campaign: Campaign) -> tuple[float, float] | None:
    """The range of times, lengths or speeds that the tests can resolve; None for other units."""
    dimension = "" if q.unit == "1" else str(ureg.Unit(q.unit).dimensionality)
    ranges = []
    for e in campaign.train:
        if dimension == "[time]" and (t := duration(e)):
            ranges.append((t / 30, t * 2))
        elif dimension == "[length]" and e.x_unit == "mm":
            ranges.append((e.reach / 15, e.reach))
        elif dimension == "[length] / [time]" and (v := e.travel_speed) > 0:
            ranges.append((v / 30, v * 10))
    return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None
