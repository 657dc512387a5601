"""Blocks whose elements are a section's, drawn out along the blade."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cutbench.base.errors import BadInput
from cutbench.case.case import load_case
from cutbench.case.numerics import Numerics
from cutbench.models2d.section import half_block
from cutbench.models3d.block import PARTS, block
from cutbench.models3d.extruded import extruded, planes
from cutbench.run.build import build, geometry_of

SMALL = {
    "width": "6 mm",
    "height": "6 mm",
    "length": "8 mm",
    "depth": "0.6 mm",
    "h": "0.6 mm",
    "corner": 0.25,
}


@given(st.floats(1.0, 30.0), st.integers(1, 20))
def test_layers_fill_half_the_blade_and_get_thinner_towards_its_end(half, layers):
    z = planes(half, layers)
    thick = np.diff(z)
    assert z.size == layers + 1 and z[0] == 0.0 and z[-1] == pytest.approx(half)
    assert np.all(thick > 0) and np.all(np.diff(thick) < 0)


@settings(deadline=None, max_examples=8)
@given(st.floats(0.4, 2.0), st.integers(1, 5))
def test_tetrahedra_conform_and_fill_the_block(h, layers):
    section = half_block(6.0, 6.0, h)
    mesh = extruded(section, planes(4.0, layers))
    corners = mesh.p[:, mesh.t]
    edges = corners[:, 1:] - corners[:, :1]
    assert np.abs(np.linalg.det(np.moveaxis(edges, 2, 0))).sum() / 6 == pytest.approx(3.0 * 6.0 * 4.0)
    # Two triangles over each edge on the outside of the section, and the section twice: nothing else is open.
    outside = 2 * section.boundary_facets().size * layers + 2 * section.t.shape[1]
    assert mesh.boundary_facets().size == outside


def test_parts_of_a_drawn_out_block_have_their_faces():
    mesh = extruded(half_block(6.0, 6.0, 1.5), planes(4.0, 3))
    faces = {part: set(block(mesh, part).mesh.boundaries) for part in PARTS}
    assert faces["quarter"] == {"cut", "top", "bottom", "side", "end", "middle"}
    assert faces["full"] == {"cut", "cut_minus", "top", "bottom", "side", "end"}


def test_the_word_is_for_blocks_and_takes_the_sections_contact():
    numerics = load_case("gelatin", {"numerics": "extruded"}, dim=3).numerics
    own = Numerics()
    assert numerics.layers > 0 and numerics.element == own.element
    assert (numerics.penalty, numerics.normal, numerics.multiplier) == (
        own.penalty,
        own.normal,
        own.multiplier,
    )
    with pytest.raises(BadInput, match="extruded"):
        load_case("gelatin", {"numerics": "extruded"})


def curve(case, held=None):
    """Travel (steps,) and force (steps,) of the whole block."""
    geometry = geometry_of(case)
    built = build(case, replace(geometry, held=held) if held else geometry)
    rows = np.array([(s.travel, s.force * built.geometry.multiplicity) for s in built.march])
    return rows.T


def test_between_two_planes_of_symmetry_it_is_the_section():
    section = curve(load_case("gelatin", {**SMALL, "around": 0}))
    solid = load_case("gelatin", {"numerics": "extruded", **SMALL, "layers": 1}, dim=3)
    travel, force = curve(solid, (("middle", 2), ("end", 2)))
    assert np.abs(np.interp(travel, *section) - force).max() < 3e-3 * force.max()
    # With a free end it gives way a little there.
    assert 0.8 < curve(solid)[1][-1] / force[-1] < 0.995
