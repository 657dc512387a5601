"""Pictures of blocks: what they show as data, with PyVista and without it, and drawn again from files."""

from __future__ import annotations

import json
import re
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from coarse_runs import SOFT
from matplotlib.collections import PolyCollection
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.models3d.block import PARTS
from cutbench.run.figures import view
from cutbench.run.figures.block_page import block_contents
from cutbench.run.figures.block_picture import plot_solid
from cutbench.run.figures.cut_open import columns_of, cut_open, whole_columns
from cutbench.run.figures.motion import save_frames
from cutbench.run.figures.solid import plot_front
from cutbench.run.files import write_run
from cutbench.run.paraview import read_fields, write_fields
from cutbench.run.result import Snapshot
from cutbench.run.runner import run_case

WIDTH, HEIGHT, LENGTH = 6.0, 6.0, 8.0
SHIFT = np.array([0.1, 0.2, 0.3])


def small(**values):
    given = {"width": "6 mm", "height": "6 mm", "length": "8 mm", "element": "P1", "h": "0.7 mm"}
    return load_case("gelatin", {**given, **SOFT, "cohesion": 0.5, "tip": "3.5 mm", **values}, dim=3)


@pytest.fixture(scope="module", name="cut")
def a_cut_block():
    return run_case(small(depth="0.5 mm"), snapshots_mm=[0.2, 0.5])


@pytest.fixture(name="bare")
def without_pyvista(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)


def slanted(z, height=5.0):
    """A snapshot whose cut plane is cut to ``height`` + z/4 at z, and moved by SHIFT."""
    y = np.linspace(0, HEIGHT, 61)
    X = np.array([(0.0, b, a) for a in z for b in y])
    damage = np.clip(0.5 + (X[:, 1] - height - X[:, 2] / 4) / 0.5, 0, 1)
    return Snapshot(
        1.0, np.array([[0.0, 0, min(z)], [3, 6, max(z)]]), np.empty((0, 4), int), "tetra",
        faces={"cut": {"X": X, "x": X + SHIFT, "damage": damage}},
    )  # fmt: skip


def test_the_front_is_where_half_of_the_cohesion_is_lost():
    columns = columns_of(slanted(np.linspace(-2, 2, 5)))
    assert np.allclose(columns.depth_mm, 1 - columns.z / 4)
    expected = np.column_stack([0 * columns.z, 5 + columns.z / 4, columns.z]) + SHIFT
    assert np.allclose(columns.front(), expected)
    assert np.allclose(columns.damage_at(np.array([0.5, 0.5]), np.array([5.125, 1.0])), [0.5, 0.0])


def test_the_front_of_scattered_points_is_read_in_planes():
    s = slanted(np.linspace(-2, 2, 60))
    cut = s.faces["cut"]
    cut["X"][:, 2] += 1e-4 * np.sin(np.arange(len(cut["X"])))  # no two in one plane
    columns = columns_of(s)
    assert np.allclose(columns.depth_mm, 1 - columns.z / 4, atol=0.01)


def test_of_a_quarter_both_halves_are_shown_and_the_middle_once():
    columns = whole_columns(slanted(np.array([0.0, 1.0, 2.0])))
    assert columns.z.tolist() == [-2, -1, 0, 1, 2]
    assert np.allclose(columns.depth_mm, 1 - np.abs(columns.z) / 4)
    assert np.allclose(columns.front()[:, 2], [-2.3, -1.3, 0.3, 1.3, 2.3])


