"""What a wire costs in steady cutting, with the default numerics: its toughness where nothing rubs, whatever
its diameter, and with friction as much as on finer elements."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.run.cutting import run2d
from cutbench.run.measures import MAX_JUMPS

#: Gelatin of ten per cent, of which a cohesive zone is 51 µm long; a slit spares the wire the way in.
E, G_C = 14.8e-3, 1.1e-3
LAWS = ["neo_hookean", "volumetric", "stiff_cohesion", "wire", "coulomb", "surface_gradient"]


def wire(diameter, mu=0.0, **changes):
    sizes = {"thickness": 1, "precut": 4, "width": 50, "height": 40, "depth": 9}
    return load_case("gelatin", {
        "mechanisms": LAWS, "G": f"{E / 2.95} MPa", "nu": 0.475, "G_c": f"{G_C} N/mm", "delta_c": "0.02 mm",
        "surface_length": "0.01 mm", "mu": mu, "length": "25 mm", "speed": f"{diameter / 6} mm/s",
        **{name: f"{times * diameter} mm" for name, times in sizes.items()}, **changes,
    })  # fmt: skip


def steady(result):
    """Force per length of the blade in the last third of the travel, in units of the toughness."""
    d, F = result.displacement_mm, result.force_N
    last = d > d[-1] * 2 / 3
    return np.trapezoid(F[last], d[last]) / np.ptp(d[last]) / (25 * G_C)


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "travel"), [(2, 14), (7, 9), (20, 9)])
def test_a_wire_without_friction_costs_its_toughness(ratio, travel):
    """Once it is steady, which a fine one is later: its cohesive zone is long beside it."""
    diameter = ratio * G_C / E
    result = run2d(wire(diameter, depth=f"{travel * diameter} mm"), snapshots_mm=())
    assert steady(result) == pytest.approx(1, abs=0.03)
    assert result.measures["jumps_rel"] < MAX_JUMPS and "detail" not in str(result.outcome)
    assert abs(result.measures["closure"]) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("mu", [0.05, 0.2])
def test_with_friction_it_costs_as_much_as_on_finer_elements(mu):
    once, twice = (steady(run2d(wire(0.5, mu, **finer), snapshots_mm=())) for finer in ({}, {"h": 5 / 112}))
    assert once > 1.2
    assert math.log(once) == pytest.approx(math.log(twice), rel=0.1)


@pytest.mark.slow
def test_elements_that_do_not_see_the_zone_are_said():
    result = run2d(wire(0.5, detail=1.0, h=0.125, depth="4 mm"), snapshots_mm=())
    assert steady(result) > 1.1 and result.measures["jumps_rel"] > MAX_JUMPS
    assert "detail = '0.22 mm'" in result.outcome.advice
