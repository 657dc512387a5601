"""Studies of convergence: what is read, compared and written."""

from __future__ import annotations

import json
import math
from pathlib import Path

import convergence_runs
import numpy as np
import pytest
from refusals import refused
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.cli.main import app
from cutbench.run.convergence import (
    COMPARED,
    compute,
    load_plan,
    markdown,
    plot_convergence,
    relative_changes,
    write,
)

STUDY = """materials = ["gelatin", "meat"]

[base]
h = "0.5 mm"
depth = "3 mm"

[[change]]
name = "h/2"
h = "0.25 mm"

[[change]]
name = "the material's normal"
kind = "choice"
normal = "material"
"""


@pytest.fixture
def study(tmp_path) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def rows_of(study, **how):
    return compute(load_plan(study), study.parent / "out", run=convergence_runs.converging, **how)


def test_changes_are_compared_with_their_own_base(study):
    rows = rows_of(study, workers=0)
    assert [(r.material, r.change) for r in rows] == [
        (m, c) for m in ("gelatin", "meat") for c in ("", "h/2", "the material's normal")
    ]
    fine = rows[1]
    assert fine.moved["onset_mm"] == pytest.approx(2.75 / 2.5 - 1)
    assert fine.moved["peak_N"] == pytest.approx((1 - 0.0625) / 0.75 - 1)
    assert fine.moved["drop_rel"] == pytest.approx(-0.001 / 0.1), "a drop of nothing is compared with 0.1"
    assert fine.holds is False and fine.worst == pytest.approx(0.25)
    other = rows[2]
    assert other.holds is None
    assert math.isinf(other.moved["slope_N_per_mm"])


def test_a_change_may_be_for_some_materials_only(study):
    study.write_text(STUDY + 'materials = ["meat"]\n', encoding="utf-8")
    assert [set(cases) for cases in load_plan(study).cases.values()] == [
        {"", "h/2"},
        {"", "h/2", "the material's normal"},
    ]
    study.write_text(STUDY + 'materials = ["steel"]\n', encoding="utf-8")
    with refused("change 2: materials", value="steel", hint="gelatin"):
        load_plan(study)


def test_a_second_time_nothing_is_computed(study):
    first = rows_of(study, workers=0)
    assert compute(load_plan(study), study.parent / "out", workers=0) == first


@pytest.mark.slow
def test_processes_give_the_same(study):
    assert rows_of(study, workers=2) == rows_of(study, workers=0)


def test_what_neither_run_has_does_not_count():
    nothing = relative_changes({}, {}, 0.7)
    assert all(math.isnan(v) for v in nothing.values()) and set(nothing) == set(COMPARED)


def test_files_hold_what_the_table_shows(study):
    rows = rows_of(study, workers=0)
    table = markdown(rows)
    assert "| h/2 | +10.0 % | +25.0 % | -1.0 % |" in table and "✗" in table
    written = write(load_plan(study), rows, study.parent / "out")
    assert [p.name for p in written] == [
        "convergence.json", "convergence.md", "convergence.png", "choices.png",
    ]  # fmt: skip
    record = json.loads(written[0].read_text(encoding="utf-8"))
    assert record["rows"][1]["moved"]["onset_mm"] == pytest.approx(0.1)
    for row in record["rows"]:
        assert (study.parent / "out" / "runs" / row["run"][:2] / row["run"] / "run.json").is_file()


def test_the_picture_shows_every_finite_change(study):
    rows = rows_of(study, workers=0)
    figure = plot_convergence(rows)
    shown = sum(np.size(line.get_xdata()) for line in figure.axes[0].lines if line.get_linestyle() == "None")
    mine = [r for r in rows if r.material == "gelatin" and r.change]
    assert shown == sum(not math.isnan(v) for r in mine for v in r.moved.values())


@pytest.mark.parametrize(
    ("old", "new", "key", "value", "hint"),
    [
        ('materials = ["gelatin", "meat"]', "materials = []", "materials", "[]", "names"),
        ('materials = ["gelatin", "meat"]', 'materials = ["gelatine"]', "file", "gelatine", "gelatin"),
        ('name = "h/2"', "name = 3", "change 1: name", "3", "a name"),
        ('kind = "choice"', 'kind = "choise"', "kind", "choise", "choice"),
        ('h = "0.25 mm"', "h = 25", "h/2: h", "25", "unit"),
        ('h = "0.25 mm"', "", "change 1: h/2", "(empty)", ""),
        ('normal = "material"', 'normal = "tol"', "normal", "tol", "tool"),
        ('depth = "3 mm"', 'depth = "3 s"', "depth", "3 s", "mm"),
        ("[base]", "[bass]", "bass", "depth", "base"),
        ("the material's normal", "h/2", "name", "h/2", ""),
    ],
)
def test_errors_name_what_would_be_right(study, old, new, key, value, hint):
    study.write_text(STUDY.replace(old, new), encoding="utf-8")
    with pytest.raises(BadInput) as error:
        load_plan(study)
    text = str(error.value)
    assert key in text and value in text and hint in text


def test_the_studies_that_are_shipped_can_be_read_and_the_command_refuses_what_is_not_there(tmp_path):
    studies = Path(__file__).parent.parent / "studies"
    shipped, choices = (load_plan(studies / f"{name}.toml") for name in ("convergence", "choices"))
    assert set(shipped.cases) == set(choices.cases) == {"gelatin", "elastomer", "meat"}
    assert {"h/2", "step/2", "quadrature × 2"} <= {c.name for c in shipped.changes}
    refined = [c.refinement for c in shipped.changes if c.name != "fast"]
    assert all(refined) and not any(c.refinement for c in choices.changes)
    done = CliRunner().invoke(app, ["converge", str(tmp_path / "no.toml"), "--out", str(tmp_path / "out")])
    assert done.exit_code == 2 and "no.toml" in done.output


def test_a_base_that_is_not_cut_accuses_no_refinement(study, tmp_path):
    rows = compute(load_plan(study), tmp_path / "out", run=convergence_runs.uncut, workers=0)
    assert [r.holds for r in rows if r.change == "h/2"] == [None, None]
    said = markdown(rows)
    assert said.lower().count("nothing was cut") == 2 and "✗" not in said
    paths = write(load_plan(study), rows, tmp_path / "out")
    assert all(path.is_file() for path in paths)
    (base, *_) = json.loads((tmp_path / "out" / "convergence.json").read_text("utf-8"))["rows"]
    assert base["change"] == "as given"
