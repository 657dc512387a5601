"""How far a map's line may be off: repeated runs, strips, undecided labels, and what is said of them."""

from __future__ import annotations

import math
from dataclasses import replace

import analytic_runs
import numpy as np
import pytest

from cutbench import load_case
from cutbench.base.errors import BadInput
from cutbench.calibration.mesh_error import refined_case
from cutbench.maps.dataset import LABELS, MapRow, build_map, load_map, row_of, to_csv
from cutbench.maps.guidance import guide
from cutbench.maps.phase import draw_phase
from cutbench.maps.sampling_plan import plan_of
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study
from cutbench.maps.uncertainty import (
    MODEL,
    NUMERICS,
    RepeatedRuns,
    log_ratio,
    nearest_to_boundary,
    refined,
    total_change,
    uncertainty_strips,
    undecided,
)
from cutbench.run.result import Result

HEAD = 'base = "gelatin"\n[protocol]\ndepth = "9 mm"\n'
SECTION = "[uncertainty]\nruns = 4\nbands = 2\n"
BIAS = 1.5


def halved(case) -> Result:
    """As ``analytic_runs``, with a drop that is ``BIAS`` times as large on small elements, and twice as
    large with a surface's length that is half the default's or less."""
    found = analytic_runs.computed(case)
    factor = BIAS if case.sizes.h_mm < 0.05 else 1.0
    factor *= 2.0 if case.values["surface_length"] < 0.05 else 1.0
    drop = min(factor * analytic_runs.drop_of(case), 0.95)
    force = np.array([0.0, 1.0, 1.0, 1 - drop, 1 - drop, 1.2 - drop])
    return replace(found, curve=found.curve | {"force_N": force})


@pytest.fixture
def study(tmp_path):
    def make(section: str = SECTION):
        path = tmp_path / "study.toml"
        path.write_text(f"{HEAD}{analytic_runs.AXES}{section}", encoding="utf-8")
        return load_study(path)

    return make


def test_refined_halves_elements_and_steps_and_keeps_the_tip():
    case = load_case("gelatin")
    fine = refined(case)
    assert fine.sizes.h_mm == case.sizes.h_mm / 2 and fine.sizes.step_mm == case.sizes.step_mm / 2
    assert fine.numerics.damage_step == case.numerics.damage_step / 2
    assert fine.numerics.corner * fine.sizes.h_mm == pytest.approx(0.7 / 44.8)
    assert fine.numerics.shallow == 1 and fine.p == case.p and fine.id != case.id
    coarse = case.set(h="0.5 mm", corner=0.25, shallow=0.5)
    again, h = refined(coarse).numerics, refined(coarse).sizes.h_mm
    assert h * again.corner == pytest.approx(0.125) and h * again.shallow == 0.125


def test_steps_that_are_as_short_as_they_may_be_are_refined():
    shortest = load_case("gelatin", {"step": "0.01 mm", "step_min": "0.01 mm"})
    assert refined(shortest).sizes.step_mm == refined(shortest).sizes.step_min_mm == 0.005
    assert refined_case(shortest).sizes.step_mm == 0.005


def test_ratios_are_of_margins_and_end():
    assert log_ratio(math.tanh(0.3)) == pytest.approx(0.3) and log_ratio(0.0) == 0.0
    assert log_ratio(1.0) == 2.0 and log_ratio(-1.0) == -2.0 and math.isnan(log_ratio(math.nan))


def test_strips_hold_no_change_and_widen_with_what_changes():
    checks = RepeatedRuns({"a": "A", "b": "B"}, {"a": {"x": "ax", "y": "ay"}})
    r = {"a": 0.1, "b": -0.1, "A": 0.1, "B": -0.1, "ax": 0.3, "ay": -0.5}
    assert (checks.numerics(r).low, checks.numerics(r).high) == (0.0, 0.0)
    assert (checks.model(r).low, checks.model(r).high) == pytest.approx((-0.6, 0.2))
    widths = [np.diff(total_change([checks.numerics(r | {"A": 0.1 + by})]))[0] for by in (0.1, 0.2, 0.4)]
    assert widths == sorted(widths) and widths[0] > 0
    assert checks.numerics({"a": 0.1}).runs == 0  # a refined run that fell short says nothing
    assert undecided(np.array([-0.3, -0.1, 0.1, 0.3]), -0.2, 0.2).tolist() == [False, True, True, False]
    assert not undecided(np.array([-1e-9, 0.0]), 0.0, 0.0).any()


