"""What the model leaves open: which runs that makes, their ranges, labels, files, and the command."""

from __future__ import annotations

import csv
import json
import math

import band_runs
import numpy as np
import pytest
from coarse_runs import QUICK
from refusals import refused
from typer.testing import CliRunner

import cutbench
from cutbench.case.case import load_case
from cutbench.case.model_alternatives import alternative_cases
from cutbench.cli.main import app
from cutbench.mechanisms import registry
from cutbench.run.band import AS_ASKED, write_band
from cutbench.run.figures.choices import plot_choices
from cutbench.run.measures import UNDECIDED


def names(**changes):
    return list(alternative_cases(load_case("gelatin", changes))[0])


# -- what is open -------------------------------------------------------------------------------------
def test_one_thing_at_a_time_is_changed_that_the_model_leaves_open():
    case = load_case("gelatin", {"until": "transition"})
    found, refused = alternative_cases(case)
    assert not refused and len({each.id for each in found.values()} | {case.id}) == len(found) + 1
    assert {each.until for each in found.values()} == {"transition"}
    lengths = {each.p.surface_length for each in found.values()}
    assert lengths == {0.07, 0.035, 0.14}
    assert {each.p.tip for each in found.values()} == {1.05, 0.525, 2.1}
    assert {each.values.get("onset_stiffness") for each in found.values()} == {20, 5, 80, None}
    assert {each.numerics.penalty / case.numerics.penalty for each in found.values()} == {1, 0.5, 4}
    for each in found.values():
        laws, numerics = each.mechanisms != case.mechanisms, each.numerics != case.numerics
        values = not laws and dict(each.values) != dict(case.values)
        assert laws + numerics + values == 1


def test_friction_that_is_off_could_as_well_be_there():
    assert {"mu = 0.1", "mu = 0.4"} <= set(names()) and "mu = 0.05" in names(mu=0.1)


def test_what_cannot_be_is_not_repeated():
    assert not [name for name in names(surface_length="0 mm") if name.startswith("surface_length")]
    found, refused = alternative_cases(load_case("gelatin", {"tip": "3.5 mm", "h": "0.5 mm"}))
    assert list(refused) == ["tip = 7 mm"] and "tip = 1.75 mm" in found
    assert not set(names(numerics="paper")) & {"with whole_surface_gradient", "onset_stiffness = 5"}


def test_a_law_that_says_so_joins():
    assert "with viscous" not in names()
    assert "edge_radius = 0.01 mm" in names(with_="wedge") and "tip = 2.1 mm" not in names(with_="wedge")


def test_what_laws_name_instead_of_themselves_is_there_and_has_their_role():
    for law in registry().values():
        for name in law.alternatives:
            other = registry()[name]
            assert (other.slot, other.role) == (law.slot, law.role) and other is not law


# -- what is made of it -------------------------------------------------------------------------------
def made(log, run=band_runs.leaving_open, **how):
    return cutbench.band("gelatin", run=run, **how)


def test_a_measure_has_a_value_and_a_range_and_a_label_within_it_is_undecided(log):
    found = made(log)
    assert found.case.until == "transition"
    drop, onset = found.ranges["drop_rel"], found.ranges["onset_mm"]
    assert (drop.value, drop.low, drop.high) == pytest.approx((0.12, 0.06, 0.24))
    assert (onset.value, onset.low, onset.high) == pytest.approx(
        (3.4, 3.4 / math.sqrt(2), 3.4 * math.sqrt(2))
    )
    assert drop.runs == len(found.results) - 1 and "peak_mm" not in found.ranges
    assert found.label == UNDECIDED and found.labels[AS_ASKED] == "abrupt"
    said = found.sentence()
    assert said.startswith("undecided") and "12 % (6 to 24 % over" in said
    assert said.endswith("whole_surface_gradient")


def test_a_label_that_all_have_is_decided(log):
    assert made(log, surface_length="0.2 mm").label == "abrupt"
    soft = made(log, surface_length="0.02 mm")
    assert soft.label == "smooth" and soft.sentence().startswith("smooth")


def test_one_that_is_not_cut_says_what_else_is(log):
    found = made(log, with_="whole_surface_gradient")
    assert found.label == "uncut"
    assert "18.2 mm" in found.sentence() and "surface_gradient" in found.sentence()


def test_what_fell_short_is_in_no_range(log):
    found = made(log, run=band_runs.falling_short)
    assert found.short == ("tip = 0.525 mm",) and found.short[0] in found.sentence()
    assert found.ranges["drop_rel"].runs == len(found.results) - 2


def test_a_case_goes_as_far_as_asked(log):
    assert made(log, until="depth").case.until == "depth"
    moving = load_case("gelatin", {"motion": [["0 s", "0 mm"], ["9 s", "1 mm"]]})
    assert cutbench.band(moving, run=band_runs.leaving_open).case.until == "depth"
    with refused("until", value="onset"):
        made(log, until="onset")


