"""The predictor that solves around the front of the cut first, and the parts of forms that it needs."""

from __future__ import annotations

from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest
from coarse_runs import BRIEF, PRESSED, force_at, tuned
from form_checks import HEIGHT, P, blade, blade_case, bulk_form, displacement, space_of, spaces, step_between

from cutbench.case.model import DEFAULT, Model
from cutbench.forms.base import Step
from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.mixed import MixedVolumetric
from cutbench.forms.space import Faces
from cutbench.run.build import build
from cutbench.run.runner import run_case
from cutbench.solver.newton import NoConvergence


def check_part(form, u, state, step, p=P) -> None:
    """A part has the columns of the whole: residuals, matrices, new states."""
    columns = np.flatnonzero(np.random.default_rng(0).random(form.dofs.shape[1]) < 0.6)
    part, some = form.part(columns), form.pick(state, columns)
    np.testing.assert_array_equal(part.dofs, form.dofs[:, columns])
    whole, found = form.evaluate(u, p, state, step), part.evaluate(u, p, some, step)
    size = np.abs(whole.matrix).max()
    np.testing.assert_allclose(
        found.vector, whole.vector[:, columns], atol=1e-12 * np.abs(whole.vector).max()
    )
    np.testing.assert_allclose(found.matrix, whole.matrix[:, :, columns], atol=1e-12 * size)
    expected = form.pick(whole.state, columns)
    assert found.state.keys() == expected.keys()
    for name, value in found.state.items():
        np.testing.assert_allclose(value, expected[name], rtol=1e-9, atol=1e-12)


@spaces
def test_parts_of_bulk_and_damping(dim, order):
    space = space_of(dim, order)
    step, u = step_between(space), displacement(space)
    names = ("neo_hookean", "volumetric", "maxwell", "mullins")
    typical = {name: q.typical * q.factor for name, q in Model(names).parameters().items()}
    p = SimpleNamespace(**(typical | vars(P)))
    for form in (bulk_form(space, names=names), DampingForm(space.volume(2 * order - 1), 0.03)):
        check_part(form, u, form.evaluate(step.u_old, p, form.start(p), step).state, step, p)


@spaces
def test_parts_of_the_cut_and_the_blade(dim, order):
    space = space_of(dim, order)
    step, u = step_between(space), displacement(space)
    cut = CutForm(Model(DEFAULT).laws("cut"), space.faces("cut", 4), HEIGHT)
    check_part(cut, u, cut.evaluate(step.u_old, P, cut.start(P), step).state, step)
    form = blade(space, normal="material")
    u, state, step = blade_case(space, form)
    check_part(form, u, state, step)


def test_a_part_of_a_mixed_form():
    space = space_of(2, 2)
    law = next(law for law in Model(DEFAULT).laws("bulk") if law.role == "volumetric")
    form = MixedVolumetric(law, space, 4, HEIGHT)
    u = np.zeros(form.ndof)
    u[: space.ndof] = displacement(space)
    u[space.ndof :] = 0.01 * np.random.default_rng(1).standard_normal(form.ndof - space.ndof)
    check_part(form, u, {}, None)


def test_some_faces_keep_their_names():
    space = space_of(2, 2)
    both = Faces.joined([space.faces("top", 4), space.faces("cut", 4)])
    first = both.parts["top"].stop
    some = both.some(np.array([0, first, first + 2]))
    assert some.parts == {"top": slice(0, 1), "cut": slice(1, 3)}
    np.testing.assert_array_equal(some.nodes[:, 1:], space.faces("cut", 4).nodes[:, [0, 2]])


def test_the_window_is_in_balance_and_the_rest_stays():
    built = build(tuned(BRIEF, "window", enough=1e-3))
    before, last = islice((step for step in built.march if step.travel > 0.15), 2)
    problem, step = built.problem, last.step
    states = last.solves[0][0]
    straight = before.u + (before.u - before.step.u_old) * (last.dt / before.dt)
    found = built.march.window.solved(straight, before.u, states, step, built.march.newton)
    moved = np.abs(found - straight).reshape(-1, 2).max(axis=1) > 0
    X = built.space.X
    assert moved.any()
    assert np.ptp(X[1, moved]) < 8 * BRIEF.p.thickness and np.abs(X[0, moved]).max() < 3 * BRIEF.p.thickness

    def residual(u):
        out = problem.evaluate(u, states, step).residual
        out[problem.fixed] = 0.0
        return np.abs(out.reshape(-1, 2)[moved]).max()

    assert residual(found) < 0.02 * residual(straight)


@pytest.fixture(scope="module")
def at_rest():
    """A block that nothing has touched, and its state, cut for 3 mm."""
    built = build(BRIEF)
    states = built.problem.start()
    cut = built.form("cohesion").faces
    states["cohesion"]["damage"] = (cut.X[1].ravel() > built.geometry.height - 3).astype(float)
    return built, states


