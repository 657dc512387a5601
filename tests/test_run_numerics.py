"""Whole runs in plane strain: what changes, and what does not, with the numerical choices."""

from __future__ import annotations

import numpy as np
import pytest
from coarse_runs import BRIEF, COARSE, PRESSED, QUICK, SOFT, force_at, seen_by_blade, tuned

from cutbench.case.case import load_case
from cutbench.case.numerics import Numerics
from cutbench.forms.base import Step
from cutbench.maps.dataset import row_of
from cutbench.maps.study_sections import Regime
from cutbench.mechanisms.base import Points
from cutbench.run.build import build
from cutbench.run.runner import run_case
from cutbench.solver import march
from cutbench.solver.newton import newton as march_newton


def test_a_law_by_itself_closes_as_it_does_in_a_run():
    assert Points.closing == Numerics().closing


def test_half_and_full_block_agree():
    # The window's iterations differ by rounding, and with them the steps: without it.
    # So viscous that nothing snaps.
    steady = QUICK.set(mu=0.0, viscosity=8.0, depth="0.8 mm", step="0.05 mm", predictor="line", **SOFT)
    brief, full = run_case(steady), run_case(steady.set(symmetry="full"))
    assert full.curve["cut_length_mm"][-1] > 0.01
    at = np.linspace(0.05, 0.8, 30)
    np.testing.assert_allclose(force_at(full, at), force_at(brief, at), rtol=2e-3)
    short = PRESSED.set(depth="0.3 mm", step="0.01 mm")  # one length of step: effort does not choose it
    virgin, half = run_case(short.set(symmetry="full")), run_case(short)
    np.testing.assert_allclose(virgin.force_N, half.force_N, rtol=1e-6)
    assert virgin.counts["degrees_of_freedom"] > 1.9 * half.counts["degrees_of_freedom"]


@pytest.mark.parametrize("normal", ["tool", pytest.param("material", marks=pytest.mark.slow)])
def test_elements_from_stiff_to_soft(normal):
    """While nothing is cut, a richer space is softer: linear triangles lock at ν = 0.49."""
    case = PRESSED.set(normal=normal, depth="1 mm")
    linear, quadratic, mixed = (force_at(run_case(case.set(element=e)), 1.0) for e in ("P1", "P2", "P2P1"))
    assert linear > 1.1 * quadratic
    assert mixed == pytest.approx(quadratic, rel=0.02)
    assert mixed <= quadratic


def test_linear_triangles_lock_less_where_the_solid_is_compressible():
    def excess(nu):
        case = PRESSED.set(nu=nu, depth="0.5 mm")
        linear, quadratic = (force_at(run_case(case.set(element=e)), 0.5) for e in ("P1", "P2"))
        return linear / quadratic - 1

    assert excess(0.3) < 0.7 * excess(0.49)


def test_normals_and_gaps_are_choices_that_matter_little_before_the_cut(pressed):
    for change in ({"normal": "material"}, {"gap": "ellipse"}):
        other = force_at(run_case(PRESSED.set(**change)), 1.5)
        assert other != force_at(pressed, 1.5)
        assert other == pytest.approx(force_at(pressed, 1.5), rel=0.05)


@pytest.mark.slow
def test_a_carried_multiplier_does_what_repeated_ones_do(pressed):
    """Material gives way by what the pressure changes in a step, not by all of it: no loop is needed."""
    bare = PRESSED.set(**SOFT)
    soft, hard = (force_at(run_case(bare.set(augmentations=n)), 1.5) for n in (0, 3))
    carried = run_case(bare.set(multiplier="carried"))
    assert hard > 1.005 * soft
    assert abs(force_at(carried, 1.5) - hard) < 0.1 * (hard - soft)
    assert abs(carried.curve["closure"][-1]) < 0.01


@pytest.mark.slow
def test_the_staggered_scheme_tends_to_the_monolithic_one():
    """Damage that lags is repeated until it stands still; viscosity then sees it at a step's end."""
    # Viscous enough that the cut grows steadily: in a snap, what a step meets depends on the step.
    case = BRIEF.set(
        mu=0.0, viscosity=8.0, depth="0.8 mm", element="P1", with_="smith_ferrante",
        without="surface_gradient", **SOFT,
    )  # fmt: skip
    case = tuned(case, "steps", nascent=1.0, resolved=100.0)  # all steps are as long as asked
    at = np.linspace(0.05, 0.8, 40)
    apart, forces = [], []
    for step in ("0.02 mm", "0.005 mm"):
        whole, lagged = (run_case(case.set(step=step, scheme=s)) for s in ("monolithic", "staggered"))
        assert lagged.outcome.done
        assert lagged.curve["cut_length_mm"][-1] > 0.01
        assert lagged.counts["iterations"] >= whole.counts["iterations"]
        assert lagged.counts["steps"] < 1.3 * whole.counts["steps"], "nothing snaps"
        forces.append(force_at(whole, at))
        apart.append(np.abs(force_at(lagged, at) / forces[-1] - 1).max())
    # First order in the step: a quarter of it leaves a quarter, or a little more, of the difference.
    assert apart[1] < 0.4 * apart[0] < 0.4 * 0.03
    # The monolithic scheme is of second order.
    forces.append(force_at(run_case(case.set(step="0.01 mm")), at))
    far, near = (np.abs(force / forces[1] - 1).max() for force in (forces[0], forces[2]))
    assert 15 / 4 * near < 1.2 * far < 1.2 * 0.005


