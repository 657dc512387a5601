"""How results show themselves: short texts, tables, pictures, files, and one function that reads them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from coarse_runs import cutting_run, pressed_run
from matplotlib.figure import Figure

import cutbench

STUDIES = Path(__file__).parents[1] / "studies"


@pytest.fixture(scope="module")
def result():
    return cutting_run()


@pytest.fixture(scope="module")
def map_():
    return cutbench.load(STUDIES / "results" / "boundary")


@pytest.fixture(scope="module")
def campaign():
    return cutbench.load(STUDIES / "rubber" / "treloar.toml")


@pytest.fixture(scope="module")
def found(campaign):
    return cutbench.fit(campaign, workers=0)


def one(request, name):
    return request.getfixturevalue(name)


DISPLAYED = ("result", "map_", "campaign", "found")


@pytest.mark.parametrize("name", DISPLAYED)
def test_a_text_is_short_and_says_what_it_is(request, name):
    text = repr(one(request, name))
    assert 40 < len(text) < 1500 and len(text.splitlines()) < 20
    assert text.startswith(type(one(request, name)).__name__)


@pytest.mark.parametrize("name", DISPLAYED)
def test_a_notebook_has_a_table_and_a_picture(request, name):
    page = one(request, name)._repr_html_()
    assert "<table>" in page and "<svg" in page and "<script" not in page and "<?xml" not in page


@pytest.mark.parametrize("name", DISPLAYED)
def test_pictures_go_into_axes_of_ones_own(request, name):
    axes = Figure().subplots()
    assert one(request, name).plot(axes) is axes
    assert axes.get_xlabel() and axes.has_data()


@pytest.mark.parametrize("name", DISPLAYED)
def test_tables_have_a_row_each(request, name):
    frame = one(request, name).to_dataframe()
    assert len(frame) > 0 and not frame.columns.duplicated().any()


def test_a_run_says_onset_and_peak_in_that_order(result):
    text = repr(result)
    assert text.index("onset") < text.index("peak") < text.index("work")
    assert f"{result.measures['peak_N']:.4g} N" in text


def test_a_run_that_is_not_cut_says_no_force_of_cutting():
    text = repr(pressed_run())
    assert "not cut" in text and "steady" not in text and "onset" not in text


def test_two_runs_in_one_figure_are_told_apart_and_whole(result):
    from dataclasses import replace

    high = replace(pressed_run(), case=replace(pressed_run().case, name="pressed"))
    axes = result.plot(high.plot(Figure().subplots()))
    one, two = (line for line in axes.lines if len(line.get_xdata()) > 2)
    assert one.get_color() != two.get_color() and one.get_linestyle() != two.get_linestyle()
    assert axes.get_ylim()[1] > high.force_N.max() > result.force_N.max()
    shown = {text.get_text() for text in axes.get_legend().get_texts()}
    assert {result.case.name, "pressed"} <= shown


def test_a_run_as_a_dataset_has_units(result):
    data = result.to_xarray()
    np.testing.assert_array_equal(data["force"], result.force_N)
    assert data["force"].attrs["units"] == "N" and data["work_contact"].attrs["units"] == "mJ"
    assert {"displacement", "time"} <= set(data.coords)


@pytest.mark.slow
def test_what_is_saved_can_be_loaded(result, found, tmp_path):
    again = cutbench.load(result.save(tmp_path / "run"))
    assert again.id == result.id
    np.testing.assert_allclose(again.force_N, result.force_N)
    record = cutbench.load(found.save(tmp_path / "fit"))
    assert record["parameters"] and "keys" in repr(record) and len(repr(record)) < 1500


def test_a_map_is_saved_without_its_runs(map_, tmp_path):
    again = cutbench.load(map_.save(tmp_path / "map"))
    assert again.to_xarray().identical(map_.to_xarray())
    assert again.guide("gelatin").regime == map_.guide("gelatin").regime


@pytest.mark.parametrize(
    ("path", "kind"),
    [("transition.toml", cutbench.Study), ("rubber/treloar.toml", cutbench.Campaign),
     ("results/boundary/map.nc", cutbench.Map)],
)  # fmt: skip
def test_a_file_is_what_it_holds(path, kind):
    assert isinstance(cutbench.load(STUDIES / path), kind)


def test_a_name_or_a_file_is_a_case(tmp_path):
    (tmp_path / "mine.toml").write_text('base = "gelatin"\n[parameters]\nG = "9 kPa"\n')
    assert cutbench.load("gelatin") == cutbench.load_case("gelatin")
    mine = cutbench.load(tmp_path / "mine.toml")
    assert mine.shown()["G"] == "9 kPa" and "G 9 kPa" in repr(mine) and len(repr(mine)) < 800


@pytest.mark.parametrize("what", ["nowhere", "nowhere.nc", "empty", "other.json", "fit.json", "gelatine"])
def test_anything_else_is_refused(what, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "fit.json").write_text("[1")
    with pytest.raises(cutbench.BadInput):
        cutbench.load(tmp_path / what)


def test_titles_are_text_and_not_markup(tmp_path):
    (tmp_path / "fit.json").write_text(json.dumps({"status": "converged", "sentence": "<b>"}))
    assert "converged" in cutbench.load(tmp_path / "fit.json")["status"]