def test_the_nearest_are_taken_from_every_panel():
    r = {(0, 0): 0.01, (1, 0): 0.02, (2, 0): 0.03, (0, 1): 0.5, (1, 1): 2.0}
    assert nearest_to_boundary(r, None) == [(0, 0), (1, 0), (2, 0), (0, 1)]
    assert nearest_to_boundary(r, 1) == [(0, 0), (0, 1), (1, 0), (2, 0)]


def test_a_sweep_repeats_what_is_near_and_calls_it_undecided(study, tmp_path):
    out = tmp_path / "out"
    plain = run_study(study(""), tmp_path / "plain", workers=0, run=halved, pictures=False).map
    sweep = run_study(study(), out, workers=0, run=halved, pictures=False)
    data = load_map(out / "map.nc")
    strips = uncertainty_strips(data)
    assert strips[NUMERICS].runs == 4 and strips[MODEL].runs == 2
    # All refined runs fall by half as much again: a shift without scatter, and no other shift.
    assert strips[NUMERICS].high == pytest.approx(math.log(BIAS), abs=0.05) and strips[NUMERICS].low == 0
    assert strips[MODEL].high == pytest.approx(math.log(2), abs=0.1) and strips[MODEL].low == 0
    names, before = np.array(LABELS)[data["label"].values], np.array(LABELS)[plain["label"].values]
    open_ = names == "undecided"
    r = np.log(plain["drop_rel"].values / 0.1)
    low, high = total_change(strips.values())
    assert open_.any() and (open_ == ((r + low < 0) & (r + high >= 0))).all()
    assert (names[~open_] == before[~open_]).all() and np.isfinite(data["refined_ratio"].values).sum() == 4
    assert "undecided" in to_csv(data) and "refined_ratio" in to_csv(data).splitlines()[0]
    # Once more: all is in the store.
    again = run_study(study(), out, workers=0, run=halved, pictures=False)
    assert again.status.reused == again.status.total == sweep.status.total
    assert again.map["label"].equals(sweep.map["label"])
    assert draw_phase(data).axes


def test_guide_is_undecided_within_the_strip_and_says_why(study, tmp_path):
    data = run_study(study(), tmp_path / "out", workers=0, run=halved, pictures=False).map
    near = int(np.nanargmin(np.abs(np.log(data["drop_rel"].values / 0.1 * 1.2))))
    index = np.unravel_index(near, data["drop_rel"].shape)
    at = {name: float(data[name].values[i]) for name, i in zip(data["drop_rel"].dims, index, strict=True)}
    text = "".join(f"{name} = {value!r}\n" for name, value in at.items() if name not in ("switch",))
    case = tmp_path / "near.toml"
    case.write_text(f'base = "gelatin"\n[parameters]\n{text}', encoding="utf-8")
    found = guide(data, str(case))
    assert found.regime == "undecided" and "numerics" in found.doubt and "undecided" in found.text()


def test_nothing_is_repeated_unless_asked_for(study):
    plain = study("")
    plan = plan_of(plain)
    rows = {case.id: row_of(analytic_runs.computed(case), plain.regime) for case in plan.ask({})}
    assert plan.repeats(rows) == [] and uncertainty_strips(build_map(plain, rows)) == {}
    asked = plan_of(study())
    asked.ask({})
    first = asked.repeats(rows)
    assert len(first) > 4 and asked.repeats(rows) == []
    assert len({case.id for case in first} & set(rows)) == 0
    uncut = {id: MapRow("done", "", 9.0, "uncut") for id in rows}
    nothing = plan_of(study())
    nothing.ask({})
    assert nothing.repeats(uncut) == []


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ("[uncertainty]\nruns = -1\n", "runs"),
        ("[uncertainty]\nbands = 1.5\n", "bands"),
        ("[uncertainty]\nrefine = 2\n", "refine"),
        ("uncertainty = 3\n", "uncertainty"),
    ],
)
def test_bad_sections_are_refused(study, section, key):
    with pytest.raises(BadInput) as error:
        study(section)
    assert key in str(error.value)
