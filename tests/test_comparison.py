"""A comparison of nested models names the class of what was hidden, and nothing where nothing was."""

from __future__ import annotations

import numpy as np
import pytest
from blind_cases import campaign, found, judged, made

from benchmarks.blind_campaigns import DOUBLE, Planned, make
from cutbench.calibration.fitting import fit
from cutbench.calibration.settings import SETTINGS
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover
from cutbench.discovery.candidates import baseline_of, family_of
from cutbench.discovery.comparison import ComparisonRound, comparisons


def compared(*asked):
    return found(*asked)[1]


def classes(step: ComparisonRound) -> set[str]:
    return {family_of(c.name) for c in step.group}


@pytest.mark.slow
def test_it_names_the_class_of_what_was_hidden_and_nothing_else():
    d = compared("gent", "bulk")
    assert made("gent", "bulk").misfit > 2
    assert d.verdict == "mechanism" and family_of("gent") in classes(d.steps[0])
    (cause,) = d.found
    assert cause.compared.evidence > 0 and cause.compared.p < SETTINGS.chance


@pytest.mark.parametrize(
    "shows", ["bulk", *(pytest.param(s, marks=pytest.mark.slow) for s in ("joint", "sliding"))]
)
def test_it_names_nothing_where_nothing_is_hidden(shows):
    d = compared("", shows)
    assert d.verdict == "none" and not d.found and d.final is d.first


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["jump", "fade"])
def test_what_no_candidate_has_is_not_named(effect):
    d = compared(effect, "sliding", False)
    assert d.verdict == "unexplained" and not d.found


@pytest.mark.slow
def test_what_was_found_predicts_better():
    d = compared("gent", "bulk")
    (e,) = d.campaign.test
    t, _, clean = made("gent", "bulk").clean[e.id]
    true = np.interp(d.first.posterior.predictions.grids[e.id].time_s, t, clean)
    errors = [np.sqrt(np.mean((m.predicted(e).y - true) ** 2)) for m in (d.first, d.final)]
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.slow
def test_candidates_of_one_class_are_a_group_and_the_evidence_orders_them():
    step = compared("gent", "bulk").steps[0]
    evidence = [c.evidence for c in step.compared]
    assert evidence == sorted(evidence, reverse=True)
    assert all(c.convincing for c in step.group)


@pytest.mark.slow
def test_a_strength_without_an_upper_bound_is_fitted():
    d = compared("viscous_degraded", "joint", False)
    assert d.verdict == "mechanism" and family_of(d.names[0]) == family_of("viscous_degraded")


@pytest.mark.slow
@pytest.mark.parametrize("effects", [("Zener", "Zuniga-Beatty"), ("van der Waals", "Elias-Zuniga")])
def test_one_cause_is_found_beside_another(effects, tmp_path):
    planned = Planned(DOUBLE.index(effects), "homogeneous", effects, ("formula", "several conditions"))
    truth = make(planned, 1, tmp_path)
    d = discover(load_campaign(truth.file), workers=0)
    said = judged(truth, d)
    assert said["both"] and not said["wrong"], d.names
    assert d.final.log_evidence > d.found[0].compared.fitted.log_evidence > d.first.log_evidence


@pytest.mark.slow
def test_a_search_tells_of_each_round_as_it_ends():
    baseline = fit(baseline_of(campaign("gent", "bulk", False)), workers=0).estimated
    every = list(comparisons(baseline))
    counts = [len(each.steps) for each in every]
    assert counts == sorted(counts) and set(counts) == set(range(1, counts[-1] + 1))
    assert len(every[-1].found) == 1 and every[-1].final.log_evidence > baseline.log_evidence
