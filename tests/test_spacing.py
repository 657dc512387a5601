"""Where a test with holds is compared: its ramps count as much as its holds."""

import numpy as np

from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition

RAMP_S, HOLD_S, TOP = 2.0, 60.0, 2.5


def ramp_and_hold(jitter: float = 0.0, count: int = 3) -> Experiment:
    """A neo-Hookean bar, pulled within two seconds and held for a minute, read often."""
    t = np.append(np.linspace(0.02, RAMP_S, 120), RAMP_S + np.geomspace(0.5, HOLD_S, 120))
    x = np.interp(t, [0.0, RAMP_S], [1.0, TOP])
    rng = np.random.default_rng(0)
    made = []
    for k in range(count):
        shown = x + jitter * rng.standard_normal(t.size) * (t > RAMP_S)
        made.append(Repetition(shown, x - x**-2, t, f"{k}"))
    return Experiment("hold", "uniaxial", tuple(made), "train", {}, {}, None)


def test_readings_on_the_grid_are_those_of_the_curve():
    grid = ramp_and_hold().on_grid(40)
    x = np.interp(grid.time_s, [0.0, RAMP_S], [1.0, TOP])
    assert np.abs(grid.mean - (x - x**-2)).max() < 0.005 * grid.mean.max()


def test_half_of_the_values_lie_on_the_ramp():
    for jitter in (0.0, 1e-3):  # the way of a gauge that trembles is none
        on_ramp = int(np.sum(ramp_and_hold(jitter).on_grid(40).time_s < RAMP_S))
        assert 15 <= on_ramp <= 25


def test_a_cycle_at_one_rate_keeps_its_even_grid():
    t = np.linspace(1.0, 200.0, 200)
    x = 1 + np.minimum(t, 200.0 - 0.5 * t) / 100
    made = tuple(Repetition(x, x - x**-2, t, f"{k}") for k in range(2))
    grid = Experiment("cycle", "uniaxial", made, "train", {}, {}, None).on_grid(20)
    assert np.all(np.diff(grid.time_s) > 0) and grid.x.max() > 0.99 * x.max()
