"""Pictures of a run show what they claim."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
from made_up_runs import made_up_curve, made_up_result, made_up_snapshot

from cutbench.base.figure_style import new_figure
from cutbench.case.case import load_case
from cutbench.run.blade_geometry import blade_outline
from cutbench.run.figures import plot_curve, plot_section, save
from cutbench.run.figures.curve import look_of, smooth_force
from cutbench.run.figures.section import split
from cutbench.run.result import Outcome, Result


@pytest.fixture(scope="module")
def case():
    return load_case("gelatin")


@pytest.fixture
def result(case):
    return made_up_result(case)


def test_smoothing_keeps_the_work_and_does_not_see_the_steps():
    at = np.linspace(1, 9, 50)
    coarse, fine = (
        np.linspace(0, 10, 11),
        np.sort(np.append(np.linspace(0, 10, 11), np.random.default_rng(0).uniform(0, 10, 90))),
    )
    work = np.cumsum(np.random.default_rng(1).normal(size=11))
    a = smooth_force(coarse, work, 0.7, at)
    b = smooth_force(fine, np.interp(fine, coarse, work), 0.7, at)
    np.testing.assert_allclose(a, b, atol=1e-12)
    np.testing.assert_allclose(smooth_force(coarse, 3 * coarse, 0.7, np.array([0.0, 5, 10])), 3)


def test_split_stacks_to_the_force(result):
    """Areas above zero minus areas below it are the force: nothing is hidden, nothing drawn twice."""
    axes = plot_curve(result).axes[1]
    height = np.zeros(2)
    at = 10.0
    for area in axes.collections:
        at_edge = [
            v[:, 1]
            for v in (p.vertices[np.abs(p.vertices[:, 0] - at) < 0.014] for p in area.get_paths())
            if len(v)
        ]
        if at_edge:
            height[0] = max(height[0], np.concatenate(at_edge).max())
            height[1] = min(height[1], np.concatenate(at_edge).min())
    total = next(line for line in axes.lines if line.get_label() == "force on the blade")
    assert height.sum() == pytest.approx(np.interp(at, *total.get_data()), rel=0.02)


def test_released_energy_lies_below_zero(result):
    axes = plot_curve(result).axes[1]
    lowest = min(p.vertices[:, 1].min() for area in axes.collections for p in area.get_paths())
    released = -np.diff(result.curve["work_neo_hookean_mJ"]).min()
    assert released > 0 and lowest < -0.3


def test_curve_picture_marks_onset_peak_and_a_run_that_fell_short(result):
    short = replace(result, outcome=Outcome("stalled", "step below 1e-4 mm.", "smaller h", 9.5))
    texts = [t.get_text() for t in plot_curve(short).legends[0].get_texts()]
    assert all(word in t for word, t in zip(("onset", "peak", "9.50 mm"), texts[:3], strict=True))
    assert len(plot_curve(result).legends[0].get_texts()) == len(texts) - 1


def test_runs_in_one_axes_are_named_once_each_and_their_symbols_once(result):
    ax = result.plot(new_figure().subplots())
    replace(result, id="0123").plot(ax)
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert texts == [result.name, f"{result.name}, run 0123", "onset of cutting", "peak"]


def test_a_law_has_its_look_whatever_else_the_ledger_has():
    assert look_of("gent") == look_of("neo_hookean") != look_of("contact")
    assert look_of("wedge") == look_of("contact")


def test_curve_picture_of_a_single_point(case):
    curve = {name: values[:1] for name, values in made_up_curve(20).items()}
    save_nothing = plot_curve(Result(case, curve, Outcome("failed", "no first step.")))
    assert len(save_nothing.axes) == 2


def test_section_shows_both_halves_and_the_blade(result):
    figure = plot_section(replace(result, snapshots=result.snapshots[1:2]))
    whole, near = figure.axes[:2]
    x = np.concatenate([p.vertices[:, 0] for c in whole.collections for p in c.get_paths()])
    assert x.min() == pytest.approx(-x.max()) and x.max() > 14.9
    assert near.get_ylim()[0] < 21 - 6.0 < near.get_ylim()[1]


def test_blade_tip_is_at_height_minus_travel(case):
    outline = blade_outline(case, 6.0, 25.0)
    assert outline[:, 1].min() == pytest.approx(case.p.height - 6.0)
    assert np.abs(outline[:, 0]).max() == pytest.approx(case.p.thickness / 2)
    assert outline[:, 1].max() == 25.0


def test_split_triangles_fill_the_same_area():
    snapshot = made_up_snapshot()

    def area(cells):
        a, b, c = (snapshot.points[cells[:, i], :2] for i in range(3))
        u, v = b - a, c - a
        return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() / 2

    assert area(split(snapshot.cells)) == pytest.approx(15 * 21)
    assert len(split(snapshot.cells)) == 4 * len(snapshot.cells)


def test_section_needs_plane_snapshots(result):
    with pytest.raises(ValueError, match="snapshots_mm"):
        plot_section(replace(result, snapshots=[]))
    with pytest.raises(ValueError, match="plane"):
        plot_section(replace(result, snapshots=[replace(result.snapshots[0], cell_type="tetra")]))


def test_pictures_are_300_dpi_and_come_in_other_formats(tmp_path, result):
    written = save(plot_curve(result), tmp_path / "curve.png", also=("svg", "pdf"))
    assert [p.suffix for p in written] == [".png", ".svg", ".pdf"]
    width = matplotlib.image.imread(written[0]).shape[1]
    assert width == pytest.approx(140 / 25.4 * 300, abs=2)
    assert written[2].read_bytes()[:5] == b"%PDF-"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["curve.pdf", "curve.png", "curve.svg"]
