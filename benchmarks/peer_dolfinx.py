"""One Newton iteration of the published model in DOLFINx, timed: assembly of both sides and a factorization.

``peer_dolfinx.py [REPEAT] [section|block]`` runs under an interpreter that has DOLFINx, without cutbench, and
prints a line of JSON: CPU milliseconds. In plane strain quadratic elements, 2,070 degrees of freedom; as a
quarter block 11,220 linear tetrahedra; neo-Hookean bulk, cohesive traction with the printed viscosity on the
cut plane, contact with the dimensionless gap along the material's normal on both faces. Friction, adhesion
and updates of states, which the real thing has besides, are left out: it is rather faster than that.
MUMPS with Debian's reference BLAS takes three times as long for a block as with OpenBLAS.
"""

import json
import statistics
import sys
import time

import dolfinx
import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

WARM_UP = 10
WIDTH, HEIGHT, LENGTH = 15.0, 21.0, 15.0  # mm, half of the block across and along the blade
G, KAPPA, G_C, DELTA_C, ETA_PER_STEP = 3.6e-3, 0.18, 0.01, 0.07, 0.05


def problem(kind):
    """Residual, tangent, boundary condition and the unknown."""
    if kind == "section":
        corners, cells = [[0, 0], [WIDTH, HEIGHT]], [11, 22]
        block, degree = mesh.create_rectangle(MPI.COMM_SELF, corners, cells, mesh.CellType.triangle), 2
    else:
        corners, cells = [[0, 0, 0], [WIDTH, HEIGHT, LENGTH]], [11, 17, 10]
        block, degree = mesh.create_box(MPI.COMM_SELF, corners, cells, mesh.CellType.tetrahedron), 1
    dim = block.geometry.dim
    V = fem.VectorFunctionSpace(block, ("CG", degree))
    u, u_old = fem.Function(V), fem.Function(V)
    damage = fem.Function(fem.FunctionSpace(block, ("CG", 1)))
    v, du = ufl.TestFunction(V), ufl.TrialFunction(V)
    F = ufl.Identity(dim) + ufl.grad(u)
    J = ufl.det(F)
    energy = G / 2 * (J ** (-2 / 3) * (ufl.inner(F, F) + 3 - dim) - 3) + KAPPA / 2 * (J - 1) ** 2
    sides = [
        mesh.locate_entities_boundary(block, dim - 1, lambda x: np.isclose(x[0], 0)),
        mesh.locate_entities_boundary(block, dim - 1, lambda x: np.isclose(x[1], HEIGHT)),
    ]
    faces = np.concatenate(sides).astype(np.int32)
    kinds = np.concatenate([np.full(len(side), i + 1) for i, side in enumerate(sides)]).astype(np.int32)
    order = np.argsort(faces)
    tags = mesh.meshtags(block, dim - 1, faces[order], kinds[order])
    ds = ufl.Measure("ds", block, subdomain_data=tags, metadata={"quadrature_degree": 4})
    traction = G_C / DELTA_C**2 * ((1 - damage) * 2 * u + ETA_PER_STEP * 2 * (u - u_old))
    normal = ufl.inv(F).T * ufl.FacetNormal(block)
    normal = normal / ufl.sqrt(ufl.dot(normal, normal))
    tip = fem.Constant(block, PETSc.ScalarType(HEIGHT + 0.5))
    x = ufl.SpatialCoordinate(block) + u
    gap = 1 - (x[0] / 0.35) ** 2 - ((x[1] - tip) / 1.05) ** 2
    push = ufl.conditional(gap > 0, gap, 0.0) * normal
    residual = ufl.derivative(energy * ufl.dx(metadata={"quadrature_degree": 2}), u, v)
    residual += ufl.inner(traction, v) * ds(1) + ufl.inner(push, v) * (ds(1) + ds(2))
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 0))
    bc = fem.dirichletbc(np.zeros(dim), held, V)
    return fem.form(residual), fem.form(ufl.derivative(residual, u, du)), bc, u


def main() -> None:
    repeat = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    residual, tangent, bc, u = problem(sys.argv[2] if len(sys.argv) > 2 else "section")
    matrix, vector = petsc.create_matrix(tangent), petsc.create_vector(residual)
    step = vector.duplicate()
    solver = PETSc.KSP().create(MPI.COMM_SELF)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    u.x.array[:] = 1e-3 * np.random.default_rng(0).standard_normal(u.x.array.size)
    times = []
    for _ in range(WARM_UP + repeat):
        start = time.process_time()
        with vector.localForm() as local:
            local.set(0)
        petsc.assemble_vector(vector, residual)
        petsc.apply_lifting(vector, [tangent], [[bc]], x0=[u.vector], scale=-1)
        petsc.set_bc(vector, [bc], u.vector, -1)
        matrix.zeroEntries()
        petsc.assemble_matrix(matrix, tangent, bcs=[bc])
        matrix.assemble()
        solver.setOperators(matrix)
        solver.solve(vector, step)
        times.append(1e3 * (time.process_time() - start))
    kept = times[WARM_UP:]
    found = {"dofs": u.x.array.size, "ms": statistics.median(kept), "dolfinx": dolfinx.__version__}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
