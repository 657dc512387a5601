"""Runs of a block: symmetry, one layer against plane strain, what is written."""

from __future__ import annotations

import json
from dataclasses import fields, replace

import meshio
import numpy as np
import pytest
import skfem
from coarse_runs import SOFT
from PIL import Image
from typer.testing import CliRunner

import cutbench.run.build
from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.forms import space as spaces
from cutbench.forms.geometry import Geometry
from cutbench.models2d import plane_strain
from cutbench.models3d.block import PARTS, block
from cutbench.models3d.extruded import extruded
from cutbench.models3d.mesh import quarter
from cutbench.run.build import build
from cutbench.run.figures.solid import plot_block, plot_cut_plane, plot_front
from cutbench.run.runner import run_case

#: A block so small that a run of it takes seconds.
SMALL = {"width": "6 mm", "height": "6 mm", "length": "8 mm", "element": "P1"}
#: And of elements of its own.
OWN = {**SMALL, "numerics": "tetrahedra"}


def curve_of(case, geometry=None):
    """Travel, force and reaction (steps, 3) of the whole block."""
    built = build(case, geometry)
    rows = [(s.travel, s.force, s.reaction) for s in built.march]
    return np.array(rows) * np.array([1.0, built.geometry.multiplicity, built.geometry.multiplicity])


@pytest.mark.parametrize("element", ["P1", pytest.param("P2", marks=pytest.mark.slow)])
def test_quarter_half_and_full_block_agree_through_the_onset(element):
    # Weak enough for the cut to open abruptly half way.
    values = {**OWN, **SOFT, "element": element, "G_c": "1.2 J/m^2", "depth": "1.2 mm"}
    case = load_case("gelatin", values, dim=3)
    mesh = quarter(6.0, 6.0, 8.0, 2.0)
    curves = {part: curve_of(case, block(mesh, part)) for part in PARTS}
    travel, force, _ = curves["quarter"].T
    assert force[-1] < 0.7 * force.max()
    for part in ("half", "full"):
        found = np.interp(travel, *curves[part][:, :2].T)
        assert np.abs(found - force).max() < 1e-6 * force.max(), part


def test_force_equals_the_reaction_of_the_clamped_bottom():
    case = load_case("gelatin", {**OWN, "depth": "0.5 mm"}, dim=3)
    _, force, reaction = curve_of(case, block(quarter(6.0, 6.0, 8.0, 1.5))).T
    assert np.abs(reaction - force).max() < 1e-6 * force.max()


# -- one layer is plane strain -------------------------------------------------------------------


def one_layer(section: skfem.MeshTri, thickness: float) -> skfem.MeshTet:
    """One layer of prisms with names; its upright triangles are told apart by where their edge is."""
    n, mesh = section.p.shape[1], extruded(section, np.array([0.0, thickness]))
    outer = mesh.boundary_facets()
    x, y, z = mesh.p[:, mesh.facets[:, outer]]
    places = {"cut": x, "bottom": y, "top": y - section.p[1].max(), "front": z}
    faces = {name: outer[np.all(np.abs(v) < 1e-9, axis=0)] for name, v in places.items()}
    # Facets are numbered from the front: (a, b, b') and (a, a', b') make the rectangle over an edge.
    upright = {name: np.diff(mesh.facets[:, found], axis=0) == n for name, found in faces.items()}
    split = {f"{name} {i}": faces[name][upright[name][1 - i]] for name in ("cut", "top") for i in (0, 1)}
    return mesh.with_boundaries({**faces, **split})


