"""Campaigns by formulas that the package has not: they can be read, and hide what they say they do."""

from __future__ import annotations

import ast
import inspect

import numpy as np
import pytest

from benchmarks import outside
from cutbench.data.campaign import load_campaign

SEED = 3
EFFECTS = sorted({e for each in outside.plan(60, SEED, wider=True) for e in each})
STRETCH = np.linspace(1.0, 1.8, 60)[1:]


def body(*effects, G=0.1, **values):
    made = outside.Body(effects, np.random.default_rng(1))
    made.G, made.__dict__ = G, {**made.__dict__, **values, "G": G}
    return made


def test_nothing_of_the_package_is_in_them():
    tree = ast.parse(inspect.getsource(outside))
    names = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    assert names and not [n for n in names if n.split(".")[0] in ("cutbench", "benchmarks")]


def test_half_have_one_effect_and_each_other_sort_a_sixth():
    for wider in (False, True):
        sorts = [len(e) for e in outside.plan(120, SEED, wider)]
        assert (sorts.count(1), sorts.count(0), sorts.count(2)) == (80, 20, 20)
        assert {c for e in outside.plan(120, SEED, wider) for c in e} <= set(outside.CLASSES)


@pytest.mark.parametrize("number", range(6))
def test_a_campaign_reads_as_it_was_made(tmp_path, number):
    truth = outside.make(number, ("compliance",), SEED, tmp_path, wider=True)
    campaign = load_campaign(truth.file)
    assert [e.role for e in campaign.experiments] == ["train", "train", "test", "test"]
    for e in campaign.experiments:
        t, F = truth.clean[e.id]
        grid = e.on_grid()
        part = np.interp(grid.time_s, t, F) / e.area_mm2 / grid.mean
        # The specimens differ from the clean one by a factor.
        assert np.median(part) == pytest.approx(1.0, abs=4 * truth.scatter / truth.repetitions**0.5)
        assert len(e.repetitions) == truth.repetitions


@pytest.mark.parametrize("mode", ["uniaxial", "press", "pure_shear"])
@pytest.mark.parametrize("effect", [None, *outside.EFFECTS])
def test_every_law_starts_with_its_modulus(mode, effect):
    """Stress over stretch at the start, fast: 3 G in tension, 4 G in pure shear; no effect lowers that."""
    x = 1 + np.array([1, 2, 3]) * (-1e-5 if mode == "press" else 1e-5)
    slope = body(*[effect] * (effect is not None)).force(mode, np.array([1.0, 2.0, 3.0]) * 1e-6, x)[0] / (
        x[0] - 1
    )
    assert slope == pytest.approx((0.4 if mode == "pure_shear" else 0.3), rel=0.02)


def test_a_held_zener_body_relaxes_to_its_spring():
    t = np.geomspace(1e-3, 400, 200)
    P = body("Zener", part=0.5, tau=5.0).force("pure_shear", t, np.full(t.size, 1.4))
    spring = 0.1 * (1.4 - 1.4**-3)
    assert P[0] == pytest.approx(spring, rel=0.01) and P[-1] == pytest.approx(spring / 2, rel=1e-3)
    small = body("Zener", part=0.5, tau=5.0).force("uniaxial", t, np.full(t.size, 1.001))
    np.testing.assert_allclose(small / small[0], 0.5 + 0.5 * np.exp(-t / 5.0), atol=5e-3)


def test_blatz_and_kos_rubber_has_its_poissons_ratio():
    P = body("volume", nu=0.3).force("uniaxial", np.ones(1), np.array([1 + 1e-6]))
    assert P[0] / 1e-6 == pytest.approx(2 * 0.1 * 1.3, rel=1e-3)
    shear = body("volume", nu=0.3).force("pure_shear", np.ones(1), np.array([1 + 1e-6]))
    assert shear[0] / 1e-6 == pytest.approx(2 * 0.1 / 0.7, rel=1e-3)


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e in outside.WRONG + outside.MORE])
def test_what_is_wrong_beside_the_material_shows(effect):
    way = np.linspace(1, 2000, STRETCH.size), STRETCH
    assert body(effect).misfit(("uniaxial", way)) > 100 * body().misfit(("uniaxial", way))
