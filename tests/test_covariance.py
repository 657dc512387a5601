"""How far measured curves can be trusted: readings, averages, specimens."""

from __future__ import annotations

import numpy as np
import pytest

from cutbench.data.covariance import Block, Factors, matern, roughness
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition, averaging_matrix, turning_points


def test_averages_keep_lines_and_lower_the_noise():
    s = np.sort(np.random.default_rng(0).uniform(0, 10, 400))
    grid = np.linspace(s[0], s[-1], 30)
    A = averaging_matrix(s, grid)
    np.testing.assert_allclose(A @ (3 - 2 * s), 3 - 2 * grid, atol=1e-12)
    assert 0.15 < np.sqrt((A[5:-5] ** 2).sum(axis=1)).mean() < 0.45  # thirteen readings each: 0.28
    few = averaging_matrix(s[::40], s[::40])
    np.testing.assert_allclose(few, np.eye(10), atol=1e-12)


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_roughness_is_the_noise(sigma):
    s = np.linspace(0, 12, 500)
    smooth = 2 * np.minimum(s, 3) + np.sin(s)
    jump = np.where(s > 6, -3.0, 0.0)
    noisy = smooth + jump + sigma * np.random.default_rng(1).standard_normal(s.size)
    found = roughness(s, noisy)
    assert found.mean() == pytest.approx(sigma, rel=0.12)
    # A noise that doubles half way is seen to grow.
    louder = smooth + sigma * np.where(s > 6, 2, 1) * np.random.default_rng(2).standard_normal(s.size)
    found = roughness(s, louder)
    assert 1.2 < found[s > 7].mean() / found[s < 5].mean() < 2.2


def sawing(tooth: float, high: float, seed: int, noise: float = 0.003) -> Experiment:
    """A force that saws about a smooth one behind 3 mm, in teeth of some ``tooth`` mm and ``high`` N."""
    rng, s = np.random.default_rng(seed), np.linspace(0.1, 12, 1200)
    ends = np.cumsum(tooth * rng.uniform(0.5, 1.5, int(40 / tooth)))
    nth = np.searchsorted(ends, s)
    ramp = (s - np.append(0.0, ends)[nth]) / np.diff(ends, prepend=0.0)[nth] - 0.5
    force = np.where(s < 3, 0.5 * s, 1.5 - 0.6 * np.minimum(s - 3, 1) + 0.02 * s)
    force += np.where(s < 3, 0.0, high * ramp) + noise * rng.standard_normal(s.size)
    specimen = {"width": 30.0, "length": 30.0, "height": 20.0}
    return Experiment("saw", "cut", (Repetition(s, force),), speed=0.02, specimen=specimen)


def test_a_saw_in_the_force_of_a_cut_is_noise():
    """No smooth curve can follow it: about its own mean it is to be worth a standard deviation, not ten."""
    off, before = [], []
    for seed in range(30):
        saw, plain = (sawing(0.3, high, seed).on_grid(40) for high in (0.2, 0.0))
        line = np.where(saw.x < 3, 0.5 * saw.x, 1.5 - 0.6 * np.minimum(saw.x - 3, 1) + 0.02 * saw.x)
        behind = saw.x > 5.5
        off.append(((saw.mean - line) / saw.reading)[behind])
        before.append((saw.reading / plain.reading)[saw.x < 1.5])
        # Where nothing saws, noise is the noise that it was.
        assert plain.reading[behind].mean() == pytest.approx(0.003 / np.sqrt(30), rel=0.35)
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.6
    assert np.mean(before) == pytest.approx(1.0, abs=0.1)


def test_where_a_blade_turns_is_no_tooth():
    t = np.linspace(0.0, 30.0, 900)
    u = np.interp(t, [0, 10, 20, 30], [0.0, 5.0, 5.0, 0.0])
    force = np.interp(t, [0, 6, 7, 10, 20, 22, 30], [0.0, 1.5, 0.9, 1.1, 0.7, 0.0, 0.0])
    returns = Experiment("back", "cut", (Repetition(u, force, t),))
    assert not returns.monotone
    assert returns.on_grid(40).reading.max() < 1.1e-3 * force.max()


