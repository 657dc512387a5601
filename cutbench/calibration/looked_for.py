"""What a fit looks for: by the campaign's plan or, where it leaves that open, by what its tests can see."""

from __future__ import annotations

from cutbench.base.errors import BadInput
from cutbench.base.toml import one_of
from cutbench.calibration.identifiability import Unknown
from cutbench.case.case import Case
from cutbench.data.campaign import Campaign
from cutbench.data.experiment import SLOTS, Experiment
from cutbench.run.sensitivity import differentiable


def visible(experiment: Experiment, case: Case) -> set[str]:
    """Names of the parameters that a test of its kind can depend on."""
    slots = SLOTS[experiment.kind]
    laws = [law for law in case.model.all if law.slot in slots]
    return {name for law in laws for name in (*law.reads, *(q.name for q in law.parameters))}


def unknowns(campaign: Campaign) -> list[Unknown]:
    """What is looked for, by the campaign's plan or, where it leaves that open, by what its tests can see.

    Raises BadInput for a name that cannot be fitted, or if nothing is left.
    """
    plan, case = campaign.plan, campaign.base
    # A speed is known; a test of its own has one of its own.
    possible = [name for name in differentiable(case.model) if name != "speed"]
    seen = set().union(*(visible(e, case) for e in campaign.train))
    given = {name: e.id for e in campaign.train for name in (*e.blade, *e.specimen)}
    known = [name for name in possible if name in seen]
    for key, name in [*(("free", name) for name in plan.free or ()), *(("own", name) for name in plan.own)]:
        if name not in known:
            raise BadInput(key, name, f"a parameter of these tests: {', '.join(known)}")
        if name in given:
            expected = f"a parameter that no experiment gives; '{given[name]}' does: take it out there"
            raise BadInput(key, name, expected)
    for name in plan.fixed:
        if name not in case.model.parameters():
            raise BadInput("fixed", name, one_of(name, possible))
    if plan.free is None:
        parameters = case.model.parameters()
        # Known beforehand, or better known otherwise.
        left_out = {n for n, q in parameters.items() if not q.sought} | given.keys() | set(plan.fixed)
        chosen = set(known) - left_out
    else:
        chosen = set(plan.free)
    found = []
    for name in possible:
        if name in plan.own:
            found += [_unknown(campaign, name, e.id) for e in campaign.train if name in visible(e, case)]
        elif name in chosen:
            found.append(_unknown(campaign, name, None))
    if not found:
        expected = f"one parameter or more of {', '.join(possible)}"
        raise BadInput("free", "(nothing)", expected)
    return found


def _unknown(campaign: Campaign, name: str, experiment: str | None) -> Unknown:
    q = campaign.model.parameters()[name]
    low, high = campaign.plan.bounds.get(name, q.bounds)
    start = min(max(campaign.base.values[name], low), high)
    if q.open_high and start == high:
        start = campaign.base.values[name]
    return Unknown(q, start, low, high, experiment)