@pytest.mark.parametrize("part", PARTS)
def test_of_every_part_the_whole_side_is_shown_as_a_closed_surface(part):
    case = small(depth="0.1 mm", symmetry=part)
    block = cut_open(run_case(case, snapshots_mm=[0.1]).snapshots[-1], case)
    a, b, c = (block.reference[np.concatenate([block.cut, block.skin])[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(WIDTH / 2 * HEIGHT * LENGTH)
    a, b, c = (block.reference[block.cut[:, k]] for k in range(3))
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(HEIGHT * LENGTH)
    outline = block.reference[block.edges]
    assert np.linalg.norm(np.diff(outline, axis=1), axis=2).sum() == pytest.approx(4 * (3 + 6 + 8))
    # The far half of the blade, its tip where the travel says.
    assert block.blade_points[:, 1].min() == pytest.approx(HEIGHT - 0.1)
    assert np.allclose([block.blade_points[:, 2].min(), block.blade_points[:, 2].max()], [-LENGTH / 2, 0])


def lines_called(axes, name):
    return [line for line in axes.lines if line.get_gid() == name]


def test_without_pyvista_matplotlib_draws(cut, bare):
    figure = plot_solid(cut)
    front = cut_open(cut.snapshots[-1], cut.case).front
    for axes in figure.axes[:2]:
        assert any(isinstance(each, PolyCollection) for each in axes.collections)
        (line,) = [line for line in axes.lines if line.get_gid() == "front"]
        assert np.allclose(line.get_xydata(), view.View().flat(front))


def test_what_fails_to_render_is_drawn_by_matplotlib_and_the_reason_is_said_once(cut, monkeypatch, caplog):
    pyvista = pytest.importorskip("pyvista")

    def broken(*args, **kwargs):
        raise RuntimeError("no EGL here")

    monkeypatch.setattr(pyvista.Plotter, "screenshot", broken)
    assert not any(axes.images for _ in range(2) for axes in plot_solid(cut).axes[:2])
    assert caplog.messages == [view.STANDS_IN.format("no EGL here")]


def test_with_pyvista_an_image_fills_the_axes_and_the_nearer_surface_is_seen(cut):
    pytest.importorskip("pyvista")
    square = np.array([[0.0, -1, -1], [0, -1, 1], [0, 1, 1], [0, 1, -1]])
    triangles, none = np.array([[0, 1, 2], [0, 2, 3]]), np.empty((0, 2), dtype=int)
    red, green = (np.tile(colour, (4, 1)) for colour in ([1.0, 0, 0], [0, 1.0, 0]))
    looked = view.View((-1.0, 0.2, 0.0))
    surfaces = [
        view.Surface(square - [1, 0, 0], triangles, red, none),
        view.Surface(square, triangles, green, none),
    ]
    try:
        image = view.rendered(looked, surfaces, (-2, 2, -2, 2), 20)
    except view.NoPyVista as why:
        pytest.skip(str(why))
    assert image.shape == (80, 80, 4)
    assert image[40, 40, 0] > 100 and image[40, 40, 1] < 20 and image[2, 2, 3] == 0
    for axes in plot_solid(cut).axes[:2]:
        (shown,) = axes.images
        assert np.allclose(shown.get_extent(), [*axes.get_xlim(), *axes.get_ylim()])


@pytest.mark.slow
def test_both_sides_of_a_split_block_are_read_again(tmp_path):
    case = small(depth="0.2 mm", symmetry="full", precut="0.5 mm")
    snapshot = run_case(case, snapshots_mm=[0.2]).snapshots[-1]
    write_fields([snapshot], tmp_path, case)
    (again,) = read_fields(tmp_path)
    assert list(again.faces) == list(snapshot.faces) == ["top", "cut", "cut_minus"]
    assert np.array_equal(columns_of(again).depth_mm, columns_of(snapshot).depth_mm)
    assert columns_of(again).depth_mm.min() > 0.3


def test_the_front_is_drawn_to_its_own_scale(cut):
    axes = plot_front(cut).axes[0]
    depth = whole_columns(cut.snapshots[-1]).depth_mm
    assert depth.max() > 0.05
    assert np.allclose(axes.lines[-1].get_ydata(), depth)
    low, high = axes.get_ylim()
    assert high == 0 and depth.max() < low < 1.2 * depth.max()


def test_the_page_has_a_step_a_travel_of_one_mesh_and_asks_nobody(cut, bare, tmp_path):
    found = block_contents(cut)
    block = cut_open(cut.snapshots[-1], cut.case)
    assert [step["travel"] for step in found["steps"]] == [f"{s.displacement_mm:.2f}" for s in cut.snapshots]
    last = found["steps"][-1]
    assert np.allclose(last["points"], block.points, atol=1e-3)
    assert np.allclose(last["front"], block.front, atol=1e-3)
    assert np.allclose(last["stress"], block.stress_kPa, atol=1e-2)
    (mesh,) = found["meshes"]
    assert np.allclose(last["damage"], block.damage[mesh["cutNodes"]], atol=1e-3)
    for step in found["steps"]:
        assert len(step["points"]) == np.max(mesh["skin"] + mesh["cut"]) + 1
        assert len(step["blade"]) == np.max(found["blade"]) + 1 == 2 * found["loop"] + 2
    page = write_run(cut, tmp_path)["solid_html"].read_text(encoding="utf-8")
    assert json.loads(re.search('type="application/json">(.*?)</script>', page)[1]) == json.loads(
        json.dumps(found)
    )
    assert not re.search(r"<(?:script|link|img)[^>]*(?:src|href)=", page) and "default-src 'none'" in page


def test_pictures_of_a_run_that_went_from_mesh_to_mesh(cut, bare, tmp_path):
    coarse = run_case(small(depth="0.2 mm", h="0.6 mm"), snapshots_mm=[0.2])
    both = replace(cut, snapshots=[*coarse.snapshots, *cut.snapshots[1:]], frames=[])
    found = block_contents(both)
    assert [step["mesh"] for step in found["steps"]] == [0, 1]
    for step in found["steps"]:
        mesh = found["meshes"][step["mesh"]]
        assert len(step["points"]) == np.max(mesh["skin"] + mesh["cut"]) + 1
        assert len(step["damage"]) == len(mesh["cutNodes"])
    written = write_run(both, tmp_path)
    assert written["solid_html"].exists() and (tmp_path / "solid.png").exists()
    # The animation goes over the same meshes.
    moving = replace(both, frames=both.snapshots)
    assert save_frames(moving, tmp_path)


def test_pictures_are_drawn_again_from_the_files(cut, bare, tmp_path):
    write_run(cut, tmp_path)
    for old, new in zip(cut.snapshots, read_fields(tmp_path), strict=True):
        assert new.displacement_mm == pytest.approx(old.displacement_mm)
        assert new.faces.keys() == old.faces.keys()
        assert np.array_equal(new.current, old.current)
        assert np.array_equal(new.faces["cut"]["damage"], old.faces["cut"]["damage"])
        assert np.allclose(new.faces["cut"]["x"], old.faces["cut"]["x"], rtol=0, atol=1e-14)
    names = ("solid.png", "solid.html", "front.png", "cut_plane.png")
    for name in names:
        (tmp_path / name).unlink()
    done = CliRunner().invoke(app, ["plot", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert all((tmp_path / name).stat().st_size > 1000 for name in names)


def test_a_field_file_that_cannot_be_read_is_named(cut, bare, tmp_path):
    write_run(cut, tmp_path)
    (tmp_path / "fields" / "faces_0001.vtu").write_text("torn")
    done = CliRunner().invoke(app, ["plot", str(tmp_path)])
    assert done.exit_code == 2 and "faces_0001.vtu" in done.output
    shutil.rmtree(tmp_path / "fields")
    assert CliRunner().invoke(app, ["plot", str(tmp_path)]).exit_code == 0
