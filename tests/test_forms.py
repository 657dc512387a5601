"""Weak forms on small meshes in two and three dimensions: tangents, patch tests, forces, work, assembly."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import skfem

from cutbench.forms.assembly import Pattern
from cutbench.forms.base import Step, add_states
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.space import Space
from cutbench.model import DEFAULT, PAPER, Model
from cutbench.models2d.section import named

SIZE, HEIGHT, LENGTH = 1.0, 2.0, 0.7
EPS = 1e-30
spaces = pytest.mark.parametrize("dim, order", [(2, 1), (2, 2), (3, 1), (3, 2)])
#: Internal units, chosen so that a blade pressed into a 1 mm × 2 mm piece sticks here and slips there.
P = SimpleNamespace(
    G=0.025, nu=0.49, G_c=0.01, delta_c=0.07, beta=0.8, eta_reg=0.3, speed=0.5, thickness=0.7, tip=1.05,
    mu=0.3, tau_W=0.004, tilt=0.0, overhang=0.0,
)  # fmt: skip


def mesh(dim: int) -> skfem.Mesh:
    """A piece 0 ≤ x ≤ 1, 0 ≤ y ≤ 2 (0 ≤ z ≤ 0.7), its cut plane at x = 0, of unequal elements."""
    x, y = np.array([0.0, 0.3, 1.0]), np.linspace(0, HEIGHT, 10 if dim == 2 else 4)
    if dim == 2:
        return named(skfem.MeshTri.init_tensor(x, y), SIZE, HEIGHT)
    return skfem.MeshTet.init_tensor(x, y, np.array([0.0, 0.4, LENGTH])).with_boundaries(
        {
            "cut": lambda x: np.abs(x[0]) < 1e-9,
            "top": lambda x: np.abs(x[1] - HEIGHT) < 1e-9,
            "bottom": lambda x: np.abs(x[1]) < 1e-9,
        }
    )


def space_of(dim: int, order: int) -> Space:
    return Space.build(mesh(dim), order)


def displacement(space: Space, seed: int = 0, size: float = 0.02, opening: float = 0.3) -> np.ndarray:
    """Opened near the top, as by the blade, and shaken, so that nothing is by accident zero."""
    X = space.X
    u = size * np.random.default_rng(seed).uniform(-1, 1, X.shape)
    u[0] += opening * np.clip((X[1] - 1.0) / 1.0, 0, None) ** 0.5 * np.exp(-X[0])
    return u.T.ravel()


def step_between(space: Space) -> Step:
    c = np.array([0.0, 2.3, 0.0])
    return Step(0.2, displacement(space, 1), c, c + np.array([0.0, 0.1, 0.0]))


def assembled(space: Space, form, symmetric: bool = False, fixed=()) -> Pattern:
    return Pattern(space.ndof, np.asarray(fixed, int), {form.name: form.dofs}, symmetric)


def total(pattern: Pattern, form, local) -> np.ndarray:
    return pattern.vector(form.name, local.vector)


def matrix(pattern: Pattern, form, local):
    data = np.zeros(pattern.indices.size)
    pattern.add(data, form.name, local.matrix)
    return pattern.csr(data)


def check_tangent(space, form, u, state, step, p=P, rtol: float = 1e-10) -> None:
    """K v against a complex step and against central differences of the residual, for several v."""
    pattern = assembled(space, form)
    K = matrix(pattern, form, form.evaluate(u, p, state, step))
    assert K.nnz and np.abs(K.data).max() > 0

    def residual(at):
        return total(pattern, form, form.evaluate(at, p, state, step, tangent=False))

    for seed in range(3):
        v = np.random.default_rng(seed).normal(size=space.ndof)
        Kv = K @ v
        size = np.abs(Kv).max()
        np.testing.assert_allclose(residual(u + 1j * EPS * v).imag / EPS, Kv, rtol=0, atol=rtol * size)
        h = 1e-7
        central = (residual(u + h * v) - residual(u - h * v)) / (2 * h)
        np.testing.assert_allclose(central, Kv, rtol=0, atol=1e-5 * size)


def bulk_form(space: Space, degree: int | None = None, names=DEFAULT) -> BulkForm:
    degree = 2 * space.order - 1 if degree is None else degree
    return BulkForm(Model(names).laws("bulk"), space.volume(degree), HEIGHT)


# -- bulk ----------------------------------------------------------------------------------------
@spaces
def test_bulk_tangent(dim, order):
    space = space_of(dim, order)
    form = bulk_form(space)
    u = 2 * displacement(space, size=0.01)
    assert form.smallest_volume_ratio(u) > 0.1
    check_tangent(space, form, u, form.start(P), step_between(space))


def affine(space: Space, gradient: np.ndarray) -> np.ndarray:
    return (gradient[: space.dim, : space.dim] @ space.X).T.ravel()


GRADIENT = np.array([[0.2, 0.15, -0.05], [-0.1, 0.1, 0.08], [0.07, -0.12, -0.15]])


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
    R = total(pattern, form, form.evaluate(u, P, {}, None, tangent=False)).reshape(-1, dim)
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
    R = total(assembled(space, form), form, form.evaluate(u, P, {}, None, tangent=False))
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
    step = Step(0.2, 0.5 * u, np.zeros(3), np.zeros(3))
    np.testing.assert_allclose(half.jump(u)[0], whole.jump(u)[0], atol=1e-15)
    np.testing.assert_allclose(half.jump(u)[0], 0.1 * half._X[1] / HEIGHT + 0.02, atol=1e-14)
    np.testing.assert_allclose(whole.jump(u)[1:], 0, atol=1e-15)
    both = whole.evaluate(u, P, whole.start(P), step)
    one = half.evaluate(u, P, half.start(P), step)
    f = total(assembled(space, whole), whole, both).reshape(-1, dim)
    g = total(assembled(space, half), half, one).reshape(-1, dim)
    nodes = np.unique(plus.nodes)
    assert np.abs(g[nodes, 0]).max() > 0
    np.testing.assert_allclose(g[nodes, 0], f[nodes, 0], rtol=1e-12)
    np.testing.assert_allclose(f.sum(axis=0), 0, atol=1e-14)
    W, w = (x.work(u, P, x.start(P), e.state, step) for x, e in ((whole, both), (half, one)))
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


# -- blade ---------------------------------------------------------------------------------------
def blade(space: Space, *, face="cut", names=DEFAULT, normal="tool", gap="distance", degree=6) -> BladeForm:
    numerics = ContactNumerics(stiffness=5 * P.G, tangential=25 * P.G, normal=normal, gap=gap)
    laws, faces = Model(names).laws("blade"), space.faces(face, degree)
    return BladeForm(laws, faces, numerics, keep_touched=["cut"], height=HEIGHT)


def blade_case(space, form):
    """Displacements, a step and a state with a past: multipliers, shear and touched points."""
    c = np.array([0.0, 2.3, 0.0])
    u_old = displacement(space, 1, 0.03)
    step = Step(0.2, u_old, c, c + np.array([0.0, 0.01, 0.0]))
    state = form.start(P)
    for past in (displacement(space, 2, 0.03), u_old):
        before = Step(0.2, displacement(space, 3), step.centre_old, step.centre_old)
        state = form.augment(form.touch(form.evaluate(past, P, state, before, tangent=False).state))
    return u_old + 0.025 * np.random.default_rng(4).standard_normal(u_old.size), state, step


FRICTIONLESS = tuple(name for name in DEFAULT if name not in ("coulomb", "adhesion"))


@spaces
@pytest.mark.parametrize("normal", ["tool", "material", "blended"])
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


@spaces
def test_some_points_stick_and_some_slip(dim, order):
    """The tangents above are tested on both branches of the return mapping."""
    space = space_of(dim, order)
    form = blade(space)
    u, state, step = blade_case(space, form)
    new = form.evaluate(u, P, state, step).state
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
    c = np.array([0.0, HEIGHT + 0.9, 0.0])
    step = Step(0.2, displacement(space, 1, opening=0.0), c, c + np.array([0.0, 0.1, 0.0]))
    state = form.touch(form.start(P))
    assert form.evaluate(u, P, state, step).state["pressure"].max() > 0
    check_tangent(space, form, u, state, step, rtol=1e-9)


@spaces
@pytest.mark.parametrize("normal", ["tool", "material", "blended"])
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
    c = np.array([0.0, HEIGHT + 0.95, 0.0])
    local = form.evaluate(np.zeros(space.ndof), P, form.start(P), Step(1.0, np.zeros(space.ndof), c, c))
    assert form.force(local.state)[1] > 0
    assert local.state["pressure"].max() > 0
    far = c + np.array([0.0, 5.0, 0.0])
    away = form.evaluate(np.zeros(space.ndof), P, form.start(P), Step(1.0, np.zeros(space.ndof), far, far))
    assert not away.vector.any() and not away.matrix.any()


@spaces
@pytest.mark.parametrize("normal", ["tool", "material", "blended"])
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
        past = form.evaluate(displacement(space, 1, 0.03), off, form.start(off), step, tangent=False)
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


@spaces
@pytest.mark.parametrize("normal", ["tool", "material", "blended"])
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
    assert sum(work.values()) == pytest.approx(taken, rel=1e-10)


# -- space and assembly --------------------------------------------------------------------------
@spaces
def test_quadrature_measures_the_piece(dim, order):
    space = space_of(dim, order)
    deep = LENGTH if dim == 3 else 1.0
    v = space.volume(3)
    assert v.w.sum() == pytest.approx(SIZE * HEIGHT * deep, rel=1e-13)
    assert (v.w * v.X[0] ** 2 * v.X[1]).sum() == pytest.approx(HEIGHT**2 / 2 * SIZE**3 / 3 * deep, rel=1e-12)
    across, up = np.eye(dim)[:2]
    for name, area, outward in (("cut", HEIGHT * deep, -across), ("top", SIZE * deep, up)):
        f = space.faces(name, 4)
        assert f.w.sum() == pytest.approx(area, rel=1e-13)
        np.testing.assert_allclose(f.normal, np.broadcast_to(outward[:, None], f.normal.shape), atol=1e-13)
        np.testing.assert_allclose(f.N.sum(axis=1), 1, atol=1e-13)
        np.testing.assert_allclose(f.dN.sum(axis=2), 0, atol=1e-11)
        at_points = np.einsum("qaf,daf->dqf", f.N, space.X[:, f.nodes])
        np.testing.assert_allclose(at_points, f.X, atol=1e-13)
        slope = np.einsum("sqaf,daf->sdqf", f.dN, space.X[:, f.nodes])
        np.testing.assert_allclose(slope, np.broadcast_to(f.tangents[:, :, None], slope.shape), atol=1e-11)


def tables(rng, ndof: int) -> dict[str, np.ndarray]:
    return {
        name: np.stack([rng.permutation(ndof)[:nd] for _ in range(n)], axis=1)
        for name, nd, n in (("bulk", 6, 25), ("faces", 3, 9))
    }


@pytest.mark.parametrize("fixed", [[], [0, 3, 17, 29]], ids=["all free", "some fixed"])
def test_assembly_equals_the_dense_sum(fixed):
    rng, ndof = np.random.default_rng(8), 30
    dofs = tables(rng, ndof)
    free = np.setdiff1d(np.arange(ndof), fixed)
    dense = np.zeros((ndof, ndof))
    vector = np.zeros(ndof, complex)
    full = Pattern(ndof, np.array(fixed, int), dofs, symmetric=False)
    upper = Pattern(ndof, np.array(fixed, int), dofs, symmetric=True)
    data, half, summed = np.zeros(full.indices.size), np.zeros(upper.indices.size), 0
    for name, table in dofs.items():
        nd, n = table.shape
        local = rng.normal(size=(nd, nd, n))
        local = local + local.transpose(1, 0, 2)
        force = rng.normal(size=(nd, n)) + 1j * rng.normal(size=(nd, n))
        for e in range(n):
            dense[np.ix_(table[:, e], table[:, e])] += local[:, :, e]
            vector[table[:, e]] += force[:, e]
        full.add(data, name, local)
        upper.add(half, name, local)
        summed = summed + full.vector(name, force)
    expected = dense[np.ix_(free, free)]
    np.testing.assert_allclose(summed, vector, atol=1e-13)
    np.testing.assert_allclose(full.csr(data).toarray(), expected, atol=1e-13)
    np.testing.assert_allclose(upper.csr(half).toarray(), np.triu(expected), atol=1e-13)
    assert upper.indices.size < full.indices.size
    np.testing.assert_array_equal(full.free, free)
    np.testing.assert_allclose(data[full.diagonal], np.diag(expected), atol=1e-13)


def test_unsymmetric_local_matrices_keep_rows_and_columns_apart():
    rng, ndof = np.random.default_rng(9), 12
    table = np.stack([rng.permutation(ndof)[:4] for _ in range(5)], axis=1)
    pattern = Pattern(ndof, np.array([2]), {"only": table}, symmetric=False)
    local, dense = rng.normal(size=(4, 4, 5)), np.zeros((ndof, ndof))
    for e in range(5):
        dense[np.ix_(table[:, e], table[:, e])] += local[:, :, e]
    data = np.zeros(pattern.indices.size)
    pattern.add(data, "only", local)
    free = pattern.free
    np.testing.assert_allclose(pattern.csr(data).toarray(), dense[np.ix_(free, free)], atol=1e-13)


def test_a_diagonal_entry_is_kept_where_nothing_is_assembled():
    pattern = Pattern(4, np.array([], int), {"only": np.array([[0], [1]])}, symmetric=True)
    assert pattern.csr(np.ones(pattern.indices.size)).diagonal().tolist() == [1, 1, 1, 1]


def test_two_laws_with_one_name_for_their_state_are_refused():
    assert add_states({"a": 1}, {"b": 2}) == {"a": 1, "b": 2}
    with pytest.raises(ValueError, match="'a'"):
        add_states({"a": 1}, {"a": 2})
