"""The gallery of published experiments: its cases are there, and its findings read what runs say."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from cutbench.run.result import Outcome, Result
from studies.gallery.__main__ import judged, record
from studies.gallery.experiments import EXPERIMENTS, WIRES_MM
from studies.gallery.picture import pictures
from studies.gallery.runs import PUBLISHED, exponent, slope


def made_up(case) -> Result:
    """A steady force of G_c a length, an onset in proportion to the edge's radius."""
    p = case.p
    d = np.linspace(0, p.depth, 50)
    force = np.full(d.size, p.length * p.G_c)
    radius = getattr(p, "edge_radius", p.thickness)
    measures = {
        "onset_mm": 40 * radius,
        "closure": 0.0,
        "jumps_rel": 0.0,
        "drop_rel": 0.0,
        "steady_N": force[0],
    }
    curve = {"displacement_mm": d, "force_N": force, "cut_length_mm": d}
    return Result(case, curve, Outcome("done", "by formula", "", p.depth), {"total": 0.0}, {}, [], measures)


@pytest.fixture(scope="module")
def results():
    return {run.case.id: made_up(run.case) for e in EXPERIMENTS for run in e.runs.values()}


def test_every_experiment_has_its_folder_and_its_source():
    for folder in {e.folder for e in EXPERIMENTS} - {""}:
        case = tomllib.loads((PUBLISHED / folder / "case.toml").read_text("utf-8"))
        text = (PUBLISHED / folder / "README.md").read_text("utf-8")
        assert ("how sure" in text and "base" in case) or case["material"]["doi"].startswith("10.")


def test_runs_of_an_experiment_are_different(results):
    assert all(len({run.case.id for run in e.runs.values()}) == len(e.runs) for e in EXPERIMENTS)
    assert len(results) >= 30


def test_a_run_that_is_not_steady_is_no_finding(results):
    unsteady = {id: made_up(r.case) for id, r in results.items()}
    for result in unsteady.values():
        result.measures["steady_N"] = np.nan
    (rows,) = (
        [row[3:] for row in judged(unsteady) if row[0] == e.title]
        for e in EXPERIMENTS
        if e.folder == "razor-pdms"
    )
    assert set(rows) == {("none", "missed")}


def test_findings_are_judged_by_what_runs_say(results):
    found = {(title, what): (float(value), kind) for title, what, _, value, kind in judged(results)}
    of = [(e.folder, [found[e.title, each.what] for each in e.findings]) for e in EXPERIMENTS]
    assert next(rows for folder, rows in of if folder == "gelatin-wires")[0] == (1, "verified")
    assert dict(of)["blade-edges"] == [(pytest.approx(1), "predicted"), (pytest.approx(0), "missed")]
    assert {kind for _, kind in found.values()} == {"verified", "predicted", "missed", "open"}
    assert len(record(results)) == sum(len(e.runs) for e in EXPERIMENTS)


def test_pictures_are_drawn_where_nothing_is_cut_too(results, tmp_path):
    held = {id: made_up(r.case) for id, r in results.items()}
    for result in held.values():
        if getattr(result.case.p, "mu", 0.0) > 0:
            result.measures |= {"onset_mm": np.nan, "steady_N": np.nan}
    pictures(held, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"friction.png", "wires.png", "experiments.png"}


def test_lines_and_powers_are_read_off():
    assert slope({d: 3 + 2 * d for d in WIRES_MM}) == pytest.approx((3, 2))
    assert exponent({x: 3 * x**0.7 for x in WIRES_MM}) == pytest.approx(0.7)
