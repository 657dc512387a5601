"""Homogeneous tests against closed forms, and their exact derivatives."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from refusals import refused

from cutbench.base.errors import ComputationFailed
from cutbench.case.model import Model
from cutbench.data.campaign import load_campaign
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.data.plausible import NEO_HOOKE, apparent_modulus
from cutbench.data.repetition import Repetition
from cutbench.homogeneous import LoadingHistory, predict, respond, slopes
from cutbench.homogeneous.stretching import nominal_stress
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import STEP

STUDIES = Path(__file__).parents[1] / "studies"
ELASTIC = Model(("neo_hookean", "volumetric"))
STRETCH = np.linspace(0.5, 4, 36)


def start(model: Model, **values: float) -> SimpleNamespace:
    """All of a model's parameters in the middle of what is usual (internal units), with ``values``."""
    known = model.parameters()
    usual = {
        name: (q.typical if q.default in (None, 0.0) else q.default) * q.factor for name, q in known.items()
    }
    return SimpleNamespace(**{**usual, **values})


# -- closed forms ------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", HOMOGENEOUS)
def test_neo_hooke_at_constant_volume(kind):
    """P = G(λ − λ⁻²), G(λ − λ⁻⁵), G(λ − λ⁻³): exactly, without a law for volume change."""
    history = LoadingHistory.along(STRETCH, rest=1.0)
    P = respond(kind, history, Model(("neo_hookean",)), SimpleNamespace(G=0.4))
    power = {"uniaxial": -2.0, "equibiaxial": -5.0, "pure_shear": -3.0}[kind]
    np.testing.assert_allclose(P, 0.4 * (STRETCH - STRETCH**power), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("kind", HOMOGENEOUS)
def test_nearly_incompressible_goes_to_the_limit(kind):
    """The error falls with 1 − 2ν, as the compressibility does."""
    history = LoadingHistory.along(STRETCH, rest=1.0)
    limit = 0.4 * NEO_HOOKE[kind](STRETCH)
    errors = []
    for nu in (0.4999, 0.49999, 0.499999):
        P = respond(kind, history, ELASTIC, SimpleNamespace(G=0.4, nu=nu))
        errors.append(np.abs(P - limit).max())
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.05)
    assert errors[2] < 1e-3 * np.abs(limit).max()


@pytest.mark.parametrize(
    ("kind", "slope"),
    [
        ("uniaxial", lambda G, nu: 2 * G * (1 + nu)),
        ("equibiaxial", lambda G, nu: 2 * G * (1 + nu) / (1 - nu)),
        ("pure_shear", lambda G, nu: 2 * G / (1 - nu)),
    ],
)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_hooke_at_small_strain(kind, slope, nu):
    """Linear elasticity: E, E/(1 − ν) and E/(1 − ν²)."""
    history = LoadingHistory.along(np.array([1 + 1e-6]), rest=1.0)
    P = respond(kind, history, ELASTIC, SimpleNamespace(G=0.4, nu=nu))
    assert P[0] / 1e-6 == pytest.approx(slope(0.4, nu), rel=1e-5)


def test_a_free_face_carries_no_stress():
    """The compressible uniaxial test: lateral stretch by bisection, independently."""
    G, nu = 0.4, 0.3
    kappa = 2 * G * (1 + nu) / (3 * (1 - 2 * nu))

    def piola(stretch, a):
        J = stretch * a * a
        I1 = stretch**2 + 2 * a**2
        first = G * J ** (-2 / 3) * (stretch - I1 / (3 * stretch)) + kappa * (J - 1) * a * a
        lateral = G * J ** (-2 / 3) * (a - I1 / (3 * a)) + kappa * (J - 1) * stretch * a
        return first, lateral

    for stretch in (0.6, 1.5, 3.0):
        low, high = 0.2, 3.0
        for _ in range(200):
            middle = (low + high) / 2
            low, high = (middle, high) if piola(stretch, middle)[1] < 0 else (low, middle)
        P = respond(
            "uniaxial",
            LoadingHistory.along(np.array([stretch]), rest=1.0),
            ELASTIC,
            SimpleNamespace(G=G, nu=nu),
        )
        assert P[0] == pytest.approx(piola(stretch, low)[0], rel=1e-10)


