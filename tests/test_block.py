"""The block in three dimensions: mesh, symmetry, one layer against plane strain, the front, the command."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
import skfem
from coarse_runs import SOFT
from typer.testing import CliRunner

import cutbench.run.build
from cutbench.base.errors import BadInput
from cutbench.case.case import load_case
from cutbench.case.numerics import Numerics
from cutbench.cli.main import app
from cutbench.forms import space as spaces
from cutbench.forms.geometry import Geometry
from cutbench.models2d import plane_strain
from cutbench.models3d.block import PARTS, block, geometry
from cutbench.models3d.mesh import length_along, mirrored, quarter, tetrahedra
from cutbench.run.build import build
from cutbench.run.figures.solid import plot_block, plot_cut_plane, plot_front
from cutbench.run.front import FRONT, ONSET_MM, Front, end_effect
from cutbench.run.runner import run_case

WIDTH, HEIGHT, LENGTH = 30.0, 21.0, 30.0
VALUES = {"width": WIDTH, "height": HEIGHT, "length": LENGTH, "thickness": 0.7}
#: A block so small that a run of it takes seconds.
SMALL = {"width": "6 mm", "height": "6 mm", "length": "8 mm", "element": "P1"}


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
    mesh = geometry(VALUES, Numerics(h_mm=0.85, corner=1.0, shallow=1.0, slender=1.0, along=1.25)).mesh
    assert 10_000 < mesh.t.shape[1] < 12_000


@pytest.mark.parametrize("h", [0.75, 0.7, 0.65, 0.35])
def test_no_size_needs_far_more_elements_than_its_neighbours(h):
    mesh = geometry(VALUES, Numerics(h_mm=h, corner=1.0, shallow=1.0, slender=1.0, along=1.25)).mesh
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
    assert geometry(values, Numerics(h_mm=2.0)).multiplicity == 4
    assert geometry(values, Numerics(h_mm=2.0)).held == (("middle", 2),)
    assert geometry(values, Numerics(h_mm=2.0, symmetry="half")).multiplicity == 2
    full = geometry(values, Numerics(h_mm=2.0, symmetry="full"))
    assert (full.multiplicity, full.split, full.held) == (1, True, ())


def test_what_a_block_cannot_be_is_refused():
    with pytest.raises(BadInput, match="symmetry"):
        plane_strain.geometry({"width": 6.0, "height": 6.0, "length": 8.0}, Numerics(symmetry="quarter"))
    with pytest.raises(BadInput, match="mesh"):
        geometry({"width": 6.0, "height": 6.0, "length": 8.0}, Numerics(mesh="block.msh"))
    with pytest.raises(ValueError, match="quarter, half, full"):
        block(quarter(6.0, 6.0, 8.0, 2.0), "eighth")


# -- runs --------------------------------------------------------------------------------------


def curve_of(case, geometry=None):
    """Travel, force and reaction (steps, 3) of the whole block."""
    built = build(case, geometry)
    rows = [(s.travel, s.force, s.reaction) for s in built.march]
    return np.array(rows) * np.array([1.0, built.geometry.multiplicity, built.geometry.multiplicity])


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_quarter_half_and_full_block_agree_through_the_onset(element):
    # Weak enough for the cut to open abruptly half way.
    values = {**SMALL, **SOFT, "element": element, "G_c": "1.2 J/m^2", "depth": "1.2 mm"}
    case = load_case("gelatin", values, dim=3)
    mesh = quarter(6.0, 6.0, 8.0, 2.0)
    curves = {part: curve_of(case, block(mesh, part)) for part in PARTS}
    travel, force, _ = curves["quarter"].T
    assert force[-1] < 0.7 * force.max()
    for part in ("half", "full"):
        found = np.interp(travel, *curves[part][:, :2].T)
        assert np.abs(found - force).max() < 1e-6 * force.max(), part


def test_force_equals_the_reaction_of_the_clamped_bottom():
    case = load_case("gelatin", {**SMALL, "depth": "0.5 mm"}, dim=3)
    _, force, reaction = curve_of(case, block(quarter(6.0, 6.0, 8.0, 1.5))).T
    assert np.abs(reaction - force).max() < 1e-6 * force.max()


# -- one layer is plane strain -------------------------------------------------------------------


def extruded(section: skfem.MeshTri, thickness: float) -> skfem.MeshTet:
    """One layer of prisms, each cut into three tetrahedra; nodes of the back follow those of the front."""
    n = section.p.shape[1]
    a, b, c = np.sort(section.t, axis=0)
    p = np.vstack([np.tile(section.p, 2), np.repeat([0.0, thickness], n)])
    cells = [(a, b, c, c + n), (a, b, b + n, c + n), (a, a + n, b + n, c + n)]
    mesh = tetrahedra(p, np.hstack([np.stack(cell) for cell in cells]))
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
        "layer": 0.0,
    }
    flat = load_case("gelatin", changes, dim=2)
    section = plane_strain.geometry(flat.values, flat.numerics)
    thickness = 0.5
    layer = Geometry(
        extruded(section.mesh, thickness), section.height, section.multiplicity / thickness, (("front", 2),)
    )
    plane = curve_of(flat)
    monkeypatch.setattr(cutbench.run.build, "Space", TiedSpace)
    solid = curve_of(replace(flat, dim=3), layer)
    assert len(solid) == len(plane)
    assert plane[:, 1].max() > 0.3
    assert np.abs(solid - plane).max() < 1e-6 * plane[:, 1].max()


# -- the front -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def built():
    case = load_case("gelatin", {**SMALL, "depth": "0.1 mm"}, dim=3)
    return build(case, block(quarter(6.0, 6.0, 8.0, 1.0)))


def made_up(built, travel, damage):
    """A step with displacements at rest and this damage on the cut plane."""
    states = built.problem.start()
    states["cohesion"]["damage"] = damage
    return SimpleNamespace(travel=travel, u=np.zeros(built.problem.ndof), states=states)


def test_front_finds_where_the_cut_starts_and_how_fast_it_runs(built):
    front = Front(built, strips=4)
    faces = built.form("cohesion").faces
    z, y = np.abs(faces.X[2]).ravel(), faces.X[1].ravel()
    # The front lies at a depth of travel − 1 − z/2: it runs sideways by 2 mm per mm of blade travel.
    for travel in np.linspace(0, 4.5, 451):
        front.add(made_up(built, travel, (6.0 - y < travel - 1 - z / 2).astype(float)))
    found = front.measures()
    assert front.z == pytest.approx([0.5, 1.5, 2.5, 3.5])
    assert found["front_start_z_mm"] == 0.5
    assert found["front_start_mm"] == found["front_centre_mm"]
    # Quadrature points are discrete: the depth that they see is that of an element at the most off.
    assert found["front_centre_mm"] == pytest.approx(1 + front.z[0] / 2 + ONSET_MM, abs=0.2)
    assert found["front_edge_mm"] == pytest.approx(1 + front.z[-1] / 2 + ONSET_MM, abs=0.2)
    assert found["front_lateral_speed"] == pytest.approx(2.0, rel=0.1)
    assert front.lengths(made_up(built, 9.0, np.ones(y.size))) == pytest.approx([6.0] * 4)
    assert found.keys() == FRONT.keys()


def test_stress_is_read_in_the_process_zone_only(built):
    front = Front(built, strips=2)
    faces = built.form("cohesion").faces
    z, y = np.abs(faces.X[2]).ravel(), faces.X[1].ravel()
    rng = np.random.default_rng(1)
    step = made_up(built, 1.0, np.where(z < 2, np.where(y > 5, 1.0, 0.5), 0.0))
    step.u[:] = 1e-3 * rng.standard_normal(step.u.size)
    front.add(step)
    found = front.measures()
    assert found["front_von_mises_start_MPa"] > 0
    assert np.isnan(found["front_von_mises_running_MPa"])
    whole = Front(built, strips=2)
    whole.add(replace_damage(step, np.where(z < 2, 1.0, 0.0)))
    assert np.isnan(whole.measures()["front_von_mises_start_MPa"])  # no process zone, no front


def replace_damage(step, damage):
    states = {**step.states, "cohesion": {**step.states["cohesion"], "damage": damage}}
    return SimpleNamespace(travel=step.travel, u=step.u, states=states)


def test_an_uncut_block_has_no_front(built):
    front = Front(built)
    front.add(made_up(built, 1.0, np.zeros(built.form("cohesion").faces.w.size)))
    assert all(np.isnan(value) for value in front.measures().values())


def test_end_effect_is_the_ratio_of_the_two_runs():
    found = end_effect({"peak_N": 1.0, "steady_N": 2.0}, {"peak_N": 2.0, "steady_N": float("nan")})
    assert found["end_effect_peak"] == 0.5
    assert np.isnan(found["end_effect_steady"])
    assert set(found) == {f"end_effect_{stage}" for stage in ("peak", "max", "steady", "slope", "onset")}


# -- pictures and the command ----------------------------------------------------------------------


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
    options = ["--h", "0.7", "--depth", "0.4", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, ["run3d", "gelatin", *sets, *options])
    assert done.exit_code == 0, done.output
    for name in ("curve.csv", "curve.png", "cut_plane.png", "front.png", "block.png", "plane_strain.png"):
        assert (tmp_path / name).stat().st_size > 100, name
    record = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert record["case"]["dim"] == 3
    assert 0.3 < record["measures"]["end_effect_max"] < 1.2
    fields_of = meshio.read(sorted((tmp_path / "fields").glob("fields_*.vtu"))[-1])
    assert "tetra" in fields_of.cells_dict
    assert {"displacement_mm", "von_mises_MPa"} <= set(fields_of.point_data)