def test_a_state_that_moves_with_the_front_is_foreseen(at_rest):
    """A field that goes down in a step goes on, exactly where elements hold it; a straight line does not."""
    built, states = at_rest
    window_, space, a = built.march.window, built.space, 0.05
    part, damage = window_.around(states), states["cohesion"]["damage"]

    def field(fall):
        x, y = space.X[0], space.X[1] + fall - 18
        return np.stack([0.01 * x + 0.03 * y**2, 0.02 * x * y - 0.01 * y**2], axis=1).ravel()

    before, last, then = field(0), field(a), field(2 * a)
    straight = 2 * last - before
    found = window_.moved(straight, last, damage, part, np.array([a]))
    moving = np.isin(np.arange(then.size), part.problem.free)
    inner = moving & np.repeat(space.X[1] < built.geometry.height - 2 * a, 2)
    np.testing.assert_allclose(found[inner], then[inner], atol=1e-6)
    np.testing.assert_array_equal(found[~moving], straight[~moving])
    assert np.abs(straight - then)[inner].max() > 1e-4


def test_nodes_beside_the_blade_keep_their_distance(at_rest):
    """A prediction that lets the flanks go keeps them, but for the part around the front."""
    built, states = at_rest
    problem, space, form = built.problem, built.space, built.form("blade")
    march = built.march
    rng = np.random.default_rng(2)
    part = march.window.around(states)
    touching = states | {"blade": states["blade"] | {"active": np.ones_like(states["blade"]["active"])}}
    last = np.zeros(problem.ndof)
    # The blade stands 3 mm deep in material that lies along it to a micrometre.
    centre = march.centre(3.0)
    step = Step(1.0, last, centre - [0, 0.05, 0], centre)
    before = Step(1.0, last, centre, centre)
    for _ in range(30):
        gap, normal, nodes = form.gap_of_nodes(space.X, last, touching["blade"], problem.p, before)
        pressed = gap < 0.001
        for i in range(2):
            last[nodes[pressed] * 2 + i] -= ((gap - 0.001) * normal[i])[pressed]
    guess = last + 1e-3 * rng.normal(size=last.size)
    found = march.window.beside(guess, last, touching, step, part)
    was, now, loose = (
        form.gap_of_nodes(space.X, u, touching["blade"], problem.p, at)[0]
        for u, at in ((last, before), (found, step), (guess, step))
    )
    nodes = form.gap_of_nodes(space.X, last, touching["blade"], problem.p, before)[2]
    held = problem.is_free[2 * nodes] & problem.is_free[2 * nodes + 1]
    held &= ~part.problem.is_free[2 * nodes] & (was < 0.01)
    assert held.sum() > 3
    assert np.abs(now - was)[held].max() < 0.1 * np.abs(loose - was)[held].max()
    np.testing.assert_array_equal(found[part.problem.free], guess[part.problem.free])


def test_a_window_that_is_nearly_solved_will_do():
    # Two iterations do not solve it, without steps of old factorizations.
    few = tuned(tuned(BRIEF, "newton", close=0.0), "window", iterations=2, enough=1e-12)
    built, usable = build(few), few.numerics.tuning.window.usable
    strict = build(tuned(few, "window", usable=0.0)).march.window
    before, last = islice((step for step in built.march if step.travel > 0.15), 2)
    march, problem, step = built.march, built.problem, last.step
    states = last.solves[0][0]
    straight = before.u + (before.u - before.step.u_old) * (last.dt / before.dt)

    def found(window):
        return window.solved(straight, before.u, states, step, march.newton)

    def relative_residual(u):
        e = problem.evaluate(u, states, step)
        return np.linalg.norm(e.residual[problem.free]) / e.scale

    with pytest.raises(NoConvergence, match="2 iterations") as error:
        found(strict)
    assert 0 < error.value.nearest[0] < usable
    assert relative_residual(found(march.window)) < 0.2 * relative_residual(straight)


BOND = {"with_": "imperfect_bond", "bond_compliance": "0.3 mm/kPa"}
SHORT = {**BOND, "step": "0.04 mm", "depth": "0.5 mm"}


# Steps short enough for their line to be the curve.
MIXED = {"element": "P2P1", "mu": 0.0, "step": "0.02 mm", "depth": "0.7 mm"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes", [{"step": "0.04 mm"}, *(pytest.param(c, marks=pytest.mark.slow) for c in (MIXED, SHORT))]
)
def test_it_finds_the_same_curve_with_fewer_factorizations_of_the_whole(changes):
    case = BRIEF.set(**changes)
    front = run_case(case)
    line = run_case(case.set(predictor="line"))
    assert front.outcome.done and line.outcome.done
    assert front.counts["factorization_calls"] < 0.7 * line.counts["factorization_calls"]
    # As long as nothing snaps there is one curve; behind that the steps decide when.
    smooth = np.linspace(0.05, 0.35, 30)
    np.testing.assert_allclose(force_at(front, smooth), force_at(line, smooth), rtol=2e-3)
    assert front.measures["onset_mm"] == pytest.approx(line.measures["onset_mm"], rel=0.03, nan_ok=True)
    assert abs(front.curve["closure"][-1]) < 0.01


def test_the_staggered_scheme_and_a_block_without_a_cut_do_without():
    assert build(BRIEF).march.window is not None
    assert build(BRIEF.set(scheme="staggered")).march.window is None
    assert build(PRESSED.set(predictor="line")).march.window is None
