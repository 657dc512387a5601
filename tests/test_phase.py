"""Phase diagrams: what is drawn, for whole and partial maps, with one axis or four."""

from __future__ import annotations

import json

import analytic_runs
import numpy as np
import pytest
import xarray as xr
from matplotlib.contour import QuadContourSet

from cutbench.maps.dataset import MapRow, build_map, row_of
from cutbench.maps.phase import DROP_COLOURS, draw_phase, save_phase
from cutbench.maps.plot_coordinates import MAX_PANELS, between, nearest_level
from cutbench.maps.sampling_plan import plan_of
from cutbench.maps.study import load_study

AXES = {
    "cohesion": "from = 1.0\nto = 30.0\npoints = 5\nscale = 'log'",
    "viscosity": "from = 0.01\nto = 5.0\npoints = 4\nscale = 'log'",
    "adhesion": "values = [0.0, 0.0106, 0.187]",
    "G": "values = ['5 kPa', '10 kPa']",
}


@pytest.fixture
def study(tmp_path):
    def study(*axes, extra='[plot]\nmark = ["gelatin", "elastomer", "meat"]\n'):
        text = 'base = "gelatin"\n' + "".join(f'[[axis]]\nname = "{name}"\n{AXES[name]}\n' for name in axes)
        path = tmp_path / "study.toml"
        path.write_text(text + extra)
        return load_study(path)

    return study


def rows_of(study, n=None):
    return {case.id: row_of(analytic_runs.computed(case), study.regime) for case in study.cases()[:n]}


def panels(figure):
    return [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]


def texts(ax):
    return [t.get_text() for t in ax.texts]


def contours(ax):
    """The map's own boundary: the classical estimate's line lies below it."""
    return [c for c in ax.collections if isinstance(c, QuadContourSet) and c.get_zorder() == 3]


def legend(figure):
    return [t.get_text() for t in figure.legends[0].get_texts()]


def test_a_panel_a_level_with_boundary_and_each_material_on_its_own(study):
    s = study("cohesion", "viscosity", "adhesion")
    figure = draw_phase(build_map(s, rows_of(s)))
    axes = panels(figure)
    assert [texts(ax) for ax in axes] == [["meat"], ["gelatin"], ["elastomer"]]
    assert ["0.187" in ax.get_title() for ax in axes] == [False, False, True]
    assert all(len(contours(ax)) == 1 for ax in axes)
    said = [
        "abrupt",
        "smooth",
        "boundary: drop of 10 % within a blade thickness",
        "classical estimate",
        "material, own run",
    ]
    assert legend(figure) == [*said, "elastomer (μ = 0.35)"]
    assert figure.get_figwidth() * 25.4 == pytest.approx(180)
    assert "viscosity" in axes[0].get_ylabel() and "cohesion" in axes[2].get_xlabel()


def test_the_boundary_parts_the_regimes(study):
    s = study("cohesion", "viscosity", "adhesion")
    data = build_map(s, rows_of(s))
    margin = data["drop_rel"] / 0.1
    for k, ax in enumerate(panels(draw_phase(data))):
        line = np.concatenate([p.vertices for p in contours(ax)[0].get_paths()])
        x, y = np.log(data["cohesion"].values), np.log(data["viscosity"].values)
        inside = (np.log(line[:, 0]) >= x[0]) & (np.log(line[:, 0]) <= x[-1])
        inside &= (np.log(line[:, 1]) >= y[0]) & (np.log(line[:, 1]) <= y[-1])
        z = margin.isel(adhesion=k).transpose("viscosity", "cohesion").values
        for px, py in np.log(line[inside]):
            i, j = np.clip(np.searchsorted(x, px), 1, 4), np.clip(np.searchsorted(y, py), 1, 3)
            corners = z[j - 1 : j + 1, i - 1 : i + 1]
            assert corners.min() <= 1 + 1e-9 and corners.max() >= 1 - 1e-9


