"""What several reference problems need: parameters, closed forms, meshes, loads, one Newton solve."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import skfem
from scipy.integrate import cumulative_trapezoid

from cutbench.case.case import Case, load_case
from cutbench.forms.base import Form, Local, Step, component_major
from cutbench.forms.bulk import BulkForm
from cutbench.forms.mixed import MixedVolumetric
from cutbench.forms.space import Space, Volume
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import STEP
from cutbench.models2d.plane_strain import mirrored
from cutbench.models3d.block import block
from cutbench.models3d.mesh import quarter
from cutbench.run.build import ORDER
from cutbench.run.result import Result
from cutbench.run.runner import run_case
from cutbench.solver.newton import NewtonSettings, newton
from cutbench.solver.problem import Evaluation, Problem

ELEMENTS = ("P1", "P2", "P2P1")
#: Volume quadrature of the element kinds, as runs use it by default.
DEGREE = {"P1": 1, "P2": 2, "P2P1": 2}


def parameters(material: str = "gelatin", **changes: float) -> SimpleNamespace:
    """A known material's numbers in mm, N and s, with changes."""
    return SimpleNamespace(**{**load_case(material).values, **changes})


def law(name: str):
    """The registered mechanism."""
    return registry()[name]


def nu_of(kappa_over_G: float) -> float:
    """Poisson's ratio at small strain."""
    return (3 * kappa_over_G - 2) / (2 * (3 * kappa_over_G + 1))


def piola(F: np.ndarray, G: float, nu: float) -> np.ndarray:
    """P (3, 3, n) for F (3, 3, n), real or complex, from the formula on paper with F⁻ᵀ, not from the law:
    P = G J^(−2/3) (F − tr(FᵀF)/3 F⁻ᵀ) + κ (J − 1) J F⁻ᵀ."""
    kappa = 2 * G * (1 + nu) / (3 * (1 - 2 * nu))
    rows = np.moveaxis(F, -1, 0)
    J = np.linalg.det(rows)
    inverse = np.moveaxis(np.linalg.inv(rows), 0, -1).transpose(1, 0, 2)
    trace = (F * F).sum(axis=(0, 1))
    return G * J ** (-2 / 3) * (F - trace / 3 * inverse) + kappa * (J - 1) * J * inverse


def bulk_forms(
    space: Space, element: str, height: float = 1.0, degree: int | None = None
) -> tuple[list, int]:
    """Neo-Hooke with volume change on one element kind: forms and the number of unknowns."""
    degree = degree or DEGREE[element]
    shear, volumetric = law("neo_hookean"), law("volumetric")
    if element != "P2P1":
        return [BulkForm((shear, volumetric), space.volume(degree), height)], space.ndof
    mixed = MixedVolumetric(volumetric, space, degree, height)
    return [BulkForm((shear,), space.volume(degree), height), mixed], mixed.ndof


def space_of(mesh: skfem.Mesh, element: str) -> Space:
    return Space.build(mesh, ORDER[element])


def step_at_rest(u: np.ndarray, dt: float = 1.0) -> Step:
    """A step of time ``dt`` that begins at ``u``, with the blade at rest."""
    return Step(dt, u.copy(), np.zeros(3), np.zeros(3))


def solve(
    problem: Problem, u: np.ndarray, states: dict, step: Step, tolerance: float = 1e-8
) -> tuple[np.ndarray, Evaluation]:
    """Equilibrium from the guess ``u``, whose fixed components are the boundary values."""
    u, result, _ = newton(problem, u, states, step, NewtonSettings(tolerance=tolerance))
    return u, result


class DeadLoad(Form):
    """A load that does not follow: ∫ b·δu over a volume, or over faces with ``N`` and ``w`` of their own."""

    def __init__(self, nodes: np.ndarray, vector: np.ndarray):
        """``nodes`` (nn, n); ``vector`` (dim, nn, n) nodal forces at full load."""
        self.name, self.loaded = "load", 1.0
        self.dofs = component_major(nodes, vector.shape[0])
        self._vector = vector.reshape(self.dofs.shape)

    @classmethod
    def in_volume(cls, volume: Volume, density: Callable[[np.ndarray], np.ndarray]) -> DeadLoad:
        """``density`` gives b (dim, n) in N/mm³ at points (dim, n)."""
        dim, nq, ne = volume.X.shape
        b = density(volume.X.reshape(dim, -1)).reshape(dim, nq, ne)
        return cls(volume.nodes, np.einsum("qa,dqe,qe->dae", volume.phi, b, volume.w))

    def evaluate(self, u, p, state, step):
        return Local(-self.loaded * self._vector + 0 * u[0], None, {})


def body_force(gradient: Callable[[np.ndarray], np.ndarray], G: float, nu: float) -> Callable:
    """−Div P of the field with displacement gradient ``gradient(X)`` (2, 2, n), by a complex step in X."""

    def density(X: np.ndarray) -> np.ndarray:
        b = np.zeros(X.shape)
        for j in range(2):
            ahead = X.astype(complex)
            ahead[j] += 1j * STEP
            F = np.zeros((3, 3, X.shape[1]), complex)
            F[:2, :2] = gradient(ahead)
            F[[0, 1, 2], [0, 1, 2]] += 1.0
            b -= piola(F, G, nu)[:2, j].imag / STEP
        return b

    return density


def finished(case: Case, **how: Any) -> Result:
    """A run to its depth. Raises ArithmeticError where it falls short."""
    result = run_case(case, **how)
    if not result.outcome.done:
        raise ArithmeticError(str(result.outcome))
    return result


def rate(values: np.ndarray, curve: Mapping[str, np.ndarray], start: float, end: float) -> float:
    """By how much ``values`` (n,) grow per mm of travel from ``start`` to ``end``, mm."""
    first, last = np.interp([start, end], curve["displacement_mm"], values)
    return float(last - first) / (end - start)


def blade_work(curve: Mapping[str, np.ndarray], name: str = "force_N") -> np.ndarray:
    """Work of the blade up to each point (n,), mJ; of one that slices, of its way down, or of another force
    as far as it goes down."""
    return cumulative_trapezoid(curve[name], curve["displacement_mm"], initial=0)


def split_block(dim: int) -> skfem.Mesh:
    """Two pieces 1 mm × 1.5 mm (× 1 mm) that meet at x = 0 and share no node, of unequal, skewed elements."""
    rng = np.random.default_rng(0)
    if dim == 2:
        half = skfem.MeshTri.init_tensor(np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.5, 0.9, 1.5]))
        mesh = mirrored(half)
    else:
        mesh = block(quarter(2.0, 1.5, 1.0, 0.75), "full").mesh
    inner = np.ones(mesh.p.shape[1], bool)
    inner[np.unique(mesh.facets[:, mesh.f2t[1] == -1])] = False
    p = mesh.p + 0.05 * inner * rng.uniform(-1, 1, mesh.p.shape)
    return replace(mesh, doflocs=p)
