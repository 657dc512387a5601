"""The blade's form on small meshes: tangents, forces, what is off, work."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from form_checks import (
    FRICTIONLESS,
    HEIGHT,
    P,
    assembled,
    blade,
    blade_case,
    bulk_form,
    check_tangent,
    displacement,
    matrix,
    space_of,
    spaces,
    step_between,
    total,
)

from cutbench.case.model import DEFAULT, Model
from cutbench.forms.base import Step, blend, gather
from cutbench.forms.blade import ContactNumerics
from cutbench.forms.cut import CutForm


@spaces
@pytest.mark.parametrize("normal", ["tool", "material"])
@pytest.mark.parametrize("gap", ["distance", "ellipse"])
@pytest.mark.parametrize("names", [FRICTIONLESS, DEFAULT], ids=["frictionless", "friction"])
def test_blade_tangent(dim, order, normal, gap, names):
    space = space_of(dim, order)
    form = blade(space, normal=normal, gap=gap, names=names)
    u, state, step = blade_case(space, form)
    new = form.evaluate(u, P, state, step).state
    pressed = new["pressure"] > 0
    assert pressed.any() and not pressed.all()
    assert state["multiplier"].max() > 0
    check_tangent(space, form, u, state, step, rtol=1e-9)


def evaluated(dim, order):
    """A blade's form, the state at the start of a step and the one that it finds."""
    space = space_of(dim, order)
    form = blade(space)
    u, state, step = blade_case(space, form)
    return form, state, form.evaluate(u, P, state, step).state


@spaces
def test_what_is_carried_is_one_pressure_a_face_and_its_force(dim, order):
    form, _, new = evaluated(dim, order)
    carried = form.augment(new)["multiplier"]
    assert np.ptp(new["pressure"], axis=0).max() > 0 == np.ptp(carried, axis=0).max()
    w = form.faces.w
    np.testing.assert_allclose((w * carried).sum(axis=0), (w * new["pressure"]).sum(axis=0), atol=1e-15)


@pytest.mark.parametrize("carried", [True, False])
def test_shear_that_grows_evenly_is_foreseen_where_it_is_carried(carried):
    numerics = ContactNumerics(stiffness=5 * P.G, tangential=25 * P.G, carried=carried)
    form = blade(space_of(2, 2)).with_numerics(numerics)
    rests, goes = (Step(0.2, np.zeros(0), np.zeros(3), np.zeros(3), ratio=r, rests=r == 0) for r in (0, 0.5))
    state = form.start(P)
    shear = np.random.default_rng(1).normal(size=state["shear"].shape)
    state = form.begun({**state, "shear": shear}, goes)
    # What a blade at rest does between two steps is no part of how the shear grows.
    state = form.begun({**state, "shear": 2 * shear}, rests)
    begun = form.begun({**state, "shear": 3 * shear}, goes)
    np.testing.assert_allclose(begun["foreseen_shear"], (4 if carried else 3) * shear)
    np.testing.assert_array_equal(begun["shear"], 3 * shear)


@spaces
def test_some_points_stick_and_some_slip(dim, order):
    """The tangents above are tested on both branches of the return mapping."""
    _, state, new = evaluated(dim, order)
    strength = P.mu * state["pressure"] + P.tau_W * state["touched"]  # of the last step: see the form
    shear = np.sqrt((new["shear"] ** 2).sum(axis=0))
    assert np.all(shear <= strength * (1 + 1e-9) + 1e-15), "the slip criterion holds everywhere"
    carries = strength > 0
    assert (shear[carries] < 0.99 * strength[carries]).any()
    assert (shear[carries] > 0.999 * strength[carries]).any()


@spaces
def test_top_face_tangent(dim, order):
    space = space_of(dim, order)
    form = blade(space, face="top")
    u = displacement(space, opening=0.0)
    c = np.array([0.0, HEIGHT + 0.9 - P.tip, 0.0])
    step = Step(0.2, displacement(space, 1, opening=0.0), c, c + np.array([0.0, 0.1, 0.0]))
    state = form.touch(form.start(P))
    assert form.evaluate(u, P, state, step).state["pressure"].max() > 0
    check_tangent(space, form, u, state, step, rtol=1e-9)


