"""A strip in tension: against uniaxial tension, its energy, the notch, and the command."""

from __future__ import annotations

import json

import numpy as np
import pytest
from refusals import refused
from scipy.optimize import brentq
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.models3d.strip import strip
from cutbench.run.tension import run_tension, strip_case


def test_faces_of_a_notched_strip():
    mesh = strip(12.0, 30.0, 3.0, 2.4, 1.0).mesh

    def area(name):
        a, b, c = np.moveaxis(mesh.p[:, mesh.facets[:, mesh.boundaries[name]]], 1, 0)
        return np.linalg.norm(np.cross((b - a).T, (c - a).T), axis=1).sum() / 2

    assert area("cut") == pytest.approx(9.6 * 1.5)
    assert area("notch") == pytest.approx(2.4 * 1.5)
    assert area("clamp") == pytest.approx(12 * 1.5)
    assert area("middle") == pytest.approx(12 * 15)
    assert "notch" not in strip(12.0, 30.0, 3.0, 0.0, 1.0).mesh.boundaries


def uniaxial(stretch, G, nu):
    """Nominal stress (MPa) of the compressible neo-Hookean solid, isochoric part and κ/2 (J − 1)²."""
    kappa = 2 * G * (1 + nu) / (3 * (1 - 2 * nu))

    def cauchy(axial, side):
        J = axial * side**2
        mean = (axial**2 + 2 * side**2) / 3
        part = G * J ** (-5 / 3)
        return part * (axial**2 - mean) + kappa * (J - 1), part * (side**2 - mean) + kappa * (J - 1)

    side = brentq(lambda s: cauchy(stretch, s)[1], 0.5, 1.5)
    return cauchy(stretch, side)[0] * side**2


@pytest.mark.slow
def test_a_slender_strip_is_in_uniaxial_tension():
    base = load_case("elastomer", dim=3)
    changes = {"width": "1 mm", "length": "1 mm", "height": "60 mm", "h": "0.5 mm", "depth": "12 mm"}
    case = strip_case(base, {**changes, "step": "2 mm", "damping_mm": 0.0}, notch_mm=0.0)
    test = run_tension(case, 0.0)
    assert test.outcome.done and test.outcome.reached_mm == pytest.approx(12.0)
    strain = test.curve["elongation_mm"] / 60
    wanted = [uniaxial(1 + e, base.p.G, base.p.nu) for e in strain[1:]]
    # What is left is the clamps, which let the ends not narrow.
    assert test.curve["stress_MPa"][1:] == pytest.approx(wanted, rel=0.01)
    assert np.all(test.curve["stress_MPa"][1:] > wanted)
    assert not test.curve["cut_length_mm"].any()


@pytest.fixture(scope="module")
def torn():
    case = load_case("elastomer", dim=3)
    changes = {"h": "1.5 mm", "element": "P1", "width": "6 mm", "height": "10 mm", "energy_step": 0.01}
    return run_tension(strip_case(case, changes, notch_mm=1.5), 1.5)


def test_a_notched_strip_tears_and_its_energy_closes(torn):
    assert torn.outcome.done and torn.outcome.message.startswith("torn")
    curve, found = torn.curve, torn.measures
    assert curve["force_N"][-1] < 0.05 * found["max_N"]
    assert curve["cut_length_mm"][-1] == pytest.approx(4.5, rel=0.05)
    assert 0 < found["onset_mm"] <= found["max_mm"] < curve["elongation_mm"][-1]
    assert abs(curve["closure"][-1]) < 0.02
    # All of the ligament was torn: at least its work of separation was spent.
    assert found["energy_mJ"] > 15e-3 * 4.5 * 3.0


def test_a_longer_notch_bears_less(torn):
    case = load_case("elastomer", dim=3)
    changes = {"h": "1.5 mm", "element": "P1", "width": "6 mm", "height": "10 mm"}
    other = run_tension(strip_case(case, changes, notch_mm=3.0), 3.0)
    assert other.measures["max_N"] < 0.8 * torn.measures["max_N"]


def test_a_strip_has_no_blade_and_needs_a_law_to_tear():
    case = load_case("gelatin", dim=3)
    whole = strip_case(case, notch_mm=0.0)
    assert all(law.slot == "bulk" for law in whole.model.all)
    assert (whole.p.width, whole.p.height, whole.p.length, whole.p.speed) == (12.0, 30.0, 3.0, 0.03)
    assert {law.slot for law in strip_case(case, notch_mm=2.4).model.all} == {"bulk", "cut"}
    with refused("notch", value="2.4 mm"):
        strip_case(whole, notch_mm=2.4)
    with refused("notch", value="12 mm", hint="12 mm"):
        strip_case(case, notch_mm=12.0)


def test_the_command_writes_curve_record_and_picture(tmp_path):
    sets = ["--set=width=6 mm", "--set=height=10 mm", "--element=P1", "--h=1.5"]
    done = CliRunner().invoke(app, ["tension", "elastomer", "--notch=1.5", *sets, f"--out={tmp_path}"])
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "tension.json").read_text(encoding="utf-8"))
    assert record["notch_mm"] == 1.5 and record["measures"]["max_N"] > 0
    lines = (tmp_path / "curve.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("elongation_mm,force_N,") and len(lines) > 5
    assert (tmp_path / "tension.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "says"),
    [(["--notch=-1"], "--notch = '-1 mm'"), (["--notch=soft"], "'soft'"), (["--elongation=0"], "depth")],
)
def test_bad_input_is_one_message(tmp_path, options, says):
    done = CliRunner().invoke(app, ["tension", "gelatin", *options, f"--out={tmp_path}"])
    assert done.exit_code == 2
    assert says in done.output and "Traceback" not in done.output
