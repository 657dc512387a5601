"""What a law says it is like: values with which a model without it does the same."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from looped import over
from test_candidates import LAW, parameters
from test_candidates_runs import SMALL

from cutbench.case.case import load_case
from cutbench.run.runner import run_case


def test_adhesion_by_blade_speed_is_an_adhesion_as_much_stronger():
    """Whatever slides how fast."""
    at = SimpleNamespace(touched=np.array([1.0, 1.0, 0.0]), slip_rate=np.array([0.0, 0.1, 0.1]))
    p = parameters(tau_W=1e-3, speed_sticking=0.4, sticking_speed=0.02, speed=0.08, slice_push=0.75)
    mine = [LAW[name].strength(np.zeros(3), p, {}, at) for name in ("adhesion", "speed_adhesion")]
    like = LAW["speed_adhesion"].like(p)
    assert like["tau_W"] == pytest.approx(1e-3 * (1 + 0.4 * np.log(6.0)))
    stronger = parameters(**{**vars(p), **like})
    np.testing.assert_allclose(sum(mine), LAW["adhesion"].strength(np.zeros(3), stronger, {}, at))


def test_a_blunt_tip_is_a_shorter_one():
    p = parameters(thickness=0.7, tip=1.05, blunting=0.5)
    sharp = parameters(thickness=0.7, **LAW["blunt_tip"].like(p))
    np.testing.assert_array_equal(LAW["blunt_tip"].outline(p), LAW["contact"].outline(sharp))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["speed_toughness", "speed_modulus"])
def test_a_cut_by_a_law_of_speed_is_what_the_law_says_that_it_is_like(name):
    """Viscosity and all, until it drops."""
    hard = {key: SMALL[key] for key in ("G_c", "mu", "tip", "width", "height", "h", "step")}
    changes = {
        **hard,
        "G_c": "0.15 J/m^2",
        "until": "transition",
        "depth": "0.8 mm",
        "eta_reg": "2 s",
        "element": "P1",
        "normal": "material",
        "surface_length": "0 mm",
    }
    base = load_case("gelatin", changes, dim=2)
    model, _ = base.model.extended(name)
    strength, speed = LAW[name].parameters
    law = replace(
        base, mechanisms=model.mechanisms, values={**base.values, strength.name: 0.6, speed.name: 0.01}
    )
    alone = replace(base, values={**base.values, **LAW[name].like(law.p)})
    one, other = run_case(law), run_case(alone)
    onset = one.measures["onset_mm"]
    assert onset == pytest.approx(other.measures["onset_mm"], rel=0.02)
    x = np.linspace(0, 0.95 * onset, 20)
    a, b = (np.interp(x, run.displacement_mm, run.force_N) for run in (one, other))
    np.testing.assert_allclose(a, b, rtol=0, atol=2e-3 * b.max())


@over("law", LAW.values())
def test_what_a_law_is_like_is_said_of_what_it_resembles_and_nothing_where_it_is_off(law):
    values = {q.name: q.typical * q.factor for other in LAW.values() for q in other.parameters if q.typical}
    p = parameters(**{**values, **{q.name: q.off_value for q in law.parameters if q.off is not None}})
    assert set(law.like(p)) <= set(law.resembles)
    for name, value in law.like(p).items():
        assert value == getattr(p, name)