@spaces
@pytest.mark.parametrize("normal", ["tool", "material"])
def test_the_force_reported_is_the_sum_of_the_contact_forces(dim, order, normal):
    space = space_of(dim, order)
    form = blade(space, normal=normal)
    u, state, step = blade_case(space, form)
    local = form.evaluate(u, P, state, step)
    nodal_sum = total(assembled(space, form), form, local).reshape(-1, dim).sum(axis=0)
    force = form.force(local.state)
    assert np.abs(force).max() > 0
    np.testing.assert_allclose(nodal_sum, force, rtol=1e-12, atol=1e-15)


@spaces
def test_a_blade_that_comes_down_is_pushed_up(dim, order):
    space = space_of(dim, order)
    form = blade(space, face="top")
    c = np.array([0.0, HEIGHT + 0.95 - P.tip, 0.0])
    local = form.evaluate(np.zeros(space.ndof), P, form.start(P), Step(1.0, np.zeros(space.ndof), c, c))
    assert form.force(local.state)[1] > 0
    assert local.state["pressure"].max() > 0
    far = c + np.array([0.0, 5.0, 0.0])
    away = form.evaluate(np.zeros(space.ndof), P, form.start(P), Step(1.0, np.zeros(space.ndof), far, far))
    assert not away.vector.any() and away.matrix is None


@spaces
@pytest.mark.parametrize("normal", ["tool", "material"])
def test_a_form_that_calls_itself_symmetric_is(dim, order, normal):
    """The solver then sees the upper triangle only: an unsymmetric tangent would be cut in silence."""
    space = space_of(dim, order)
    for names in (FRICTIONLESS, DEFAULT):
        form = blade(space, normal=normal, names=names)
        K = matrix(assembled(space, form), form, form.evaluate(*case_of(space, form)))
        skew = np.abs((K - K.T).toarray()).max()
        if form.symmetric:
            assert skew < 1e-10 * np.abs(K.data).max(), (normal, names)
    for form in (bulk_form(space), CutForm(Model(DEFAULT).laws("cut"), space.faces("cut", 4), HEIGHT)):
        u, step = 2 * displacement(space, size=0.01), step_between(space)
        K = matrix(assembled(space, form), form, form.evaluate(u, P, form.start(P), step))
        if form.symmetric:
            assert np.abs((K - K.T).toarray()).max() < 1e-10 * np.abs(K.data).max(), form.name


def case_of(space, form):
    u, state, step = blade_case(space, form)
    return u, P, state, step


@spaces
@pytest.mark.parametrize("absent, value", [("coulomb", {"mu": 0.0}), ("adhesion", {"tau_W": 0.0})])
def test_a_blade_law_that_is_off_is_absent_to_the_bit(dim, order, absent, value):
    space = space_of(dim, order)
    off = SimpleNamespace(**(vars(P) | value))
    got = []
    for model in (Model(DEFAULT), Model(DEFAULT).without(absent)):
        form = blade(space, names=model.mechanisms)
        step = step_between(space)
        past = form.evaluate(displacement(space, 1, 0.03), off, form.start(off), step)
        got.append(form.evaluate(displacement(space), off, form.touch(past.state), step))
    assert got[0].vector.any()
    assert np.array_equal(got[0].vector, got[1].vector)
    assert np.array_equal(got[0].matrix, got[1].matrix)


@spaces
def test_all_friction_off_is_frictionless_to_the_bit(dim, order):
    space = space_of(dim, order)
    off = SimpleNamespace(**(vars(P) | {"mu": 0.0, "tau_W": 0.0}))
    u, step, got = displacement(space), step_between(space), []
    for names in (DEFAULT, FRICTIONLESS):
        form = blade(space, names=names)
        got.append(form.evaluate(u, off, form.start(off), step))
    assert got[0].vector.any()
    assert np.array_equal(got[0].vector, got[1].vector)
    assert np.array_equal(got[0].matrix, got[1].matrix)


