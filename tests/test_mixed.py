"""The mixed element: its tangent, its ledger, and Cook's membrane, where other elements lock."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import skfem

from cutbench.forms.assembly import Pattern
from cutbench.forms.base import Step
from cutbench.forms.mixed import MixedVolumetric
from cutbench.forms.space import Space
from cutbench.mechanisms import Volumetric, registry
from cutbench.solver.linear import available
from verification.cook import KAPPA, G, membrane

ISOCHORIC, QUADRATIC = registry()["neo_hookean"], registry()["volumetric"]


class Logarithmic(Volumetric):
    """U = κ/4 (J² − 1 − 2 ln J): stiffer in compression, so that dU/dJ is not linear."""

    name, title = "logarithmic", "test law"

    def U(self, J, p):
        return p.G * 10 * (J**2 - 1 - 2 * np.log(J))

    def dU_dJ(self, J, p):
        return p.G * 20 * (J - 1 / J)


def step_from(u: np.ndarray) -> Step:
    return Step(dt=1.0, u_old=u, centre=np.zeros(3), centre_old=np.zeros(3))


def bent(mesh_type, seed: int = 0):
    """A small skewed mesh and unknowns with sizeable strains, rotations and pressures."""
    mesh = mesh_type().refined(1)
    rng = np.random.default_rng(seed)
    mesh = mesh_type(mesh.p * 2 + 0.08 * rng.standard_normal(mesh.p.shape), mesh.t)
    space = Space.build(mesh, 2)
    u = np.empty(space.ndof + mesh.p.shape[1])
    u[: space.ndof] = 0.05 * rng.standard_normal(space.ndof)
    u[space.ndof :] = 0.4 * rng.standard_normal(mesh.p.shape[1])
    return space, u


def assembled(form, pattern, u, p, tangent=True):
    local = form.evaluate(u, p, form.start(p), step_from(0 * u.real))
    data = np.zeros(pattern.indices.size)
    if tangent:
        pattern.add(data, form.name, local.matrix)
    return pattern.vector(form.name, local.vector), pattern.csr(data).toarray()


@pytest.mark.parametrize("law", [QUADRATIC, Logarithmic()], ids=lambda law: law.name)
@pytest.mark.parametrize("mesh", [skfem.MeshTri, skfem.MeshTet], ids=["2D", "3D"])
class TestConsistency:
    p = SimpleNamespace(G=1.3, nu=0.45)

    def setting(self, mesh, law):
        space, u = bent(mesh)
        form = MixedVolumetric(law, space, 4, 2.0)
        assert form.ndof == u.size == form.dofs.max() + 1
        pattern = Pattern(form.ndof, np.array([], int), {form.name: form.dofs}, symmetric=False)
        return space, form, pattern, u

    def test_tangent_is_the_derivative(self, mesh, law):
        _, form, pattern, u = self.setting(mesh, law)
        _, K = assembled(form, pattern, u, self.p)
        d = np.random.default_rng(1).standard_normal(u.size)
        # Complex step: exact to rounding.
        R, _ = assembled(form, pattern, u + 1e-30j * d, self.p, tangent=False)
        np.testing.assert_allclose(K @ d, R.imag / 1e-30, rtol=0, atol=1e-12 * np.abs(K @ d).max())
        # Central differences: independent of complex arithmetic in the laws.
        h = 1e-5
        ahead, _ = assembled(form, pattern, u + h * d, self.p, tangent=False)
        behind, _ = assembled(form, pattern, u - h * d, self.p, tangent=False)
        np.testing.assert_allclose(K @ d, (ahead - behind) / (2 * h), rtol=0, atol=1e-7 * np.abs(K @ d).max())

    def test_tangent_is_symmetric_with_a_negative_pressure_block(self, mesh, law):
        space, form, pattern, u = self.setting(mesh, law)
        _, K = assembled(form, pattern, u, self.p)
        np.testing.assert_allclose(K, K.T, rtol=0, atol=1e-14 * np.abs(K).max())
        assert np.linalg.eigvalsh(K[space.ndof :, space.ndof :]).max() < 0

    def test_residual_is_the_gradient_of_the_energy(self, mesh, law):
        _, form, pattern, u = self.setting(mesh, law)
        d = np.random.default_rng(2).standard_normal(u.size)
        R, _ = assembled(form, pattern, u, self.p, tangent=False)
        h = 1e-5
        energy = [form.energies(u + s * h * d, self.p, {})[law.name] for s in (1, -1)]
        assert (energy[0] - energy[1]) / (2 * h) == pytest.approx(R @ d, rel=1e-7)

    def test_derivative_by_a_parameter(self, mesh, law):
        _, form, pattern, u = self.setting(mesh, law)
        at = [SimpleNamespace(G=G, nu=0.45) for G in (1.3 + 1e-30j, 1.3 + 1e-5, 1.3 - 1e-5)]
        exact, ahead, behind = (assembled(form, pattern, u, p, tangent=False)[0] for p in at)
        by_steps = (ahead - behind) / 2e-5
        assert np.abs(by_steps).max() > 0
        np.testing.assert_allclose(exact.imag / 1e-30, by_steps, rtol=0, atol=1e-6 * np.abs(by_steps).max())


def test_quadratic_law_gives_the_perturbed_lagrangian():
    space, u = bent(skfem.MeshTri)
    p = SimpleNamespace(G=1.3, nu=0.45)
    form = MixedVolumetric(QUADRATIC, space, 4, 2.0)
    kappa = QUADRATIC.kappa(p)
    J = np.linalg.det(np.moveaxis(form.deformation(u), 2, 0))
    phi = form.phi
    w = form.volume.w
    expected = phi.T @ (((J - 1 - form.pressure(u) / kappa).reshape(w.shape)) * w)
    np.testing.assert_allclose(form.evaluate(u, p, {}, step_from(u)).vector[-3:], expected, atol=1e-14)
    mass = np.einsum("qv,qe,qx->vxe", phi, w, phi) / kappa
    np.testing.assert_allclose(form.evaluate(u, p, {}, step_from(u)).matrix[-3:, -3:], -mass, rtol=1e-12)


def test_stress_does_the_work_of_the_residual():
    space, u = bent(skfem.MeshTri)
    form = MixedVolumetric(QUADRATIC, space, 4, 2.0)
    p = SimpleNamespace(G=1.0, nu=0.4)
    pattern = Pattern(form.ndof, np.array([], int), {form.name: form.dofs}, symmetric=True)
    R, _ = assembled(form, pattern, u, p, tangent=False)
    d = np.zeros_like(u)
    d[: space.ndof] = np.random.default_rng(5).standard_normal(space.ndof)
    grad = form.deformation(u + d) - form.deformation(u)
    power = np.einsum("ijn,ijn,n->", form.stress(u), grad, form.volume.w.ravel())
    assert R @ d == pytest.approx(power, rel=1e-12)


def test_a_pressure_that_no_volume_carries_gives_nan_not_nonsense():
    """Newton's method then shortens its step; J̄ ≤ 0 would let an inverted element pass."""
    space, u = bent(skfem.MeshTri)
    p = SimpleNamespace(G=1.0, nu=0.4)
    form = MixedVolumetric(QUADRATIC, space, 2, 2.0)
    u[space.ndof :] = -1.5 * QUADRATIC.kappa(p)
    assert np.isnan(form.evaluate(u, p, {}, step_from(u)).vector[-3:]).all()
    u[space.ndof :] = -0.9 * QUADRATIC.kappa(p)
    assert np.isfinite(form.evaluate(u, p, {}, step_from(u)).vector).all()


