"""Paths through snap-backs: one that is known exactly, one of a cut, what is said of them, the command."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import skfem
from coarse_runs import tuned
from refusals import refused
from scipy.integrate import quad
from scipy.optimize import brentq
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.case.tuning import PathTuning
from cutbench.cli.main import app
from cutbench.forms.base import Local
from cutbench.forms.blade import BladeForm
from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.space import Space
from cutbench.mechanisms import registry
from cutbench.run.result import Outcome, Result
from cutbench.run.snap_back import (
    INTERRUPTED,
    MESH,
    OPEN,
    PHYSICAL,
    STABLE,
    SnapBack,
    as_seen_by_advancing_blade,
    describe_followed,
    jumps_of,
    rate_independent_case,
    sentence,
    trace_path,
    viscosity_limit_cases,
)
from cutbench.solver.arc_length import Path
from cutbench.solver.problem import Problem
from cutbench.solver.stability import lowest_eigenvalue

SPRING = 0.1  # N/mm for each mm of depth
LONG = 2.0  # mm
SECTION = 1.0  # mm


class Spring(BladeForm):
    """Pulls one side along x, its other end at the travel; where a problem has its blade."""

    name = "blade"

    def __init__(self, nodes):
        self.dofs = 2 * nodes[None]

    def start(self, p):
        return {}

    def touch(self, state, step=None):
        return state

    def evaluate(self, u, p, state, step):
        pull = SPRING / self.dofs.shape[1] * (-step.centre[1] - u[self.dofs])
        stiffness = np.full((1, *self.dofs.shape), SPRING / self.dofs.shape[1])
        return Local(-pull, stiffness, {"pull": np.real(pull)})

    def force(self, state):
        return np.array([0.0, state["pull"].sum()])

    def work(self, u, p, old, new, step):
        before = old["pull"] if old else 0.0
        change = (step.centre_old - step.centre)[1] - (u - step.u_old)[self.dofs]
        return {"spring": float(((before + new["pull"]) / 2 * change).sum())}


def bar_of(along, across):
    """A bar that can only stretch, held by a cohesive face and pulled by a soft spring: problem and path."""
    p, law = SimpleNamespace(**{**load_case("gelatin").values, "G": 0.1, "nu": 0.3}), registry()
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, LONG, along + 1), np.linspace(0, SECTION, across + 1))
    mesh = mesh.with_boundaries({"cut": lambda x: x[0] < 1e-9, "end": lambda x: x[0] > LONG - 1e-9})
    space = Space.build(mesh, 1)
    forms = [
        BulkForm((law["neo_hookean"], law["volumetric"]), space.volume(1), 1.0),
        CutForm((law["smith_ferrante"],), space.faces("cut", 4), SECTION),
        Spring(space.nodes_on("end")),
    ]
    forms.append(DampingForm(space.volume(1), 1.0))
    problem = Problem(forms, space.ndof, np.arange(1, space.ndof, 2), p)
    rules = PathTuning(travel=0.05, growth=0.01, first=1e-3)
    return problem, Path(problem, np.zeros(3), 0.7, np.array([], int), rules)


@pytest.fixture(scope="module")
def bar():
    problem, path = bar_of(2, 1)
    points, soft = [], []
    for point in path:
        points.append(point)
        soft.append(lowest_eigenvalue(problem, point))
    return SimpleNamespace(p=problem.p, path=path, points=points, soft=np.array(soft))


def traction(opening, p):
    return p.G_c / p.delta_c**2 * opening * np.exp(-opening / p.delta_c)


def stretched(T, p):
    """Stretch of a bar that cannot narrow, by the formula on paper."""

    def out_of_balance(x):
        kappa = 2 * p.G * (1 + p.nu) / (3 * (1 - 2 * p.nu))
        return p.G * x ** (-2 / 3) * (x - (x**2 + 2) / (3 * x)) + kappa * (x - 1) - T

    return brentq(out_of_balance, 1.0, 20.0, xtol=1e-14)


def travel(opening, p):
    """Of the far end of the spring, where the face has opened so far."""
    T = traction(opening, p)
    return opening / 2 + LONG * (stretched(T, p) - 1) + T * SECTION / SPRING


def turning(p):
    """Opening at the turning point: dT/dδ of the face undoes what bar and spring give."""

    def slope(opening, step=1e-6):
        return travel(opening + step, p) - travel(opening - step, p)

    return brentq(slope, 0.5 * p.delta_c, 1.5 * p.delta_c)


def curve_of(points):
    works = {f"work_{name}_mJ" for point in points for name in point.work}
    columns = {
        "displacement_mm": [0.0, *(point.travel for point in points)],
        "force_N": [0.0, *(point.force for point in points)],
        "cut_length_mm": [0.0, *(point.broken for point in points)],
        "released": [0.0, *(float(point.by == "release") for point in points)],
        "softest": [math.nan] * (len(points) + 1),
    }
    for name in works:
        done = [point.work.get(name[5:-3], 0.0) for point in points]
        columns[name] = np.concatenate([[0.0], np.cumsum(done)])
    return {name: np.array(values) for name, values in columns.items()}


# -- a path that is known exactly -----------------------------------------------------------------------
def test_the_path_of_a_bar_is_the_exact_one(bar):
    assert bar.path.stopped is None and bar.points[-1].travel == pytest.approx(0.7, abs=0.1)
    openings = [2 * float(point.u[0]) for point in bar.points]
    exact = [(travel(opening, bar.p), traction(opening, bar.p) * SECTION) for opening in openings]
    found = [(point.travel, point.force) for point in bar.points]
    np.testing.assert_allclose(found, exact, rtol=1e-6, atol=1e-9)
    # It goes forward, back and forward again, and nothing was let go.
    d = np.array([point.travel for point in bar.points])
    top = int(np.argmax(np.diff(d) < 0))
    assert d[top] - d[top:].min() > 0.2 and d[-1] > d[top] > 0.4
    assert {point.by for point in bar.points} <= {"travel", "cut", "damage"}


def test_the_turning_point_and_the_energy_set_free(bar):
    (jump,) = jumps_of(curve_of(bar.points), 0.7)
    opening = turning(bar.p)
    assert jump.landed
    assert jump.travel_mm == pytest.approx(travel(opening, bar.p), rel=1e-3)
    assert jump.force_N == pytest.approx(traction(opening, bar.p) * SECTION, rel=2e-3)
    landing = brentq(lambda x: travel(x, bar.p) - jump.travel_mm, 4 * bar.p.delta_c, 100 * bar.p.delta_c)
    assert jump.landing_N == pytest.approx(traction(landing, bar.p) * SECTION, abs=1e-4 * jump.force_N)

    def power(x, step=1e-6):
        return traction(x, bar.p) * SECTION * (travel(x + step, bar.p) - travel(x - step, bar.p)) / (2 * step)

    freed = -quad(power, opening, landing, points=[0.2, 0.5], limit=200)[0]
    assert jump.freed_mJ == pytest.approx(freed, rel=5e-3)
    # Half of the face belongs to this side; what is left of its work of separation is spent on the way.
    spent = quad(lambda x: traction(x, bar.p), opening, landing, points=[0.2, 0.5], limit=200)[0] / 2
    assert jump.spent_mJ["smith_ferrante"] == pytest.approx(spent * SECTION, rel=1e-2)
    assert sum(jump.spent_mJ.values()) == pytest.approx(-jump.freed_mJ, rel=2e-2)


def test_the_lowest_eigenvalue_passes_zero_where_the_path_turns(bar):
    d = np.array([point.travel for point in bar.points])
    top = int(np.argmax(np.diff(d) < 0))
    # The bar is free to move along itself, so the motion that loses its hold comes down from infinity.
    # The turning point lies on one side of the farthest point or the other.
    assert (bar.soft[:top] > 0).all() and -5 < bar.soft[top : top + 2].min() < 0


# -- what is jumped over -----------------------------------------------------------------------------------
def shape(d, F, c=None, released=None):
    d = np.array(d, float)
    return {
        "displacement_mm": d,
        "force_N": np.array(F, float),
        "cut_length_mm": np.arange(d.size, dtype=float) if c is None else np.array(c, float),
        "released": np.zeros(d.size) if released is None else np.array(released, float),
        "softest": np.full(d.size, math.nan),
        "work_snap_mJ": np.zeros(d.size),
    }


def test_a_jump_goes_from_the_turning_point_to_the_same_travel():
    (jump,) = jumps_of(shape([0, 1, 2, 1, 3], [0, 1, 2, 0.5, 1.5]), 0.7)
    assert (jump.travel_mm, jump.back_mm, jump.force_N) == (2.0, 1.0, 2.0)
    assert jump.landing_N == 1.0 and jump.advance_mm == 1.5 and jump.drop_rel == 0.5
    # Triangle (2, 2), (1, 0.5), (2, 1) between the way back and the way forward.
    assert jump.freed_mJ == pytest.approx(0.5)


def test_small_loops_and_forward_paths_are_no_jumps():
    assert jumps_of(shape([0, 1, 2, 3], [0, 1, 0.5, 1]), 0.7) == []
    assert jumps_of(shape([0, 1, 1 - 1e-3, 2], [0, 1, 0.9, 1]), 0.7) == []


def test_a_path_that_does_not_come_back_has_not_landed():
    (jump,) = jumps_of(shape([0, 2, 1], [0, 2, 1]), 0.7)
    assert not jump.landed and jump.landing_N == 1.0 and jump.advance_mm == 1.0


def test_a_release_is_a_jump_and_counted():
    (jump,) = jumps_of(shape([0, 1, 1, 1, 2], [0, 1, 0.8, 0.6, 1], released=[0, 0, 1, 1, 0]), 0.7)
    assert jump.releases == 1 and jump.released_mm == 2.0 and jump.back_mm == 0.0


def result(case, drop):
    curve = {name: np.array([0.0, 1.0]) for name in ("displacement_mm", "force_N", "cut_length_mm")}
    return Result(case, curve, Outcome("done", "reached 1 mm"), measures={"drop_rel": drop})


@pytest.mark.parametrize(
    ("d", "c", "stopped", "verdict"),
    [
        ([0, 2, 1, 3], [0, 0, 1, 2], None, PHYSICAL),
        ([0, 2, 1, 3], [0, 0, 0.2, 0.3], None, MESH),
        ([0, 2, 3, 4], [0, 0, 1, 2], None, STABLE),
        ([0, 2, 3, 4], [0, 0, 1, 2], "lost", OPEN),
        ([0, 2, 1.5, 1], [0, 0, 0.2, 0.3], "lost", OPEN),
    ],
)
def test_the_verdict(d, c, stopped, verdict):
    case = load_case("gelatin", {"h": "0.125 mm"})
    curve = shape(d, [0, 2, 1, 1.5], c)
    found = SnapBack(case, curve, tuple(jumps_of(curve, 0.7)), stopped, (), result(case, 0.16))
    assert found.verdict == verdict
    words = {PHYSICAL: "is physical", MESH: "fewer than 3 elements", STABLE: "No jump", OPEN: "Open"}
    assert words[verdict] in sentence(found) and "16%" in sentence(found)
    assert describe_followed(found)["verdict"] == verdict


def test_what_a_blade_sees_that_only_moves_forward():
    case = load_case("gelatin")
    curve = shape([0, 1, 2, 1, 3], [0, 1, 2, 0.5, 1.5])
    seen = as_seen_by_advancing_blade(
        SnapBack(case, curve, tuple(jumps_of(curve, 0.7)), None, (), result(case, 0.1))
    )
    assert seen["displacement_mm"].tolist() == [0, 1, 2, 2, 3]
    assert seen["force_N"].tolist() == [0, 1, 2, 1, 1.5]


# -- cases -------------------------------------------------------------------------------------------------
def test_a_case_at_rest_has_no_viscosity():
    case = rate_independent_case(load_case("gelatin"))
    assert "viscous_degraded" not in case.mechanisms and "adhesion" in case.mechanisms


def test_laws_of_time_are_refused():
    case = load_case("gelatin", {"with": "maxwell"})
    with refused("--follow", value="maxwell", hint="maxwell"):
        rate_independent_case(case)


def test_viscosity_fades_and_steps_halve():
    case = load_case("gelatin")
    cases = viscosity_limit_cases(case, 3.0)
    assert [one.values["eta_reg"] / case.values["eta_reg"] for _, one in cases] == pytest.approx(
        [0.1, 0.01, 0.01]
    )
    assert cases[-1][1].sizes.step_mm == case.sizes.step_mm / 2
    assert all(one.p.depth == 3.0 for _, one in cases)


# -- a cut -------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_the_path_of_a_cut_passes_its_turning_point():
    case = rate_independent_case(load_case("gelatin", {"h": "0.8 mm", "depth": "5 mm"}))
    curve, stopped = trace_path(tuned(case, "path", points=140))
    assert stopped != INTERRUPTED
    jumps = jumps_of(curve, case.p.thickness)
    jump = max(jumps, key=lambda one: one.advance_mm)
    assert max(one.back_mm for one in jumps) > 0.1 and jump.force_N > jump.landing_N
    assert (np.diff(curve["cut_length_mm"]) > -1e-9).all()
    # Before the turning point nothing was let go.
    assert not curve["released"][: jump.first + 1].any()


@pytest.mark.slow
def test_the_command_writes_what_it_found(tmp_path):
    args = ["run2d", "gelatin", "--h", "0.8", "--depth", "0.6", "--follow", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, args)
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "follow.json").read_text(encoding="utf-8"))
    assert record["verdict"] == STABLE and record["text"] in done.stdout.replace("\n", " ")
    assert (tmp_path / "follow.png").stat().st_size > 10_000
    assert (tmp_path / "path.csv").read_text(encoding="utf-8").count("\n") > 3


def test_following_a_law_of_time_is_one_message(tmp_path):
    args = ["run2d", "gelatin", "--with", "maxwell", "--follow", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, args)
    assert done.exit_code == 2 and "maxwell" in done.stderr and done.stderr.count("\n") == 1
