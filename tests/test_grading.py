"""How large elements are to be, by where they are, and that the built-in meshes keep to it on the rim."""

from __future__ import annotations

import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.case.mesh_sizes import wanted
from cutbench.case.numerics import Fixed, Numerics
from cutbench.case.tuning import MeshTuning
from cutbench.models2d.plane_strain import geometry
from cutbench.models2d.section import half_block
from cutbench.models3d.mesh import quarter

H, RIM, THICKNESS = 0.5, 2.0, 0.7
GRADING, ON_RIM = MeshTuning.grading, MeshTuning.on_rim


def test_the_rim_is_finer_than_the_cut_plane_and_sizes_grow_from_its_edge():
    x = np.array([0.0, 1.0, RIM, RIM + 1.0, RIM, 0.0])
    deep = np.array([0.0, RIM / 4, 0.0, 0.0, RIM / 4 + 1.0, 10.0])
    size = wanted(x, deep, H, rim=RIM)
    assert size[:3] == pytest.approx(ON_RIM * H)
    assert size[3:5] == pytest.approx(ON_RIM * H + GRADING)
    assert size[5] == pytest.approx(H)  # on the cut plane
    # Without a rim the distance from the cut plane counts alone.
    assert wanted(x, deep, H)[2] == pytest.approx(H + GRADING * (RIM - H))
    # Outside of what is to be fine it is large, but for the rim.
    assert wanted(x[:1], deep[:1], H, outside=1.0)[0] == pytest.approx(H + GRADING * (1 - H))
    assert wanted(x[:1], deep[:1], H, rim=RIM, outside=1.0)[0] == pytest.approx(ON_RIM * H)


def test_shallow_elements_are_those_of_the_rim():
    size = wanted(np.array([0.0, 1.0]), np.zeros(2), H, shallow=0.25, surge=3.0, rim=RIM)
    assert size == pytest.approx(ON_RIM * H / 4)


def test_elements_on_the_cut_plane_are_as_much_smaller_as_the_detail():
    def tallest(detail, h):
        values = {"width": 30.0, "height": 21.0, "length": 30.0, "thickness": THICKNESS}
        mesh = geometry(values, Numerics(h=Fixed(h, "mm")), detail=detail).mesh
        faces = mesh.p[1, mesh.facets[:, mesh.boundaries["cut"]]]
        return np.ptp(faces, axis=0).max()

    h = 0.25
    # Sizes are halves of one another, and a half more than asked for is taken.
    asked = {THICKNESS: h, 10 * THICKNESS: h, THICKNESS / 2: h / 2, THICKNESS / 5: h / 5}
    for detail, size in asked.items():
        assert 0.6 * size < tallest(detail, h) <= 1.5 * size
    assert tallest(THICKNESS / 2, h / 2) == pytest.approx(tallest(THICKNESS / 2, h) / 2)


@pytest.mark.parametrize(("name", "factor"), [("G_c", 1 / 4), ("delta_c", 1 / 2), ("thickness", 2)])
def test_the_detail_is_the_least_of_thickness_edge_and_cohesive_zone(name, factor):
    blunt = load_case("gelatin")
    p = blunt.p
    assert blunt.sizes.detail_mm == pytest.approx(p.thickness)
    zone = 4 * p.G * p.G_c / (p.G_c / (np.e * p.delta_c)) ** 2
    assert blunt.model.cohesive_zone(p) == pytest.approx(zone)
    # 4 G G_c/σ_c² = 4 e² G δ_c²/G_c.
    tough = blunt.set(G_c=f"{3 * p.G_c} N/mm")
    assert tough.sizes.detail_mm == pytest.approx(4 * zone / 3)
    sharp = blunt.set(with_="wedge", edge_radius="0.05 mm")
    assert sharp.sizes.detail_mm == pytest.approx(0.3)
    assert sharp.set(detail="0.2 mm").sizes.detail_mm == 0.2
    moved = tough.set(**{name: f"{factor * tough.values[name]} {'N/mm' if name == 'G_c' else 'mm'}"})
    t, edge = moved.p.thickness, moved.model.tool.edge_radius(moved.p)
    asked = min(t, 6 * edge, 4 * moved.model.cohesive_zone(moved.p))
    assert moved.sizes.detail_mm == pytest.approx(max(asked, t / 8))
    assert any("detail" in said for said in moved.doubts) == (asked < t / 12)


@pytest.mark.parametrize("dim", [2, 3])
def test_meshes_keep_to_it(dim):
    def top(rim):
        """Sizes of the elements at the top, and where they begin."""
        make = half_block(30, 21, H, rim=rim) if dim == 2 else quarter(12, 12, 12, H, rim=rim)
        corners = make.p[:, make.t]
        at = corners[1].max(axis=0) > make.p[1].max() - 1e-9
        return np.ptp(corners[0], axis=0)[at], corners[0].min(axis=0)[at]

    wide, x = top(RIM)
    # A half more than asked for is taken.
    assert wide[x < RIM / 2].max() <= 1.5 * ON_RIM * H * (1 + 1e-9)
    before, x_before = top(0.0)
    assert wide[(x > RIM / 2) & (x < RIM)].mean() < before[(x_before > RIM / 2) & (x_before < RIM)].mean()
    assert wide[x > 2 * RIM].mean() > 1.5 * H


def test_the_rim_is_coarse_once_the_front_has_left_unless_something_is_kept_there():
    def at_top(kept):
        mesh = half_block(30, 21, H, rim=RIM, fine=(8.0, 12.0), kept=kept)
        corners = mesh.p[:, mesh.t]
        on_rim = (corners[1].max(axis=0) > 21 - 1e-9) & (corners[0].min(axis=0) < RIM / 2)
        return np.ptp(corners[0], axis=0)[on_rim]

    nothing, below, folded = (at_top(np.array(place).reshape(2, -1)) for place in ([], [0, 16], [1.0, 20.9]))
    assert min(nothing.min(), below.min()) > 1.5 * H
    # One place is enough for all of it.
    assert folded.max() <= 1.5 * ON_RIM * H * (1 + 1e-9)