def test_touched_is_kept_on_the_cut_and_not_on_the_top():
    space = space_of(2, 2)
    for face, kept in (("cut", True), ("top", False)):
        form = blade(space, face=face)
        state = form.start(P)
        shape = state["pressure"].shape
        once = form.touch({**state, "pressure": np.ones(shape)})
        assert once["touched"].all()
        later = form.touch({**once, "pressure": np.zeros(shape)})
        assert bool(later["touched"].all()) is kept


def test_adhesion_ends_where_the_blade_is_away():
    space = space_of(2, 2)
    numerics = ContactNumerics(stiffness=5 * P.G, tangential=25 * P.G)
    step = Step(0.1, np.zeros(space.ndof), *2 * (np.array([0.0, -1.0, 0.0]),))  # its flank at every point
    for release, gap, kept in ((0.01, 0.005, True), (0.01, 0.02, False), (0.0, 0.2, True)):
        form = blade(space).with_numerics(replace(numerics, release=release))
        u = np.zeros(space.ndof)
        u[::2] = P.thickness / 2 + gap
        shape = form.start(P)["pressure"].shape
        touched = {**form.start(P), "touched": np.ones(shape)}
        ended = form.evaluate(u, P, touched, step).state
        assert (form.touch(ended)["touched"] == float(kept)).all(), (release, gap)


@spaces
@pytest.mark.parametrize("normal", ["tool", "material"])
def test_blade_work_is_what_the_blade_gives_less_what_the_material_takes(dim, order, normal):
    space = space_of(dim, order)
    form = blade(space, normal=normal)
    u, state, step = blade_case(space, form)
    old = form.evaluate(step.u_old, P, state, replace(step, centre=step.centre_old)).state
    old_vector = form.evaluate(step.u_old, P, state, replace(step, centre=step.centre_old)).vector
    new = form.evaluate(u, P, old, step)
    pattern = assembled(space, form)
    mean = pattern.vector(form.name, (old_vector + new.vector) / 2)
    force = (form.force(old) + form.force(new.state)) / 2
    work = form.work(u, P, old, new.state, step)
    taken = mean @ (u - step.u_old) - force @ (step.centre - step.centre_old)[:dim]
    assert set(work) == {law.name for law in Model(DEFAULT).laws("blade")}
    if normal == "tool":
        # It is pressure times the gap's change: the same, but for how far things turn.
        N, w = form.faces.N, form.faces.w
        slip = blend(N, gather(u - step.u_old, form.dofs, dim))
        slip = slip - (step.centre - step.centre_old)[:dim, None, None]
        pushed = -((old["normal_traction"] + new.state["normal_traction"]) / 2 * slip * w).sum()
        assert work["contact"] == pytest.approx(pushed, rel=0.05)
        work["contact"] = pushed
    assert sum(work.values()) == pytest.approx(taken, rel=1e-10)


@pytest.mark.parametrize("dim", [2, 3])
def test_what_slides_round_the_tip_takes_nothing(dim):
    space = space_of(dim, 2)
    form = blade(space, face="top")
    p = SimpleNamespace(**vars(P) | {"tip": P.thickness / 2})  # round: a turn about its centre keeps gaps
    centre = np.array([0.0, HEIGHT + 1.0, 0.0])
    apex = centre - [0.0, P.thickness / 2, 0.0]
    c, s = np.cos(0.3), np.sin(0.3)
    arm = space.X[:2] - centre[:2, None]
    u = np.zeros_like(space.X)
    u[:2] = np.array([[c, -s], [s, c]]) @ arm - arm
    step = Step(0.1, np.zeros(space.ndof), apex, apex)
    state = form.start(p)
    old, new = ({**state, "pressure": state["pressure"] + much} for much in (1.0, 3.0))
    sunk = np.zeros_like(space.X)
    sunk[1] = 0.01
    assert form.work(sunk.T.ravel(), p, old, new, step)["contact"] > 1e-3
    assert form.work(u.T.ravel(), p, old, new, step)["contact"] == pytest.approx(0, abs=1e-12)
