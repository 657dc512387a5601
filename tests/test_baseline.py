"""Discovery starts where the fit ends, and says what it could not try."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from invented import write_campaign
from typer.testing import CliRunner

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.fitting import fit
from cutbench.cli.main import app
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover
from cutbench.discovery.report import to_dict

#: Changes the curves like Yeoh's law, as far as its derivative says; with any strength it cannot be computed.
SHY = '''
import numpy as np
from cutbench.base.errors import ComputationFailed
from cutbench.mechanisms import Isochoric, NeoHookean
from cutbench.base.units import Parameter


class Shy(Isochoric):
    """Stiffening that cannot be computed."""

    name = "shy"
    title = "shy stiffening"
    role = "isochoric"
    parameters = (
        *NeoHookean.parameters,
        Parameter("shyness", "1", "s", "how shy", low=-9, high=9, off=0, default=0, typical=0.1),
    )

    def dW_dI1(self, I1, p, at):
        if np.any(np.real(p.shyness) != 0) and np.any(np.real(I1) > 3.01):
            raise ComputationFailed("nobody has seen it")
        return p.G / 2 * (1 + 2 * p.shyness * (I1 - 3))

    def W(self, I1, p, at):
        return p.G / 2 * (I1 - 3) * (1 + p.shyness * (I1 - 3))
'''


@pytest.mark.parametrize(("softening", "specimens"), [(0.2, 4), (0.6, 4), (0.6, 1)])
def test_the_baseline_is_the_fit(tmp_path, softening, specimens):
    campaign = load_campaign(write_campaign(tmp_path, softening=softening, specimens=specimens))
    fitted, found = fit(campaign, workers=0), discover(replace(campaign, candidates=()), workers=0)
    assert found.first.values() == pytest.approx(fitted.values, rel=1e-9)
    assert found.first.chi2 == pytest.approx(fitted.chi2, rel=1e-9)
    for c in fitted.compared:
        np.testing.assert_allclose(found.first.predicted(c.experiment).y, c.fitted, rtol=1e-9)
        if c.experiment.role == "train":
            said = to_dict(found)["misfit"]["baseline"][c.experiment.id]
            assert said == pytest.approx(c.misfit, rel=0.1, abs=1e-3)


@pytest.mark.parametrize("softening", [0.2, 0.6])
@pytest.mark.parametrize("specimens", [1, 4])
def test_a_large_misfit_does_not_shrink_the_baseline(tmp_path, softening, specimens):
    campaign = load_campaign(write_campaign(tmp_path, softening=softening, specimens=specimens))
    for c in fit(campaign, workers=0).compared:
        if c.experiment.role == "train":
            factor = c.fitted @ c.mean / (c.fitted @ c.fitted)
            assert 0.75 < factor < 1.25


@pytest.fixture
def shy(law_of):
    """A mechanism that looks promising and cannot be computed."""
    return law_of("bulk", "shy", SHY)


def test_a_start_that_cannot_be_computed_is_said_with_the_test(shy, tmp_path):
    head = 'baseline = ["shy"]\n[parameters]\nG = "30 kPa"\nshyness = 0.1\n[fit]\nfree = ["G"]\n'
    with pytest.raises(ComputationFailed) as said:
        fit(load_campaign(write_campaign(tmp_path, head=head)), workers=0)
    assert any(f"'{id}'" in str(said.value) for id in ("far", "near"))


def test_what_could_not_be_tried_is_undecided(shy, tmp_path):
    head = 'material = "meat"\nbaseline = ["neo_hookean"]\ncandidates = ["shy"]\n'
    path = write_campaign(tmp_path, head=head)
    done = CliRunner().invoke(app, ["discover", str(path), "--out", str(tmp_path / "d"), "--workers", "0"])
    assert done.exit_code == 1, done.output
    data = json.loads((tmp_path / "d" / "discovery.json").read_text(encoding="utf-8"))
    assert data["verdict"] == "undecided" and data["found"] == []
    (why,) = data["not_tried"]["shy"].splitlines()
    assert why.strip()
    for text in (done.output, (tmp_path / "d" / "discovery.html").read_text(encoding="utf-8")):
        assert "shy" in text and why in " ".join(text.split())


def test_without_a_candidate_a_failing_baseline_is_undecided(tmp_path):
    head = 'material = "meat"\nbaseline = ["neo_hookean"]\ncandidates = []\n'
    assert discover(load_campaign(write_campaign(tmp_path, head=head)), workers=0).verdict == "undecided"


@pytest.mark.slow
def test_values_far_from_those_of_the_material_are_tried(tmp_path):
    """What readings can be of is asked of the material, not of values that a fit tries."""
    head = """baseline = ["neo_hookean"]
candidates = ["mullins"]
[parameters]
G = "0.4 kPa"
[fit]
bounds = { G = ["0.1 kPa", "0.2 kPa"] }
"""
    found = discover(load_campaign(write_campaign(tmp_path, head=head)), workers=0)
    assert found.first.values()["G"] < 3e-4 and not found.not_tried and found.verdict != "undecided"