@pytest.mark.slow
def test_errors_of_the_ledger_do_not_add_up():
    """Beyond a part of the work, steps that would add to what is open are held tighter."""
    # A run whose steps leave enough open to be held.
    case = COARSE.set(
        element="P1",
        h="1 mm",
        depth="6 mm",
        energy_step=0.1,
        cohesion=8.0,
        surface_length="0 mm",
        normal="material",
        predictor="line",
        **SOFT,
    )
    allowed = 0.004
    held, free = (run_case(tuned(case, "steps", drift=drift)) for drift in (allowed, 1.0))
    most = [np.abs(run.curve["closure"]).max() for run in (held, free)]
    # What one step leaves open before that much is, it may; two in a row it may not.
    assert most[1] > 1.5 * allowed, "nothing to hold"
    assert most[0] < 0.6 * most[1]


@pytest.mark.slow
def test_a_tough_viscous_material_closes():
    """Each step of its cutting leaves something open, and always to the same side."""
    case = load_case("meat").set(
        h="0.25 mm", corner=0.25, shallow=1, step="0.1 mm", around=0, energy_step=0.1, depth="5.2 mm",
        height="8 mm", width="8 mm",
    )  # fmt: skip
    result = run_case(case)
    assert result.outcome.done
    assert abs(result.measures["closure"]) < 1.2 * case.numerics.tuning.steps.drift


def test_a_march_does_not_crawl(newton_by):
    """Where only raised damping helps, over a way that the smallest steps would take a thousand for."""
    case, newton = QUICK.set(depth="0.6 mm"), march_newton

    def stubborn(problem, u, states, step, settings, **options):
        travel = case.p.height - step.centre[1]
        if 0.3 < travel < 0.4 and step.damping_factor < 100:
            raise march.NoConvergence("stubborn")
        return newton(problem, u, states, step, settings, **options)

    newton_by(stubborn)
    result = run_case(case)
    assert result.outcome.done
    assert result.counts["steps"] < 150 and result.counts["rejected_steps"] < 150


def stubborn(case):
    """Newton's method, but for a step across 0.35 mm without much damping."""
    newton = march_newton

    def found(problem, u, states, step, settings, **options):
        before, travel = (case.p.height - c[1] for c in (step.centre_old, step.centre))
        if before < 0.35 < travel and step.damping_factor < 1e4:
            raise march.NoConvergence("stubborn")
        return newton(problem, u, states, step, settings, **options)

    return found


def test_raised_damping_leaves_no_force_on_the_curve(newton_by):
    """The blade drags what it moves against it: so it rests until the damping is back."""
    case = QUICK.set(depth="0.6 mm")
    free = run_case(case)
    newton_by(stubborn(case))
    held = run_case(case)
    assert held.outcome.done and held.counts["rejected_steps"] > free.counts["rejected_steps"]
    assert (np.diff(held.displacement_mm) > 0).all()
    there = np.interp(held.displacement_mm, free.displacement_mm, free.force_N)
    assert held.force_N == pytest.approx(there, abs=2e-3 * free.force_N.max())
    assert abs(held.measures["closure"]) < 0.01


def test_rest_is_on_the_clock(newton_by):
    case = QUICK.set(depth="0.6 mm")
    free = run_case(case)
    newton_by(stubborn(case))
    held = run_case(case)
    late = [run.curve["time_s"] * case.p.speed - run.displacement_mm for run in (free, held)]
    assert np.abs(late[0]).max() < 1e-9
    rests = late[1] / case.sizes.step_min_mm
    assert (np.diff(rests) > -1e-6).all() and rests[-1] > 0.9
    np.testing.assert_allclose(rests, np.round(rests), atol=1e-6)


def test_what_goes_on_against_raised_damping_is_counted(newton_by):
    case = tuned(QUICK.set(depth="0.6 mm"), "steps", tries=3)
    newton, refuses = march_newton, stubborn(case)

    def restless(problem, u, states, step, settings, **options):
        if step.centre[1] == step.centre_old[1] and step.damping_factor > 1:
            raise march.NoConvergence("no state at rest")
        return refuses(problem, u, states, step, settings, **options)

    newton_by(restless)
    dragged = run_case(case)
    newton_by(newton)
    free = run_case(case)
    assert dragged.outcome.done and free.outcome.done
    assert free.measures["drag_steps"] == free.measures["drag_boost"] == 0
    assert dragged.measures["drag_steps"] > 1 and dragged.measures["drag_boost"] > 10
    for run in (free, dragged):
        part = run.curve["work_snap_mJ"][-1] / run.measures["energy_mJ"]
        assert run.measures["snap_rel"] == pytest.approx(part, rel=0.01)
    row = row_of(dragged, Regime(0.1, None, 0.1))
    assert row.measures["drag_steps"] == dragged.measures["drag_steps"]


