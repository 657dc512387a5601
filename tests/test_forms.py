"""Weak forms on small meshes in two and three dimensions: tangents, patch tests, forces, work."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from form_checks import (
    GRADIENT,
    HEIGHT,
    LENGTH,
    SIZE,
    P,
    affine,
    assembled,
    bulk_form,
    check_tangent,
    displacement,
    matrix,
    mesh,
    space_of,
    spaces,
    step_between,
    total,
)

from cutbench.case.model import DEFAULT, PAPER, Model
from cutbench.forms.base import Step
from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.space import Space


# -- bulk ----------------------------------------------------------------------------------------
@spaces
def test_bulk_tangent(dim, order):
    space = space_of(dim, order)
    form = bulk_form(space)
    u = 2 * displacement(space, size=0.01)
    assert form.smallest_volume_ratio(u) > 0.1
    check_tangent(space, form, u, form.start(P), step_between(space))


@spaces
def test_patch(dim, order):
    """An affine displacement: one stress everywhere, and interior nodes are in equilibrium."""
    space = space_of(dim, order)
    form = bulk_form(space)
    u = affine(space, GRADIENT)
    F = form.deformation(u)
    expected = np.eye(3)
    expected[:dim, :dim] += GRADIENT[:dim, :dim]
    np.testing.assert_allclose(F, np.broadcast_to(expected[:, :, None], F.shape), atol=1e-13)
    pattern = assembled(space, form)
    R = total(pattern, form, form.evaluate(u, P, {}, None)).reshape(-1, dim)
    edge = np.zeros(space.X.shape[1], bool)
    for i, end in enumerate([SIZE, HEIGHT, LENGTH][:dim]):
        edge |= (space.X[i] < 1e-9) | (space.X[i] > end - 1e-9)
    if not edge.all():
        np.testing.assert_allclose(R[~edge], 0, atol=1e-13 * np.abs(R).max())
    np.testing.assert_allclose(R.sum(axis=0), 0, atol=1e-13 * np.abs(R).max())
    # The virtual work of the nodal forces on the field itself is ∫ P : ∇u.
    stress = sum(law.stress(expected[:, :, None], P, {}, form.points(None))[0][:, :, 0] for law in form.laws)
    volume = SIZE * HEIGHT * (LENGTH if dim == 3 else 1)
    work = volume * (stress[:dim, :dim] * GRADIENT[:dim, :dim]).sum()
    assert R.ravel() @ u == pytest.approx(work, rel=1e-12)


@spaces
def test_rigid_motion_costs_nothing(dim, order):
    space = space_of(dim, order)
    form = bulk_form(space)
    c, s = np.cos(0.7), np.sin(0.7)
    Q = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    if dim == 3:
        Q = Q @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    u = affine(space, Q - np.eye(3)) + np.tile([0.3, -0.2, 0.5][:dim], space.X.shape[1])
    volume = form.volume.w.sum()
    for name, value in form.energies(u, P, {}).items():
        assert abs(value) < 1e-13 * P.G * volume, name
    R = total(assembled(space, form), form, form.evaluate(u, P, {}, None))
    assert np.abs(R).max() < 1e-12 * P.G * volume
    assert form.smallest_volume_ratio(u) == pytest.approx(1, abs=1e-13)


@pytest.mark.parametrize("order", [1, 2])
def test_plane_strain_is_a_layer_held_between_two_planes(order):
    """The same field of x and y, in the section and in a slab with u_z = 0: energy and forces agree."""

    def field(X):
        x, y = X[0], X[1]
        u = np.zeros_like(X)
        u[0], u[1] = 0.1 * x + 0.05 * y, -0.08 * y + 0.03 * x
        if order == 2:
            u[0] += 0.04 * x * y - 0.02 * y * y
            u[1] += 0.03 * x * x
        return u.T.ravel()

    def virtual(X):
        v = np.zeros_like(X)
        v[0], v[1] = 0.3 * X[0] - 0.2 * X[1], X[1] + 0.1 * X[0]
        if order == 2:
            v[0] += X[1] ** 2
        return v.T.ravel()

    out = []
    for dim in (2, 3):
        space = space_of(dim, order)
        form = bulk_form(space, degree=8)
        u, v = field(space.X), virtual(space.X)
        local = form.evaluate(u, P, {}, None)
        pattern = assembled(space, form)
        per = LENGTH if dim == 3 else 1.0
        energies = form.energies(u, P, {})
        K = matrix(pattern, form, local)
        out.append(np.array([*energies.values(), v @ total(pattern, form, local), v @ (K @ v)]) / per)
    assert np.abs(out[0]).min() > 0
    np.testing.assert_allclose(out[1], out[0], rtol=1e-6)


# -- cohesion ------------------------------------------------------------------------------------
def cut_state(form: CutForm, u: np.ndarray, step: Step):
    return form.evaluate(u, P, form.start(P), step).state


@spaces
@pytest.mark.parametrize("names", [PAPER, DEFAULT], ids=["constant viscosity", "degraded viscosity"])
def test_cut_tangent(dim, order, names):
    space = space_of(dim, order)
    form = CutForm(Model(names).laws("cut"), space.faces("cut", 4), HEIGHT)
    step = step_between(space)
    # History: a jump elsewhere, so that some points load and some unload.
    state = cut_state(form, 0.8 * displacement(space, 7, 0.05), step)
    u = displacement(space)
    new = form.evaluate(u, P, state, step).state
    grew = new["delta_max"] > state["delta_max"]
    assert grew.any() and not grew.all()
    assert (form.jump(u)[0] < 0).any(), "some points close"
    check_tangent(space, form, u, state, step)
    check_tangent(space, form, u, state, replace(step, ratio=0.8))


def test_a_rate_s_traction_is_of_second_order():
    """Viscous faces that open as t²: exact at the end of steps of unequal length, but for the first, and with
    a rest between them."""
    space = space_of(2, 2)
    laws = [law for law in Model(PAPER).laws("cut") if law.name == "viscous"]
    form = CutForm(laws, space.faces("cut", 4), HEIGHT)
    opening = np.zeros_like(space.X)
    opening[0], none = 1.0, np.zeros(3)
    u = lambda t: 0.01 * t**2 * opening.T.ravel()  # noqa: E731
    times, state, last = (1.0, 1.3, 1.5, 1.5, 1.9), form.start(P), 0.0
    for begin, end in pairwise(times):
        rests, dt = begin == end, end - begin or 1e-3
        step = Step(dt, u(begin), none, none, ratio=dt / last if last and not rests else 0.0, rests=rests)
        state = form.evaluate(u(end), P, state, step).state
        rate = 0.0 if rests else 2 * 0.02 * end if last else 2 * 0.01 * (begin + end)
        expected = P.G_c / P.delta_c**2 * P.eta_reg * rate
        np.testing.assert_allclose(state["tractions"][0, 0], expected, rtol=1e-12)
        last = last if rests else dt


def test_a_rate_term_that_fades_is_of_second_order():
    """Faces that open evenly faster, to δ_c and beyond: half the step, a quarter of the error."""
    space = space_of(2, 2)
    form = CutForm(Model(DEFAULT).laws("cut"), space.faces("cut", 4), HEIGHT)
    viscous = [law.role for law in form.laws].index("viscous")
    opening = np.zeros_like(space.X)
    opening[0], none = 1.0, np.zeros(3)
    width = lambda t: P.delta_c * (t + t**2)  # noqa: E731
    u = lambda t: width(t) / 2 * opening.T.ravel()  # noqa: E731
    errors = []
    for count in (20, 40):
        dt, state, worst = 1.0 / count, form.start(P), 0.0
        for i in range(count):
            step = Step(dt, u(i * dt), none, none, ratio=1.0 if i else 0.0)
            state = form.evaluate(u((i + 1) * dt), P, state, step).state
            t = (i + 1) * dt
            exact = P.G_c / P.delta_c * P.eta_reg * np.exp(-width(t) / P.delta_c) * (1 + 2 * t)
            found = state["tractions"][viscous, 0]
            worst = max(worst, np.abs(found / exact - 1).max() if i > 1 else 0.0)
        errors.append(worst)
    assert errors[1] < errors[0] / 3.5 < 0.01


def two_sided(dim: int, order: int):
    """The piece and its mirror image, not joined: space, the two sides of the cut, and the mirror map."""
    m = mesh(dim)
    n = m.p.shape[1]
    flip = np.array([[-1.0], *[[1.0]] * (dim - 1)])
    both = type(m)(np.hstack([m.p, flip * m.p]), np.hstack([m.t, m.t + n]))
    on_cut = np.flatnonzero(np.abs(both.p[0][both.facets]).max(axis=0) < 1e-9)
    plus = on_cut[both.facets[0, on_cut] < n]
    minus = on_cut[both.facets[0, on_cut] >= n]
    both = both.with_boundaries({"plus": plus, "minus": minus})
    space = Space.build(both, order)
    faces = space.faces("plus", 4), space.faces("minus", 4)
    np.testing.assert_allclose(faces[0].X, faces[1].X, atol=1e-14)
    np.testing.assert_allclose(space.X[:, faces[0].nodes], space.X[:, faces[1].nodes], atol=1e-14)
    return space, *faces


@spaces
def test_cut_tangent_between_two_sides(dim, order):
    space, plus, minus = two_sided(dim, order)
    form = CutForm(Model(DEFAULT).laws("cut"), plus, HEIGHT, minus)
    rng = np.random.default_rng(3)
    step = Step(0.2, rng.uniform(-0.03, 0.03, space.ndof), np.zeros(3), np.zeros(3))
    state = cut_state(form, rng.uniform(-0.05, 0.05, space.ndof), step)
    u = rng.uniform(-0.05, 0.05, space.ndof)
    assert np.abs(form.jump(u)[1]).max() > 0
    assert (np.abs(form.jump(u)[2]).max() > 0) == (dim == 3)
    check_tangent(space, form, u, state, step)


@spaces
def test_half_a_block_with_twice_the_opening_is_the_whole(dim, order):
    space, plus, minus = two_sided(dim, order)
    laws = Model(DEFAULT).laws("cut")
    whole, half = CutForm(laws, plus, HEIGHT, minus), CutForm(laws, plus, HEIGHT)
    u = displacement(space).reshape(-1, dim)
    opening = np.zeros_like(u)
    for name, sign in ((plus, 1), (minus, -1)):
        nodes = np.unique(name.nodes)
        smooth = 0.05 * space.X[1, nodes] / HEIGHT + 0.01
        opening[nodes, 0] = sign * smooth
        opening[nodes, 1] = 0.02  # moving along together opens nothing
    u = opening.ravel()
    # A first step to half of it, so that the second begins where its state has been.
    first, step = (Step(0.2, by * u, np.zeros(3), np.zeros(3)) for by in (0.0, 0.5))
    begun = {form: form.evaluate(0.5 * u, P, form.start(P), first).state for form in (whole, half)}
    np.testing.assert_allclose(half.jump(u)[0], whole.jump(u)[0], atol=1e-15)
    np.testing.assert_allclose(half.jump(u)[0], 0.1 * plus.X[1].ravel() / HEIGHT + 0.02, atol=1e-14)
    np.testing.assert_allclose(whole.jump(u)[1:], 0, atol=1e-15)
    both = whole.evaluate(u, P, begun[whole], step)
    one = half.evaluate(u, P, begun[half], step)
    f = total(assembled(space, whole), whole, both).reshape(-1, dim)
    g = total(assembled(space, half), half, one).reshape(-1, dim)
    nodes = np.unique(plus.nodes)
    assert np.abs(g[nodes, 0]).max() > 0
    np.testing.assert_allclose(g[nodes, 0], f[nodes, 0], rtol=1e-12)
    np.testing.assert_allclose(f.sum(axis=0), 0, atol=1e-12 * np.abs(f).max())
    W, w = (x.work(u, P, begun[x], e.state, step) for x, e in ((whole, both), (half, one)))
    for name in W:
        assert w[name] == pytest.approx(W[name] / 2, rel=1e-12) and w[name] > 0


@spaces
def test_a_cut_law_that_is_off_is_absent_to_the_bit(dim, order):
    space = space_of(dim, order)
    off = SimpleNamespace(**(vars(P) | {"eta_reg": 0.0}))
    faces, step, u = space.faces("cut", 4), step_between(space), displacement(space)
    got = []
    for model in (Model(DEFAULT), Model(DEFAULT).without("viscous_degraded")):
        form = CutForm(model.laws("cut"), faces, HEIGHT)
        got.append(form.evaluate(u, off, form.start(off), step))
    assert np.array_equal(got[0].vector, got[1].vector)
    assert np.array_equal(got[0].matrix, got[1].matrix)


# -- damping -------------------------------------------------------------------------------------
@spaces
def test_damping_is_linear_and_dissipates(dim, order):
    space = space_of(dim, order)
    form = DampingForm(space.volume(2 * order - 1), 0.03)
    step, u = step_between(space), displacement(space)
    check_tangent(space, form, u, {}, step)
    force = total(assembled(space, form), form, form.evaluate(u, P, {}, step))
    new = form.evaluate(u, P, {}, step).state
    # From rest the mean of both ends is half of the last force; in steady motion it is all of it.
    assert form.work(u, P, form.start(P), new, step)["snap"] == pytest.approx(force @ (u - step.u_old) / 2)
    work = form.work(u, P, new, new, step)["snap"]
    assert work == pytest.approx(force @ (u - step.u_old), rel=1e-12) and work > 0
    shifted = form.evaluate(step.u_old + 0.3, P, {}, step)
    assert np.abs(shifted.vector).max() < 1e-12, "a translation is not resisted"
    # η ∫ |∇u̇|² for a homogeneous rate.
    v = affine(space, GRADIENT)
    steady = form.evaluate(step.u_old + v, P, {}, step).state
    rate = form.work(step.u_old + v, P, steady, steady, step)["snap"]
    volume = SIZE * HEIGHT * (LENGTH if dim == 3 else 1)
    assert rate == pytest.approx(0.03 * volume * (GRADIENT[:dim, :dim] ** 2).sum() / step.dt, rel=1e-12)


# -- the ledger ----------------------------------------------------------------------------------
@spaces
def test_bulk_and_cut_work_is_that_of_the_forces(dim, order):
    """Sum of the mechanisms' work = mean force times displacement, to third order in the step."""
    space = space_of(dim, order)
    start = displacement(space, size=0.005) + np.tile([0.05, 0, 0][:dim], space.X.shape[1])
    move = displacement(space, 4, 0.02) - displacement(space, 5, 0.02)
    for form in (bulk_form(space), CutForm(Model(DEFAULT).laws("cut"), space.faces("cut", 4), HEIGHT)):
        errors = []
        for size in (0.04, 0.02):
            u = start + size * move
            # A state to start from: from there each point loads or unloads, and none closes.
            before = Step(0.2, start - size * move, np.zeros(3), np.zeros(3))
            old = form.evaluate(start, P, form.start(P), before)
            step = Step(0.2, start, np.zeros(3), np.zeros(3))
            new = form.evaluate(u, P, old.state, step)
            pattern = assembled(space, form)
            mean = (total(pattern, form, old) + total(pattern, form, new)) / 2
            work = sum(form.work(u, P, old.state, new.state, step).values())
            errors.append(abs(work - mean @ (u - start)) / abs(mean @ (u - start)))
        assert errors[0] < 1e-2
        assert errors[1] < 0.4 * errors[0] or errors[1] < 1e-9
