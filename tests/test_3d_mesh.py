"""Meshes of the user's in three dimensions: read, refused with what is wrong; the blade along the block."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from refusals import refused

from cutbench.case.case import load_case
from cutbench.case.numerics import Fixed, Numerics
from cutbench.forms.base import Step
from cutbench.models3d.block import block, geometry
from cutbench.models3d.mesh import quarter
from cutbench.run.build import build

VALUES = {"width": 6.0, "height": 6.0, "length": 8.0, "thickness": 0.7}
SMALL = {
    "numerics": "tetrahedra", "width": "6 mm", "height": "6 mm", "length": "8 mm", "element": "P1",
    "depth": "0.5 mm",
}  # fmt: skip
NAMED = {
    "quarter": ("cut", "top", "bottom", "middle"),
    "half": ("cut", "top", "bottom"),
    "full": ("cut", "cut_minus", "top", "bottom"),
}


def raw(part="quarter", names=None, h=2.0):
    """Points, tetrahedra and named triangles of a block."""
    mesh = block(quarter(6.0, 6.0, 8.0, h), part).mesh
    names = NAMED[part] if names is None else names
    faces = {name: mesh.facets[:, mesh.boundaries[name]].T.copy() for name in names}
    return mesh.p.T.copy(), mesh.t.T.copy(), faces


def written(path, points, tets, faces, kind="tetra"):
    """A Gmsh file with physical groups, as its own mesher writes."""
    triangles = np.concatenate([*faces.values(), np.empty((0, 3), int)]).astype(int)
    tags = np.repeat(np.arange(1, len(faces) + 1), [len(f) for f in faces.values()])
    cells = [(kind, tets), ("triangle", triangles)]
    volume = np.full(len(tets), len(faces) + 1)
    data = {"gmsh:physical": [volume, tags], "gmsh:geometrical": [volume, tags]}
    field = {name: np.array([i + 1, 2]) for i, name in enumerate(faces)}
    field["block"] = np.array([len(faces) + 1, 3])
    mesh = meshio.Mesh(points, cells, cell_data=data, field_data=field)
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return str(path)


@pytest.mark.parametrize("part", NAMED)
def test_a_gmsh_file_gives_what_the_own_mesh_gives(tmp_path, part):
    path = written(tmp_path / "block.msh", *raw(part))
    read = geometry(VALUES, Numerics(mesh=path))
    own = geometry(VALUES, Numerics(h=Fixed(2.0, "mm"), corner=1.0, shallow=1.0, symmetry=part))
    assert (read.multiplicity, read.split, read.held) == (own.multiplicity, own.split, own.held)
    case = load_case("gelatin", SMALL, dim=3)
    forces = []
    for made in (read, block(quarter(6.0, 6.0, 8.0, 2.0), part)):
        built = build(case, made)
        forces.append([step.force for step in built.march])
    assert forces[0] == pytest.approx(forces[1], rel=1e-6)


def broken(what, points, tets, faces):
    y = points[:, 1]
    if what == "shifted":
        points[:, 0] += 1.0
    elif what == "inches":
        points /= 25.4
    elif what == "nan":
        points[3, 1] = np.nan
    elif what == "no top":
        del faces["top"]
    elif what == "half of the top":
        faces["top"] = faces["top"][::2]
    elif what == "top for bottom":
        faces["top"], faces["bottom"] = faces["bottom"], faces["top"]
    elif what == "hole":
        tets = np.delete(tets, len(tets) // 2, axis=0)
    elif what == "flat":
        tets[0, 1] = tets[0, 0]
    elif what == "torn":  # nodes of the upper part are doubled
        inner = [v for v in np.unique(y) if 0 < v < 6]
        across = [((y[tets].min(axis=1) < v) & (y[tets].max(axis=1) > v)).sum() for v in inner]
        level = inner[int(np.argmin(across))]
        upper = (y[tets] >= level - 1e-9).all(axis=1)
        seam = np.unique(tets[upper][y[tets[upper]] <= level + 1e-9])
        number = np.arange(len(points))
        number[seam] = len(points) + np.arange(seam.size)
        tets[upper] = number[tets[upper]]
        points = np.vstack([points, points[seam]])
    return points, tets, faces


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("shifted", "1 to 4"),
        ("inches", "0 to 0.11"),
        ("nan", "number"),
        ("no top", "middle"),
        ("half of the top", "'top'"),
        ("top for bottom", "6 mm"),
        ("hole", "72"),
        ("flat", "1 tetrahedra"),
        ("torn", ""),
    ],
)
def test_a_mesh_that_cannot_be_used_is_refused_with_the_reason(tmp_path, what, says):
    path = written(tmp_path / "block.msh", *broken(what, *raw()))
    with refused("mesh", file="block.msh") as error:
        geometry(VALUES, Numerics(mesh=path))
    assert says in f"{error.value.value} {error.value.expected}"


def test_the_file_must_hold_the_part_that_is_asked_for(tmp_path):
    path = written(tmp_path / "block.msh", *raw("half"))
    assert geometry(VALUES, Numerics(mesh=path, symmetry="half")).multiplicity == 2
    with refused("symmetry", value="quarter", hint="'half'"):
        geometry(VALUES, Numerics(mesh=path, symmetry="quarter"))
    with refused("mesh"):
        geometry({**VALUES, "tilt": 0.01}, Numerics(mesh=path))


def test_both_sides_of_a_split_must_match(tmp_path):
    points, tets, faces = raw("full")
    minus = (points[:, 0] < -1e-9) | np.isin(np.arange(len(points)), np.unique(faces["cut_minus"]))
    on_cut = minus & (np.abs(points[:, 0]) < 1e-9)
    inner = on_cut & (points[:, 1] > 0.5) & (points[:, 1] < 5.5) & (np.abs(points[:, 2]) < 3.5)
    points[inner, 1] += 0.05
    path = written(tmp_path / "block.msh", points, tets, faces)
    with refused("mesh"):
        geometry(VALUES, Numerics(mesh=path))


def test_other_elements_and_files_are_refused(tmp_path):
    points, _, faces = raw()
    path = tmp_path / "block.vtu"
    meshio.write(path, meshio.Mesh(points[:, :3], [("triangle", faces["top"])]))
    with refused("mesh", value="cells: triangle"):
        geometry(VALUES, Numerics(mesh=str(path)))
    path.write_text("nothing")
    with refused("mesh", value="block.vtu"):
        geometry(VALUES, Numerics(mesh=str(path)))


# -- the blade along the block -------------------------------------------------------------------


def forces(**changes):
    case = load_case("gelatin", {**SMALL, "h": "2 mm", "depth": "0.3 mm", **changes}, dim=3)
    built = build(case)
    found = [step.force * built.geometry.multiplicity for step in built.march]
    return np.array(found)


@pytest.mark.slow
def test_a_tilt_needs_the_full_block_and_does_not_know_left_from_right():
    assert build(load_case("gelatin", {**SMALL, "tilt": "2 deg", "h": "1.5 mm"}, dim=3)).geometry.split
    straight, left, right = forces(), forces(tilt="2 deg"), forces(tilt="-2 deg")
    assert left == pytest.approx(right, rel=1e-6)
    # The way there may be cut into other steps; where the blade stops is the same.
    assert abs(left[-1] - straight[-1]) > 1e-5 * straight[-1]
    almost = forces(tilt="0.001 deg")
    assert almost[-1] == pytest.approx(straight[-1], rel=1e-5)
    with refused("symmetry", value="quarter"):
        load_case("gelatin", {**SMALL, "tilt": "2 deg", "symmetry": "quarter"}, dim=3)
    with refused("tilt", value="2 deg"):
        load_case("gelatin", {"tilt": "2 deg"})


@pytest.mark.slow
def test_a_shorter_blade_meets_less_of_the_block():
    whole, longer, short = forces(), forces(overhang="3 mm"), forces(overhang="-2 mm")
    assert longer == pytest.approx(whole, rel=1e-12)
    assert 0.3 * whole[-1] < short[-1] < 0.9 * whole[-1]
    split = forces(overhang="-2 mm", symmetry="full")
    assert split[-1] == pytest.approx(short[-1], rel=1e-3)
    with refused("overhang", value="-4 mm"):
        load_case("gelatin", {**SMALL, "overhang": "-4 mm"}, dim=3)


@pytest.mark.slow
def test_an_inclined_blade_needs_both_ends_and_begins_at_the_low_one():
    straight, none = forces(), forces(incline="0 deg")
    assert np.array_equal(straight, none)
    almost = forces(incline="0.001 deg")
    assert almost[-1] == pytest.approx(straight[-1], rel=1e-3)
    up, down = forces(incline="1 deg"), forces(incline="-1 deg")
    assert up[-1] == pytest.approx(down[-1], rel=1e-3)
    assert 0.2 * straight[-1] < up[-1] < 0.9 * straight[-1]
    changes = {**SMALL, "h": "2 mm", "depth": "0.1 mm", "incline": "3 deg"}
    built = build(load_case("gelatin", changes, dim=3))
    assert built.geometry.multiplicity == 2.0
    (*_, last) = built.march
    (form,) = built.blades
    pressed = form.faces.X[2][last.states[form.name]["pressure"] > 0]
    # The edge is 0.1 mm deep at the low end, z = -4 mm, and at the top 0.1 mm / tan 3 deg from there.
    assert pressed.min() >= -4.0 and pressed.max() < -4.0 + 0.1 / np.tan(np.radians(3)) + 0.2
    with refused("symmetry", value="quarter"):
        load_case("gelatin", {**changes, "symmetry": "quarter"}, dim=3)
    with refused("incline", value="3 deg"):
        load_case("gelatin", {"incline": "3 deg"})


@pytest.mark.parametrize("normal", ["tool", "material"])
def test_the_tangent_of_a_tilted_blade_is_the_derivative_of_its_forces(normal):
    changes = {**SMALL, "h": "2 mm", "tilt": "7 deg", "incline": "3 deg", "overhang": "-0.5 mm"}
    changes |= {"normal": normal, "mu": "0.3"}
    case = load_case("gelatin", changes, dim=3)
    built = build(case)
    rng = np.random.default_rng(3)
    ndof = built.problem.ndof
    u = 0.02 * rng.standard_normal(ndof)
    old = 0.02 * rng.standard_normal(ndof)
    centre = np.array([0.0, case.p.height - 0.4, 0.0])
    step = Step(1.0, old, centre, centre + np.array([0.0, 0.05, 0.0]))
    checked = 0
    for form in built.blades:
        state = form.start(built.problem.p)
        state["touched"] = np.ones_like(state["touched"])
        local = form.evaluate(u, built.problem.p, state, step)
        if not np.abs(local.vector).max() > 0:
            continue
        way = rng.standard_normal(ndof)
        slope = np.einsum("abn,bn->an", local.matrix, way[form.dofs])
        e = 1e-6
        ahead, behind = (form.evaluate(u + s * e * way, built.problem.p, state, step) for s in (1, -1))
        difference = (ahead.vector - behind.vector) / (2 * e)
        assert np.abs(slope - difference).max() < 2e-4 * np.abs(difference).max()
        checked += 1
    assert checked >= 1