def test_the_boundary_of_a_power_law_is_a_straight_line_on_log_axes(study):
    """A drop whose logarithm is linear in those of the axes, on five by four points: the line is known."""
    s = study("cohesion", "viscosity", "adhesion")
    data = build_map(s, rows_of(s))
    slope = 0.9 * np.log(data["cohesion"] / 5) + 0.4 * np.log(data["viscosity"] / 0.4)
    data["drop_rel"] = (0.1 * np.exp(-slope)).broadcast_like(data["drop_rel"])
    for ax in panels(draw_phase(data)):
        x, y = np.concatenate([p.vertices for p in contours(ax)[0].get_paths()]).T
        inside = (x >= 1) & (x <= 30) & (y >= 0.01) & (y <= 5)
        assert inside.sum() > 20
        octaves = np.log2(y / 0.4) + 0.9 / 0.4 * np.log2(x / 5)
        assert np.abs(octaves[inside]).max() < 0.02


def test_markers_count_the_regimes(study):
    s = study("cohesion", "viscosity", "adhesion")
    data = build_map(s, rows_of(s))
    counts = {"black": 0, "white": 0}
    for ax in panels(draw_phase(data)):
        for line in ax.lines:
            if line.get_marker() == "o":
                counts[line.get_markerfacecolor()] += len(line.get_xdata())
    assert counts == {"black": int((data["label"] == 2).sum()), "white": int((data["label"] == 1).sum())}


