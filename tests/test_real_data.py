"""Discovery on the measurements that ship: what the page says of them, and what must not change it."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from benchmarks.real import CAMPAIGNS, found_in, halves, row
from cutbench.calibration.fitting import fit
from cutbench.data.campaign import load_campaign
from cutbench.data.experiment import Experiment
from cutbench.discovery import Discovery, discover
from cutbench.discovery.candidates import family_of

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "validation" / "real-data.md").read_text("utf-8")
CHEAP = "rubber/treloar"
found = cache(found_in)


def of(name: str, *candidates: str):
    campaign = load_campaign(ROOT / "studies" / f"{name}.toml")
    return replace(campaign, candidates=candidates) if candidates else campaign


def cells(line: str) -> tuple[str, list[float]]:
    """Campaign and verdict, and all numbers of gain and errors."""
    _, name, verdict, gain, errors, _ = (part.strip() for part in line.split("|"))
    return name + verdict, [float(x.replace("−", "-")) for x in re.findall(r"[-−+]?\d+\.?\d*", gain + errors)]


def test_every_shipped_measurement_is_on_the_page():
    tests = [path for folder in ("rubber", "silicone") for path in (ROOT / "studies" / folder).glob("*.toml")]
    assert {f"{path.parent.name}/{path.stem}" for path in tests} == set(CAMPAIGNS)
    assert all(f"| `{name}` |" in PAGE for name in CAMPAIGNS)


@pytest.mark.parametrize(
    "name", [n if n == CHEAP else pytest.param(n, marks=pytest.mark.slow) for n in CAMPAIGNS]
)
def test_the_page_says_what_discovery_does(name):
    (line,) = (
        line
        for line in PAGE.splitlines()
        if line.startswith(f"| `{name}` | ") and "→" in line and "%" in line
    )
    (said, numbers), (now, others) = cells(line), cells(row(name, found(name)))
    assert now == said
    assert others == pytest.approx(numbers, abs=1.0, rel=0.02)


# -- bounds ------------------------------------------------------------------------------------------
def test_a_formula_at_its_bound_is_held_out_as_it_would_be_fitted():
    """All of Dragon Skin's modulus follows a power: w = 1. Without the last readings it still does."""
    d = discover(of("silicone/dragon_skin_20", "lopez_pamies"), workers=0)
    assert d.names[0] == "lopez_pamies" and d.final.values()["w_power"] == pytest.approx(1.0, abs=1e-3)
    assert d.held_out.gain > 0.2 and d.held_out.better


def test_a_value_at_its_bound_explains_nothing_that_lies_beyond():
    d = discover(of("silicone/rtv615", "gent"), workers=0)
    (nu,) = (c for c in d.steps[0].compared if c.name == "nu")
    assert nu.fitted.values()["nu"] == pytest.approx(0.5, abs=1e-5) and nu.explained_variance < 0.1


# -- what explains too much, and what is known -----------------------------------------------------------
def test_a_drift_that_leaves_no_specimen_is_no_explanation():
    d = discover(of("silicone/dragon_skin_20", "force_drift", "lopez_pamies"), workers=0)
    assert d.names[0] == "lopez_pamies" and "force_drift" not in {n for f in d.found for n in f.group}


def test_what_a_formula_leaves_of_a_silicone_has_no_cause_of_its_own():
    """No specimen follows a formula: Dragon Skin's rest is a fifteenth of what the baseline misses."""
    assert discover(of("silicone/dragon_skin_20", "lopez_pamies"), workers=0).names == ("lopez_pamies",)


def test_what_the_campaign_fixes_is_not_asked():
    campaign = of("rubber/kawabata", "gent")
    asked = replace(campaign, plan=replace(campaign.plan, fixed=()))
    names = [{s.name for s in discover(c, workers=0).steps[0].scores.scores} for c in (campaign, asked)]
    assert names == [{"gent"}, {"gent", "nu"}]


# -- what must not change a verdict ------------------------------------------------------------------
def scaled(e: Experiment, factor: float) -> Experiment:
    return replace(e, repetitions=tuple(replace(r, y=factor * r.y) for r in e.repetitions))


def thinned(e: Experiment, every: int) -> Experiment:
    parts = (replace(r, x=r.x[::every], y=r.y[::every], time_s=r.time_s[::every]) for r in e.repetitions)
    return replace(e, repetitions=tuple(parts))


def changed(how: str):
    campaign = of("rubber/treloar")
    tests, base = campaign.experiments, campaign.base
    (pull,) = campaign.train
    if how == "order":
        tests = tests[::-1]
    elif how == "twice":
        tests = (*tests, replace(pull, id="again"))
    elif how == "useless":
        (r,) = pull.repetitions
        tests = (*tests, replace(pull, id="short", repetitions=(replace(r, x=r.x[:6], y=r.y[:6]),)))
    else:
        tests, base = tuple(scaled(e, 1000.0) for e in tests), base.set(G="400 MPa")
    return replace(campaign, experiments=tests, base=base)


def same(d: Discovery, other: Discovery) -> None:
    """The class, and formulas that the data cannot tell apart: which of them is added may change."""
    assert other.verdict == d.verdict and len(other.names) == len(d.names)
    assert [family_of(name) for name in other.names] == [family_of(name) for name in d.names]
    assert other.names[0] in d.found[0].group or d.names[0] in other.found[0].group
    if other.names != d.names:
        assert other.held_out.gain == pytest.approx(d.held_out.gain, abs=d.held_out.gain_se)
        return
    # A model that is wrong everywhere follows what it was fitted to, but predicts no worse.
    errors = [each.held_out.extended_rmse / each.held_out.noise_floor for each in (d, other)]
    assert errors[1] < 1.15 * errors[0]


@pytest.mark.parametrize(
    "how", ["useless", *(pytest.param(h, marks=pytest.mark.slow) for h in ("twice", "order", "thousand"))]
)
def test_what_says_nothing_new_of_a_rubber_changes_nothing(how):
    same(found("rubber/treloar"), discover(changed(how), workers=0))


@pytest.mark.slow
def test_half_of_the_readings_say_the_same_of_a_silicone():
    campaign = of("silicone/ecoflex_00_50", "gent", "lopez_pamies")
    fewer = replace(campaign, experiments=tuple(thinned(e, 2) for e in campaign.experiments))
    same(discover(campaign, workers=0), discover(fewer, workers=0))


def test_the_baseline_is_the_fit_to_a_tenth_of_its_interval():
    fitted, d = fit(of(CHEAP), workers=0), found(CHEAP)
    for e in fitted.estimates:
        assert abs(d.first.values()[e.label] - e.value) < 0.1 * (e.high - e.low)


def test_halves_are_fitted_below_and_predicted_above():
    campaign, ends = halves(of("silicone/rtv615"))
    (lower,), (whole,) = campaign.train, campaign.test
    assert lower.reach <= ends["tension"] < whole.reach and lower.rest == whole.rest
    assert (whole.reach - 1) == pytest.approx(2 * (ends["tension"] - 1))
