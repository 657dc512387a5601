"""Surface tension and bending of the top and of the cut faces: what they ignore, and take, and where they
end."""

from __future__ import annotations

import numpy as np
import pytest
from form_checks import spaces, step_between
from scipy.spatial.transform import Rotation
from surface_forms import HEIGHT, P, begun, energy, forms, moved, piece

from cutbench.mechanisms.base import STEP

LAWS = ("surface_tension", "bending_skin", "film", "surface_gradient")
every = pytest.mark.parametrize("name", LAWS)
parts = pytest.mark.parametrize("part", ["half", "full"])


def shaken(space, size=0.02, seed=0) -> np.ndarray:
    r = np.random.default_rng(seed)
    waves = [0.1 * np.sin(3 * space.X.sum(axis=0) + i) for i in range(space.dim)]
    return (np.stack(waves) + size * r.uniform(-1, 1, space.X.shape)).T.ravel()


def turned(space, turn: float = 0.7) -> np.ndarray:
    R = Rotation.from_rotvec([0, 0, turn] if space.dim == 2 else [0.3, 0.5, turn]).as_matrix()
    return R[: space.dim, : space.dim]


@spaces
@every
@parts
def test_forces_are_the_energys_derivative_and_tangents_theirs(dim, order, name, part):
    space, geometry = piece(dim, order, part, 3)
    u = shaken(space)
    for form in forms(space, geometry, name):
        state, step = begun(form, space, 0.3), step_between(space)
        found, v = form.evaluate(u, P, state, step), np.random.default_rng(1).normal(size=u.size)
        local = np.take(v, form.dofs)
        slope = form.evaluate(u + 1j * STEP * v, P, state, step, tangent=False).vector.imag / STEP
        size = np.abs(found.vector).max() * np.abs(v).max()
        np.testing.assert_allclose(np.einsum("ijn,jn->in", found.matrix, local), slope, atol=1e-10 * size)
        h = 1e-6
        slope = (form.energy(u + h * v, P, state) - form.energy(u - h * v, P, state)) / (2 * h)
        assert (found.vector * local).sum() == pytest.approx(slope, rel=1e-6)


@spaces
@every
@parts
def test_energy_does_not_see_rotations_nor_forces_push_the_whole(dim, order, name, part):
    space, geometry = piece(dim, order, part, 3)
    found = [form for form in forms(space, geometry, name) if not form.name.endswith("across")]
    u = shaken(space)
    x = space.X + u.reshape(-1, dim).T
    R, u = turned(space), (x - space.X).T.ravel()
    again = moved(space, lambda _: R @ x + 0.3)
    # The mirror of a half does not turn with it.
    cut = 1.0 if part == "half" else 0.3
    assert energy(found, space, again, cut) == pytest.approx(energy(found, space, u, cut), rel=1e-11)
    for form in found:
        force = form.evaluate(u, P, begun(form, space, cut), step_between(space), tangent=False).vector
        total = force.reshape(dim, -1).sum(axis=1)
        assert np.abs(total).max() < 1e-11 * np.abs(force).max()


@spaces
@pytest.mark.parametrize("name", ["bending_skin", "film"])
@parts
def test_a_flat_surface_is_stretched_for_nothing(dim, order, name, part):
    """However unevenly, and turned: there is no resistance to the stretch nor to its gradients."""
    space, geometry = piece(dim, order, part)

    def stretched(X):
        x = X.copy()
        x[0] = X[0] * (0.4 + 0.5 * X[0] ** 2) if dim == 2 else X[0] * (0.4 + 0.5 * X[0] ** 2 + 0.2 * X[2])
        x[1] = X[1] * (0.7 - 0.3 * X[1] / 2)
        x[2:] = X[2:] * (1.5 + 0.4 * X[2:])
        return x

    u = moved(space, stretched)
    scale = energy(forms(space, geometry, name), space, shaken(space))
    for form in forms(space, geometry, name):
        state = begun(form, space, 0.0)
        assert form.energy(u, P, state) < 1e-24 * scale + 1e-28
        force = form.evaluate(u, P, state, step_between(space), tangent=False).vector
        assert np.abs(force).max() < 1e-12


@pytest.mark.parametrize("squeezed", [1.0, 0.3])
@pytest.mark.parametrize("dim", [2, 3])
def test_bending_has_its_stiffness_squeezed_too(dim, squeezed):
    """Rolled up by an angle per reference length, however long that has become: ½ B (dθ/dS)² over the area.
    The free edges have none, which goes with the element."""
    turn, errors = 1.3, []

    def rolled(X):
        radius = squeezed / turn + X[1] - HEIGHT
        return np.stack([radius * np.sin(turn * X[0]), radius * np.cos(turn * X[0]), *X[2:]])

    for nx in (8, 16):
        space, geometry = piece(dim, 2, "full", nx)
        found = energy(forms(space, geometry, "bending_skin"), space, moved(space, rolled))
        area = space.faces("top", 2).w.sum()
        errors.append(1 - found / (P.skin_bending * turn**2 * area / 2))
    assert 0 < errors[1] < 0.62 * errors[0] < 0.15


@spaces
@parts
@every
def test_half_of_a_block_has_half_of_the_energy(dim, order, part, name):
    if part == "full":
        return
    half, whole = piece(dim, order), piece(dim, order, "full")

    def bent(X):
        x = X.copy()
        x[1] += 0.2 * np.cos(2 * X[0])
        x[0] += np.where(X[0] == 0, 0.0, 0.1 * np.sin(3 * X[0]))
        return x

    for damage in (0.0, 0.6, 1.0):
        energies = [
            energy(forms(space, geometry, name), space, moved(space, bent), damage)
            for space, geometry in (half, whole)
        ]
        assert energies[1] == pytest.approx(2 * energies[0], rel=1e-9)
