"""The gain on clean curves: made-up tests of which it is known."""

import numpy as np
import pytest

from cutbench.data.covariance import Factors, matern
from cutbench.discovery.noise_free_gain import NEAR, Evidence, PredictedTest, gain_from_draws

S = np.linspace(0.025, 1, 40)
CLEAN = S + S**3


def evidence(rng, scatter=0.05, repetitions=3, tests=2, noise=0.005, before=1.3, bend=0.02):
    """Tests whose clean curve is known, a first model with a wrong shape and a second nearly right, by
    a factor and a wave. What the fit leaves open is a factor. With its true gain."""
    fitted = 1 + scatter / np.sqrt(2 * repetitions) * rng.standard_normal()
    after = fitted * (CLEAN + bend * np.sin(5 * S))
    wrong = fitted * before * (S + 0.2 * S**3)

    def known(mean, rest):
        correlation = matern(np.abs(S[:, None] - S), 0.1)
        return PredictedTest(
            mean, wrong, after, after[:, None], rest * np.eye(40), correlation, repetitions, "uniaxial", 1.0
        )

    def measured():
        factor = 1 + scatter / np.sqrt(repetitions) * rng.standard_normal()
        return CLEAN * factor + noise / np.sqrt(repetitions) * rng.standard_normal(40)

    rest = noise**2 / repetitions
    made = [known(measured(), rest) for _ in range(tests)]
    fits = [known(measured(), rest + bend**2) for _ in range(2)]
    true = 1 - np.linalg.norm(after - CLEAN) / np.linalg.norm(wrong - CLEAN)
    dof = 4 * (repetitions - 1) + 2
    return Evidence(made, fits, {"uniaxial": Factors(scatter**2, dof)}), true


@pytest.mark.slow
def test_it_holds_the_true_gain_as_often_as_it_says():
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        made, true = evidence(rng)
        found.append((gain_from_draws(made, rng, 150), true))
    inside = sum(gain.low <= true <= gain.high for gain, true in found)
    assert inside >= 31  # of 36 expected: fewer by chance in one of fifty
    assert np.median([abs(gain.value - true) for gain, true in found]) < 0.05


@pytest.mark.slow
def test_it_is_near_as_often_as_it_says():
    near, chances = 0, []
    for seed in range(30):
        rng = np.random.default_rng([seed, 1])
        made, true = evidence(rng, scatter=0.15, tests=1)
        gain = gain_from_draws(made, rng, 150)
        near += abs(gain.value - true) < NEAR
        chances.append(gain.near)
    expected, chance = np.sum(chances), np.array(chances)
    assert 6 < expected < 24  # neither is certain
    assert abs(near - expected) < 2.5 * np.sqrt(np.sum(chance * (1 - chance)))


def test_scatter_is_not_what_a_model_is_off_by():
    """One specimen 15 % too stiff: the readings are far from a model that is right."""
    rng = np.random.default_rng(0)
    made, _ = evidence(rng, scatter=0.1, repetitions=1, tests=1, bend=0.0)
    one = made.tests[0]
    stiff = PredictedTest(
        1.15 * CLEAN, 0.6 * CLEAN, CLEAN, one.J, one.rest, one.correlation, 1, "uniaxial", 1.0
    )
    gain = gain_from_draws(Evidence([stiff], made.train, made.factors), rng)
    against_readings = 1 - 0.15 / 0.55
    assert gain.value > against_readings + 0.05 and gain.high > 0.9
    assert gain.high - gain.low > 0.1


def test_what_is_known_exactly_has_a_narrow_interval():
    rng = np.random.default_rng(1)
    narrow, true = evidence(rng, scatter=0.002, noise=0.001, repetitions=5)
    wide, _ = evidence(rng, scatter=0.1, noise=0.001, repetitions=1)
    narrow, wide = (gain_from_draws(each, rng) for each in (narrow, wide))
    assert narrow.value == pytest.approx(true, abs=0.02)
    assert narrow.near > 0.9 > wide.near
    assert narrow.high - narrow.low < (wide.high - wide.low) / 3
