"""Blocks whose elements are a section's, drawn out along the blade."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused

from cutbench.case.case import load_case
from cutbench.case.mesh_sizes import under_tip
from cutbench.case.numerics import Numerics, defaults
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


@given(st.floats(1.0, 30.0), st.integers(1, 20), st.floats(1.0, 20.0))
def test_layers_fill_half_the_blade_and_are_thinner_towards_its_end(half, layers, graded):
    z = planes(half, layers, graded)
    assert z.size == layers + 1 and z[0] == 0.0 and z[-1] == pytest.approx(half)
    thick = np.diff(z)
    assert thick[0] == pytest.approx(thick[-1] * (graded if layers > 1 else 1.0))
    assert thick[1:] / thick[:-1] == pytest.approx(graded ** (-1 / max(layers - 1, 1)))


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


def test_elements_under_the_tip_are_as_small_whatever_h_is():
    cases = [load_case("gelatin", {"h": h}, dim=3) for h in ("0.125 mm", "0.25 mm", "0.5 mm")]
    sizes = [under_tip(case.numerics, case.p.thickness, np.inf) for case in cases]
    assert sizes == pytest.approx([case.p.thickness / 22.4 for case in cases])


def test_a_block_is_a_section_drawn_out_unless_it_is_asked_for_tetrahedra(tmp_path):
    case, own = load_case("gelatin", dim=3), Numerics()
    numerics = case.numerics
    assert numerics.layers > 0
    for name in ("element", "normal", "multiplier", "facet_degree", "bulk_degree", "energy_step"):
        assert getattr(numerics, name) == getattr(own, name), name
    # Softer, but a pressure of 3 G presses the blade in by less than a fiftieth of an element.
    assert 3 / case.sizes.penalty_per_mm < 0.02 * case.sizes.h_mm
    tetrahedra = load_case("gelatin", {"numerics": "tetrahedra"}, dim=3).numerics
    assert tetrahedra.layers == 0
    with refused("numerics", value="tetrahedra"):
        load_case("gelatin", {"numerics": "tetrahedra"})
    # A mesh file's elements are such.
    path = tmp_path / "block.msh"
    path.write_text("what it holds is read later")
    named = load_case("gelatin", {"mesh": str(path)}, dim=3).numerics
    assert replace(named, mesh=None) == tetrahedra
    with refused("element", value="P2P1"):
        build(load_case("gelatin", {**SMALL, "element": "P2P1"}, dim=3))


# -- against the section -----------------------------------------------------------------------------
#: A cut that opens on the way, with all that a surface may have.
OPENS = {
    **SMALL, "depth": "1.2 mm", "G_c": "0.2 J/m^2", "eta_v": "0.05 mm", "mu": 0.2,
    "with": ["surface_tension", "film"], "gamma_s": "50 mN/m", "film_thickness": "0.07 mm",
}  # fmt: skip


def fibres(angle):
    """Those changes that add fibres in the plane."""
    law = {"g_f": 0.5, "fibre_angle": angle, "fibre_dispersion": 0.1}
    return {**law, "with": [*OPENS["with"], "fibres"]}


def section_of(changes, symmetry="half"):
    """The section that a block is drawn out of, with what a block's numerics differ in."""
    solid = defaults(3)
    names = ("around", "self_contact", "penalty", "stick", "damping")
    flat = load_case("gelatin", {n: getattr(solid, n) for n in names} | {"symmetry": symmetry, **changes})
    return build(flat, geometry_of(flat, fine=(0.0, flat.p.depth)))


def solid_of(changes, held):
    case = load_case("gelatin", changes, dim=3)
    return build(case, replace(geometry_of(case), held=held))


def forces(built, given=None):
    """Travel (steps,) and force (steps,) of the whole block, and the steps."""
    steps = list(built.march.steps(given=given))
    travel, force = np.array([(s.travel, s.force) for s in steps]).T
    return travel, force * built.geometry.multiplicity, steps


@pytest.mark.parametrize(
    ("layers", "symmetry", "more"),
    [
        (1, "half", {}),
        (1, "half", fibres("0 deg")),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in ((2, "half", {}), (1, "full", {}), (2, "full", {}), (1, "full", fibres("30 deg")))
        ),
    ],
)
def test_between_two_planes_of_symmetry_it_is_the_section_to_rounding(layers, symmetry, more):
    tight = {**OPENS, "tolerance": 1e-11, "symmetry": symmetry, **more}
    travel, force, steps = forces(section_of(tight, symmetry))
    # As far as the force has fallen by a tenth.
    end = 1 + int(np.argmax((force < 0.9 * force.max()) & (travel > travel[force.argmax()])))
    assert end > 1
    force, steps = force[:end], steps[:end]
    built = solid_of({**tight, "layers": layers}, (("middle", 2), ("end", 2)))
    # Each step begins from the section's solution in every plane, so that both are one branch.
    planes = built.space.z.size

    def drawn(u):
        return np.tile(np.pad(u.reshape(-1, 2), ((0, 0), (0, 1))), (planes, 1)).ravel()

    _, found, taken = forces(built, [replace(s.given, u=drawn(s.u)) for s in steps])
    assert np.abs(found - force).max() < 1e-9 * force.max()
    off = max(np.abs(t.u - drawn(s.u)).max() for s, t in zip(steps, taken, strict=True))
    assert off < 1e-8


@pytest.mark.slow
def test_a_free_end_gives_way_a_little():
    values = {**SMALL, "layers": 1}
    held = forces(solid_of(values, (("middle", 2), ("end", 2))))[1]
    free = forces(solid_of(values, (("middle", 2),)))[1]
    assert 0.8 < free[-1] / held[-1] < 0.95


@pytest.mark.slow
def test_few_layers_do():
    small = {**SMALL, "depth": "0.3 mm"}
    few, more = (forces(solid_of({**small, "layers": n}, (("middle", 2),)))[1][-1] for n in (1, 3))
    assert few == pytest.approx(more, rel=0.015)


@pytest.mark.slow
def test_a_half_is_two_quarters():
    quarter, half = (
        forces(build(load_case("gelatin", {**SMALL, "layers": 1, "symmetry": part}, dim=3)))[1]
        for part in ("quarter", "half")
    )
    assert half[-1] == pytest.approx(quarter[-1], rel=1e-8)


def test_values_at_points_are_those_of_quadratic_functions():
    built = solid_of({**SMALL, "layers": 2}, (("middle", 2),))
    space, rng = built.space, np.random.default_rng(2)

    def value(X):
        return 1 + X[0] * X[2] + X[1] ** 2 - 0.3 * X[2] ** 2

    points = rng.uniform(size=(3, 50)) * np.array([[3.0], [6.0], [4.0]])
    assert space.probes(points) @ value(space.X) == pytest.approx(value(points), abs=1e-9)
    volume = space.volume(4)
    assert volume.w.sum() == pytest.approx(3.0 * 6.0 * 4.0)
    at_points = np.einsum("qa,ae->qe", volume.phi, value(space.X)[volume.nodes])
    assert at_points == pytest.approx(value(volume.X), abs=1e-9)
    slope = np.einsum("qma,ae,mje->jqe", volume.dphi, value(space.X)[volume.nodes], volume.jinv)
    assert slope[2] == pytest.approx(volume.X[0] - 0.6 * volume.X[2], abs=1e-8)
