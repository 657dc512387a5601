"""The search for a boundary: as sure as it says, with few runs, on boundaries of many shapes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import analytic_runs
import numpy as np
import pytest
from refusals import refused
from scipy.ndimage import distance_transform_edt

from cutbench.emulator.gaussian_process import GaussianProcess, Kernel
from cutbench.maps.boundary import (
    NORMAL_QUANTILE,
    BoundaryEstimate,
    BoundarySearch,
    distance_to_boundary,
    limited_slope,
    margin,
    margins_between,
)
from cutbench.maps.dataset import LABELS, build_map, load_map, row_of
from cutbench.maps.grid_agreement import agreement
from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study


def squashed(steepness):
    return lambda field: lambda p: math.tanh(steepness * field(p))


def jump(field):
    """The regime alone: the margin says nothing of how far the boundary is."""
    return lambda p: 0.9 if field(p) >= 0 else -0.9


PLANE = {
    "slanted": squashed(4)(lambda p: p[0] - p[1] ** 2 + 0.1),
    "wave": squashed(5)(lambda p: p[1] - 0.5 - 0.2 * math.sin(6 * p[0])),
    "corner": squashed(6)(lambda p: min(p[0] - 0.4, p[1] - 0.35)),
    "closed curve": squashed(20)(lambda p: 0.25**2 - (p[0] - 0.45) ** 2 - (p[1] - 0.55) ** 2),
    "two boundaries": squashed(-12)(
        lambda p: (p[0] - 0.25 - 0.1 * math.sin(3 * p[1])) * (p[0] - 0.75 + 0.15 * p[1])
    ),
    "leaves the box": squashed(5)(lambda p: 0.8**2 - (p[0] - 1) ** 2 - p[1] ** 2),
    "scattered": squashed(1)(
        lambda p: 4 * (p[0] - p[1] ** 2 + 0.1) + 0.03 * math.sin(1000 * p[0] + 777 * p[1])
    ),
    "a jump": jump(lambda p: p[0] - p[1] ** 2 + 0.1),
    "a closed jump": jump(lambda p: 0.3**2 - (p[0] - 0.45) ** 2 - (p[1] - 0.55) ** 2),
}
SPACE = {
    "slanted": squashed(3)(lambda p: p[0] + 0.5 * p[1] ** 2 - 0.7 * p[2] - 0.2),
    "closed surface": squashed(8)(lambda p: 0.33**2 - ((p - [0.5, 0.5, 0.45]) ** 2).sum()),
    "two boundaries": squashed(-10)(lambda p: (p[0] - 0.25 - 0.1 * p[1]) * (p[0] - 0.75 + 0.15 * p[2])),
    "leaves the box": squashed(4)(lambda p: 0.8**2 - (p[0] - 1) ** 2 - p[1] ** 2 - (p[2] - 0.2) ** 2),
}  # fmt: skip


def crossings(estimate):
    """Row, root, and the nearest points to either side whose regime is sure, of each line along axis 0."""
    found = []
    mean, spread = np.atleast_2d(estimate.mean.T), np.atleast_2d(estimate.spread.T)
    for row, (m, sd) in enumerate(zip(mean, spread, strict=True)):
        sure = np.flatnonzero(np.abs(m) > NORMAL_QUANTILE * sd)
        for j in np.flatnonzero(np.diff(m >= 0)):
            root = j + m[j] / (m[j] - m[j + 1])
            low, high = max(sure[sure <= j], default=0), min(sure[sure > j], default=m.size - 1)
            found.append((row, root, low, high))
    return found


def seek(field, d, parts, **changes):
    """Seeker, its margins, for a tolerance of 1/parts of each axis."""
    n = 2 * parts + 1
    seeker = BoundarySearch((n,) * d, **{"start": 5, "batch": 8 * (d - 1), "runs": parts**d // 8} | changes)
    known = {}
    while asked := seeker.ask(known):
        assert not set(asked) & known.keys(), "a point was asked for twice"
        known |= {i: float(field(np.array(i) / (n - 1))) for i in asked}
    return seeker, known


def grid_points(count, d):
    ticks = np.linspace(0, 1, count)
    return np.stack(np.meshgrid(*[ticks] * d, indexing="ij"), axis=-1).reshape(-1, d)


def far_from(field, points, tolerance, d):
    """Points whose distance to the true boundary, measured on a fine grid, exceeds the tolerance."""
    m = {2: 321, 3: 81}[d]
    side = np.array([field(p) >= 0 for p in grid_points(m, d)]).reshape((m,) * d)
    away = np.where(side, distance_transform_edt(side), distance_transform_edt(~side)) / (m - 1)
    at = tuple(np.rint(points * (m - 1)).astype(int).T)
    return away[at] > tolerance + 1 / (m - 1)


@pytest.mark.parametrize("name", PLANE)
def test_a_plane_boundary_to_a_32nd_with_an_eighth_of_the_runs_of_the_grid(name):
    field = PLANE[name]
    seeker, known = seek(field, 2, 32)
    assert len(known) <= 32 * 32 / 8 and seeker.asked == list(known)
    estimate = seeker.estimate(known)
    assert not estimate.unsure.any()
    points = grid_points(33, 2)
    true = np.array([field(p) >= 0 for p in points])
    found = estimate.mean[tuple((points * 64).round().astype(int).T)] >= 0
    far = far_from(field, points, 1 / 32, 2)
    assert far.sum() > 600 and not ((true != found) & far).any()


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACE)
def test_a_boundary_in_three_axes_to_a_16th_with_an_eighth_of_the_runs_of_the_grid(name):
    field = SPACE[name]
    seeker, known = seek(field, 3, 16)
    assert len(known) <= 16**3 / 8
    estimate = seeker.estimate(known)
    points = grid_points(17, 3)
    true = np.array([field(p) >= 0 for p in points])
    found = estimate.mean[tuple((points * 32).round().astype(int).T)] >= 0
    far = far_from(field, points, 1 / 16, 3)
    assert far.sum() > 2000 and not ((true != found) & far).any() and not estimate.unsure.any()


def test_the_runs_of_a_search_lie_along_the_boundary():
    seeker, _ = seek(PLANE["slanted"], 2, 32)
    later = np.array(seeker.asked[25:]) / 64
    away = np.abs(later[:, 0] - later[:, 1] ** 2 + 0.1)
    assert np.median(away) < 2.5 / 32  # of runs anywhere it would be a third of the box


def test_crossings_hold_the_true_boundary_between_low_and_high():
    seeker, known = seek(PLANE["slanted"], 2, 32)
    along_x = crossings(seeker.estimate(known))
    assert len(along_x) > 30
    hits = [low - 0.1 <= 64 * ((y / 64) ** 2 - 0.1) <= high + 0.1 for y, _, low, high in along_x]
    assert np.mean(hits) > 0.95
    assert max(high - low for _, _, low, high in along_x) <= 4  # within one tolerance to either side


def test_one_regime_everywhere_ends_soon_and_is_sure():
    seeker, known = seek(lambda p: math.tanh(p[0] + 0.5), 2, 32)
    estimate = seeker.estimate(known)
    assert len(known) <= 80 and (estimate.mean > 0).all() and not estimate.unsure.any()


def test_the_same_runs_give_the_same_search():
    first, known = seek(PLANE["wave"], 2, 32)
    again = BoundarySearch((65, 65), start=5, batch=8, runs=128)
    seen = {}
    while asked := again.ask(dict(sorted(seen.items(), reverse=True))):
        for i in asked:
            seen[i] = known[i]
            if len(seen) % 7 == 0:
                again.estimate(seen)  # a picture on the way changes nothing
    assert again.asked == first.asked


def test_runs_that_fail_are_not_asked_for_again_and_leave_the_rest_known():
    def field(p):
        return math.nan if 0.4 < p[0] < 0.6 and p[1] > 0.5 else PLANE["slanted"](p)

    seeker, known = seek(field, 2, 32)
    assert len(seeker.asked) == len(set(seeker.asked)) <= 128
    failed = sum(math.isnan(v) for v in known.values())
    assert 0 < failed < len(known) / 3
    estimate = seeker.estimate(known)
    elsewhere = [(y, x) for y, x, *_ in crossings(estimate) if 24 < y < 32]
    assert len(elsewhere) == 7
    for y, x in elsewhere:
        assert x == pytest.approx(64 * ((y / 64) ** 2 - 0.1), abs=2)


def test_nothing_that_succeeds_ends_the_search_and_nothing_is_sure():
    seeker, known = seek(lambda p: math.nan, 2, 32)
    assert len(known) == 25 and seeker.estimate(known).unsure.all()


def test_the_budget_holds_and_what_is_unknown_is_said():
    rough = squashed(4)(lambda p: math.sin(40 * p[0]) * math.sin(37 * p[1]))
    seeker, known = seek(rough, 2, 32, runs=60)
    assert len(known) == 60 and seeker.estimate(known).unsure.mean() > 0.2


def test_one_axis_is_a_root():
    seeker, known = seek(lambda p: math.tanh(5 * (p[0] - 0.377)), 1, 32, batch=2, runs=20)
    ((_, root, *_),) = crossings(seeker.estimate(known))
    assert root / 64 == pytest.approx(0.377, abs=1 / 64) and len(known) <= 20


def test_margins_are_zero_on_the_thresholds():
    assert margin(np.array([0.1]), np.array([0.0]), np.array([False]), drop=0.1)[0] == 0
    found = margin(
        np.array([0.0, 0.05, 0.9, np.nan, np.nan]), np.array([1, 1, 0.5, 1, 1.0]),
        np.array([False, False, False, False, True]), drop=0.1, surge_min=2.0,
    )  # fmt: skip
    assert found[0] == -1 and -1 < found[2] < found[1] < 0 and np.isnan(found[3:]).all()


def test_jumps_become_ramps_and_slopes_stay():
    x = np.linspace(0, 1, 21)[:, None]
    slope = np.tanh(3 * (x[:, 0] - 0.43))
    np.testing.assert_array_equal(limited_slope(x, slope), slope)
    steps = np.where(x[:, 0] < 0.43, -1.0, 1.0)
    soft = limited_slope(x, steps)
    assert (np.sign(soft) == steps).all() and np.abs(np.diff(soft)).max() < 0.75


def test_distances_count_from_between_the_regimes():
    side = np.zeros((4, 6), dtype=bool)
    side[:, 3:] = True
    np.testing.assert_allclose(distance_to_boundary(side)[0], [2.5, 1.5, 0.5, 0.5, 1.5, 2.5])
    assert np.isinf(distance_to_boundary(~np.zeros((2, 2), dtype=bool))).all()


def test_the_sign_of_a_margin_is_taken_for_certain():
    rng = np.random.default_rng(0)
    x = rng.random((40, 2))
    y = np.tanh(3 * (x[:, 0] - 0.5)) + 0.3 * rng.standard_normal(40)
    rough = Kernel((0.8, 0.8), 0.3)
    smooth = GaussianProcess(x, y, kernel=rough, trend="none")
    assert ((smooth.mean(x) >= 0) != (y >= 0)).any()
    assert ((margins_between(x, y, rough).mean(x) >= 0) == (y >= 0)).all()


@pytest.mark.parametrize(
    ("adhesion", "runs", "off"),
    [(0.0, 22, None), (0.0106, 22, None), (0.187, 22, None), (0.0, 11, 0.25), (0.0106, 11, -0.2)],
)
def test_the_search_of_the_default_study_has_the_line_within_its_tolerance(adhesion, runs, off):
    """On a formula like its drop: a power of viscosity on the line, level where viscosity is small. With half
    the runs where it is told beforehand of a line that is ``off`` by a part of the viscosity's logarithm."""
    study = load_study(Path(__file__).resolve().parents[1] / "studies" / "transition.toml")
    (low, high), (thin, thick) = ((a.values[0], a.values[-1]) for a in study.axes[:2])

    def line(cohesion):  # viscosity
        return 3.4 * math.exp(-3.4 * adhesion) * (cohesion / 2.58) ** -(0.9 + 7 * adhesion)

    def field(p):
        viscosity = thin * (thick / thin) ** p[1]
        over = 2.2 * math.log(line(low * (high / low) ** p[0]) / viscosity)
        return math.tanh(min(over, 2.0 - 4 * adhesion))

    shape, search = study.shape[:2], study.search
    expected = None
    if off is not None:
        places = np.stack(np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij"), axis=-1)
        shift = np.array([0.0, off / math.log(thick / thin)])
        thought = np.array([[field(p + shift) for p in row] for row in places])
        expected = BoundaryEstimate(thought, np.full(shape, 0.3), np.zeros(shape, dtype=bool))
    seeker = BoundarySearch(shape, start=search.start, batch=search.batch, runs=runs, expected=expected)
    known = {}
    while asked := seeker.ask(known):
        known |= {i: field(np.array(i) / (np.array(shape) - 1)) for i in asked}
    mean, compared = seeker.estimate(known).mean, 0
    for i, column in enumerate(mean):
        true = study.axes[1].place(line(study.axes[0].values[i]))
        if 0.02 < true < 0.98:
            (j,) = np.flatnonzero(np.diff(column >= 0))
            found = (j + column[j] / (column[j] - column[j + 1])) / (shape[1] - 1)
            assert abs(found - true) < study.axes[1].tolerance, (study.axes[0].values[i], found, true)
            compared += 1
    assert compared > 30


STUDY = """mode = "boundary"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 30.0
scale = "log"
[[axis]]
name = "viscosity"
from = 0.01
to = 5.0
scale = "log"
"""


@pytest.fixture
def study(tmp_path):
    def study(text):
        path = tmp_path / f"study{len(list(tmp_path.iterdir()))}.toml"
        path.write_text(text)
        return load_study(path)

    return study


def test_a_study_finds_the_boundary_that_its_grid_has(study, tmp_path):
    """The same two axes as a search and as a grid of 33 x 33 runs: the product's own comparison."""
    found = run_study(
        study(STUDY), tmp_path / "sought", workers=0, run=analytic_runs.computed, pictures=False
    )
    ticks = 'points = 33\nscale = "log"'
    grid = study(STUDY.replace('mode = "boundary"\n', "").replace('scale = "log"', ticks))
    whole = build_map(
        grid, {case.id: row_of(analytic_runs.computed(case), grid.regime) for case in grid.grid}
    )
    said = agreement(load_map(tmp_path / "sought" / "map.nc"), whole)
    assert said.points == 33 * 33 and said.far > 900 and said.wrong_far == 0 and said.wrong <= 12
    assert said.runs[0] <= 128 and said.runs[1] == said.whole == 1089 and str(said.far) in said.text()
    # A grid as fine over a part of the box: counted there, and against the whole of what it stands for.
    part = whole.isel(cohesion=slice(8, 21), viscosity=slice(14, 30))
    there = agreement(load_map(tmp_path / "sought" / "map.nc"), part)
    assert there.points == 13 * 16 and there.whole == 1089 and there.runs == (said.runs[0], 13 * 16)
    assert 0 < there.far < said.far and there.wrong_far == 0 and "208" in there.text()
    # What differs there, and only there, is found.
    off = part.copy(deep=True)
    flipped = off["label"].values
    flipped[:] = np.where(flipped == LABELS.index("abrupt"), LABELS.index("smooth"), LABELS.index("abrupt"))
    turned = agreement(load_map(tmp_path / "sought" / "map.nc"), off)
    assert turned.wrong == 13 * 16 - there.wrong and turned.wrong_far == turned.far
    assert found.complete
    assert found.map["margin"].dims == ("cohesion", "viscosity") and found.map.sizes["cohesion"] == 65
    csv = (tmp_path / "sought" / "map.csv").read_text().splitlines()
    assert len(csv) == said.runs[0] + 1
    with refused("--against", value="study2", hint="'boundary'"):
        agreement(whole, whole)


@pytest.mark.slow
def test_levels_are_searched_side_by_side_and_a_second_sweep_computes_nothing(study, tmp_path):
    text = STUDY + '[[axis]]\nname = "adhesion"\nvalues = [0.0, 0.187]\n[boundary]\nruns = 60\n'
    first = run_study(study(text), tmp_path / "out", workers=0, run=analytic_runs.computed, pictures=False)
    counts = (first.map["run_id"] != "").sum(["cohesion", "viscosity"]).values
    assert (counts <= 60).all() and counts.sum() == first.status.total
    drop = analytic_runs.drop_of(first.map and study(text).case_at([5.0, 1.0, 0.187]))
    assert (first.map["margin"].sel(adhesion=0.187).interp(cohesion=5.0, viscosity=1.0) < 0) == (drop < 0.1)
    again = run_study(study(text), tmp_path / "out", workers=0, run=failing, pictures=False)
    assert again.status.reused == again.status.total == first.status.total
    assert again.map.equals(first.map)


def failing(case):
    raise AssertionError("computed again")


@pytest.mark.parametrize(
    ("name", "points", "part", "axes"),
    [("boundary", 17 * 33, 1 / 32, ("cohesion", "viscosity")),
     ("boundary3", 17 * 17 * 9, 1 / 16, ("cohesion", "viscosity", "adhesion"))],
)  # fmt: skip
def test_the_kept_boundary_agrees_with_the_kept_grid(name, points, part, axes):
    """studies/results: finite-element runs, by ``cutbench sweep`` from the studies of these names."""
    results = Path(__file__).resolve().parents[1] / "studies" / "results"
    sought, grid = (load_map(results / kind / "map.nc") for kind in (name, f"{name}-grid"))
    found = agreement(sought, grid)
    assert found.runs[0] <= found.whole / 8 and found.whole >= points
    assert found.wrong_far == 0 and found.points > 50 and found.far > found.points / 3
    assert json.loads(sought.attrs["tolerance"]) == dict.fromkeys(axes, part)
    assert sought["unsure"].values.mean() < 0.01