def test_a_march_goes_on_where_the_blade_rests(newton_by):
    case = QUICK.set(depth="0.4 mm")
    newton_by(stubborn(case))
    steps = list(build(case).march)
    number = next(i for i, step in enumerate(steps) if step.progress.control.rests)
    assert steps[number].between
    rest, same = list(build(case).march.steps(steps[number].progress)), steps[number + 1 :]
    assert [s.between for s in rest] == [s.between for s in same]
    # Solvers have seen other matrices before.
    for one in ("travel", "force"):
        assert [getattr(s, one) for s in rest] == pytest.approx([getattr(s, one) for s in same], rel=1e-9)


def test_stepping_of_the_paper_reaches_the_same_force(pressed):
    result = run_case(PRESSED.set(stepping="paper"))
    assert result.outcome.done
    assert force_at(result, 1.5) == pytest.approx(force_at(pressed, 1.5), rel=1e-3)
    assert result.counts["steps"] != pressed.counts["steps"]


def deepest(case):
    """Largest penetration of the blade by quadrature points in contact, mm."""
    picture = run_case(case, snapshots_mm=(case.p.depth,)).snapshots[-1]
    p = case.p
    found = 0.0
    for face in picture.faces.values():
        g, _ = seen_by_blade(face, p, picture.displacement_mm)
        assert (g[face["contact_state"] == 0] > -1e-9).all(), "whoever is inside is in contact"
        found = max(found, -g[face["contact_state"] == 1].min(initial=0.0))
    return found


@pytest.mark.slow
def test_augmentation_reduces_the_penetration():
    case = PRESSED.set(depth="0.3 mm", normal="tool", penalty="20 1/mm", multiplier="none")
    penalty, once, thrice = (deepest(case.set(augmentations=n)) for n in (0, 1, 3))
    assert penalty > 1e-4
    assert once < 0.7 * penalty
    assert thrice < once


def test_augmentations_end_where_pressures_stand_still():
    case = PRESSED.set(
        depth="0.3 mm", normal="tool", multiplier="none", penalty="3200 1/mm", augmentations=50
    )
    built, still = build(case), case.numerics.tuning.newton.multipliers
    steps, w = list(built.march), built.form("blade").faces.w
    assert max(len(step.solves) for step in steps) < 51
    for step in steps:
        last = step.solves[-1][0]["blade"]["multiplier"]
        mean = (w * step.states["blade"]["pressure"]).sum(axis=0) / w.sum(axis=0)
        assert np.abs(mean - last).max() <= still * mean.max()
        assert last.max() > 0.9 * mean.max() > 0


def test_damage_and_multipliers_that_are_held_stand_still_together(newton_by):
    solve, solutions = march_newton, []
    newton_by(lambda *a, **k: solutions.append(0) or solve(*a, **k))
    case = load_case("gelatin", {"numerics": "paper"}).set(h="1 mm", depth="3.4 mm")
    built, tuning = build(case), case.numerics.tuning.newton
    problem, w = built.problem, built.form("blade").faces.w
    damage = 0.0
    for step in built.march:
        begun = step.solves[-1][0]
        found = problem.evaluate(step.u, begun, step.step)
        assert problem.relative_residual(found) < 10 * tuning.staggered_change
        last = begun["blade"]["multiplier"]
        mean = (w * step.states["blade"]["pressure"]).sum(axis=0) / w.sum(axis=0)
        assert np.abs(mean - last).max() <= tuning.multipliers * mean.max()
        damage = step.states["cohesion"]["damage"].max()
        # Each solution is for both: a loop in a loop takes up to 51 here.
        assert len(solutions) == len(step.solves) < 25
        solutions.clear()
    assert damage > 0.9


def test_the_paper_s_contact_is_its_penalty_over_the_element():
    case = load_case("gelatin", {"numerics": "paper"}).set(h="1 mm", corner=0.25)
    built = build(case)
    form, problem = built.form("blade"), built.problem
    below = np.array([0.0, -10.0, 0.0])  # its flanks at every point, with x = 0: the gap is 1
    step = Step(1.0, np.zeros(problem.ndof), below, below)
    with np.errstate(invalid="ignore"):  # above the blade's apex, on its axis, the top has no direction
        found = form.evaluate(step.u_old, problem.p, form.start(problem.p), step).state["pressure"]
    cut = form.faces.parts["cut"]
    elements = built.geometry.mesh.p[:, built.geometry.mesh.t]
    edges = np.linalg.norm(elements - np.roll(elements, 1, axis=1), axis=0)
    assert set(np.round(form.faces.cell[cut], 9)) <= set(np.round(edges.max(axis=0), 9))
    assert np.ptp(form.faces.cell[cut]) > 0
    np.testing.assert_allclose(found[:, cut], np.broadcast_to(1 / form.faces.cell[cut], found[:, cut].shape))


def test_a_larger_penalty_reduces_the_penetration():
    soft, stiff = (deepest(PRESSED.set(depth="0.3 mm", penalty=k, multiplier="none")) for k in (20, 100))
    assert stiff < 0.5 * soft
