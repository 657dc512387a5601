"""Pictures of a cut in motion: spread over the run however far it goes, and files that show it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import meshio
import numpy as np
import pytest
from coarse_runs import QUICK
from made_up_runs import made_up_result, made_up_snapshot
from PIL import Image
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.run.blade_geometry import blade_mesh
from cutbench.run.fields import Frames
from cutbench.run.figures.motion import save_frames
from cutbench.run.files import write_run
from cutbench.run.result import Snapshot
from cutbench.run.runner import run_case

COUNT = 5


def bare(time_s: float) -> Snapshot:
    return Snapshot(time_s, np.zeros((1, 3)), np.zeros((1, 3), int), "triangle", time_s=time_s)


@pytest.mark.parametrize("steps", [30, 77, 400, 2000])
@pytest.mark.parametrize("uneven", [0.0, 0.9])
def test_frames_are_spread_evenly_wherever_the_run_ends(steps, uneven):
    rng = np.random.default_rng(steps)
    times = np.cumsum(1 + uneven * rng.uniform(-1, 1, steps))
    album = Frames(COUNT)
    for time_s in times:
        if album.wants(time_s):
            album.add(bare(time_s))
        assert len(album.kept) <= 4 * COUNT
    chosen = [s.time_s for s in album.ended(times[-1], lambda: bare(times[-1]))]
    meant = times[-1] * np.arange(1, COUNT + 1) / COUNT
    assert np.abs(chosen - meant).max() < 0.3 * times[-1] / COUNT
    assert chosen[-1] == times[-1] and (np.diff(chosen) > 0).all()


def test_a_run_of_few_steps_has_them_all():
    album = Frames(COUNT)
    for time_s in (1.0, 2.0, 3.0):
        album.add(bare(time_s))
    assert [s.time_s for s in album.ended(3.0, None)] == [1.0, 2.0, 3.0]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run, its fields kept and written."""
    result = run_case(QUICK.set(depth="0.6 mm"), frames=COUNT)
    folder = tmp_path_factory.mktemp("run")
    write_run(result, folder)
    return result, folder


def series(folder, kind):
    sets = ET.parse(folder / f"{kind}.pvd").getroot().findall("Collection/DataSet")
    return [(float(s.get("timestep")), meshio.read(folder / s.get("file"))) for s in sets]


@pytest.mark.slow
def test_a_run_has_so_many_frames_of_rising_travel_and_no_less_to_say(run):
    result, _ = run
    travel = [s.displacement_mm for s in result.frames]
    assert len(travel) == COUNT and (np.diff(travel) > 0).all()
    assert travel[-1] == pytest.approx(0.6)
    plain = run_case(QUICK.set(depth="0.6 mm"))
    assert not plain.frames
    np.testing.assert_array_equal(plain.force_N, result.force_N)


def test_pictures_and_animation_have_all_frames(run):
    _, folder = run
    pictures = sorted(p.name for p in (folder / "frames").iterdir())
    assert pictures == [f"frame-{i:03d}.png" for i in range(COUNT)]
    with Image.open(folder / "section.gif") as film:
        assert film.n_frames == COUNT
        assert film.size == Image.open(folder / "frames" / pictures[0]).size


def test_axes_and_colours_stay(run):
    """Numbers along the axes and on the colour bar are the same in all frames; the picture is not."""
    _, folder = run
    frames = np.stack([np.asarray(Image.open(p)) for p in sorted((folder / "frames").iterdir())])
    same = (frames == frames[0]).all(axis=(0, 3))
    height, width = same.shape
    assert same[-height // 10 :].all()  # the labels below
    # Columns left of the section, and the bar with its numbers, which stand between its two neighbours.
    below_title = same[height // 8 :].all(axis=0)
    assert below_title[: width // 16].all()
    assert below_title[int(0.53 * width) : int(0.66 * width)].all()
    assert not same.all()


def test_paraview_has_the_whole_travel_and_the_blade(run):
    result, folder = run
    travel = [s.displacement_mm for s in result.frames]
    for kind in ("fields", "faces", "blade"):
        assert [at for at, _ in series(folder, kind)] == pytest.approx(travel), kind
    for (at, blade), shown in zip(series(folder, "blade"), result.frames, strict=True):
        moved = blade.points + blade.point_data["displacement_mm"]
        assert moved[:, 1].min() == pytest.approx(result.case.p.height - at)
        # It stands above the material, of which nothing is inside it.
        assert moved[:, 1].max() > shown.current[:, 1].max()
        assert np.ptp(moved[:, 0]) == pytest.approx(result.case.p.thickness)


def test_a_blade_of_a_block_is_turned_and_longer_as_it_is_asked():
    case = load_case("gelatin", {"tilt": "30 deg", "overhang": "2 mm"}, dim=3)
    mesh = blade_mesh(case, 1.5, 30.0)
    half, end = case.p.thickness / 2, case.p.length / 2 + 2.0
    x, _, z = mesh.points.T
    # In the blade's frame, in which contact is computed.
    c, s = np.cos(case.p.tilt), np.sin(case.p.tilt)
    assert np.abs(x * c - z * s).max() == pytest.approx(half)
    np.testing.assert_allclose(np.abs(z * c + x * s), end)
    # Inclined by as much as makes its low end touch the top and its high end 2 mm above.
    rising = blade_mesh(load_case("gelatin", {"incline": "3.8141 deg"}, dim=3), 0.0, 30.0)
    low = [rising.points[rising.points[:, 2] * side > 10, 1].min() for side in (-1, 1)]
    assert low == pytest.approx([case.p.height, case.p.height + 2.0], abs=5e-3)
    # A closed surface: each edge belongs to two of its faces.
    faces = [face for block in mesh.cells for face in block.data]
    edges = [sorted((face[i], face[i - 1])) for face in faces for i in range(len(face))]
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}


def test_pictures_of_an_earlier_run_go(tmp_path):
    result = made_up_result(load_case("gelatin"))
    frames = [replace(made_up_snapshot(mm), time_s=mm / 0.021) for mm in (3.0, 9.0)]
    save_frames(replace(result, frames=frames), tmp_path)
    assert (tmp_path / "section.gif").is_file() and len(list((tmp_path / "frames").iterdir())) == 2
    save_frames(result, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("count", ["0", "-1", "2.5", "many", "501"])
def test_a_number_that_is_none_is_refused_before_anything_is_computed(count, tmp_path):
    done = CliRunner().invoke(app, ["run2d", "gelatin", "--frames", count, "--out", str(tmp_path)])
    assert done.exit_code == 2 and "frames" in done.output and count in done.output
    assert not list(tmp_path.iterdir())
    with pytest.raises(BadInput):
        run_case(QUICK, frames=count)
