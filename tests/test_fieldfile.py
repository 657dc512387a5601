"""Displacement fields that a fit takes along with the force of a cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cut_files import COARSE, campaign_of, write_readings
from refusals import refused

from cutbench.base.errors import BadInput
from cutbench.calibration.fitting import fit
from cutbench.case.case import load_case
from cutbench.data.field_comparison import at_travel, gradient, sample, sampled_slopes, shape
from cutbench.data.fields import Field, read_fields_of, thinned
from cutbench.run.runner import run_case

TRAVEL_MM = 1.2
#: Compressible, so that the displacements tell ν, which the force hardly does. With the tool's normal
#: cases that hardly differ take other steps.
CASE = load_case(
    "gelatin", {**COARSE, "step": "0.2 mm", "depth": f"{TRAVEL_MM} mm", "nu": 0.45, "normal": "material"}
)
NAMES = ("G", "nu")


def grid(configuration: str) -> Field:
    x, y = np.linspace(-9, 9, 13), np.linspace(3, 20, 9)
    return Field(x, y, np.zeros((2, y.size, x.size)), TRAVEL_MM, configuration)


def fields_of(case, configuration):
    result = run_case(case, snapshots_mm=(TRAVEL_MM,))
    return sample(at_travel(result.snapshots, TRAVEL_MM), grid(configuration)).u, result


@pytest.mark.parametrize("count", [3, 6])
def test_the_gradient_in_an_element_is_that_of_the_field(count):
    rng = np.random.default_rng(0)
    corners = np.array([[0, 0], [2, 0.3], [0.4, 1.5], [1, 0.15], [1.2, 0.9], [0.2, 0.75]])[:count]
    slope, offset = rng.standard_normal((2, 2)), rng.standard_normal(2)
    N = shape(np.array([0.2, 0.6]), np.array([0.3, 0.1]), count)[0]
    nodes = np.broadcast_to(corners, (2, count, 2))
    np.testing.assert_allclose(gradient(nodes, N, nodes @ slope.T + offset), [slope, slope], atol=1e-12)


@pytest.mark.parametrize("configuration", ["deformed", "reference"])
def test_slopes_of_a_sampled_field_are_its_differences(configuration):
    result = run_case(CASE, snapshots_mm=(TRAVEL_MM,), sensitivities=NAMES)
    slopes = sampled_slopes(at_travel(result.snapshots, TRAVEL_MM), grid(configuration), NAMES)
    for k, name in enumerate(NAMES):
        value, by = CASE.values[name], 1e-4 * CASE.values[name]
        unit = " MPa" if name == "G" else ""
        ahead, behind = (
            fields_of(CASE.set(**{name: f"{value + way * by!r}{unit}"}), configuration)[0] for way in (1, -1)
        )
        difference = (ahead - behind) / (2 * by)
        both = np.isfinite(difference) & np.isfinite(slopes[..., k])
        assert both.mean() > 0.9
        scale = np.abs(difference[both]).max()
        assert np.abs(slopes[..., k] - difference)[both].max() < 5e-3 * scale, name


FIELDS = 'fields = { data = "dic.csv", noise = "0.002 mm" }'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A computed force curve and field with noise, of ν = 0.45."""
    where, rng = tmp_path_factory.mktemp("fields"), np.random.default_rng(1)
    u, result = fields_of(CASE, "deformed")
    x = np.linspace(0.05, TRAVEL_MM, 24)
    F = np.interp(x, result.displacement_mm, result.force_N) * (1 + 0.01 * rng.standard_normal(x.size))
    write_readings(where / "press.csv", "displacement [mm],force [N]", (x, F), (5, 6))
    points = grid("deformed").grid
    u = u + 0.002 * rng.standard_normal(u.shape)
    columns = [*points.reshape(2, -1), *u.reshape(2, -1), np.full(u[0].size, TRAVEL_MM)]
    write_readings(where / "dic.csv", "x [mm],y [mm],u_x [mm],u_y [mm],travel [mm]", columns, (5, 5, 6, 6, 1))
    return where


def campaign(folder, fields: str):
    return campaign_of(
        folder,
        "press",
        CASE,
        parameters='G = "4.5 kPa"\nnu = 0.42',
        numerics='step = "0.2 mm"',
        fit='free = ["G", "nu"]\nbounds = { nu = [0.3, 0.49] }',
        experiment='speed = "0.021 mm/s"\n' + fields,
    )


@pytest.mark.slow
def test_a_field_tells_what_the_force_does_not(folder):
    alone = fit(campaign(folder, ""), workers=0)
    seen = campaign(folder, FIELDS)
    (press,) = seen.experiments
    again = replace(press, id="again", role="test")
    both = fit(replace(seen, experiments=(press, again)), workers=0)
    a, b = (found.estimate("nu") for found in (alone, both))
    assert b.sd < 0.3 * a.sd
    assert b.low < CASE.values["nu"] < b.high
    assert both.estimate("G").low < CASE.values["G"] < both.estimate("G").high
    fitted, predicted = sorted((note for note in both.notes if "displacements" in note), reverse=True)
    assert "'press'" in fitted and "1 field" in fitted
    assert "'again'" in predicted and "1 field" in predicted


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ({"data": "dic.csv"}, "fields.noise"),
        ({"data": "dic.csv", "noise": "0 mm"}, "fields.noise"),
        ({"data": "dic.csv", "noise": "1 kPa"}, "fields.noise"),
        ({"data": "other.csv", "noise": "1 um"}, "fields.data"),
        ({"noise": "1 um"}, "fields.data"),
        ({"data": "dic.csv", "noise": "1 um", "configuration": "bent"}, "fields.configuration"),
        ({"data": "dic.csv", "noise": "1 um", "shift": "3 mm"}, "fields.shift"),
        ({"data": "dic.csv", "noise": "1 um", "y_down": "yes"}, "fields.y_down"),
        ({"data": "dic.csv", "noise": "1 um", "columns": "x"}, "fields.columns"),
        ({"data": "dic.csv", "noise": "1 um", "nois": 1}, "fields.nois"),
        ("dic.csv", "fields"),
    ],
)
def test_what_is_no_field_is_refused_by_its_key(folder, section, key):
    with pytest.raises(BadInput) as caught:
        read_fields_of(section, folder)
    assert caught.value.key == key and caught.value.expected


def test_a_field_beyond_the_readings_is_refused(folder):
    text = (folder / "dic.csv").read_text().replace(f",{TRAVEL_MM}", ",7.5")
    (folder / "late.csv").write_text(text)
    with refused("fields.travel", value="7.5 mm", line=24):
        campaign(folder, FIELDS.replace("dic.csv", "late.csv"))


def test_a_large_grid_is_thinned_evenly():
    x, y = np.arange(40.0), np.arange(30.0)
    field = Field(x, y, np.stack(np.meshgrid(x, y)), 1.0)
    small = thinned(field, 150)
    assert small.x.size * small.y.size <= 150
    np.testing.assert_array_equal(small.u, np.stack(np.meshgrid(small.x, small.y)))
    assert thinned(small, 150).x.size == small.x.size
