"""The claims' machinery on stand-in runs, their judgement, and what the page shows of them."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import claims_runs
import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.case.numerics import Numerics
from cutbench.run.result import Outcome, Result, Snapshot
from cutbench.run.store.runs import Store
from studies.paper import cases as cases_of_claims
from studies.paper import claims
from studies.paper.base import BLOCK, CONVERGED, PAPER, TENSION, Ask, Finding, at_least, below, near
from studies.paper.cases import CHANGES, OPEN, TARGETS, TIPS, best_tip, case_of, left_open, scan
from studies.paper.investigation import investigate
from studies.paper.judgement import (
    CHOICE,
    COARSE,
    NOT,
    REPRODUCED,
    RESOLVED,
    SOLID,
    UNKNOWN,
    VERDICTS,
    reason,
    verdict,
)
from studies.paper.observed import COLUMNS, looked_at, observed_run
from studies.paper.reading import end_of_indentation, mean_force, share, straightness
from studies.paper.report import markdown

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
STAND_INS = {
    "cut": claims_runs.cut,
    "block": claims_runs.block,
    "tension": claims_runs.strip,
    "notched": claims_runs.notched,
}


@pytest.fixture
def log(tmp_path, monkeypatch):
    path = tmp_path / "log"
    path.touch()
    monkeypatch.setenv("CLAIMS_LOG", str(path))
    return lambda: path.read_text(encoding="utf-8").split()


def curve(d, F, cut=None, **more) -> Result:
    d, F = np.asarray(d, dtype=float), np.asarray(F, dtype=float)
    columns = {"displacement_mm": d, "force_N": F, "time_s": d, "cut_length_mm": np.zeros(d.size)} | more
    return Result(load_case("gelatin"), columns, Outcome("done", "", "", float(d[-1])), measures={})


# -- the list -----------------------------------------------------------------------------------------
def test_all_claims_are_there_once_and_say_something():
    found = claims()
    assert list(found) == ["units", *(f"C{i}" for i in range(1, 16))]
    for claim in found.values():
        assert claim.text.endswith(".")
        assert claim.asks or claim.beyond
    assert all(claim.asks for claim in found.values())


@pytest.mark.parametrize("claim", [c for c in claims().values() if c.asks], ids=lambda c: c.id)
def test_every_claim_can_be_read_from_runs_without_measures(claim):
    """Runs that failed have no curve: a claim says it does not know, and never falls."""
    runs = {}
    for name, ask in claim.asks.items():
        case = case_of(ask, PAPER, 1.05)
        empty = {key: np.zeros(0) for key in ("displacement_mm", "force_N", "time_s", "cut_length_mm")}
        runs[name] = Result(case, empty, Outcome("failed", "no"))
    found = claim.read(runs)
    assert found and len({one.what for one in found}) == len(found)
    for one in found:
        assert one.published and one.what and (one.holds is None) == math.isnan(one.value)


# -- cases --------------------------------------------------------------------------------------------
def test_the_paper_s_numerics_have_its_viscous_term_and_the_defaults_do_not():
    paper, converged = (case_of(Ask("gelatin"), word, 0.85) for word in (PAPER, CONVERGED))
    assert paper.numerics.element == "P1" and "viscous" in paper.mechanisms
    assert converged.numerics == Numerics() and "viscous_degraded" in converged.mechanisms
    assert paper.p.tip == converged.p.tip == 0.85


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_one_difference_towards_the_other_numerics(name):
    change = CHANGES[name]
    base = case_of(Ask("gelatin"), change.start, 1.05)
    other = case_of(Ask("gelatin"), PAPER if change.start == CONVERGED else CONVERGED, 1.05)
    changed = case_of(Ask("gelatin"), change.start, 1.05, change)
    assert changed.id != base.id
    assert dict(changed.values).items() <= (dict(base.values) | dict(other.values)).items()
    different = {k for k, v in vars(changed.numerics).items() if v != vars(base.numerics)[k]}
    if changed.mechanisms != base.mechanisms:
        new, gone = (
            set(a) - set(b)
            for a, b in ((changed.mechanisms, base.mechanisms), (base.mechanisms, changed.mechanisms))
        )
        assert not different and new <= set(other.mechanisms) and not gone & set(other.mechanisms)
        assert len(new) <= 1 and len(gone) <= 1
    elif name != "size":  # a size between the two
        assert {vars(changed.numerics)[k] == vars(other.numerics)[k] for k in different} == {True}


def test_the_changes_together_lead_from_one_model_to_the_other():
    case = case_of(Ask("gelatin"), PAPER, 1.05)
    for change in CHANGES.values():
        if change.start == PAPER and "with_" in change.values:
            case = case.set(**change.values)
    assert case.mechanisms == case_of(Ask("gelatin"), CONVERGED, 1.05).mechanisms


def test_b_is_taken_where_the_target_is_met_best_by_more_than_an_element():
    cases = scan("gelatin")
    assert tuple(cases) == TIPS and {case.numerics.element for case in cases.values()} == {"P1"}
    results = {tip: claims_runs.cut(case) for tip, case in cases.items()}
    assert TARGETS["gelatin"].published_mm == 4.19
    own = load_case("gelatin").p.tip
    told = {tip: TARGETS["gelatin"].of(result) for tip, result in results.items()}
    assert min(told, key=lambda tip: abs(told[tip] - 4.19)) == 0.85 != own
    assert abs(told[own] - told[0.85]) < cases_of_claims.PAPER_EDGE
    assert best_tip("gelatin", results) == own  # a front jumps by an element: no reason to leave it

    def stalled(result):
        return replace(result, outcome=replace(result.outcome, kind="stalled"))

    assert best_tip("gelatin", results | {own: stalled(results[own])}) == 0.85
    assert best_tip("gelatin", {tip: stalled(result) for tip, result in results.items()}) == own


# -- judging ------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("paper", "converged", "expected"),
    [(True, True, REPRODUCED), (True, False, COARSE), (False, True, RESOLVED), (False, False, NOT),
     (None, True, UNKNOWN), (True, None, UNKNOWN)],
)  # fmt: skip
def test_verdicts(paper, converged, expected):
    assert verdict(paper, converged) == expected


def test_a_statement_that_another_reading_of_the_paper_turns_has_no_verdict_of_its_own():
    for paper, converged in ((True, False), (False, True)):
        assert verdict(paper, converged, [paper, None]) == verdict(paper, converged)
        assert verdict(paper, converged, [paper, not paper]) == CHOICE
    found = {PAPER: finding(0.05, True), CONVERGED: finding(0.02, True)}
    names = list(OPEN)
    choices = {names[0]: finding(0.3, False), names[1]: finding(0.06, True)}
    text = reason(found, {}, choices)
    assert OPEN[names[0]].text in text and "0.3" in text and OPEN[names[1]].text not in text


def test_what_the_paper_leaves_open_is_a_range_around_the_preset():
    base = case_of(Ask("elastomer"), PAPER, 1.05).numerics
    cases = [case_of(Ask("elastomer"), PAPER, 1.05, change).numerics for change in OPEN.values()]
    assert {replace(n, facet_degree=6, augmentations=0) for n in cases} == {replace(base, augmentations=0)}
    chosen = {(n.facet_degree, n.augmentations > 0) for n in (base, *cases)}
    assert chosen == {(degree, updated) for degree in (2, 6, 12) for updated in (False, True)}
    assert not left_open(Ask("gelatin", test=BLOCK)) and not left_open(Ask("gelatin", test=TENSION))


def finding(value, holds):
    return Finding("fall", "1", "sharp", value, holds)


def test_reasons_name_what_decides_and_what_does_not():
    found = {PAPER: finding(0.4, True), CONVERGED: finding(0.02, False)}
    changed = {
        "order": finding(0.41, True),
        "size": finding(0.03, False),
        "printed_viscous": finding(0.01, False),
    }
    text = reason(found, changed)
    assert text.index("0.5 mm (0.03)") < text.index("quadratic elements (0.41)")
    changed["printed_viscous"] = finding(0.3, True)
    assert "(0.3)" in reason(found, changed)


def test_a_reason_where_nothing_helps_says_so():
    found = {PAPER: finding(0.04, False), CONVERGED: finding(0.02, False)}
    text = reason(found, {"size": finding(0.03, False)})
    holds = reason(found, {"size": finding(0.3, True)})
    assert text.endswith("0.5 mm (0.03)") and holds.endswith("0.5 mm (0.3)")
    assert text.removesuffix("(0.03)") != holds.removesuffix("(0.3)")
    assert "converged" in reason(found | {CONVERGED: finding(math.nan, None)}, {})


def test_tolerances():
    assert near(4.6, 4.19) and not near(4.9, 4.19) and not near(3.5, 4.19)
    assert near(12.0, 12, 16, within=0) and not near(16.1, 12, 16, within=0)
    assert near(math.nan, 1.0) is below(math.nan, 1.0) is at_least(math.nan, 1.0) is None
    assert below(0.09, 0.1) and not below(0.1, 0.1) and at_least(0.1, 0.1)


# -- reading ------------------------------------------------------------------------------------------
def test_numbers_of_a_curve():
    line = curve([0, 1, 2, 4], [0, 2, 4, 8])
    assert straightness(line) == pytest.approx(1.0)
    assert mean_force(line, 1.0, 3.0) == pytest.approx(4.0)
    assert math.isnan(mean_force(line, 1.0, 5.0))
    bent = curve([0, 1, 5], [0, 1, 1.1])
    assert straightness(bent) < 0.8
    assert end_of_indentation(bent) == 5.0
    bent.measures["peak_mm"] = 1.0
    assert end_of_indentation(bent) == 1.0


def test_shares_are_of_the_work_in_the_steady_part():
    d = np.linspace(0, 10, 11)
    both = {"work_coulomb_mJ": np.where(d < 5, d, 5.0), "work_adhesion_mJ": d}
    run = curve(d, d, **both)
    assert share(run, "coulomb", "adhesion", 0.0) == pytest.approx(0.5)
    assert share(run, "coulomb", "adhesion", 6.0) == 0.0
    assert math.isnan(share(run, "nothing", "adhesion", 0.0))


def test_a_look_at_the_fields():
    """A column of cut plane, 21 mm high, blade 5 mm down: the peak sits on the tip, a little acts behind."""
    case = load_case("gelatin")
    X = np.array([[0.0, y, 0.0] for y in (10.0, 15.0, 16.0, 17.5, 18.0, 20.0)])
    pressure = np.array([0.0, 0.0, 0.2, 0.01, 0.03, 0.0])
    damage = np.array([0.0, 0.1, 0.9, 1.0, 1.0, 1.0])
    cut = {"X": X, "x": X + np.array([0, 0.5, 0]), "contact_pressure_MPa": pressure}
    faces = {"cut": cut | {"damage": damage, "opening_mm": damage * 0.7}}
    points = np.array([[0.0, 16.0, 0], [0.0, 10.0, 0], [3.0, 16.0, 0]])
    data = {"displacement": np.zeros((3, 3)), "von_mises": np.array([0.03, 0.01, 0.5])}
    seen = looked_at(Snapshot(5.0, points, np.zeros((1, 3)), "triangle", data, faces), case)
    assert tuple(seen) == COLUMNS
    assert seen["contact_peak_MPa"] == 0.2
    assert seen["contact_peak_above_tip_mm"] == pytest.approx(0.5)
    assert seen["contact_peak_depth_mm"] == pytest.approx(5.0)
    # Above 16 + 1.05 mm: the points that now lie at 18, 18.5 and 20.5 mm.
    assert seen["contact_behind_MPa"] == pytest.approx((0.02 * 0.5 + 0.015 * 2.0) / 2.5)
    assert seen["von_mises_peak_MPa"] == 0.03  # on the cut plane, not beside it
    assert seen["damage_at_widest"] == 1.0


def test_a_run_s_curve_holds_what_was_seen():
    case = load_case("gelatin", {"numerics": "paper", "depth": "0.6 mm"})
    result = observed_run(case)
    assert result.outcome.done and not result.snapshots
    seen = np.isfinite(result.curve["contact_peak_MPa"])
    assert 3 <= seen.sum() <= 6
    pressure = result.curve["contact_peak_MPa"][seen]
    assert (np.diff(pressure) > 0).all() and pressure[-1] > case.p.G
    assert np.nanmax(result.curve["von_mises_peak_MPa"]) > 0


# -- all of it ----------------------------------------------------------------------------------------
def test_an_investigation_judges_links_and_is_not_computed_twice(tmp_path, log):
    out = tmp_path / "out"
    found = investigate(out, only=["C1", "C5", "C12", "C13"], workers=0, runs=STAND_INS)
    assert found.scans["gelatin"].tip_mm == 1.05
    by_id = {one.claim.id: one for one in found.judged}
    rows = {row.what: row for row in by_id["C1"].rows}
    fall = rows["fall of the force at the transition, relative"]
    assert fall.verdict == COARSE
    assert "0.5 mm (0.05)" in fall.reason and "quadratic elements (0.05)" in fall.reason
    assert rows["end of indentation"].verdict == REPRODUCED
    assert set(fall.choices) == set(OPEN) and not by_id["C5"].rows[0].choices
    assert f"holds in {1 + len(OPEN)} of {1 + len(OPEN)}" in (out / "claims.md").read_text(encoding="utf-8")
    assert [row.verdict for row in by_id["C5"].rows] == [COARSE, COARSE]
    assert all(row.reason == SOLID and not row.changed for row in by_id["C5"].rows)
    assert {row.verdict for row in by_id["C13"].rows} <= set(VERDICTS)
    record = json.loads((out / "claims.json").read_text(encoding="utf-8"))
    store = Store(out / "runs")
    assert {claim["id"] for claim in record["claims"] if "folds" in claim["runs"]} == {"C1"}
    for claim in record["claims"]:
        for ids in claim["runs"].values():
            for id in ids.values():
                assert (out / record["runs"][id]["file"]).is_file()
                assert store.get(id).case.id == id
    for name in ("curves", "changes", "tips"):
        assert (out / f"published-{name}.png").stat().st_size > 10_000
    text = (out / "claims.md").read_text(encoding="utf-8")
    assert text.strip() == markdown(record)
    for line in text.splitlines():
        if line.startswith("|"):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            assert all(cell.strip() for cell in cells), f"an empty cell: {line}"
    for link in re.findall(r"\]\((.*?)\)", text):
        assert (out / link).is_file()

    count = len(log())
    assert count == len(set(log())) == found.runner.computed
    again = investigate(out, only=["C1", "C5", "C12", "C13"], workers=0, runs=STAND_INS, figures=False)
    assert len(log()) == count and again.runner.computed == 0
    assert again.judged == found.judged


@pytest.mark.slow  # tests/test_band.py asks the same of runs by formula
def test_runs_of_two_processes_are_the_same(tmp_path):
    one = investigate(tmp_path / "one", only=["C2"], workers=0, runs=STAND_INS, figures=False)
    two = investigate(tmp_path / "two", only=["C2"], workers=2, runs=STAND_INS, figures=False)
    assert one.judged == two.judged
    assert two.runner.computed == one.runner.computed > len(TIPS)


def test_an_interrupted_investigation_goes_on(tmp_path, log):
    with pytest.raises(KeyboardInterrupt):
        investigate(tmp_path, only=["C2"], workers=0, runs={"cut": claims_runs.third_is_stopped})
    assert len(log()) == 2
    investigate(tmp_path, only=["C2"], workers=0, runs=STAND_INS, figures=False)
    assert len(log()) == len(set(log()))


def test_runs_that_fail_leave_verdicts_open(tmp_path):
    found = investigate(tmp_path, only=["C1"], workers=0, runs={"cut": claims_runs.fails}, figures=False)
    assert {row.verdict for row in found.judged[0].rows} == {UNKNOWN}
    assert "singular" in (tmp_path / "claims.json").read_text(encoding="utf-8")


def test_a_run_of_a_sweep_is_computed_again_for_it_lacks_the_fields(tmp_path, log):
    case = scan("elastomer")[1.05]
    bare = claims_runs.cut(case)
    for name in COLUMNS:
        del bare.curve[name]
    Store(tmp_path / "runs").put(bare)
    investigate(tmp_path, only=["C2"], workers=0, runs=STAND_INS, figures=False)
    assert log().count(case.id) == 2
    assert COLUMNS[0] in Store(tmp_path / "runs").get(case.id).curve


# -- bad input ----------------------------------------------------------------------------------------
def call(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "studies.paper", *words], cwd=ROOT, capture_output=True, text=True
    )


@pytest.mark.parametrize(
    ("args", "named"),
    [
        (["--only", "C99", "--out", "x"], "C99"),
        pytest.param([], "--out", marks=pytest.mark.slow),
        pytest.param(["--workers", "two"], "two", marks=pytest.mark.slow),
    ],
)
def test_bad_input_is_one_message(args, named):
    done = call(*args)
    assert done.returncode == 2 and named in done.stderr and "Traceback" not in done.stderr


def test_the_list_computes_nothing():
    done = call("--list")
    assert done.returncode == 0 and "C15" in done.stdout
