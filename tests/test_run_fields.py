"""Whole runs in plane strain: the fields that are kept."""

from __future__ import annotations

import numpy as np
import pytest
from coarse_runs import BRIEF, CUTTING, PRESSED, seen_by_blade

from cutbench.run.build import build
from cutbench.run.figures.section import Half
from cutbench.run.runner import run_case


def test_snapshots_are_taken_where_they_were_asked_for(cutting):
    travels = [s.displacement_mm for s in cutting.snapshots]
    assert len(travels) == 2
    for asked, got in zip((0.3, 2.0), travels, strict=True):
        steps = cutting.displacement_mm
        assert got == steps[steps >= asked - 1e-9][0], "the first step at or past it"


def test_a_snapshot_holds_the_promised_fields(cutting):
    picture = cutting.snapshots[-1]
    n = len(picture.points)
    assert picture.cell_type == "triangle6"
    assert picture.cells.max() == n - 1
    sizes = {"displacement": (n, 3), "piola": (n, 9), "cauchy": (n, 9), "von_mises": (n,)}
    assert {name: field.shape for name, field in picture.point_data.items()} == sizes
    for name, field in picture.point_data.items():
        assert np.isfinite(field).all(), name
    assert set(picture.faces) == {"cut", "top"}
    for face in picture.faces.values():
        m = len(face["X"])
        assert {name: values.shape for name, values in face.items()} == {
            "X": (m, 3), "x": (m, 3), "opening_mm": (m,), "damage": (m,), "contact_pressure_MPa": (m,),
            "tangential_traction_MPa": (m, 3), "contact_state": (m,), "touched": (m,),
        }  # fmt: skip
        assert all(np.isfinite(values).all() for values in face.values())


def test_stresses_are_symmetric_and_plane(cutting):
    sigma = cutting.snapshots[-1].point_data["cauchy"].reshape(-1, 3, 3)
    scale = np.abs(sigma).max()
    assert scale > 0
    np.testing.assert_allclose(sigma, sigma.transpose(0, 2, 1), atol=1e-12 * scale)
    assert np.abs(sigma[:, 2, :2]).max() < 1e-12 * scale
    assert np.abs(sigma[:, 2, 2]).max() > 0, "plane strain holds the thickness by a stress"
    assert cutting.snapshots[-1].point_data["von_mises"].min() >= 0


def test_no_element_is_turned_inside_out_and_the_bottom_stays(cutting):
    built = build(CUTTING)
    for picture in cutting.snapshots:
        u = np.zeros(built.problem.ndof)
        u[: built.space.ndof] = picture.point_data["displacement"][:, :2].ravel()
        np.testing.assert_allclose(picture.points[:, :2].T, built.space.X)
        F = np.moveaxis(built.form("bulk").deformation(u), (0, 1), (-2, -1))
        assert np.linalg.det(F).min() > 0
    bottom = picture.points[:, 1] < 1e-9
    assert bottom.any()
    assert (picture.point_data["displacement"][bottom] == 0).all()


def test_the_cut_opens_from_the_top(cutting):
    cut = cutting.snapshots[-1].faces["cut"]
    damage, depth = cut["damage"], CUTTING.p.height - cut["X"][:, 1]
    assert ((damage >= 0) & (damage <= 1)).all()
    assert damage[depth < 0.5].min() > 0.9
    assert damage[depth > 6].max() < 0.5
    # The opening is twice the distance of one side from the plane.
    np.testing.assert_allclose(cut["opening_mm"], 2 * cut["x"][:, 0], atol=1e-12)
    assert cut["opening_mm"].max() <= CUTTING.p.thickness + 0.05


@pytest.mark.parametrize(
    "case",
    [PRESSED.set(normal="tool", mu=0.3), pytest.param(BRIEF.set(normal="tool"), marks=pytest.mark.slow)],
)
def test_tractions_on_the_faces_add_up_to_the_force(case):
    """Pressure along the blade's normal and shear, summed over the faces by hand."""
    result = run_case(case, snapshots_mm=(case.p.depth,))
    picture, p = result.snapshots[-1], case.p
    built = build(case)
    total, sheared = np.zeros(2), False
    (form,) = built.blades
    for name, part in form.faces.parts.items():
        face = picture.faces[name]
        _, normal = seen_by_blade(face, p, picture.displacement_mm)
        traction = face["contact_pressure_MPa"] * normal + face["tangential_traction_MPa"][:, :2].T
        total -= traction @ form.faces.w[:, part].ravel()
        pressure = face["contact_pressure_MPa"]
        assert (pressure >= 0).all()
        assert ((pressure > 0) == (face["contact_state"] == 1)).all()
        # Shear lies in the face of the blade.
        shear = face["tangential_traction_MPa"][:, :2].T
        right = face["x"][:, 0] >= 0
        assert np.abs((shear * normal).sum(axis=0)[right]).max() < 1e-9
        # What has just met the blade has none: strengths are those of the last pressure.
        sheared |= bool(shear.any())
    assert sheared
    assert total[1] * 2 * p.length == pytest.approx(result.force_N[-1], rel=1e-9)


def test_colours_end_by_area_not_by_nodes(cutting):
    """Stress at the many nodes of the tip stands for little of the section."""
    half = Half(cutting.snapshots[-1])
    a, b, c = (half.x[half.triangles[:, k]] for k in range(3))
    area = np.abs(np.linalg.det(np.stack([b - a, c - a], axis=2))) / 2
    above = half.stress_kPa[half.triangles].mean(axis=1) > half.top_kPa
    assert 0 < area[above].sum() < 0.002 * area.sum()
