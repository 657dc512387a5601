"""What a sweep says that it found: counts, reasons, depths that would do."""

from __future__ import annotations

import math

import analytic_runs
import numpy as np
import pytest

from cutbench.maps.dataset import MapRow, build_map, row_of
from cutbench.maps.findings import findings, summary_text
from cutbench.maps.study import load_study
from cutbench.run.measures import KNOWN


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(f'base = "gelatin"\n[protocol]\ndepth = "9 mm"\n{analytic_runs.AXES}')
    return load_study(path)


def rows_of(study):
    return {case.id: row_of(analytic_runs.computed(case), study.regime) for case in study.cases()}


def test_regimes_are_counted_and_reasons_told_without_their_numbers(study):
    rows = rows_of(study)
    ids = list(rows)
    for n, id in enumerate(ids[:3]):
        rows[id] = MapRow("stalled", f"no equilibrium at {n + 1.25} mm", 1.0)
    rows[ids[3]] = MapRow("failed", "out of memory")
    del rows[ids[4]]
    data = build_map(study, rows)
    found = findings(data)
    kinds = [row.label for row in rows.values()]
    assert found.runs == 24 and found.missing == 1
    assert found.labels == {name: kinds.count(name) for name in ("smooth", "abrupt")}
    assert [sum(reasons.values()) for reasons in found.short.values()] == [3, 1]
    assert len(found.short["stalled"]) == 1
    said = "\n".join(found.lines())
    assert "3 ×" in said and "1 ×" in said


def test_what_the_blade_did_not_reach_has_a_depth_that_would_do(study):
    """Onsets that follow a power law over the axes: those that are missing lie on it."""
    rows, onset = {}, {}
    for index, case in study.points():
        at = dict(zip((axis.name for axis in study.axes), index, strict=True))
        onset[case.id] = 2.0 * 1.5 ** at["cohesion"] * 1.1 ** at["viscosity"]
        there = onset[case.id] <= 6.7
        measured = {"drop_rel": 0.02, "onset_mm": onset[case.id]} if there else {}
        rows[case.id] = MapRow("done", "", 7.0, "smooth" if there else "uncut", measured)
    found = findings(build_map(study, rows))
    late = [mm for mm in onset.values() if mm > 6.7]
    early = [mm for mm in onset.values() if mm <= 6.7 and mm + KNOWN * 0.7 > 7.0]
    assert found.labels["uncut"] == len(late) > 0 and found.open_ended == len(early) > 0
    assert max(late) + KNOWN * 0.7 < found.deepen_mm < 1.15 * max(late) + KNOWN * 0.7 + 0.2
    assert f'depth = "{found.deepen_mm:.3g} mm"' in "\n".join(found.lines())
    # As deep as that, all are known.
    done = {
        id: MapRow("done", "", found.deepen_mm, "smooth", {"drop_rel": 0.02, "onset_mm": mm})
        for id, mm in onset.items()
    }
    assert findings(build_map(study, done)).open_ended == 0


def test_no_trend_and_no_room_are_said(study):
    none = findings(build_map(study, {id: MapRow("done", "", 9.0, "uncut") for id in rows_of(study)}))
    assert none.labels == {"uncut": 24} and math.isnan(none.deepen_mm)
    far = {}
    for n, case in enumerate(study.grid):
        measured = {} if n == 0 else {"drop_rel": 0.02, "onset_mm": 17.0}
        far[case.id] = MapRow("done", "", 18.0, "smooth" if n else "uncut", measured)
    assert findings(build_map(study, far)).deepen_mm > 18.0


def test_any_label_is_counted_and_crossings_too(study):
    data = build_map(study, rows_of(study))
    data["crossed_mm"].values.ravel()[:2] = 2.5
    found = findings(data)
    assert found.crossed == 2 and sum(found.labels.values()) == 24
    text = summary_text(data, ["more"]).splitlines()
    assert text[0] == data.attrs["title"] and text[1] == "24 runs" and text[-1] == "more"


def test_a_run_at_two_points_counts_once(study):
    data = build_map(study, rows_of(study))
    ids = data["run_id"].values
    ids[..., 1] = ids[..., 0]
    assert findings(data).runs == 12 == sum(findings(data).labels.values())
    assert np.unique(ids).size == 12
