"""Surface tension and bending of the top and of the cut faces: what they ignore, and take, and where they
end."""

from __future__ import annotations

import numpy as np
import pytest
from form_checks import spaces, step_between
from looped import over
from refusals import refused
from scipy.spatial.transform import Rotation
from surface_forms import HEIGHT, LENGTH, P, begun, energy, forms, moved, piece

from cutbench.case.case import load_case
from cutbench.mechanisms.base import STEP
from cutbench.run.runner import run_case

LAWS = ("surface_tension", "bending_skin", "film", "surface_gradient")
every = over("name", LAWS)
parts = pytest.mark.parametrize("part", ["half", "full"])


def shaken(space, size=0.02, seed=0) -> np.ndarray:
    r = np.random.default_rng(seed)
    waves = [0.1 * np.sin(3 * space.X.sum(axis=0) + i) for i in range(space.dim)]
    return (np.stack(waves) + size * r.uniform(-1, 1, space.X.shape)).T.ravel()


def turned(space, turn: float = 0.7) -> np.ndarray:
    R = Rotation.from_rotvec([0, 0, turn] if space.dim == 2 else [0.3, 0.5, turn]).as_matrix()
    return R[: space.dim, : space.dim]


@spaces
@parts
@every
def test_forces_are_the_energys_derivative_and_tangents_theirs(dim, order, name, part):
    space, geometry = piece(dim, order, part, 3)
    u = shaken(space)
    for form in forms(space, geometry, name):
        state, step = begun(form, space, 0.3), step_between(space)
        found, v = form.evaluate(u, P, state, step), np.random.default_rng(1).normal(size=u.size)
        local = np.take(v, form.dofs)
        slope = form.evaluate(u + 1j * STEP * v, P, state, step).vector.imag / STEP
        size = np.abs(found.vector).max() * np.abs(v).max()
        np.testing.assert_allclose(np.einsum("ijn,jn->in", found.matrix, local), slope, atol=1e-10 * size)
        h = 1e-6
        slope = (
            sum(form.stored(u + h * v, P, state).values()) - sum(form.stored(u - h * v, P, state).values())
        ) / (2 * h)
        assert (found.vector * local).sum() == pytest.approx(slope, rel=1e-6)


@spaces
@parts
@every
def test_energy_does_not_see_rotations_nor_forces_push_the_whole(dim, order, name, part):
    space, geometry = piece(dim, order, part, 3)
    # What holds the edges does not turn with them.
    found = [form for form in forms(space, geometry, name) if not form.name.endswith(("across", "held"))]
    u = shaken(space)
    x = space.X + u.reshape(-1, dim).T
    R, u = turned(space), (x - space.X).T.ravel()
    again = moved(space, lambda _: R @ x + 0.3)
    # The mirror of a half does not turn with it.
    cut = 1.0 if part == "half" else 0.3
    assert energy(found, space, again, cut) == pytest.approx(energy(found, space, u, cut), rel=1e-11)
    for form in found:
        force = form.evaluate(u, P, begun(form, space, cut), step_between(space)).vector
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
        assert sum(form.stored(u, P, state).values()) < 1e-24 * scale + 1e-28
        force = form.evaluate(u, P, state, step_between(space)).vector
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


@pytest.mark.parametrize("dim", [2, 3])
def test_surface_tension_is_the_area_of_what_is_deformed_and_cut(dim):
    space, geometry = piece(dim, 2, nx=6)

    def sheared(X):
        return np.stack([1.5 * X[0], X[1] + 0.4 * X[0], *(1.2 * X[2:])])

    found, u = forms(space, geometry, "surface_tension"), moved(space, sheared)
    found = [form for form in found if not form.name.endswith("held")]
    depth = 1.0 if dim == 2 else 1.2 * 2 * LENGTH
    top, cut = np.hypot(1.5, 0.4) * depth, HEIGHT * depth
    for damage in (0.0, 0.25, 1.0):
        assert energy(found, space, u, damage) == pytest.approx(P.gamma_s * (top + damage * cut), rel=1e-12)