class TiedSpace(spaces.Space):
    """Linear elements in one layer whose back follows its front, on faces the points of plane strain's.

    In such a layer linear tetrahedra hold exactly what linear triangles hold in the section.
    """

    @classmethod
    def build(cls, mesh, order):
        free = spaces.Space.build(mesh, order)
        n = free.X.shape[1] // 2
        return cls(mesh, order, free.X[:, :n], free.element_nodes % n, free._dofs)

    def faces(self, name, degree):
        n = self.X.shape[1]
        line, weight = spaces.face_quadrature(2, degree)
        r = line[0]
        # Points of the line spread over the triangle, each in the middle of its slice along z.
        rules = [(np.stack([r / 2, r / 2]), weight * r), (np.stack([(1 - r) / 2, r]), weight * (1 - r))]
        if name not in ("cut", "top"):
            found = super().faces(name, degree)
            return replace(found, nodes=found.nodes % n)
        parts = []
        for i, rule in enumerate(rules):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(spaces, "face_quadrature", lambda dim, degree, rule=rule: rule)
                parts.append(super().faces(f"{name} {i}", degree))
        arrays = {
            f.name: np.concatenate([getattr(part, f.name) for part in parts], axis=-1)
            for f in fields(spaces.Faces)
            if f.name != "name"
        }
        arrays["nodes"] = arrays["nodes"] % n
        corners = self.X[:2, arrays["nodes"]]
        arrays["size"] = np.hypot(*np.ptp(corners, axis=1))
        return spaces.Faces(name=name, **arrays)


@pytest.mark.parametrize(("normal", "law"), [("material", "viscous_degraded"), ("tool", "viscous")])
def test_one_layer_with_plane_strain_constraints_gives_the_plane_strain_curve(normal, law, monkeypatch):
    # With the degraded law the cut opens on the way and the force has fallen at the end.
    # On a mesh on which the snap is not decided by rounding.
    changes = {
        "element": "P1",
        "h": "0.6 mm",
        "corner": 0.125,
        "depth": "2.6 mm",
        "normal": normal,
        "with": law,
        # The window's iterations differ by rounding, and with them the steps.
        "predictor": "line",
        # A face of the section is two triangles of the layer, each with a mean pressure of its own to carry.
        **SOFT,
        # Tied nodes leave no triangles to bend; `cutbench verify` has a layer whose plane does.
        "without": "surface_gradient",
    }
    flat = load_case("gelatin", changes, dim=2)
    section = plane_strain.geometry(flat.values, flat.numerics)
    thickness = 0.5
    layer = Geometry(
        one_layer(section.mesh, thickness), section.height, section.multiplicity / thickness, (("front", 2),)
    )
    plane = curve_of(flat)
    monkeypatch.setattr(cutbench.run.build, "Space", TiedSpace)
    solid = curve_of(replace(flat, dim=3), layer)
    assert len(solid) == len(plane)
    assert plane[:, 1].max() > 0.3
    assert np.abs(solid - plane).max() < 1e-6 * plane[:, 1].max()


def test_pictures_need_snapshots_of_a_solid():
    case = load_case("gelatin", {"element": "P1", "h": "0.7 mm", "depth": "0.1 mm"})
    flat = run_case(case, snapshots_mm=[0.1])
    for draw in (plot_cut_plane, plot_front, plot_block):
        with pytest.raises(ValueError, match="solid"):
            draw(flat)
        with pytest.raises(ValueError, match="snapshots_mm"):
            draw(replace(flat, snapshots=[]))


def test_run3d_writes_what_run2d_writes_and_the_front(tmp_path):
    sets = [f"--set={key}={value}" for key, value in SMALL.items()]
    options = ["--h", "0.7", "--depth", "0.4", "--frames", "3", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, ["run3d", "gelatin", *sets, *options])
    assert done.exit_code == 0, done.output
    for name in ("curve.csv", "curve.png", "cut_plane.png", "front.png", "block.png", "plane_strain.png"):
        assert (tmp_path / name).stat().st_size > 100, name
    with Image.open(tmp_path / "cut_plane.gif") as film:
        assert film.n_frames == len(list((tmp_path / "frames").iterdir())) == 3
    record = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert record["case"]["dim"] == 3
    assert 0.3 < record["measures"]["end_effect_max"] < 1.2
    fields_of = meshio.read(sorted((tmp_path / "fields").glob("fields_*.vtu"))[-1])
    assert "tetra" in fields_of.cells_dict
    assert {"displacement_mm", "von_mises_MPa"} <= set(fields_of.point_data)