def test_gent_at_constant_volume():
    """P = G (λ − λ⁻²)/(1 − (I₁ − 3)/J_m)."""
    model, stretch = Model(("gent",)), np.linspace(1.1, 3, 12)
    p = start(model, G=0.4, inv_J_m=0.05)
    P = respond("uniaxial", LoadingHistory.along(stretch, rest=1.0), model, p)
    I1 = stretch**2 + 2 / stretch
    np.testing.assert_allclose(P, 0.4 * (stretch - stretch**-2) / (1 - 0.05 * (I1 - 3)), rtol=1e-10)


# -- histories ---------------------------------------------------------------------------------------
def test_relaxation_of_one_maxwell_branch():
    """After a small fast step the overstress falls as exp(−t/τ) to the elastic stress."""
    model = Model(("neo_hookean", "volumetric", "maxwell"))
    p = start(model, G=0.1, nu=0.4999, g_1=0.8, tau_1=10.0)
    t = np.concatenate([[1e-4], np.linspace(1, 60, 60)])
    history = LoadingHistory.along(np.full(t.size, 1.001), t, rest=1.0)
    history = LoadingHistory(history.x, np.append(1e-4, np.diff(t)), 1.0, history.pressure_MPa)
    P = nominal_stress("uniaxial", history, model, p, fewest=64)[:, 0]
    elastic = respond("uniaxial", history, Model(("neo_hookean", "volumetric")), p)[0]
    np.testing.assert_allclose(P / elastic, 1 + 0.8 * np.exp(-t / 10), rtol=2e-3)


def test_slow_and_fast_are_the_limits_of_a_branch():
    model = Model(("neo_hookean", "volumetric", "maxwell"))
    p = start(model, G=0.1, nu=0.49, g_1=0.8, tau_1=10.0)
    x = np.linspace(1.05, 2, 20)
    slow = respond("uniaxial", LoadingHistory.along(x, rest=1.0), model, p)
    fast = respond("uniaxial", LoadingHistory.along(x, 1e-6 * np.arange(1, 21), rest=1.0), model, p)
    elastic = ELASTIC
    np.testing.assert_allclose(
        slow, respond("uniaxial", LoadingHistory.along(x, rest=1.0), elastic, p), rtol=1e-6
    )
    assert fast[0] / slow[0] == pytest.approx(1.8, rel=1e-2)


def test_a_cycle_of_a_softened_rubber():
    """First loading is the elastic law; unloading is softer; reloading follows the unloading."""
    model = Model(("neo_hookean", "volumetric", "mullins"))
    p = start(model, G=0.4, nu=0.4999, softening=0.4, softening_energy=0.3)
    x = np.concatenate([np.linspace(1.1, 2, 10), np.linspace(1.9, 1.1, 9), np.linspace(1.2, 2.0, 9)])
    P = respond("uniaxial", LoadingHistory.along(x, rest=1.0), model, p)
    elastic = respond("uniaxial", LoadingHistory.along(x, rest=1.0), ELASTIC, p)
    np.testing.assert_allclose(P[:10], elastic[:10], rtol=1e-6)
    assert np.all(P[10:18] < 0.95 * elastic[10:18])
    np.testing.assert_allclose(P[19:27], P[10:18][::-1], rtol=1e-6)


def test_steps_converge_at_first_order():
    model = Model(("neo_hookean", "volumetric", "maxwell"))
    p = start(model, G=0.1, nu=0.49, g_1=0.8, tau_1=10.0)
    history = LoadingHistory.along(1 + 0.05 * np.arange(1, 11), 4.0 * np.arange(1, 11), rest=1.0)
    P = [nominal_stress("uniaxial", history, model, p, largest=9, fewest=n)[-1, 0] for n in (4, 8, 16, 32)]
    first, second, third = np.diff(P)
    assert first / second == pytest.approx(2, rel=0.1) and second / third == pytest.approx(2, rel=0.05)


def test_the_first_reading_is_reached_at_the_rate_of_the_second():
    history = LoadingHistory.along(np.array([1.2, 1.3, 1.4]), np.array([100.0, 101.0, 102.0]), rest=1.0)
    np.testing.assert_allclose(history.dt, [2, 1, 1])
    steps = list(history.steps(0.05, 1))
    assert sum(dt for _, dt, _ in steps) == pytest.approx(4) and sum(r for _, _, r in steps) == 3


