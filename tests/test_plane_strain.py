"""The section's mesh and its mirror image."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from refusals import refused

from cutbench.case.case import load_case
from cutbench.forms.geometry import paired
from cutbench.forms.space import Space
from cutbench.models2d.plane_strain import geometry, mirrored
from cutbench.models2d.section import SLENDER, half_block

#: Width, height and element size at the cut plane, mm: defaults, meat, wide, narrow, tall, flat, coarse, odd.
BLOCKS = [
    (30, 21, 0.4), (25, 21, 0.6), (60, 21, 0.4), (10, 30, 0.5), (3, 21, 0.4), (30, 2, 0.4), (30, 21, 6),
    (12.3, 8.9, 0.37),
]  # fmt: skip
block = pytest.mark.parametrize(("width", "height", "h"), BLOCKS)


def areas(mesh) -> np.ndarray:
    a = mesh.p[:, mesh.t[1]] - mesh.p[:, mesh.t[0]]
    b = mesh.p[:, mesh.t[2]] - mesh.p[:, mesh.t[0]]
    return np.abs(a[0] * b[1] - a[1] * b[0]) / 2


def angles(mesh) -> np.ndarray:
    """Interior angles (3, ne) in degrees."""
    p = mesh.p[:, mesh.t]
    out = []
    for i in range(3):
        a, b = p[:, (i + 1) % 3] - p[:, i], p[:, (i + 2) % 3] - p[:, i]
        out.append(np.degrees(np.arccos((a * b).sum(axis=0) / np.hypot(*a) / np.hypot(*b))))
    return np.stack(out)


def edges_on(mesh, name):
    """Lengths and mid points (2, n) of a line's edges."""
    ends = mesh.p[:, mesh.facets[:, mesh.boundaries[name]]]
    return np.hypot(*(ends[:, 1] - ends[:, 0])), ends.mean(axis=1)


def made(width, height, h):
    return half_block(width, height, h, corner=h / 4)


# -- the built-in section -----------------------------------------------------------------------------
@block
def test_the_triangles_fill_the_half_block(width, height, h):
    mesh = made(width, height, h)
    assert areas(mesh).sum() == pytest.approx(width / 2 * height, rel=1e-12)
    assert areas(mesh).min() > 0
    assert (mesh.p.min(axis=1) == 0).all()
    assert mesh.p.max(axis=1) == pytest.approx((width / 2, height), abs=1e-12)


@block
def test_no_node_hangs(width, height, h):
    """Edges with one triangle lie on the rectangle's outline: a hanging node would leave some inside."""
    mesh = made(width, height, h)
    x, y = mesh.p[:, mesh.facets[:, mesh.f2t[1] == -1]].mean(axis=1)
    to_outline = np.min([x, width / 2 - x, y, height - y], axis=0)
    assert np.abs(to_outline).max() < 1e-9 * height


@block
def test_every_edge_of_the_outline_has_one_name(width, height, h):
    mesh = made(width, height, h)
    given = np.concatenate(list(mesh.boundaries.values()))
    assert sorted(given) == sorted(np.flatnonzero(mesh.f2t[1] == -1))
    for name, length in (("cut", height), ("side", height), ("top", width / 2), ("bottom", width / 2)):
        assert edges_on(mesh, name)[0].sum() == pytest.approx(length, rel=1e-12)


@block
def test_elements_at_the_cut_plane_have_the_size_asked_for(width, height, h):
    """The largest H/(n 2^k) not above h, down the whole cut, and corner where the blade enters."""
    mesh = made(width, height, h)
    length, middle = edges_on(mesh, "cut")
    lower = length[middle[1] < height / 2]
    assert lower.max() <= h * (1 + 1e-12)
    assert lower.max() > 0.7 * h
    assert np.ptp(lower) < 1e-9 * h
    at_corner = length[middle[1].argmax()]
    assert 0.5 * h / 4 < at_corner <= h / 4 * (1 + 1e-12)


