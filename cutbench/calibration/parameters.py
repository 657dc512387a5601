"""What is estimated: by the campaign's plan or, where it leaves that open, by what its tests can see."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutbench.base.errors import require
from cutbench.base.toml import one_of
from cutbench.base.units import TYPICAL_TESTS, Parameter
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import SLOTS, Experiment
from cutbench.run.sensitivity import differentiable


@dataclass(frozen=True)
class FreeParameter:
    """A parameter that is estimated: of all tests, or of one.

    It is scaled as q: the logarithm of its ratio to the start where it is above 0 by its nature, so that 0.1
    is ten per cent of it; else its distance from the start in units of ``scale``.

    Attributes
    ----------
    quantity : Parameter
        What it is, with its unit.
    start, low, high : float
        Where the search begins, and its bounds, internal units; these may be infinite.
    experiment : str, optional
        Id of the test that it belongs to; without one, to all.
    """

    quantity: Parameter
    start: float
    low: float
    high: float
    experiment: str | None = None

    @property
    def name(self) -> str:
        return self.quantity.name

    @property
    def label(self) -> str:
        """``G_c``, or ``tau_W[slow]`` for one experiment's own."""
        return self.name if self.experiment is None else f"{self.name}[{self.experiment}]"

    @property
    def logarithmic(self) -> bool:
        return self.quantity.low == 0 and self.quantity.open_low and self.start > 0

    @property
    def scale(self) -> float:
        """What one unit of q is, where q is not a logarithm."""
        return max(abs(self.start), 0.1 * abs(self.quantity.typical * self.quantity.factor)) or 1.0

    @property
    def spread(self) -> float:
        """How far from its start it may well lie, in q: a factor of e, or so much as is typical."""
        typical = abs(self.quantity.typical * self.quantity.factor)
        return 1.0 if self.logarithmic else max(abs(self.start), typical) / self.scale

    def value(self, q: float) -> float:
        """The parameter (internal units) at q, within its bounds, and off those that are open."""
        raw = self.start * math.exp(min(q, 200.0)) if self.logarithmic else self.start + self.scale * q
        # A value that may not be its bound keeps a millionth of its size away from it.
        away, (lowest, highest) = 1e-6 * self.scale, self.quantity.bounds
        low = self.low + away * (self.quantity.open_low and self.low == lowest)
        high = self.high - away * (self.quantity.open_high and self.high == highest)
        return min(max(raw, low), high)

    def slope(self, q: float) -> float:
        """d value/dq."""
        return self.start * math.exp(q) if self.logarithmic else self.scale

    def q(self, value: float) -> float:
        if self.logarithmic:
            return math.log(value / self.start) if value > 0 else -math.inf
        return (value - self.start) / self.scale

    @property
    def reach(self) -> tuple[float, float]:
        """Bounds of q; of a logarithm never more than a factor of 1000 either way."""
        low, high = self.q(self.low), self.q(self.high)
        wide = math.log(1e3) if self.logarithmic else math.inf
        return max(low, -wide), min(high, wide)


def duration(e: Experiment) -> float | None:
    """Seconds that a test took, if that is known."""
    if e.timed:
        return float(np.mean([r.duration_s for r in e.repetitions]))
    return e.reach / e.speed if e.speed and e.kind == "cut" else None


def size_of_tests(campaign: Campaign) -> tuple[float, float, float]:
    """Force (N), travel (mm) and duration (s) of fitted tests, their geometric means; typical ones where no
    test has any. With them no start and no prior depends on units."""
    sizes = np.full((len(campaign.train), 3), math.nan)
    for row, e in zip(sizes, campaign.train, strict=True):
        x, y = (np.concatenate([getattr(r, axis) for r in e.repetitions]) for axis in "xy")
        way = np.abs(x - e.rest).max() if e.curve else e.reach
        row[1] = way * (e.specimen.get("length", math.nan) if e.x_name == "stretch" else 1)
        if e.curve:  # of measures it is not known which is a force
            length = TYPICAL_TESTS[1] if np.isnan(row[1]) else row[1]
            row[0] = np.abs(y).max() * (1 if e.y_unit == "N" else e.area_mm2 or length**2)
        row[2] = duration(e) or math.nan
    known = [np.log(column[column > 0]) for column in sizes.T]
    force, travel, time = (
        math.exp(c.mean()) if c.size else x for c, x in zip(known, TYPICAL_TESTS, strict=True)
    )
    return force, travel, time


def parameters_felt_by(experiment: Experiment, case: Case) -> set[str]:
    """Names of the parameters that a test of its kind can depend on."""
    laws = [law for law in case.model.all if law.slot in SLOTS[experiment.kind]]
    return {name for law in laws for name in (*law.reads, *(q.name for q in law.parameters))}


def free_parameters(campaign: Campaign) -> list[FreeParameter]:
    """What is looked for, by the campaign's plan or, where it leaves that open, by what its tests can see.

    Raises BadInput for a name that cannot be fitted, or if nothing is left.
    """
    plan, case = campaign.plan, campaign.base
    # A speed is known; a test of its own has one of its own.
    possible = [name for name in differentiable(case.model, campaign.finds_angles) if name != "speed"]
    seen = set().union(*(parameters_felt_by(e, case) for e in campaign.train))
    given = {name: e.id for e in campaign.train for name in (*e.blade, *e.specimen)}
    known = [name for name in possible if name in seen]
    for key, name in [*(("free", name) for name in plan.free or ()), *(("own", name) for name in plan.own)]:
        require(name in known, key, name, f"a parameter of these tests: {', '.join(known)}")
        giver = f"'{given.get(name)}' does: take it out there"
        require(name not in given, key, name, f"a parameter that no experiment gives; {giver}")
    for name in plan.fixed:
        require(name in case.model.parameters(), "fixed", name, one_of(name, possible))
    # Known beforehand, or better known otherwise.
    left_out = {n for n, q in case.model.parameters().items() if not q.sought} | {*given, *plan.fixed}
    chosen = set(known) - left_out if plan.free is None else set(plan.free)
    found = []
    for name in possible:
        if name in plan.own:
            tests = [e for e in campaign.train if name in parameters_felt_by(e, case)]
            found += [_free_parameter(campaign, name, e.id) for e in tests]
        elif name in chosen:
            found.append(_free_parameter(campaign, name, None))
    require(found, "free", "(nothing)", f"one parameter or more of {', '.join(possible)}")
    return found


def _free_parameter(campaign: Campaign, name: str, experiment: str | None) -> FreeParameter:
    q = campaign.model.parameters()[name].in_tests(*size_of_tests(campaign))
    low, high = campaign.plan.bounds.get(name, q.bounds)
    start = min(max(campaign.base.values[name], low), high)
    if q.open_high and start == high:
        start = campaign.base.values[name]
    return FreeParameter(q, start, low, high, experiment)
