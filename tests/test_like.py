"""What a law says it is like: values with which a model without it does the same."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from test_candidates import LAW, parameters

from cutbench.calibration.identifiability import Unknown
from cutbench.discovery.extending import something


def test_adhesion_by_blade_speed_is_an_adhesion_as_much_stronger():
    """Whatever slides how fast."""
    at = SimpleNamespace(touched=np.array([1.0, 1.0, 0.0]), slip_rate=np.array([0.0, 0.1, 0.1]))
    p = parameters(tau_W=1e-3, speed_sticking=0.4, sticking_speed=0.02, speed=0.1)
    mine = [LAW[name].strength(np.zeros(3), p, {}, at) for name in ("adhesion", "speed_adhesion")]
    like = LAW["speed_adhesion"].like(p)
    assert like["tau_W"] == pytest.approx(1e-3 * (1 + 0.4 * np.log(6.0)))
    stronger = parameters(**{**vars(p), **like})
    np.testing.assert_allclose(sum(mine), LAW["adhesion"].strength(np.zeros(3), stronger, {}, at))


def test_a_modulus_by_blade_speed_is_a_modulus_as_much_higher():
    p = parameters(G=8e-3, speed_stiffening=0.4, stiffening_speed=0.02, speed=0.1)
    F = np.eye(3)[:, :, None] + 0.2 * np.random.default_rng(0).standard_normal((3, 3, 5))
    mine = [LAW[name].stress(F, p, {}, None)[0] for name in ("neo_hookean", "speed_modulus")]
    stiffer = parameters(**{**vars(p), **LAW["speed_modulus"].like(p)})
    assert pytest.approx(8e-3 * (1 + 0.4 * np.log(6.0))) == stiffer.G
    np.testing.assert_allclose(sum(mine), LAW["neo_hookean"].stress(F, stiffer, {}, None)[0], atol=1e-15)


@pytest.mark.parametrize("law", LAW.values(), ids=lambda law: law.name)
def test_what_a_law_is_like_is_said_of_what_it_resembles_and_nothing_where_it_is_off(law):
    values = {q.name: q.typical * q.factor for other in LAW.values() for q in other.parameters if q.typical}
    p = parameters(**{**values, **{q.name: q.off_value for q in law.parameters if q.off is not None}})
    assert set(law.like(p)) <= set(law.resembles)
    for name, value in law.like(p).items():
        assert value == getattr(p, name)


def test_a_strength_that_is_nothing_begins_as_it_is_typical():
    g = LAW["maxwell"].parameters[0]
    u = Unknown(g, 0.4, *g.bounds)
    assert u.value(something(u, u.q(0.0))) == pytest.approx(g.typical)
    assert something(u, u.q(0.01)) == u.q(0.01)
