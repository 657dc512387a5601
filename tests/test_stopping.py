"""Runs that end with their transition, and what a run says in one sentence."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from coarse_runs import QUICK, SOFT
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.case.case import Case, load_case
from cutbench.case.physics import Physics
from cutbench.cli.main import app
from cutbench.maps.study import load_study
from cutbench.run.checkpoint import NAME, Checkpoint
from cutbench.run.files import describe, read_run, write_run
from cutbench.run.measures import KNOWN, measures
from cutbench.run.result import Outcome, Result, friction_advice
from cutbench.run.runner import run_case

#: Cut in the first millimetre, five thicknesses before its depth, so that both ends are seen.
DEEP = QUICK.set(depth="5 mm", step="0.2 mm")
SHORT = DEEP.set(until="transition")
TRANSITION = ("onset_mm", "peak_mm", "peak_N", "drop_rel")


@cache
def run(case=SHORT, pictures=()):
    return run_case(case, snapshots_mm=pictures)


# -- where it ends ------------------------------------------------------------------------------------
def test_a_run_until_its_transition_has_that_of_one_to_its_depth():
    short, deep = run(), run(DEEP)
    end = short.measures["onset_mm"] + KNOWN * SHORT.p.thickness
    assert short.outcome.done and not short.whole and deep.whole
    assert end <= short.outcome.reached_mm == short.displacement_mm[-1] < end + 0.2 + 1e-9
    for name in TRANSITION:
        assert short.measures[name] == pytest.approx(deep.measures[name], rel=1e-12), name
    n = len(short.force_N)
    np.testing.assert_array_equal(short.force_N, deep.force_N[:n])
    assert math.isnan(short.measures["steady_N"]) and math.isnan(short.measures["slope_N_per_mm"])
    assert math.isfinite(deep.measures["steady_N"])
    assert short.sentence() == deep.sentence()


def test_no_curve_says_more_of_its_transition_than_its_part_up_to_some_thicknesses_behind_the_onset():
    rng = np.random.default_rng(3)
    d = np.sort(np.append(rng.uniform(0, 20, 400), [0.0, 20.0]))
    F, cut = 1 + np.cumsum(rng.normal(0, 0.1, 402)) ** 2, np.maximum(d - 6, 0)
    whole = {"displacement_mm": d, "force_N": F, "cut_length_mm": cut}
    found = measures(whole, window_mm=0.7)
    last = int(np.searchsorted(d, found["onset_mm"] + KNOWN * 0.7)) + 1
    for end in (last, last + 7, last + 90):
        part = measures({name: column[:end] for name, column in whole.items()}, window_mm=0.7, whole=False)
        assert part["onset_mm"] == found["onset_mm"]
        assert part["drop_rel"] == pytest.approx(found["drop_rel"], rel=1e-12)
        assert math.isnan(part["steady_N"])


def test_without_a_cut_it_goes_to_its_depth():
    found = run(SHORT.set(depth="0.5 mm"))
    assert found.outcome.done and found.outcome.reached_mm == pytest.approx(0.5) and found.whole
    assert math.isnan(found.measures["onset_mm"]) and math.isnan(found.measures["steady_N"])
    assert "0.5 mm" in found.sentence()


@pytest.mark.slow
def test_of_a_precut_it_is_what_is_cut_beyond_it():
    found = run(SHORT.set(precut="1 mm"))
    cut = found.curve["cut_length_mm"]
    assert cut[0] == pytest.approx(1, abs=0.3)
    onset = float(np.interp(cut[0] + 0.1, cut, found.displacement_mm))
    assert found.measures["onset_mm"] == pytest.approx(onset, abs=0.05) and onset > 0.3
    assert found.outcome.reached_mm >= found.measures["onset_mm"] + 3.5 - 1e-9


@pytest.mark.slow
def test_its_progress_ends_where_it_does_and_the_last_state_is_shown():
    seen = []
    found = run_case(SHORT, on_progress=lambda *said: seen.append(said[:2]), snapshots_mm=(1.0, 4.9))
    totals = [total for _, total in seen]
    assert totals[0] == 5.0 and min(totals[:-1]) == pytest.approx(found.measures["onset_mm"] + 3.5)
    assert seen[-1][0] == seen[-1][1]
    assert [s.displacement_mm for s in found.snapshots] == pytest.approx(
        [1.1, found.outcome.reached_mm], abs=0.1
    )


@pytest.mark.parametrize("at", [*(pytest.param(at, marks=pytest.mark.slow) for at in (0.5, 99.0)), 2.0])
def test_one_that_was_interrupted_ends_at_the_same_place(at, tmp_path):
    last = run().outcome.reached_mm

    def stop(done, total, text):
        if done >= min(at, last - 1e-9):
            raise KeyboardInterrupt

    keep = Checkpoint(tmp_path / NAME, SHORT.id)
    first = run_case(SHORT, on_progress=stop, checkpoint=keep)
    assert first.outcome.kind == "interrupted"
    again = run_case(SHORT, checkpoint=Checkpoint(tmp_path / NAME, SHORT.id))
    assert again.outcome.reached_mm == pytest.approx(last) and again.outcome.done
    for name in TRANSITION:
        assert again.measures[name] == pytest.approx(run().measures[name], rel=1e-4), name


# -- how it is asked for ------------------------------------------------------------------------------
def test_it_is_part_of_what_a_case_is():
    plain = load_case("gelatin")
    case = plain.set(until="transition")
    assert (plain.until, case.until) == ("depth", "transition")
    assert case.id != plain.id and case.set(until="depth").id == plain.id
    assert case.set(G="8 kPa").until == "transition"
    assert Case.from_dict(case.to_dict()) == case
    older = {key: value for key, value in plain.to_dict().items() if key != "until"}
    assert Case.from_dict(older).id == plain.id
    assert Physics.from_dict(plain.to_dict()).set(until="transition", G="8 kPa").p.G == 0.008


def test_files_of_cases_and_studies_have_it_in_their_protocol(tmp_path):
    file = tmp_path / "one.toml"
    file.write_text('base = "meat"\n[protocol]\nuntil = "transition"\n', encoding="utf-8")
    assert load_case(file).until == "transition" and load_case(file, {"until": "depth"}).until == "depth"
    study = tmp_path / "study.toml"
    text = (
        'base = "gelatin"\n[protocol]\nuntil = "transition"\n[[axis]]\nname = "cohesion"\nvalues = [1, 2]\n'
    )
    study.write_text(text, encoding="utf-8")
    assert [case.until for _, case in load_study(study).points()] == 2 * ["transition"]
    wrong = {
        "onset_length": text + '[regime]\nonset_length = "0.2 mm"\n',
        "until": text.replace("[protocol]", "[specimen]"),
    }
    for key, content in wrong.items():
        study.write_text(content, encoding="utf-8")
        with pytest.raises(BadInput) as error:
            load_study(study)
        assert error.value.key == key and error.value.line


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ('[protocol]\nuntil = "onset"', "transition"),
        ("[protocol]\nuntil = 3", "transition"),
        ('[parameters]\nuntil = "transition"', "[protocol]"),
        ('[protocol]\nuntil = "transition"\nmotion = [["0 s", "0 mm"], ["9 s", "1 mm"]]', "'depth'"),
    ],
)
def test_what_cannot_be_is_refused_by_its_line(part, said, tmp_path):
    file = tmp_path / "one.toml"
    file.write_text(f'base = "meat"\n{part}\n', encoding="utf-8")
    with pytest.raises(BadInput) as error:
        load_case(file)
    assert (error.value.key, error.value.line) == ("until", 3) and said in error.value.expected


@pytest.mark.slow
def test_the_command_line_has_it_and_says_it_at_last(tmp_path):
    values = {**{k: SHORT.shown()[k] for k in ("G_c", "tip", "mu")}, "element": "P1", "step": "0.2 mm"}
    sets = [f"--set={key}={value}" for key, value in (values | SOFT).items()]
    sets += ["--set=corner=0.0625", "--set=shallow=1"]
    done = CliRunner().invoke(
        app, ["run2d", "gelatin", *sets, "--h=0.6", "--until=transition", f"--out={tmp_path}"]
    )
    assert done.exit_code == 0, done.output
    kept = read_run(tmp_path)
    assert kept.case.until == "transition" and not kept.whole
    assert done.output.splitlines()[-1] == kept.sentence()


# -- what it says -------------------------------------------------------------------------------------
def made_up(drop=0.12, onset=3.4, reached=10.0, kind="done", **changes):
    case = load_case("gelatin", {"depth": "10 mm", **changes})
    found = {"drop_rel": drop, "onset_mm": onset}
    d = np.array([0.0, reached])
    curve = {"displacement_mm": d, "force_N": d, "time_s": d, "cut_length_mm": d}
    return Result(case, curve, Outcome(kind, "made up", "", reached), measures=found)


@pytest.mark.parametrize(
    ("run", "band", "first", "parts"),
    [
        (made_up(), None, "abrupt", ["12 %", "0.7 mm", "3.4 mm"]),
        (made_up(0.03), None, "smooth", ["3 %", "3.4 mm"]),
        (made_up(0.0996), None, "smooth", ["9.96 %"]),
        (made_up(0.0), None, "smooth", ["does not fall", "3.4 mm"]),
        (made_up(math.nan, math.nan), None, "not cut", ["10 mm"]),
        (made_up(math.nan, math.nan, 2.0, "stalled"), None, "not cut", ["2 mm", "stalled"]),
        (made_up(0.03, reached=4.0, kind="stalled"), None, "smooth", ["stalled", "4 mm"]),
        (made_up(0.03, reached=4.0), None, "smooth", ["4 mm"]),
        (made_up(0.3, reached=4.0, kind="interrupted"), None, "abrupt", ["stopped", "4 mm"]),
        (made_up(kind="failed"), None, "failed", ["made up"]),
        (made_up(math.nan, math.nan, precut="2 mm"), None, "not cut", []),
        (made_up(), (0.11, 0.23), "abrupt", ["12 %", "11 to 23 %", "leaves open"]),
        (made_up(), (0.08, 0.23), "undecided", ["12 %", "8 to 23 %", "10 %"]),
        (made_up(0.0), (0.0, 0.02), "smooth", ["0 %", "0 to 2 %"]),
    ],
)  # fmt: skip
def test_a_run_says_what_it_found_in_one_sentence(run, band, first, parts):
    text = run.sentence(band)
    assert text.startswith(first)
    assert all(part in text for part in parts), text


def test_the_sentence_is_in_the_run_s_record(tmp_path):
    write_run(made_up(), tmp_path)
    assert describe(read_run(tmp_path))["said"] == made_up().sentence()


@pytest.mark.parametrize("law", [{"with_": "coulomb"}, {"with_": "coulomb_saturating", "inv_p_s": "1 1/kPa"}])
def test_a_blade_that_rubs_and_has_not_cut_is_told_what_would_tell(law):
    rubs, slides = (load_case("gelatin", {**law, "mu": mu}) for mu in (0.3, 0.0))
    assert law["with_"] in friction_advice(rubs, math.nan)
    assert not friction_advice(rubs, 3.5) and not friction_advice(slides, math.nan)
