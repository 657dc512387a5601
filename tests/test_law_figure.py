"""Pictures of laws: axes with names and units, and the numbers of the law itself."""

from __future__ import annotations

import numpy as np
import pytest
from refusals import refusal, refused
from typer.testing import CliRunner

from cutbench.case.model import Model
from cutbench.cli.main import app
from cutbench.homogeneous.law_figure import plot_law
from cutbench.mechanisms import SLOTS, registry

DRAWN = [law.name for law in registry().values() if law.slot in SLOTS[:3]]
#: One of each kind; those that remember take long.
QUICK = ("neo_hookean", "maxwell", "stiff_cohesion", "adhesion", "wedge")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in DRAWN]
)
def test_every_law_of_bulk_cut_and_blade_is_drawn(name):
    (axes,) = plot_law(name).axes
    assert axes.get_xlabel() and axes.get_ylabel()
    assert "(" in axes.get_ylabel(), "a unit"
    for line in axes.lines:
        assert np.isfinite(line.get_xydata()).all() and np.ptp(line.get_xydata(), axis=0).any()


def line(name: str, label: str) -> np.ndarray:
    (axes,) = plot_law(name).axes
    return next(each for each in axes.lines if each.get_label() == label).get_xydata()


def test_a_line_has_the_laws_own_numbers():
    values = {q.name: q.typical * q.factor for q in Model().parameters().values()}
    stretch, stress = line("neo_hookean", "uniaxial").T
    ideal = 1e3 * values["G"] * (stretch - stretch**-2)
    assert np.abs(stress - ideal).max() < 0.1 * np.abs(ideal).max()
    opening, traction = line("stiff_cohesion", "normal").T
    assert np.trapezoid(traction, opening) == pytest.approx(1e3 * values["G_c"], rel=0.02)
    pressure, strength = line("coulomb", f"at {values['speed']:g} mm/s").T
    np.testing.assert_allclose(strength, values["mu"] * pressure)


def test_the_command_draws_into_a_file_or_says_why_not(tmp_path):
    path = tmp_path / "law.svg"
    done = CliRunner().invoke(app, ["mechanisms", "coulomb", "--plot", "--out", str(path)])
    assert done.exit_code == 0 and "kPa" in path.read_text("utf-8")
    refusal(CliRunner().invoke(app, ["mechanisms", "--plot"]), "mechanism")
    with refused("mechanism", value="force_zero", hint="bulk"):
        plot_law("force_zero")
