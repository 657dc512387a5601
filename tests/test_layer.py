"""Bending of the cut plane's faces: what it ignores, what it takes, in two and three dimensions."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from form_checks import P, check_tangent, displacement, space_of, spaces, step_between

from cutbench.case.case import load_case
from cutbench.case.model import DEFAULT, Model
from cutbench.forms.layer import LayerForm
from cutbench.forms.space import Space
from cutbench.run.build import build
from cutbench.run.runner import run_case

LAYER = 2.0  # in δ_c


def plate(dim: int, n: int, order: int) -> Space:
    """4 mm high, in three dimensions 2 mm along the blade, with n elements a side."""
    y, z = np.linspace(0, 4, 2 * n + 1), np.linspace(0, 2, n + 1)
    if dim == 2:
        mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 3), y)
    else:
        mesh = skfem.MeshTet.init_tensor(np.linspace(0, 1, 3), y, z)
    return Space.build(mesh.with_boundaries({"cut": lambda x: np.abs(x[0]) < 1e-9}), order)


def form_on(space: Space, **options) -> LayerForm:
    laws = [law for law in Model(DEFAULT).all if law.slot in ("bulk", "cut")]
    return LayerForm(space.faces("cut", 4), space.X, LAYER, laws, **options)


def bent(space: Space, out_of_plane) -> np.ndarray:
    u = np.zeros_like(space.X)
    u[0] = out_of_plane
    return u.T.ravel()


@spaces
def test_tangent(dim, order):
    space = space_of(dim, order)
    form = form_on(space)
    check_tangent(space, form, displacement(space), form.start(P), step_between(space))


@spaces
def test_nothing_where_the_body_turns_or_is_stretched_evenly(dim, order):
    space = space_of(dim, order)
    gradient = np.random.default_rng(0).uniform(-1, 1, (dim, dim))
    assert form_on(space).energy((gradient @ space.X).T.ravel(), P) == pytest.approx(0, abs=1e-15)


@spaces
def test_energy_of_a_curvature(dim, order):
    """½ B κ² over the area; the plane's free edges have none, which goes with the element."""
    errors = []
    for n in (8, 16):
        space = plate(dim, n, order)
        kappa, area = 0.3, 4.0 if dim == 2 else 8.0
        energy = form_on(space).energy(bent(space, kappa * space.X[1] ** 2 / 2), P)
        errors.append(1 - energy / (P.G * (LAYER * P.delta_c) ** 3 / 3 * kappa**2 * area / 2))
    assert 0 < errors[1] < 0.55 * errors[0] < 0.15


def test_mean_curvature_counts():
    space = plate(3, 8, 2)
    _, y, z = space.X
    form = form_on(space)
    one, bowl, saddle = (form.energy(bent(space, w), P) for w in (y**2, y**2 + z**2, y**2 - z**2))
    assert bowl == pytest.approx(4 * one, rel=1e-9)
    assert saddle == pytest.approx(0, abs=1e-9 * one)


def test_a_mirror_is_no_edge():
    """Half a plate with its plane of symmetry bends as half of the whole one."""

    def plate_from(start):
        z = np.linspace(start, 2, 9 if start < 0 else 5)
        mesh = skfem.MeshTet.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 4, 9), z)
        return Space.build(
            mesh.with_boundaries({"cut": lambda x: x[0] < 1e-9, "middle": lambda x: np.abs(x[2]) < 1e-9}), 2
        )

    whole, half = plate_from(-2.0), plate_from(0.0)
    # Triangles of the whole are not mirror images: a function of z alone does not see their diagonals.
    energies = [
        form_on(space, mirrors=mirrors).energy(bent(space, np.cos(space.X[2])), P)
        for space, mirrors in ((whole, ()), (half, [(half.nodes_on("middle"), 2)]))
    ]
    assert energies[1] == pytest.approx(energies[0] / 2, rel=1e-6)


def test_a_part_has_its_share():
    space = plate(3, 4, 2)
    form, u = form_on(space), displacement(space)
    columns = np.arange(form.dofs.shape[1])
    parts = [form.part(columns[columns % 3 == i]).energy(u, P) for i in range(3)]
    assert sum(parts) == pytest.approx(form.energy(u, P), rel=1e-12)


@pytest.mark.parametrize("part", ["half", "full"])
def test_all_surfaces_at_the_blade_have_it(part):
    case = load_case("gelatin").set(h="1 mm", symmetry=part)

    def stiff(case):
        return {form.name for form in build(case).problem.forms if isinstance(form, LayerForm)}

    assert stiff(case) == {"bending", "bending_top"} | ({"bending_minus"} if part == "full" else set())
    assert stiff(case.set(layer=0.0)) == set()


@pytest.mark.slow
def test_with_it_the_onset_has_a_limit():
    """Elements of 8 and 4 µm below the tip; and whichever normal the pressure has, where none is a fold's."""
    case = load_case("gelatin").set(depth="3.4 mm")
    onset, finer, along_the_material = (
        run_case(case.set(**change)).measures["onset_mm"]
        for change in ({}, {"corner": 1 / 32}, {"normal": "material"})
    )
    assert finer == pytest.approx(onset, rel=0.02)
    assert along_the_material == pytest.approx(onset, rel=0.02)


@pytest.mark.slow
def test_without_it_the_elastomer_is_cut_in_a_fold():
    case = load_case("elastomer").set(depth="2.6 mm")
    stiff, folds = (run_case(case.set(layer=layer)).measures["onset_mm"] for layer in (1.0, 0.0))
    assert folds < 0.8 * stiff
