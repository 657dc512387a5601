"""Meshes of the user's in the plane: read as the same built in, or refused with what is wrong."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
import skfem
from refusals import refused
from skfem.io.meshio import to_file

from cutbench.base.errors import BadInput
from cutbench.case.case import load_case
from cutbench.models2d.section import half_block
from cutbench.models2d.usermesh import read_mesh
from cutbench.run.runner import run_case

W, H = 10.0, 6.0
LINES = ("cut", "top", "bottom")


def tagged(mesh: skfem.MeshTri, lines=LINES) -> meshio.Mesh:
    """As gmsh would hand it over: lines with physical names, z = 0."""
    facets = [mesh.facets[:, np.asarray(mesh.boundaries[name])] for name in lines]
    tags = np.concatenate([np.full(f.shape[1], i + 1) for i, f in enumerate(facets)]).astype(np.int32)
    body = np.full(mesh.nelements, 9, np.int32)
    return meshio.Mesh(
        np.column_stack([mesh.p.T, np.zeros(mesh.p.shape[1])]),
        [("line", np.hstack(facets).T), ("triangle", mesh.t.T)],
        cell_data={"gmsh:physical": [tags, body], "gmsh:geometrical": [tags, body]},
        field_data={**{name: np.array([i + 1, 1]) for i, name in enumerate(lines)}, "body": np.array([9, 2])},
    )


def write_msh2(mesh, path: Path) -> Path:
    mesh = mesh if isinstance(mesh, meshio.Mesh) else tagged(mesh)
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


def write_msh4(mesh: skfem.MeshTri, path: Path) -> Path:
    """Gmsh's own format 4.1: entities carry the physical names, elements belong to entities."""
    box = f"0 0 0 {W / 2} {H} 0"
    text = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", "4"]
    text += [f'1 {i + 1} "{name}"' for i, name in enumerate(LINES)]
    text += ['2 9 "body"', "$EndPhysicalNames", "$Entities", "0 3 1 0"]
    text += [f"{i + 1} {box} 1 {i + 1} 0" for i in range(3)]
    text += [f"1 {box} 1 9 0", "$EndEntities", "$Nodes"]
    n = mesh.p.shape[1]
    text += [f"1 {n} 1 {n}", f"2 1 0 {n}", *(str(i + 1) for i in range(n))]
    text += [f"{x!r} {y!r} 0" for x, y in mesh.p.T.tolist()]
    text += ["$EndNodes", "$Elements"]
    lines = [mesh.facets[:, mesh.boundaries[name]].T + 1 for name in LINES]
    total = sum(map(len, lines)) + mesh.nelements
    text.append(f"4 {total} 1 {total}")
    count = 0
    for dim, tag, kind, cells in [*((1, i + 1, 1, c) for i, c in enumerate(lines)), (2, 1, 2, mesh.t.T + 1)]:
        text.append(f"{dim} {tag} {kind} {len(cells)}")
        for cell in cells:
            count += 1
            text.append(" ".join(map(str, (count, *cell))))
    path.write_text("\n".join([*text, "$EndElements", ""]))
    return path


def write_vtu(mesh: skfem.MeshTri, path: Path) -> Path:
    to_file(mesh, str(path))
    return path


@pytest.fixture(scope="module")
def section():
    return half_block(W, H, 0.6, corner=0.6 / 16)  # shallow = 1, one mesh


@pytest.fixture(scope="module")
def small():
    """A case on the section's block, short enough for a test, long enough for the blade to press in."""
    return load_case("gelatin").set(width=f"{W} mm", height=f"{H} mm", h="0.6 mm", shallow=1, depth="0.4 mm")


@pytest.fixture(scope="module")
def built_in(small):
    return run_case(small)


@pytest.mark.parametrize(
    ("suffix", "write"), [(".msh", write_msh2), (".msh", write_msh4), (".vtu", write_vtu)]
)
def test_a_file_gives_the_curve_of_the_same_mesh_built_in(section, small, built_in, tmp_path, suffix, write):
    file = write(section, tmp_path / f"block{suffix}")
    result = run_case(small.set(mesh=str(file)))
    assert result.outcome.done
    assert built_in.force_N[-1] > 0.01
    for name, column in built_in.curve.items():
        np.testing.assert_array_equal(result.curve[name], column, err_msg=name)


def test_points_of_the_drawing_that_belong_to_no_triangle_are_left_out(section, small, built_in, tmp_path):
    raw = tagged(section)
    extra = np.vstack([[[2.0, 9.0, 0.0]], raw.points, [[-4.0, 1.0, 0.0]]])
    cells = [("vertex", np.array([[0]])), *((b.type, b.data + 1) for b in raw.cells)]
    data = {k: [np.array([1], np.int32), *v] for k, v in raw.cell_data.items()}
    drawn = meshio.Mesh(extra, cells, cell_data=data, field_data=raw.field_data)
    file = write_msh2(drawn, tmp_path / "b.msh")
    np.testing.assert_array_equal(run_case(small.set(mesh=str(file))).force_N, built_in.force_N)


def test_triangles_may_run_either_way_round(section, tmp_path):
    turned = lined(skfem.MeshTri(section.p, section.t[[0, 2, 1]]))
    mesh = read_mesh(str(write_msh2(turned, tmp_path / "b.msh")), W, H)
    a, b = mesh.p[:, mesh.t[1:]].swapaxes(0, 1) - mesh.p[:, mesh.t[0]][None]
    assert np.abs(a[0] * b[1] - a[1] * b[0]).sum() / 2 == pytest.approx(W / 2 * H)