# -- sliding and separation --------------------------------------------------------------------------
def test_sliding_is_friction_and_adhesion():
    model = Model(("neo_hookean", "coulomb", "adhesion", "contact"))
    p = start(model, mu=0.3, tau_W=0.002)
    x = np.concatenate([np.linspace(0.1, 2, 20), np.linspace(1.9, 1.0, 10)])
    history = LoadingHistory.along(x, 0.5 * np.arange(1, 31), pressure_MPa=0.01)
    np.testing.assert_allclose(respond("sliding", history, model, p)[:20], 0.3 * 0.01 + 0.002, rtol=1e-12)
    np.testing.assert_allclose(respond("sliding", history, model, p)[20:], -0.005, rtol=1e-12)


def test_sliding_knows_speed_and_distance():
    model = Model(("neo_hookean", "adhesion", "adhesion_speed", "adhesion_wear"))
    p = start(model, tau_W=0.002, tau_v=0.001, adhesion_reference=0.05, wear=0.0004)
    x = 0.25 * np.arange(1, 9)
    T = respond("sliding", LoadingHistory.along(x, x / 0.2), model, p)
    np.testing.assert_allclose(T, 0.002 + 0.001 * np.log(1 + 0.2 / 0.05) + 0.0004 * x, rtol=1e-10)


def test_separation_is_the_cohesive_law():
    """Smith–Ferrante: T = G_c/δ_c² δ exp(−δ/δ_c); unloading is a line to the origin."""
    model = Model(("neo_hookean", "smith_ferrante"))
    p = start(model, G_c=0.015, delta_c=0.07, beta=0.5)
    out = np.linspace(0.01, 0.3, 30)
    x = np.concatenate([out, [0.2, 0.1]])
    T = respond("separation", LoadingHistory.along(x), model, p)
    np.testing.assert_allclose(T[:30], 0.015 / 0.07**2 * out * np.exp(-out / 0.07), rtol=1e-12)
    np.testing.assert_allclose(T[30:], T[29] * np.array([0.2, 0.1]) / 0.3, rtol=1e-12)
    sliding = respond("separation", LoadingHistory.along(out), model, p, direction="sliding")
    np.testing.assert_allclose(sliding, 0.25 * 0.015 / 0.07**2 * out * np.exp(-0.5 * out / 0.07), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "fades", "rtol"), [("viscous", False, 1e-9), ("viscous_degraded", True, 5e-3)]
)
def test_separation_at_a_rate(name, fades, rtol):
    """The viscous term adds G_c/δ_c² η_reg δ̇, times 1 − d (of the step's middle) where it is degraded."""
    model = Model(("neo_hookean", "smith_ferrante", name))
    p = start(model, G_c=0.015, delta_c=0.07, eta_reg=2.0, beta=1.0)
    x = np.linspace(0.005, 0.2, 40)
    K, keep = 0.015 / 0.07**2, np.exp(-x / 0.07)
    T = respond("separation", LoadingHistory.along(x, x / 0.01), model, p)
    np.testing.assert_allclose(T, K * (keep * x + 2.0 * 0.01 * (keep if fades else 1.0)), rtol=rtol)


# -- derivatives -------------------------------------------------------------------------------------
CYCLE_T = np.linspace(2, 120, 60)
CYCLE = 1 + np.interp(CYCLE_T, [0, 20, 40, 60, 90, 120], [0, 0.8, 0.8, 0.1, 1.2, 1.2])

#: Kind, mechanisms beside neo-Hooke.
DIFFERENTIATED = [
    ("uniaxial", ("volumetric",)),
    pytest.param("equibiaxial", ("volumetric", "maxwell2"), marks=pytest.mark.slow),
    ("pure_shear", ("volumetric", "maxwell", "mullins")),
    ("uniaxial", ("compressible", "yeoh")),
    ("sliding", ("coulomb", "adhesion", "adhesion_speed", "adhesion_wear")),
    ("separation", ("smith_ferrante", "viscous_degraded", "rate_toughness")),
]


