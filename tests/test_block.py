"""The mesh of a block in three dimensions."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from refusals import refused

from cutbench.case.numerics import Fixed, Numerics
from cutbench.models2d import plane_strain
from cutbench.models3d.block import PARTS, block, geometry
from cutbench.models3d.mesh import length_along, mirrored, quarter

WIDTH, HEIGHT, LENGTH = 30.0, 21.0, 30.0
VALUES = {"width": WIDTH, "height": HEIGHT, "length": LENGTH, "thickness": 0.7}


def volumes(mesh: skfem.MeshTet) -> np.ndarray:
    corners = mesh.p[:, mesh.t]
    return np.abs(np.linalg.det(np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0))) / 6


def area(mesh: skfem.MeshTet, name: str) -> float:
    a, b, c = np.moveaxis(mesh.p[:, mesh.facets[:, mesh.boundaries[name]]], 1, 0)
    return float(np.linalg.norm(np.cross((b - a).T, (c - a).T), axis=1).sum() / 2)


# -- mesh --------------------------------------------------------------------------------------


@pytest.mark.parametrize("corner", [None, 0.25])
@pytest.mark.parametrize("part", PARTS)
def test_every_face_has_a_name_and_its_area(part, corner):
    mesh = block(quarter(WIDTH, HEIGHT, LENGTH, 1.0, corner=corner), part).mesh
    share = {"quarter": 4, "half": 2, "full": 1}[part]
    assert volumes(mesh).min() > 0
    assert volumes(mesh).sum() == pytest.approx(WIDTH * HEIGHT * LENGTH / share)
    along = LENGTH / 2 if part == "quarter" else LENGTH
    across = WIDTH if part == "full" else WIDTH / 2
    wanted = {"cut": HEIGHT * along, "top": across * along, "bottom": across * along}
    wanted |= {"side": HEIGHT * along, "end": HEIGHT * across}
    wanted |= {"middle": HEIGHT * across} if part == "quarter" else {"end": 2 * HEIGHT * across}
    wanted |= {"cut_minus": HEIGHT * along, "side": 2 * HEIGHT * along} if part == "full" else {}
    assert {name: area(mesh, name) for name in mesh.boundaries} == pytest.approx(wanted)
    # A hanging node would leave facets with one element inside the block.
    assert sum(len(f) for f in mesh.boundaries.values()) == mesh.boundary_facets().size


@pytest.mark.parametrize("h", [1.0, 0.7, 0.4])
def test_size_at_the_cut_plane_and_growth_away_from_it(h):
    mesh = block(quarter(WIDTH, HEIGHT, LENGTH, h)).mesh
    faces = mesh.p[:, mesh.facets[:, mesh.boundaries["cut"]]]
    _, high, along = np.ptp(faces, axis=1)
    assert h / 2 < high.max() <= h * (1 + 1e-9)
    assert along.max() <= length_along(LENGTH, h) * (1 + 1e-9)
    corners = mesh.p[:, mesh.t]
    far = corners[0].min(axis=0) > WIDTH / 4
    assert np.ptp(corners[1], axis=0)[far].max() > 1.9 * high.max()


def test_the_corner_under_the_blade_is_finer_and_only_it():
    h, corner = 1.0, 0.25
    mesh = quarter(WIDTH, HEIGHT, LENGTH, h, corner=corner)
    corners = mesh.p[:, mesh.t]
    height = np.ptp(corners[1], axis=0)
    at = (corners[0].min(axis=0) < 1e-9) & (corners[1].max(axis=0) > HEIGHT - 1e-9)
    assert height[at].max() <= 1.5 * corner
    deep = (corners[0].min(axis=0) < 1e-9) & (corners[1].max(axis=0) < HEIGHT - 4 * h)
    assert height[deep].min() > h / 2


def test_where_the_cut_surges_elements_are_finer():
    h, surge = 1.0, 3.0
    mesh = quarter(WIDTH, HEIGHT, LENGTH, h, shallow=0.5, surge=surge)
    corners = mesh.p[:, mesh.t]
    tall, deep = np.ptp(corners[1], axis=0), HEIGHT - corners[1].max(axis=0)
    on_plane = corners[0].min(axis=0) < 1e-9
    assert tall[on_plane & (deep < surge)].max() <= h / 2
    assert tall[on_plane & (deep > 2.5 * surge)].min() > h / 2


def test_a_mesh_as_coarse_as_published_ones_is_possible():
    mesh = geometry(
        VALUES, Numerics(h=Fixed(0.85, "mm"), corner=1.0, shallow=1.0, slender=1.0, along=1.25)
    ).mesh
    assert 10_000 < mesh.t.shape[1] < 12_000


@pytest.mark.parametrize("h", [0.75, 0.7, 0.65, 0.35])
def test_no_size_needs_far_more_elements_than_its_neighbours(h):
    mesh = geometry(VALUES, Numerics(h=Fixed(h, "mm"), corner=1.0, shallow=1.0, slender=1.0, along=1.25)).mesh
    # Elements lie densest on the cut plane, so their number goes with its area over h².
    assert mesh.t.shape[1] * h**2 < 13_000


def test_long_elements_only_along_the_blade():
    assert length_along(30.0, 0.2) == pytest.approx(0.8)
    assert length_along(30.0, 1.0) == pytest.approx(2.5)
    assert length_along(30.0, 1.0, along=1.25) == pytest.approx(1.25)
    assert length_along(8.0, 2.0) == 2.0


def test_mirrored_halves_share_nodes_only_where_joined():
    mesh = quarter(6.0, 6.0, 8.0, 2.0)
    on_plane = np.sum(np.abs(mesh.p[2]) < 1e-12)
    assert mirrored(mesh, 2, joined=True).p.shape[1] == 2 * mesh.p.shape[1] - on_plane
    assert mirrored(mesh, 0, joined=False).p.shape[1] == 2 * mesh.p.shape[1]


def test_symmetry_is_taken_from_the_numerics():
    values = {"width": 6.0, "height": 6.0, "length": 8.0, "thickness": 0.7}
    assert geometry(values, Numerics(h=Fixed(2.0, "mm"))).multiplicity == 4
    assert geometry(values, Numerics(h=Fixed(2.0, "mm"))).held == (("middle", 2),)
    assert geometry(values, Numerics(h=Fixed(2.0, "mm"), symmetry="half")).multiplicity == 2
    full = geometry(values, Numerics(h=Fixed(2.0, "mm"), symmetry="full"))
    assert (full.multiplicity, full.split, full.held) == (1, True, ())


def test_what_a_block_cannot_be_is_refused():
    with refused("symmetry", value="quarter"):
        plane_strain.geometry({"width": 6.0, "height": 6.0, "length": 8.0}, Numerics(symmetry="quarter"))
    with refused("mesh", value="block.msh", hint="mesh"):
        geometry({"width": 6.0, "height": 6.0, "length": 8.0}, Numerics(mesh="block.msh"))
    with pytest.raises(ValueError, match="eighth"):
        block(quarter(6.0, 6.0, 8.0, 2.0), "eighth")