def where(x, name):
    return {"cut": x[0] < 1e-9, "top": x[1] > H - 1e-9, "bottom": x[1] < 1e-9}[name]


def triangles(points, cells):
    """A mesh in a meshio object with its outline named, whatever is wrong with it."""
    return skfem.MeshTri(np.array(points, float).T, np.array(cells).T)


def lined(mesh: skfem.MeshTri) -> meshio.Mesh:
    return tagged(
        mesh.with_boundaries(
            {n: mesh.facets_satisfying(lambda x, n=n: where(x, n), boundaries_only=True) for n in LINES}
        )
    )


def no_names(section):
    raw = tagged(section)
    return meshio.Mesh(raw.points, raw.cells)


def cut_missing(section):
    return tagged(section, ("top", "bottom"))


def cut_on_the_side(section):
    moved = {**section.boundaries, "cut": section.boundaries["side"]}
    return tagged(skfem.MeshTri(section.p, section.t).with_boundaries(moved))


def half_a_cut(section):
    cut = section.boundaries["cut"]
    return tagged(section.with_boundaries({**section.boundaries, "cut": cut[: len(cut) // 2]}))


def in_metres(section):
    return tagged(skfem.MeshTri(section.p / 1000, section.t).with_boundaries(section.boundaries))


def other_height(section):
    return tagged(skfem.MeshTri(section.p * [[1], [1.5]], section.t).with_boundaries(section.boundaries))


def other_width(section):
    return tagged(skfem.MeshTri(section.p * [[1.5], [1]], section.t).with_boundaries(section.boundaries))


def left_half(section):
    return tagged(skfem.MeshTri(section.p * [[-1], [1]], section.t).with_boundaries(section.boundaries))


def quads(section):
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, W / 2, 5), np.linspace(0, H, 5))
    return meshio.Mesh(np.column_stack([mesh.p.T, np.zeros(25)]), [("quad", mesh.t.T)])


def a_quad_among_triangles(section):
    raw = tagged(section)
    some = np.array([[0, 1, 2, 3]])
    data = {k: [*v, np.array([9], np.int32)] for k, v in raw.cell_data.items()}
    return meshio.Mesh(raw.points, [*raw.cells, ("quad", some)], cell_data=data, field_data=raw.field_data)


def tetrahedra(section):
    mesh = skfem.MeshTet()
    return meshio.Mesh(mesh.p.T, [("tetra", mesh.t.T)])


def bent(section):
    raw = tagged(section)
    raw.points[:, 2] = raw.points[:, 0] ** 2
    return raw


def nodes_not_merged(section):
    """Upper and lower part, one triangle pair each, that meet but share no node."""
    w, m = W / 2, H / 2
    points = [(0, 0), (w, 0), (0, m), (w, m), (0, m), (w, m), (0, H), (w, H)]
    return lined(triangles(points, [(0, 1, 2), (1, 3, 2), (4, 5, 6), (5, 7, 6)]))


def a_hanging_node(section):
    w, m = W / 2, H / 2
    points = [(0, 0), (w, 0), (0, m), (w, m), (0, H), (w, H), (w / 2, m)]
    return lined(triangles(points, [(0, 1, 2), (1, 3, 2), (2, 6, 4), (6, 3, 5), (6, 5, 4)]))


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (no_names, "none"),
        (cut_missing, "cut missing"),
        (cut_on_the_side, "5 mm"),
        (half_a_cut, "'cut'"),
        (in_metres, "width"),
        (other_height, "specimen's height"),
        (other_width, "5 mm"),
        (left_half, "half"),
        (quads, "cells: quad"),
        (a_quad_among_triangles, "three-node triangles"),
        (tetrahedra, "cells: tetra"),
        (bent, "a plane mesh"),
        (nodes_not_merged, "2 parts"),
        (a_hanging_node, "conforming"),
    ],
)  # fmt: skip
def test_a_mesh_that_does_not_fit_is_refused(section, small, tmp_path, wrong, named):
    file = write_msh2(wrong(section), tmp_path / "block.msh")
    with pytest.raises(BadInput) as caught:
        run_case(small.set(mesh=str(file)))
    error = caught.value
    assert (error.file, error.key) == (str(file), "mesh")
    assert named in str(error)


TRUNCATED = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 2"


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("block.foo", "what is this?", ".msh"),
        ("block", "no suffix", ".msh"),
        ("block.msh", "not a mesh\n", "block"),
        ("block.msh", TRUNCATED, "block"),
        ("block.msh", "", "block"),
        ("block.vtu", "<VTKFile", "block"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_read_is_refused(small, tmp_path, capfd, name, content, named):
    file = tmp_path / name
    file.write_text(content)
    with refused("mesh") as caught:
        run_case(small.set(mesh=str(file)))
    assert named in str(caught.value)
    out, err = capfd.readouterr()
    assert (out, err) == ("", ""), "the message is the only one"


def test_a_mesh_file_holds_a_half(section, small, tmp_path):
    file = write_msh2(section, tmp_path / "block.msh")
    with refused("symmetry", value="full"):
        run_case(small.set(mesh=str(file), symmetry="full"))