def specimens(count: int, seed: int, n: int = 200) -> Experiment:
    """Curves of a known scatter, 4 % of the force, correlated over 3 mm, and noise of 0.03 N."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.1, 12, n)
    force = 2 * np.minimum(s, 3) + 0.3 * s
    C = 0.04**2 * matern(np.abs(s[:, None] - s), 3.0) * force[:, None] * force
    root = np.linalg.cholesky(C + 1e-12 * np.eye(n))
    made = [
        Repetition(s, force + root @ rng.standard_normal(n) + 0.03 * rng.standard_normal(n), name=str(i))
        for i in range(count)
    ]
    return Experiment("slow", "cut", tuple(made), speed=0.02)


def test_covariance_of_the_mean_is_that_of_means():
    """Averaged over campaigns, the stated variance of three kinds of sums is what they scatter by."""
    grids = [specimens(4, seed).on_grid(40) for seed in range(150)]
    x = grids[0].x
    truth = 2 * np.minimum(x, 3) + 0.3 * x
    sums = np.stack([np.ones(40) / 40, truth / (truth @ truth), np.eye(40)[20]])
    means = np.array([sums @ g.mean for g in grids])
    covariances = [Block.of(g, Factors.of([g]), g.mean).total for g in grids]
    stated = np.array([np.einsum("ki,ij,kj->k", sums, C, sums) for C in covariances]).mean(axis=0)
    actual = ((means - sums @ truth) ** 2).mean(axis=0)
    # 150 campaigns know a variance to 12 %.
    np.testing.assert_allclose(stated, actual, rtol=0.4)
    assert all(np.linalg.eigvalsh(C)[0] > 0 for C in covariances[:10])
    assert np.mean([g.scatter.mean() / truth.mean() for g in grids]) == pytest.approx(0.04, rel=0.25)


def test_more_specimens_know_more():
    few, many = (np.mean([specimens(n, k).on_grid(40).deviation.mean() for k in range(8)]) for n in (3, 12))
    assert many == pytest.approx(few / 2, rel=0.35)


def test_one_repetition_says_what_it_does_not_know():
    alone = specimens(1, 0).on_grid(40)
    assert alone.estimated
    assert alone.dof == 0 and not alone.scatter.any()
    several = specimens(3, 0).on_grid(40)
    assert not several.estimated and several.dof == 2
    assert alone.deviation.mean() < several.deviation.mean()


def test_a_history_keeps_its_corners():
    t = np.linspace(0, 100, 501)
    x = 1 + np.interp(t, [0, 20, 50, 70, 100], [0, 0.5, 0.5, 0, 0.8])
    r = Repetition(x, x - 0.9, t)
    test = Experiment("cycle", "uniaxial", (r,))
    assert not test.monotone
    np.testing.assert_allclose(t[turning_points(x)], [20, 50, 70], atol=0.5)
    grid = test.on_grid(40)
    for corner, stretch in ((20, 1.5), (50, 1.5), (70, 1.0)):
        i = int(np.argmin(np.abs(grid.time_s - corner)))
        assert grid.time_s[i] == pytest.approx(corner, abs=0.5)
        assert grid.x[i] == pytest.approx(stretch, abs=5e-3)


def test_no_mean_is_taken_over_a_change_of_speed():
    # Thirty times as fast in the second half, and twice the force there.
    x = np.linspace(0, 10, 121)[1:]
    fast = x > 5
    t = np.cumsum(np.where(fast, 1.0, 30.0))
    test = Experiment("steps", "separation", (Repetition(x, np.where(fast, 2.0, 1.0), t),) * 2)
    grid = test.on_grid(40)
    assert test.monotone
    np.testing.assert_allclose(grid.mean, np.where(grid.x > 5, 2.0, 1.0), atol=1e-9)
    speed = np.diff(grid.x) / np.diff(grid.time_s)
    assert (np.abs(speed / speed.max() - 1) < 1e-6).sum() + (
        np.abs(speed / speed.min() - 1) < 1e-6
    ).sum() == 39


def test_a_hold_is_no_monotone_test():
    t = np.linspace(1, 100, 100)
    rising = Experiment("a", "uniaxial", (Repetition(1 + 0.01 * t, 0.01 * t, t),))
    held = Experiment("b", "uniaxial", (Repetition(1 + 0.01 * np.minimum(t, 30), 0.01 * t, t),))
    assert rising.monotone and not held.monotone
