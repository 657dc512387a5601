"""Runs of a block: symmetry, one layer against plane strain, what is written."""

from __future__ import annotations

import json
from dataclasses import replace

import meshio
import numpy as np
import pytest
from coarse_runs import SOFT
from PIL import Image
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.models3d.block import PARTS, block
from cutbench.models3d.mesh import quarter
from cutbench.run.build import build
from cutbench.run.figures.solid import plot_cut_plane, plot_front, plot_solid
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


@pytest.mark.parametrize(
    "element, depth, left",
    # Later one end of a half block of quadratic elements jumps before the other: rounding says which.
    [("P1", "1.2 mm", 0.7), pytest.param("P2", "0.92 mm", 0.95, marks=pytest.mark.slow)],
)
def test_quarter_half_and_full_block_agree_through_the_onset(element, depth, left):
    # Weak enough for the cut to open abruptly half way.
    values = {**OWN, **SOFT, "element": element, "G_c": "1.2 J/m^2", "depth": depth}
    case = load_case("gelatin", values, dim=3)
    mesh = quarter(6.0, 6.0, 8.0, 2.0)
    curves = {part: curve_of(case, block(mesh, part)) for part in PARTS}
    travel, force, _ = curves["quarter"].T
    assert force[-1] < left * force.max()
    for part in ("half", "full"):
        found = np.interp(travel, *curves[part][:, :2].T)
        assert np.abs(found - force).max() < 1e-6 * force.max(), part


def test_force_equals_the_reaction_of_the_clamped_bottom():
    case = load_case("gelatin", {**OWN, "depth": "0.5 mm"}, dim=3)
    _, force, reaction = curve_of(case, block(quarter(6.0, 6.0, 8.0, 1.5))).T
    assert np.abs(reaction - force).max() < 1e-6 * force.max()


@pytest.mark.slow
def test_places_are_cut_at_the_same_travel_in_layers_thicker_than_the_cohesive_zone_is_long():
    # The zone, E′G_c/σ², is 0.44 mm long; planes are 1 and 0.5 mm apart.
    values = {
        **SMALL, "h": "1 mm", "corner": 0.125, "depth": "1.7 mm",
        "G_c": "0.2 J/m^2", "delta_c": "0.02 mm", "eta_v": "0.05 mm", "mu": 0.2,
    }  # fmt: skip
    coarse, fine = (run_case(load_case("gelatin", {**values, "layers": n}, dim=3)).measures for n in (2, 4))
    for name in ("onset_mm", "front_half_mm", "front_centre_mm"):
        assert coarse[name] == pytest.approx(fine[name], rel=0.015), name


def test_pictures_need_snapshots_of_a_solid():
    case = load_case("gelatin", {"element": "P1", "h": "0.7 mm", "depth": "0.1 mm"})
    flat = run_case(case, snapshots_mm=[0.1])
    for draw in (plot_cut_plane, plot_front, plot_solid):
        with pytest.raises(ValueError, match="solid"):
            draw(flat)
        with pytest.raises(ValueError, match="snapshots_mm"):
            draw(replace(flat, snapshots=[]))


def test_run3d_writes_what_run2d_writes_and_the_front(tmp_path):
    sets = [f"--set={key}={value}" for key, value in SMALL.items()]
    options = ["--h", "0.7", "--depth", "0.4", "--frames", "3", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, ["run3d", "gelatin", *sets, *options])
    assert done.exit_code == 0, done.output
    assert "gelatin: about" in done.output and "cohesive zones" in done.output  # before it begins
    assert (tmp_path / "section" / "curve.png").stat().st_size > 100
    pictures = ("curve.png", "solid.png", "cut_plane.png", "plane_strain.png")  # no front: not cut
    for name in ("curve.csv", "solid.html", *pictures):
        assert (tmp_path / name).stat().st_size > 100, name
    with Image.open(tmp_path / "solid.gif") as film:
        assert film.n_frames == len(list((tmp_path / "frames").iterdir())) == 3
    record = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert record["case"]["dim"] == 3
    assert 0.3 < record["measures"]["end_effect_max"] < 1.2
    fields_of = meshio.read(sorted((tmp_path / "fields").glob("fields_*.vtu"))[-1])
    assert "tetra" in fields_of.cells_dict
    assert {"displacement_mm", "von_mises_MPa"} <= set(fields_of.point_data)