@block
def test_where_the_cut_surges_they_are_smaller_and_grow_with_depth(width, height, h):
    surge = height / 8
    length, middle = edges_on(half_block(width, height, h, shallow=1 / 4, surge=surge), "cut")
    deep = height - middle[1]
    assert length[deep < surge].max() <= h / 4 * (1 + 1e-12)
    assert length[deep > 4.5 * surge].min() > 0.7 * h
    # From elements of one size to the next it is half, or twice.
    assert length.max() / length.min() == pytest.approx(4)
    # Depth over size: nowhere less than where the growth begins, but for the rounding to halves.
    assert (length / np.maximum(deep + length / 2, surge)).max() <= 1.5 * h / 4 / surge * (1 + 1e-9)


@block
def test_triangles_are_well_shaped(width, height, h):
    assert angles(half_block(width, height, h, corner=h / 4, slender=1)).min() > 30
    # Twice as tall as wide at the cut plane: a half right angle's thin end is atan(1/2).
    assert angles(made(width, height, h)).min() > 0.9 * np.degrees(np.arctan(1 / SLENDER))


def test_elements_grow_away_from_the_cut():
    mesh = made(30, 21, 0.4)
    corners = mesh.p[:, mesh.t]
    size = np.ptp(corners, axis=1).max(axis=0)
    nearest = corners[0].min(axis=0)
    wanted = 0.4 + 0.35 * np.maximum(nearest - 0.4, 0)
    assert (size <= 3 * wanted).all()
    far, near = size[nearest > 10], size[nearest < 0.4]
    assert far.min() > 3 * np.median(near)
    # Without grading the same size everywhere would take 2·315/0.4² ≈ 4000 triangles.
    assert mesh.nelements < 1000


def test_halving_h_halves_the_elements_at_the_cut():
    coarse, fine = (edges_on(made(30, 21, h), "cut")[0] for h in (0.8, 0.4))
    assert fine.max() == pytest.approx(coarse.max() / 2, rel=1e-9)


# -- the full block -----------------------------------------------------------------------------------
def test_the_mirror_image_is_the_same_block_twice_and_not_joined():
    half = made(30, 21, 0.6)
    full = mirrored(half)
    assert full.nelements == 2 * half.nelements
    assert areas(full).sum() == pytest.approx(30 * 21, rel=1e-12)
    right, left = (set(np.unique(full.facets[:, full.boundaries[n]])) for n in ("cut", "cut_minus"))
    assert not right & left
    assert edges_on(full, "cut")[0].sum() == pytest.approx(edges_on(full, "cut_minus")[0].sum())
    assert edges_on(full, "cut")[0].sum() == pytest.approx(21)
    assert edges_on(full, "top")[0].sum() == pytest.approx(30)
    assert edges_on(full, "bottom")[0].sum() == pytest.approx(30)


def picked(faces, which):
    """Some of the faces, in the order of ``which``; per-face arrays have the faces last."""
    arrays = {
        f.name: getattr(faces, f.name)[..., which] for f in fields(faces) if f.name not in ("name", "sets")
    }
    return replace(faces, **arrays)


@pytest.mark.parametrize("order", [1, 2])
def test_paired_faces_lie_opposite_each_other(order):
    space = Space.build(mirrored(made(30, 21, 0.6)), order)
    plus, minus = space.faces("cut", 6), space.faces("cut_minus", 6)
    # Shuffled, so that the right order is not there by luck.
    shuffled = picked(minus, np.random.default_rng(1).permutation(minus.size.size))
    other = paired(plus, shuffled, space.X)
    np.testing.assert_allclose(other.X, plus.X, atol=1e-12)
    np.testing.assert_allclose(space.X[:, other.nodes], space.X[:, plus.nodes], atol=1e-12)
    np.testing.assert_allclose(other.N, plus.N, atol=1e-12)
    np.testing.assert_allclose(other.w, plus.w, atol=1e-12)
    np.testing.assert_allclose(other.normal, -plus.normal, atol=1e-12)
    assert not set(plus.nodes.ravel()) & set(other.nodes.ravel())


def test_sides_that_do_not_match_are_refused():
    space = Space.build(mirrored(made(30, 21, 0.6)), 2)
    plus, minus = space.faces("cut", 6), space.faces("cut_minus", 6)
    X = space.X.copy()
    X[1, minus.nodes[:, 3]] += 0.01
    with pytest.raises(ValueError, match="matching nodes"):
        paired(plus, minus, X)


def test_a_quarter_is_refused_in_the_plane():
    case = load_case("gelatin").set(symmetry="quarter")
    with refused("symmetry", value="quarter"):
        geometry(case.values, case.numerics)
