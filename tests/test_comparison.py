"""A comparison of nested models names the class of what was hidden, and nothing where nothing was."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from blind_cases import campaign, made
from test_estimation import posterior_of

from cutbench.calibration.estimation import choose, estimate
from cutbench.discovery.candidates import baseline_of, family_of
from cutbench.discovery.comparison import RULES, Comparison, Step, compare_models, predicted


@cache
def compared(*asked) -> Comparison:
    posterior, _ = choose(posterior_of(baseline_of(campaign(*asked))))
    return compare_models(estimate(posterior))


def classes(step: Step) -> set[str]:
    return {family_of(c.name) for c in step.group}


@pytest.mark.slow
def test_it_names_the_class_of_what_was_hidden_and_nothing_else():
    found = compared("gent", "bulk")
    assert made("gent", "bulk").misfit > 2
    assert found.verdict == "mechanism" and family_of("gent") in classes(found.steps[0])
    assert found.found[0].evidence > 0 and found.found[0].p < RULES.chance
    assert len(found.found) == 1


@pytest.mark.parametrize(
    "shows", ["bulk", *(pytest.param(s, marks=pytest.mark.slow) for s in ("joint", "sliding"))]
)
def test_it_names_nothing_where_nothing_is_hidden(shows):
    found = compared("", shows)
    assert found.verdict == "none" and not found.found and found.final is found.baseline


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["jump", "fade"])
def test_what_no_candidate_has_is_not_named(effect):
    found = compared(effect, "sliding", False)
    assert found.verdict == "unexplained" and not found.found


@pytest.mark.slow
def test_what_was_found_predicts_better():
    found = compared("gent", "bulk")
    (e,) = found.baseline.posterior.predictions.campaign.test
    t, _, clean = made("gent", "bulk").clean[e.id]
    true = np.interp(found.baseline.posterior.predictions.grids[e.id].time_s, t, clean)
    errors = [np.sqrt(np.mean((predicted(m, e) - true) ** 2)) for m in (found.baseline, found.final)]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.slow
def test_candidates_of_one_class_are_a_group_and_the_evidence_orders_them():
    step = compared("gent", "bulk").steps[0]
    evidence = [c.evidence for c in step.compared]
    assert evidence == sorted(evidence, reverse=True)
    assert all(c.convincing for c in step.group)


def test_a_strength_without_an_upper_bound_is_fitted():
    found = compared("viscous_degraded", "joint", False)
    assert found.verdict == "mechanism" and family_of(found.found[0].name) == family_of("viscous_degraded")
