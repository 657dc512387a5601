"""Python hears what the command line hears: doubts are warnings, what cannot be used is refused in words."""

from __future__ import annotations

import numpy as np
import pytest
from refusals import refused

import cutbench
from cutbench.run.figures.curve import plot_curve

QUICK = {"h": "0.8 mm", "element": "P1", "depth": "0.2 mm"}


def test_a_run_warns_of_doubtful_input_where_it_is_called():
    with pytest.warns(cutbench.DoubtfulInput, match="units of G") as caught:
        cutbench.run2d("gelatin", G="7.5 MPa", **QUICK)
    assert caught[0].filename == __file__


def test_an_estimate_takes_changes_and_warns_as_a_run_does():
    assert cutbench.estimate("gelatin", eta_reg="10 s").verdict == "smooth"
    with pytest.warns(cutbench.DoubtfulInput) as caught, refused("eta_reg"):
        cutbench.estimate("gelatin", speed="1 mm/s")
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    ("key", "call"),
    [
        ("source", lambda: cutbench.estimate(3)),
        ("source", lambda: cutbench.run2d(None)),
        ("case", lambda: cutbench.run_case("gelatin")),
        ("snapshots_mm", lambda: cutbench.run2d("gelatin", snapshots_mm=["1 mm"], **QUICK)),
        ("G", lambda: cutbench.run2d("gelatin", G="7.5 kPa ± 1")),
        ("width", lambda: cutbench.run2d("gelatin", width=30)),
    ],
)
def test_what_cannot_be_used_is_refused_by_its_name(key, call):
    with refused(key):
        call()


@pytest.mark.parametrize(("changes", "meant"), [({"with": "wegde"}, "'wedge'"), ({"Gc": "3 J/m^2"}, "'G_c'")])
def test_of_many_names_the_nearest_are_shown(changes, meant):
    with refused(hint=meant) as caught:
        cutbench.load_case("gelatin", changes)
    assert len(str(caught.value)) < 250


def test_a_case_tells_its_parameters_with_units():
    case = cutbench.load_case("gelatin")
    assert case["G"] == "7.5 kPa"
    with refused("parameter", hint="'G_c'"):
        case["Gc"]


def test_known_mechanisms_say_what_they_are():
    assert "wedge" in repr(cutbench.known_mechanisms()["wedge"])
    assert " at 0x" not in repr(cutbench.known_mechanisms())


def test_a_blade_that_returns_is_drawn_over_time_and_its_depth_is_said():
    there_and_back = [[0, 0], ["20 s", "0.2 mm"], ["30 s", "0.2 mm"], ["40 s", "0 mm"]]
    result = cutbench.run2d("gelatin", motion=there_and_back, **{**QUICK, "depth": "0.2 mm"})
    assert result.outcome.reached_mm == pytest.approx(0.2) and "0.2 mm" in result.sentence()
    axes = plot_curve(result).axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), result.curve["time_s"])
    assert "(s)" in axes.get_xlabel()