@pytest.mark.parametrize(
    ("kind", "names"), DIFFERENTIATED, ids=lambda v: v if isinstance(v, str) else "+".join(v)
)
def test_slopes_are_exact(kind, names):
    """Against central differences, for every parameter of every mechanism, along a history with returns."""
    elastic = () if {"yeoh", "gent"} & set(names) else ("neo_hookean",)
    model = Model((*elastic, *names))
    p = start(model)
    if kind in HOMOGENEOUS:
        r = Repetition(CYCLE, 0.1 * (CYCLE - 0.9), CYCLE_T)
    else:
        r = Repetition(0.2 * (CYCLE - 0.99), 0.01 * CYCLE, CYCLE_T)
    test = Experiment("t", kind, (r,), pressure_MPa=0.01 if kind == "sliding" else 0.0)
    grid = test.on_grid(30)
    mine = [q.name for m in model.all for q in m.parameters if q.name not in ("thickness", "tip")]
    value, found = slopes(test, model, p, mine, grid)
    np.testing.assert_allclose(value, predict(test, model, p, grid), rtol=1e-12, atol=1e-16)
    for i, name in enumerate(mine):
        at = getattr(p, name)
        step = 1e-5 * at
        ends = []
        for sign in (1, -1):
            setattr(p, name, at + sign * step)
            ends.append(predict(test, model, p, grid))
        setattr(p, name, at)
        central = (ends[0] - ends[1]) / (2 * step)
        scale = max(np.abs(central).max(), np.abs(value).max() / at * 1e-6)
        np.testing.assert_allclose(found[:, i], central, atol=1e-6 * scale, err_msg=name)


def test_a_complex_parameter_gives_its_derivative():
    p = SimpleNamespace(G=0.4 + 1j * STEP, nu=0.49)
    history = LoadingHistory.along(STRETCH, rest=1.0)
    P = respond("uniaxial", history, ELASTIC, p)
    real = respond("uniaxial", history, ELASTIC, SimpleNamespace(G=0.4, nu=0.49))
    np.testing.assert_allclose(P.real, real, rtol=1e-12)
    np.testing.assert_allclose(P.imag / STEP, real / 0.4, rtol=1e-10)  # neo-Hooke is linear in G


BULK = [name for name, m in registry().items() if m.slot == "bulk" and m.role != "volumetric"]


@pytest.mark.parametrize("name", BULK)
@pytest.mark.parametrize("kind", HOMOGENEOUS)
def test_every_bulk_law_stands_a_cycle(name, kind):
    """Any registered law goes through loading, hold, return: finite, and its derivatives too."""
    law = registry()[name]
    base = () if law.role == "isochoric" else ("neo_hookean",)
    model = Model((*base, name, "volumetric"))
    # A direction lies along the pull, and there nothing changes by its angles at first.
    angles = [q.name for q in law.parameters if law.directed and q.unit == "deg"]
    p, names = start(model, **dict.fromkeys(angles, 0.0)), [q.name for q in law.parameters]
    test = Experiment("t", kind, (Repetition(CYCLE, 0.1 * (CYCLE - 0.9), CYCLE_T),))
    value, found = slopes(test, model, p, [n for n in names if n not in angles], test.on_grid(15))
    assert np.all(np.isfinite(value)) and np.all(np.isfinite(found))
    assert np.abs(value).max() > 0 and np.all(np.abs(found).max(axis=0) > 0)


def test_the_rest_is_refused():
    cut = Experiment("c", "cut", (Repetition(np.arange(1.0, 9), np.ones(8)),), speed=0.1)
    with refused("kind", value="cut"):
        predict(cut, ELASTIC, SimpleNamespace(G=0.4, nu=0.4))
    strip = Experiment("u", "uniaxial", (Repetition(STRETCH, STRETCH - 1),))
    with refused("parameter", value="Gee"):
        slopes(strip, ELASTIC, SimpleNamespace(G=0.4, nu=0.4), ["Gee"])
    with pytest.raises(ComputationFailed):
        respond(
            "uniaxial", LoadingHistory.along(STRETCH, rest=1.0), ELASTIC, SimpleNamespace(G=np.nan, nu=0.4)
        )


# -- measured ----------------------------------------------------------------------------------------
def test_treloars_rubber_is_near_neo_hooke_at_small_stretch():
    """G = 0.4 MPa meets his tension up to a stretch of 1.4 within 12 %: the units are right."""
    campaign = load_campaign(STUDIES / "rubber" / "treloar.toml")
    tension = campaign.experiment("tension")
    grid = tension.on_grid()
    small = grid.x < 1.4
    assert small.sum() >= 3 and campaign.base.p.G == 0.4
    P = predict(tension, campaign.model, campaign.base.p, grid)
    np.testing.assert_allclose(P[small], grid.mean[small], rtol=0.12)
    for e in campaign.experiments:
        assert apparent_modulus(e, e.repetitions[0]) == pytest.approx(0.4, rel=0.15)