@spaces
@parts
def test_a_whole_top_pulls_nowhere_at_the_cut_plane_a_cut_one_does(dim, order, part):
    """Stretched evenly it is in balance along itself, but at its outer edge."""
    space, geometry = piece(dim, order, part, 3)
    found = forms(space, geometry, "surface_tension")
    stretch = np.array([1.5, 0.8, 1.2])[:dim]
    u = moved(space, lambda X: stretch[:, None] * X)
    at_edge = np.intersect1d(space.nodes_on("top"), space.nodes_on("cut"))
    pulls = []
    for damage in (0.0, 1.0):
        force = np.zeros(space.ndof)
        for form in found:
            local = form.evaluate(u, P, begun(form, space, damage), step_between(space)).vector
            np.add.at(force, form.dofs, local)
        pulls.append(-force.reshape(-1, dim)[at_edge, 0].sum())
    # In space it pulls at the edge by γ per deformed length.
    length = 1.0 if dim == 2 else 1.2 * LENGTH * (2 if geometry.mesh.p[2].min() < 0 else 1)
    assert pulls[0] == pytest.approx(0, abs=1e-12)
    assert pulls[1] == pytest.approx(P.gamma_s * length, rel=1e-12)


@spaces
@parts
def test_a_whole_block_is_at_rest(dim, order, part):
    space, geometry = piece(dim, order, part, 3)
    force = np.zeros(space.ndof)
    for form in forms(space, geometry, *LAWS):
        local = form.evaluate(0 * force, P, begun(form, space, 0.0), step_between(space)).vector
        np.add.at(force, form.dofs, local)
    assert np.abs(force).max() < 1e-14


def test_what_is_left_of_an_edge_is_a_matter_of_its_damage():
    """A kinked top stores in proportion to how far its edge is whole, and nothing where that is cut."""
    space, geometry = piece(2, 2)
    found = forms(space, geometry, "bending_skin")
    u = moved(space, lambda X: np.stack([X[0], X[1] + 0.3 * X[0]]))
    whole, half, cut = (energy(found, space, u, damage) for damage in (0.0, 0.5, 1.0))
    assert whole > 0
    assert half == pytest.approx(whole / 2, rel=1e-12)
    assert cut == pytest.approx(0, abs=1e-12 * whole)


@every
def test_it_takes_the_mean_of_what_it_is_at_both_ends_of_a_step(name):
    space, geometry = piece(2, 2)
    n = space.faces("cut", 4).w.size
    step, u = step_between(space), shaken(space, 0.01)
    for form in forms(space, geometry, name):
        states = [begun(form, space, damage) for damage in (0.2, 0.6)]
        begins = form.begun(states[0], np.full(n, 0.6))
        (taken,) = form.work(u, P, begins, form.evaluate(u, P, begins, step).state, step).values()
        mean = (
            sum(
                sum(form.stored(u, P, s).values()) - sum(form.stored(step.u_old, P, s).values())
                for s in states
            )
            / 2
        )
        assert taken == pytest.approx(mean, rel=1e-12)


def test_a_film_has_a_thickness_and_a_layer_is_said_otherwise(tmp_path):
    case = load_case("gelatin").set(with_="film", film_thickness="0.07 mm")
    assert case.values["film_bending"] == pytest.approx(case.p.G * 0.07**3 / 3)
    assert case.groups()["film_thickness/a"] == pytest.approx(0.2)
    path = tmp_path / "own.toml"
    path.write_text('base = "gelatin"\n[numerics]\nlayer = 0.5\n', encoding="utf-8")
    with refused("layer", value="0.5", line=3, hint="surface_length") as error:
        load_case(path)
    assert (error.value.key, error.value.line) == ("layer", 3)
    with refused("layer", value="1.0", hint="surface_gradient"):
        case.set(layer=1.0)


@pytest.mark.slow
def test_the_onset_of_an_elastomer_with_a_film_has_a_limit():
    case = load_case("elastomer").set(
        depth="3.6 mm", h="0.125 mm", corner=0.125, shallow=1.0, step="0.1 mm", energy_step=0.1,
        with_="film", film_thickness="0.07 mm",
    )  # fmt: skip
    fine, coarser = (run_case(each).measures["onset_mm"] for each in (case, case.set(corner=0.25)))
    assert coarser == pytest.approx(fine, rel=0.02)