def test_files_hold_it_and_a_second_time_nothing_is_computed(log, tmp_path):
    seen = []
    first = made(log, out=tmp_path, on_progress=lambda *said: seen.append(said[:2]))
    count = len(first.results)
    assert seen[0] == (0, count) and seen[-1] == (count, count)
    record = json.loads((tmp_path / "band.json").read_text(encoding="utf-8"))
    assert record["said"] == first.sentence() and record["label"] == UNDECIDED
    assert record["ranges"]["drop_rel"] == pytest.approx(
        {"value": 0.12, "low": 0.06, "high": 0.24, "runs": count - 1}
    )
    assert record["runs"][AS_ASKED]["id"] == first.case.id
    with (tmp_path / "band.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["change"] for row in rows] == list(first.results)
    assert float(rows[0]["drop_rel"]) == pytest.approx(0.12)
    assert {row["label"] for row in rows} == {"abrupt", "smooth", "uncut"}
    assert (tmp_path / "band.png").stat().st_size > 10_000
    again = made(log, out=tmp_path)
    assert again.ranges == first.ranges and len(log.read_text().splitlines()) == count


@pytest.mark.slow
def test_processes_give_the_same(log, tmp_path):
    assert made(log, out=tmp_path, workers=2).ranges == made(log).ranges


def test_the_picture_has_a_row_a_run(log, tmp_path):
    found = made(log)
    figure = plot_choices({"gelatin": {name: result.measures for name, result in found.results.items()}})
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == list(found.results)
    assert [ax.get_xlabel()[-4:] for ax in figure.axes] == ["(mm)", " (N)", " (%)"]
    points = [line for line in figure.axes[2].lines if line.get_linestyle() == "None"]
    assert np.isfinite(points[0].get_xdata()).sum() == len(found.results) - 1
    uncut = cutbench.band("gelatin", run=band_runs.leaving_open, with_="whole_surface_gradient")
    assert all(path.is_file() for path in write_band(uncut, tmp_path))


def test_a_band_of_real_runs():
    found = cutbench.band(QUICK, depth="0.2 mm", step="0.1 mm")
    assert not found.short and found.label == "uncut" and "0.2 mm" in found.sentence()
    forces = {name: result.force_N[-1] for name, result in found.results.items()}
    assert forces["tip = 1.75 mm"] > forces[AS_ASKED]
    assert forces["contact stiffness × 4"] > forces["contact stiffness × 0.5"]


# -- the command --------------------------------------------------------------------------------------
def invoke(*args):
    return CliRunner().invoke(app, ["band", *map(str, args)])


@pytest.fixture
def quickly(runs_by, log):
    """Runs in this process, by formula."""
    runs_by(band_runs.leaving_open)
    return runs_by


def test_the_command_says_shows_and_writes_it(quickly, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = invoke("gelatin", "--workers", 0, "--set", "eta_reg=2 s", "--h", "0.3")
    assert done.exit_code == 0, done.output
    (folder,) = (tmp_path / "bands").iterdir()
    record = json.loads((folder / "band.json").read_text(encoding="utf-8"))
    assert record["case"]["values"]["eta_reg"]["value"] == 2 and record["case"]["until"] == "transition"
    assert done.output.splitlines()[-1] == record["said"]
    assert "2.4 to 4.81" in done.output and UNDECIDED in done.output


def test_an_interrupted_one_goes_on(quickly, tmp_path, log):
    quickly(band_runs.stopped)
    first = invoke("gelatin", "--workers", 0, "--out", tmp_path)
    assert first.exit_code == 130 and "go on" in first.output
    quickly(band_runs.leaving_open)
    assert invoke("gelatin", "--workers", 0, "--out", tmp_path).exit_code == 0
    ids = log.read_text(encoding="utf-8").split()
    assert len(ids) == len(set(ids))


def test_a_run_that_falls_short_is_named_and_is_a_status(quickly, tmp_path):
    quickly(band_runs.falling_short)
    done = invoke("gelatin", "--workers", 0, "--out", tmp_path)
    assert done.exit_code == 1 and all(part in done.output for part in ("0.525 mm", "stalled"))


@pytest.mark.parametrize(
    ("args", "parts"),
    [
        (["gelatine"], ["gelatine", "gelatin"]),
        (["gelatin", "--set", "G=-1 kPa"], ["G", "-1", "0 kPa < G"]),
        (["gelatin", "--until", "onset"], ["until", "onset", "transition"]),
        (["gelatin", "--workers", "many"], ["--workers", "many", "whole number"]),
        (["gelatin", "--without", "contact"], ["mechanisms", "contact"]),
    ],
)
def test_what_is_wrong_is_named(args, parts, quickly, tmp_path):
    done = invoke(*args, "--out", tmp_path / "out")
    assert done.exit_code == 2 and all(part in done.output for part in parts), done.output
