"""What tests of forms share: a small piece, lively displacements of it, forms on it, checks of tangents."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import skfem

from cutbench.case.model import DEFAULT, Model
from cutbench.forms.assembly import Pattern
from cutbench.forms.base import Step
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.forms.bulk import BulkForm
from cutbench.forms.space import Space
from cutbench.models2d.section import named

SIZE, HEIGHT, LENGTH = 1.0, 2.0, 0.7
EPS = 1e-30
spaces = pytest.mark.parametrize("dim, order", [(2, 1), (2, 2), (3, 1), (3, 2)])
#: Internal units, chosen so that a blade pressed into a 1 mm × 2 mm piece sticks here and slips there.
P = SimpleNamespace(
    G=0.025, nu=0.49, G_c=0.01, delta_c=0.07, beta=0.8, onset_stiffness=20.0, eta_reg=0.3,
    speed=0.5, thickness=0.7, tip=1.05, surface_length=0.07,
    mu=0.3, tau_W=0.004, tilt=0.0, incline=0.0, overhang=0.0,
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
    c = np.array([0.0, 2.3 - P.tip, 0.0])
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
        return total(pattern, form, form.evaluate(at, p, state, step))

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


def affine(space: Space, gradient: np.ndarray) -> np.ndarray:
    return (gradient[: space.dim, : space.dim] @ space.X).T.ravel()


GRADIENT = np.array([[0.2, 0.15, -0.05], [-0.1, 0.1, 0.08], [0.07, -0.12, -0.15]])


def blade(space: Space, *, face="cut", names=DEFAULT, normal="tool", gap="distance", degree=6) -> BladeForm:
    numerics = ContactNumerics(stiffness=5 * P.G, tangential=25 * P.G, normal=normal, gap=gap)
    laws, faces = Model(names).laws("blade"), space.faces(face, degree)
    return BladeForm(laws, faces, numerics, keep_touched=["cut"], height=HEIGHT)


def blade_case(space, form, p=P):
    """Displacements, a step and a state with a past: multipliers, shear and touched points."""
    c = np.array([0.0, 2.3 - P.tip, 0.0])
    u_old = displacement(space, 1, 0.03)
    step = Step(0.2, u_old, c, c + np.array([0.0, 0.01, 0.0]))
    state = form.start(p)
    for past in (displacement(space, 2, 0.03), u_old):
        before = Step(0.2, displacement(space, 3), step.centre_old, step.centre_old)
        state = form.augment(form.touch(form.evaluate(past, p, state, before).state))
    return u_old + 0.025 * np.random.default_rng(4).standard_normal(u_old.size), state, step


FRICTIONLESS = tuple(name for name in DEFAULT if name not in ("coulomb", "adhesion"))