def test_a_partial_map_shows_what_failed_and_what_is_to_come(study, tmp_path):
    s = study("cohesion", "viscosity", "adhesion")
    rows = rows_of(s, 20)
    rows[s.cases()[5].id] = MapRow("stalled", "no", 3.0)
    figure = draw_phase(build_map(s, rows))
    assert {"not computed", "to come", "interpolated"} <= set(legend(figure))
    crosses = [line for ax in panels(figure) for line in ax.lines if line.get_marker() == "x"]
    assert sum(len(line.get_xdata()) for line in crosses) == 1
    assert save_phase(build_map(s, rows), tmp_path) == [tmp_path / "phase.png", tmp_path / "phase.svg"]
    assert (tmp_path / "phase.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "phase.svg").read_text().lstrip().startswith("<?xml")


def test_an_empty_map_can_be_drawn(study):
    s = study("cohesion", "viscosity", "adhesion")
    figure = draw_phase(build_map(s, {}))
    assert not any(contours(ax) for ax in panels(figure)) and "to come" in legend(figure)


@pytest.mark.parametrize(("axes", "n"), [(("cohesion",), 1), (("cohesion", "viscosity"), 1)])
def test_fewer_axes_give_one_panel(study, axes, n):
    s = study(*axes)
    figure = draw_phase(build_map(s, rows_of(s)))
    assert len(panels(figure)) == n
    figure.canvas.draw()


def test_more_axes_are_cut_at_a_stated_value(study):
    s = study("cohesion", "viscosity", "adhesion", "G")
    figure = draw_phase(build_map(s, rows_of(s)))
    assert len(panels(figure)) == 3 and "= 10 kPa" in figure.get_supxlabel()


def test_a_material_off_a_level_says_its_value_and_one_off_the_axes_is_named(study):
    s = study("cohesion", "viscosity", "adhesion")
    data = build_map(s, rows_of(s))
    data.attrs["marks"] = json.dumps(
        [
            {"name": "rubber", "cohesion": 3.0, "viscosity": 1.0, "adhesion": 0.15},
            {"name": "steel", "cohesion": 3000.0, "viscosity": 1.0, "adhesion": 0.0},
        ]
    )
    figure = draw_phase(data)
    assert [texts(ax) for ax in panels(figure)] == [[], [], ["rubber (0.15)"]]
    assert "steel" in figure.get_supxlabel()


def test_materials_that_fall_together_share_a_mark(study):
    s = study("viscosity")
    assert texts(panels(draw_phase(build_map(s, rows_of(s))))[0]) == ["gelatin, elastomer", "meat"]
    # With runs of their own they are apart where drops are what is up.
    rows = rows_of(s) | {mark.case.id: MapRow("done", label="smooth", measures={"drop_rel": drop})
                         for mark, drop in zip(s.marks(), (0.08, 0.02, 0.0), strict=True)}  # fmt: skip
    (ax,) = panels(draw_phase(build_map(s, rows)))
    assert texts(ax) == ["gelatin", "elastomer", "meat"]
    heights = [line.get_ydata()[0] for line in ax.lines if line.get_marker() == "D"]
    assert heights == pytest.approx([0.08, 0.02, 0.0])


def test_a_material_is_filled_with_the_drop_of_its_own_run(study):
    s = study("cohesion", "viscosity", "adhesion")
    rows, fills = rows_of(s), {}
    for mark, drop in zip(s.marks(), (0.12, 0.3, 0.0), strict=True):
        rows[mark.case.id] = MapRow("done", label="abrupt", measures={"drop_rel": drop})
    figure = draw_phase(build_map(s, rows))
    assert "elastomer (μ = 0.35): abrupt" in legend(figure)
    for ax, (text,) in ((ax, texts(ax)) for ax in panels(figure)):
        (line,) = [line for line in ax.lines if line.get_marker() == "D"]
        fills[text] = np.dot(line.get_markerfacecolor()[:3], [0.2126, 0.7152, 0.0722])
    assert fills["elastomer"] < fills["gelatin"] < fills["meat"]  # the larger the darker


@pytest.mark.parametrize(
    ("value", "level"), [(0.0, 0), (0.001, 0), (0.0106, 1), (0.03, 1), (0.1, 2), (0.187, 2), (5.0, 2)]
)
def test_nearest_level_counts_in_ratios(value, level):
    assert nearest_level(value, [0.0, 0.0106, 0.187]) == level


def test_the_colours_darken_steadily_in_grey():
    grey = DROP_COLOURS(np.linspace(0, 1, 64))[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(grey) < 0).all() and grey[0] - grey[-1] > 0.4


SEARCH = """mode = "boundary"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 30.0
scale = "log"
tolerance = "1/8"
[[axis]]
name = "viscosity"
from = 0.01
to = 5.0
scale = "log"
tolerance = "1/8"
[[axis]]
name = "adhesion"
from = 0.0
to = 0.2
tolerance = "1/8"
"""


@pytest.mark.slow
def test_a_boundary_that_was_sought_has_panels_of_its_third_axis_and_each_run_on_one(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(SEARCH)
    s = load_study(path)
    plan, rows = plan_of(s), {}
    for _ in range(2):
        rows |= {case.id: row_of(analytic_runs.computed(case), s.regime) for case in plan.ask(rows)}
    data = build_map(s, rows, plan.ids, plan.estimates(rows))
    figure = draw_phase(data)
    axes = panels(figure)
    assert len(axes) == MAX_PANELS and "unsure (95 %)" in legend(figure)
    drawn = sum(len(line.get_xdata()) for ax in axes for line in ax.lines if line.get_marker() == "o")
    assert drawn == len(rows) > 100
    figure.canvas.draw()


@pytest.mark.parametrize("dims", [1, 2, 3])
def test_between_runs_the_logarithm_is_linear_and_stays_within_the_runs(dims):
    rng, shape = np.random.default_rng(2), (9, 7, 5)[:dims]
    places = np.stack(np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij"))
    true = np.exp(-1 - np.tensordot([1.0, 0.5, -0.3][:dims], places, 1))
    corners = np.isin(places, (0, 1)).all(axis=0)
    known = np.where(corners | (rng.random(shape) < 0.3), true, np.nan)
    data = xr.Dataset({"drop_rel": (list("abc")[:dims], known)})
    found = between(data, "drop_rel")
    assert np.isfinite(found).all()
    assert found.min() >= true.min() * (1 - 1e-9) and found.max() <= true.max() * (1 + 1e-9)
    np.testing.assert_allclose(found, true, rtol=1e-6)
    np.testing.assert_allclose(found.values[corners], true[corners], rtol=1e-9)
    nothing = data.assign(drop_rel=data["drop_rel"] * np.nan)
    assert np.isnan(between(nothing, "drop_rel")).all()
