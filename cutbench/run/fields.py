"""Fields at a converged step, on nodes and on the faces that the blade touches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutbench.forms.base import blend, gather
from cutbench.forms.mixed import MixedVolumetric
from cutbench.mechanisms.bulk._isotropic import det
from cutbench.run.build import Built
from cutbench.run.result import SLOPE, Snapshot
from cutbench.solver.march import Accepted


def snapshot(built: Built, step: Accepted) -> Snapshot:
    """Displacements and nodal averages of the stresses; contact, damage and opening on the faces."""
    space, p = built.space, built.problem.p
    dim, count = space.dim, space.X.shape[1]
    u = np.zeros((count, 3))
    u[:, :dim] = step.u[: space.ndof].reshape(-1, dim)
    points = np.zeros((count, 3))
    points[:, :dim] = space.X.T
    P, F = _stress(built, step, p)
    sigma = np.einsum("iJn,kJn->ikn", P, F) / det(F)
    data = {
        "displacement": u,
        "piola": _to_nodes(built, P.reshape(9, -1)),
        "cauchy": _to_nodes(built, sigma.reshape(9, -1)),
    }
    deviator = sigma - np.einsum("iin->n", sigma)[None, None] / 3 * np.eye(3)[:, :, None]
    data["von_mises"] = _to_nodes(built, np.sqrt(1.5 * (deviator**2).sum(axis=(0, 1)))[None])[:, 0]
    return Snapshot(
        step.travel,
        points,
        np.ascontiguousarray(space.cells[1].T),
        space.cells[0],
        data,
        {
            name: _face(built, form, step, name, part)
            for form in built.blades
            for name, part in form.faces.parts.items()
        },
    )


def add_slopes(picture: Snapshot, built: Built, names: Sequence[str], by_name: Sequence[np.ndarray]) -> None:
    """Put du/dθ (n, 3) into ``picture``, from the rates (ndof,) of the unknowns by each name."""
    space = built.space
    for name, rates in zip(names, by_name, strict=True):
        slope = np.zeros((space.X.shape[1], 3))
        slope[:, : space.dim] = rates[: space.ndof].reshape(-1, space.dim)
        picture.point_data[SLOPE + name] = slope


def _stress(built: Built, step: Accepted, p):
    form = built.problem.bulk
    F = form.deformation(step.u)
    P = form.stress(step.u, p, step.states["bulk"])
    for mixed in built.problem.forms:
        if isinstance(mixed, MixedVolumetric):
            P = P + mixed.stress(step.u)
    return P, F


def _to_nodes(built: Built, values: np.ndarray) -> np.ndarray:
    """Volume-weighted element means, averaged over the elements of each node: (n, components)."""
    space, volume = built.space, built.problem.bulk.volume
    nq, ne = volume.w.shape
    weight = volume.w.sum(axis=0)
    integral = (values.reshape(-1, nq, ne) * volume.w).sum(axis=1)
    nodes = space.element_nodes
    count = space.X.shape[1]
    total = np.bincount(nodes.ravel(), np.broadcast_to(weight, nodes.shape).ravel(), count)
    out = [
        np.bincount(nodes.ravel(), np.broadcast_to(row, nodes.shape).ravel(), count) / total
        for row in integral
    ]
    return np.stack(out, axis=1)


def _face(built: Built, form, step: Accepted, name: str, part: slice) -> dict[str, np.ndarray]:
    """What ``form`` has on the faces ``part``, the set called ``name``."""
    f, dim, state = form.faces, form.dim, step.states[form.name]
    count = f.w[:, part].size

    def flat(a):
        out = np.zeros((count, 3))
        out[:, : a.shape[0]] = a[..., part].reshape(a.shape[0], -1).T
        return out

    x = f.X + blend(f.N, gather(step.u, form.dofs, dim))
    out = {
        "X": flat(f.X),
        "x": flat(x),
        "contact_pressure_MPa": state["pressure"][:, part].ravel(),
        "tangential_traction_MPa": flat(state["shear"]),
        "contact_state": state["active"][:, part].ravel(),
        "touched": state["touched"][:, part].ravel(),
    }
    if name == "cut" and "cohesion" in step.states:
        cohesion = built.form("cohesion")
        out["opening_mm"] = cohesion.jump(step.u)[0]
        out["damage"] = step.states["cohesion"]["damage"]
    else:
        out["opening_mm"] = np.zeros(count)
        out["damage"] = np.zeros(count)
    return out