def test_linear_displacements_are_refused():
    with pytest.raises(ValueError, match="quadratic"):
        MixedVolumetric(QUADRATIC, Space.build(skfem.MeshTri(), 1), 2, 1.0)


BENCHMARK = (3 * KAPPA / G - 2) / (2 * (3 * KAPPA / G + 1))  # ν = 0.4999


@pytest.mark.parametrize("solver", available())
@pytest.mark.parametrize(("nu", "tip"), [(0.49, 6.910), (BENCHMARK, 6.800)])
def test_cook_coarse(solver, nu, tip):
    """n = 8: within 1.5 % of n = 32, and the same with every linear solver."""
    got = membrane(8, "P2P1", nu, solver=solver)
    assert got.tip_mm == pytest.approx(tip, abs=2e-3)
    assert got.iterations <= 5


def test_cook_other_elements_lock():
    """ν = 0.4999, n = 8: linear triangles lose two thirds, quadratic ones a twelfth."""
    mixed, p1, p2 = (membrane(8, element, BENCHMARK).tip_mm for element in ("P2P1", "P1", "P2"))
    assert p1 < 0.4 * mixed
    assert p2 < 0.95 * mixed


@pytest.mark.parametrize("nu", [0.49, BENCHMARK])
def test_ledger_closes_with_the_load_steps(nu):
    """What remains is the trapezoidal rule for the load's work: a quarter with every halving."""
    gaps = []
    for loads in (4, 8, 16):
        got = membrane(6, "P2P1", nu, loads=loads)
        gaps.append(abs(got.work_mJ - sum(got.stored_mJ.values())) / got.work_mJ)
    assert gaps[-1] < 3e-4
    np.testing.assert_allclose([gaps[0] / gaps[1], gaps[1] / gaps[2]], 4.0, rtol=0.15)
