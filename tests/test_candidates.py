"""What each candidate mechanism says, against closed forms."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from looped import over
from refusals import refused
from scipy.integrate import quad

from cutbench.case.model import DEFAULT, PAPER, Model
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import STEP, Answer, Points
from cutbench.mechanisms.cut.compact_cohesion import BELL

LAW = registry()
G = 0.025


def cofactor(F):
    """Of (3, 3, n): J F⁻ᵀ."""
    rows = np.moveaxis(F, -1, 0)
    return np.moveaxis(np.linalg.inv(rows).transpose(0, 2, 1) * np.linalg.det(rows)[:, None, None], 0, -1)


def parameters(**more) -> SimpleNamespace:
    usual = {"G": G, "nu": 0.49, "speed": 0.02, "slice_push": 0.0, "thickness": 0.7, "height": 21.0}
    return SimpleNamespace(**(usual | more))


def at_rest(**more) -> Points:
    return Points(**({"X": np.zeros((3, 1)), "depth": np.zeros(1), "dt": 1.0, "laws": ()} | more))


def tension(stretch: float) -> np.ndarray:
    """F (3, 3, 1) of uniaxial tension without change of volume."""
    return np.diag([stretch, stretch**-0.5, stretch**-0.5])[:, :, None]


def tension_stress(P: np.ndarray, F: np.ndarray) -> float:
    """Nominal stress along the first axis once the pressure that keeps the sides free is added, MPa."""
    pressure = -P[1, 1] / cofactor(F)[1, 1]
    return float((P[0, 0] + pressure * cofactor(F)[0, 0])[0])


# -- strain stiffening -----------------------------------------------------------------------------
def test_gent_in_tension():
    p, x = parameters(inv_J_m=0.05), 2.5
    P = LAW["gent"].stress(tension(x), p, {}, at_rest())[0]
    I1 = x**2 + 2 / x
    assert tension_stress(P, tension(x)) == pytest.approx(G * (x - x**-2) / (1 - 0.05 * (I1 - 3)), rel=1e-12)


def test_gent_goes_on_beyond_locking():
    law, p = LAW["gent"], parameters(inv_J_m=0.1)
    I1 = 3 + np.array([9.8 - 1e-9, 9.8 + 1e-9, 10.0, 12.0, 40.0])
    slope = law.dW_dI1(I1, p, None)
    assert slope[0] == pytest.approx(G / 2 * 50, rel=1e-6)
    assert np.all(np.diff(slope) > 0) and np.isfinite(slope).all()
    assert law.W(I1, p, None)[1] == pytest.approx(law.W(I1, p, None)[0], rel=1e-8)
    for x in I1:
        assert law.W(x + 1j * STEP, p, None).imag / STEP == pytest.approx(law.dW_dI1(x, p, None), rel=1e-12)


def test_gent_energy_has_no_seam():
    """The series and the logarithm meet where they take over from one another, and by the parameter too."""
    law = LAW["gent"]
    for k in (0.0, 1e-9, 0.0099, 0.0101, 0.2):
        exact = -G / 2 * np.log1p(-k * 1.0) / k if k else G / 2
        assert law.W(np.array(4.0), parameters(inv_J_m=k), None) == pytest.approx(exact, rel=1e-12)
    by_k = law.W(np.array(6.0), parameters(inv_J_m=1j * STEP), None).imag / STEP
    assert by_k == pytest.approx(G / 2 * 3.0**2 / 2, rel=1e-12)


def test_yeoh_in_tension():
    p, x = parameters(c2=0.03, c3=0.004), 2.2
    P = LAW["yeoh"].stress(tension(x), p, {}, at_rest())[0]
    y = x**2 + 2 / x - 3
    expected = G * (x - x**-2) * (1 + 2 * 0.03 * y + 3 * 0.004 * y**2)
    assert tension_stress(P, tension(x)) == pytest.approx(expected, rel=1e-12)


def test_compressibility_adds_a_compliance():
    law, p = LAW["compressible"], parameters(compressibility=0.3)
    stiff = LAW["volumetric"].kappa(p)
    assert 1 / law.kappa(p) == pytest.approx(1 / stiff + 0.3 / G, rel=1e-12)


# -- viscoelasticity -------------------------------------------------------------------------------
BRANCH = {"g_1": 0.5, "tau_1": 2.0}


def test_a_fast_maxwell_branch_is_a_spring():
    """C_i has no time to move: neo-Hooke of modulus g G."""
    p, F = parameters(**BRANCH), tension(1.7) * 1.1
    P = LAW["maxwell"].stress(F, p, LAW["maxwell"].start(1, p), at_rest(dt=1e-12))[0]
    spring = LAW["neo_hookean"].stress(F, parameters(G=0.5 * G), {}, at_rest())[0]
    np.testing.assert_allclose(P, spring, rtol=0, atol=1e-10 * np.abs(spring).max())


def test_a_slow_maxwell_branch_carries_nothing():
    p = parameters(**BRANCH)
    P = LAW["maxwell"].stress(tension(1.7), p, LAW["maxwell"].start(1, p), at_rest(dt=1e12))[0]
    assert np.abs(P).max() < 1e-10 * G


def relaxed(stretch: float, time: float, steps: int, law="maxwell", **more) -> float:
    """Stress a while after a sudden stretch."""
    p, F = parameters(**(BRANCH | more)), tension(stretch)
    state = LAW[law].stress(F, p, LAW[law].start(1, p), at_rest(dt=1e-12))[1]
    for _ in range(steps):
        P, state = LAW[law].stress(F, p, state, at_rest(dt=time / steps))
    return tension_stress(P, F)


def test_small_strains_relax_exponentially():
    strain, time = 1e-5, 3.0
    expected = 3 * 0.5 * G * strain * np.exp(-time / 2.0)
    assert relaxed(1 + strain, time, 4000) == pytest.approx(expected, rel=1e-3)


def test_relaxation_converges_at_first_order():
    fine = relaxed(2.0, 3.0, 6400)
    errors = [abs(relaxed(2.0, 3.0, n) - fine) for n in (25, 50, 100)]
    assert 1.8 < errors[0] / errors[1] < 2.3 and 1.8 < errors[1] / errors[2] < 2.3


def test_two_branches_are_two():
    more = {"g_2": 0.3, "tau_2": 40.0}
    second = relaxed(1.5, 3.0, 50, g_1=0.3, tau_1=40.0)
    assert relaxed(1.5, 3.0, 50, "maxwell2", **more) == pytest.approx(
        relaxed(1.5, 3.0, 50) + second, rel=1e-12
    )


def test_the_inelastic_metric_keeps_its_volume():
    p, law = parameters(**BRANCH), LAW["maxwell"]
    state = law.start(1, p)
    for x in (1.2, 2.0, 0.7, 1.1):
        state = law.stress(1.05 * tension(x), p, state, at_rest())[1]
    assert np.linalg.det(state["metric_g_1"][..., 0]) == pytest.approx(1, abs=1e-13)


def test_what_a_branch_has_dissipated_is_work_less_energy():
    """Sinusoidal shear at small strain: the loss per cycle is π G g ωτ/(1 + ω²τ²) γ²."""
    p, law, gamma, period, n = parameters(**BRANCH), LAW["maxwell"], 1e-3, 10.0, 2000
    state, work, P_old, F_old = law.start(1, p), 0.0, np.zeros((3, 3, 1)), np.eye(3)[:, :, None]
    for k in range(1, 4 * n + 1):
        F = np.eye(3)[:, :, None].copy()
        F[0, 1] = gamma * np.sin(2 * np.pi * k / n)
        P, state = law.stress(F, p, state, at_rest(dt=period / n))
        if k > 3 * n:
            work += float(((P + P_old) / 2 * (F - F_old)).sum())
        P_old, F_old = P, F
    x = 2 * np.pi / period * 2.0
    assert work == pytest.approx(np.pi * 0.5 * G * x / (1 + x**2) * gamma**2, rel=5e-3)


# -- a branch that yields --------------------------------------------------------------------------
PLASTIC = {"g_Y": 2.0, "sigma_Y": 0.01}


def pulled(stretches, dt=1.0) -> list[float]:
    """True stress of the yielding branch in uniaxial tension, along a path of stretches."""
    p, law = parameters(**PLASTIC), LAW["yielding"]
    state, stresses = law.start(1, p), []
    for x in stretches:
        P, state = law.stress(tension(x), p, state, at_rest(dt=dt))
        stresses.append(tension_stress(P, tension(x)) * x)
    return stresses


def test_a_branch_yields_at_its_stress_and_unloads_as_a_spring():
    strain = PLASTIC["sigma_Y"] / (3 * PLASTIC["g_Y"] * G)
    before = pulled([1 + strain / 2])[0]
    assert before == pytest.approx(3 * PLASTIC["g_Y"] * G * strain / 2, rel=0.05)
    loading = [*np.linspace(1, 1.6, 601)]
    stresses = pulled([*loading, 1.59])
    assert stresses[-2] == pytest.approx(PLASTIC["sigma_Y"], rel=1e-2)
    assert stresses[150] == pytest.approx(stresses[-2], rel=1e-2)
    slope = (stresses[-2] - stresses[-1]) / np.log(1.6 / 1.59)
    assert slope == pytest.approx(3 * PLASTIC["g_Y"] * G, rel=0.1)
    assert pulled(loading, dt=1e-6) == pulled(loading, dt=1e6), "it is the same at any rate"


def test_the_flow_converges_at_first_order():
    ends = [pulled(np.linspace(1, 2, n + 1)[1:])[-1] for n in (20, 40, 80, 2560)]
    errors = [abs(end - ends[-1]) for end in ends[:-1]]
    assert 1.8 < errors[0] / errors[1] < 2.3 and 1.8 < errors[1] / errors[2] < 2.3


# -- Mullins ---------------------------------------------------------------------------------------
def root(z):
    """What is lost of ς with ``steep_mullins``, z₀ = 0.01."""
    r = [np.sqrt(x / (1 + x)) for x in (0.01 + z, 0.01)]
    return (r[0] - r[1]) / (1 - r[1])


SOFTENINGS = {"mullins": np.tanh, "steep_mullins": root}


@pytest.mark.parametrize("name", SOFTENINGS)
@pytest.mark.parametrize("base", ["neo_hookean", "gent", "yeoh"])
def test_softening_scales_the_isochoric_laws(base, name):
    p = parameters(softening=0.4, softening_energy=0.2, inv_J_m=0.05, c2=0.03, c3=0.001)
    laws = Model((base, "volumetric", name)).laws("bulk")
    at, law = at_rest(laws=laws), LAW[name]
    high, low = 1.02 * tension(2.0), 1.01 * tension(1.5)
    first, state = law.stress(high, p, law.start(1, p), at)
    assert not np.abs(first).any(), "the first loading is not softened"
    W = [LAW[base].energy(F, p, {}, at)[0] for F in (low, high)]
    lost = 0.4 * SOFTENINGS[name]((W[1] - W[0]) / (0.2 * G))
    assert 0.05 < lost < 0.4
    P = law.stress(low, p, state, at)[0]
    np.testing.assert_allclose(P, -lost * LAW[base].stress(low, p, {}, at)[0], rtol=1e-12, atol=1e-17)
    beyond = law.stress(1.02 * tension(2.4), p, state, at)
    assert not np.abs(beyond[0]).any() and beyond[1]["largest_energy"] > state["largest_energy"]


@pytest.mark.parametrize("name", SOFTENINGS)
def test_softening_loses_what_the_cycle_encloses(name):
    p = parameters(softening=0.4, softening_energy=0.2)
    at = at_rest(laws=Model(("neo_hookean", name)).laws("bulk"))
    law, base = LAW[name], LAW["neo_hookean"]
    way = np.concatenate([np.linspace(1, 2, 2000), np.linspace(2, 1, 2000)[1:]])
    state, work, old = law.start(1, p), 0.0, np.zeros((3, 3, 1))
    for a, b in pairwise(way):
        part, state = law.stress(tension(b), p, state, at)
        P = base.stress(tension(b), p, {}, at)[0] + part
        work, old = work + float(((P + old) / 2 * (tension(b) - tension(a))).sum()), P
    largest = G / 2 * (4 + 1 - 3)
    m = 0.2 * G
    assert work == pytest.approx(0.4 * m * quad(SOFTENINGS[name], 0, largest / m)[0], rel=1e-4)
    assert work == pytest.approx(law.work(tension(1.0), p, state, at)[0], rel=1e-4)
    assert law.energy(tension(1.0), p, state, at)[0] == pytest.approx(0, abs=1e-12 * G)


# -- cut -------------------------------------------------------------------------------------------
INTERFACE = {"G_c": 0.01, "delta_c": 0.07, "beta": 0.8, "onset_stiffness": 20.0}


def opened(law, s, p, old=0.0, **more):
    """Normal traction (N,) at the opening s in units of δ_c, from a virgin interface, and its damage."""
    jump = np.zeros((3, np.size(s)))
    jump[0] = np.asarray(s) * p.delta_c
    at = at_rest(jump_old=np.zeros_like(jump) + old, **more)
    T, new = law.traction(jump, p, law.start(np.size(s), p), at)
    return T[0], new["damage"]


@pytest.mark.parametrize("q", [0.0, 0.3, 1.0])
def test_every_shape_has_the_same_work_of_separation_and_the_bell_peaks_at_delta_c(q):
    p, law = parameters(**INTERFACE, compactness=q), LAW["compact_cohesion"]
    s = np.linspace(0, 40, 400001)
    T = opened(law, s, p)[0]
    assert np.trapezoid(T, s * p.delta_c) == pytest.approx(p.G_c, rel=1e-6)
    if q == 1:
        assert s[np.argmax(T)] == pytest.approx(1.0, abs=1e-3)
    damage = opened(law, s, p)[1]
    assert damage[0] == 0 and np.all(np.diff(damage) >= -1e-15)


def test_the_bell_has_no_tail():
    p, law = parameters(**INTERFACE, compactness=1.0), LAW["compact_cohesion"]
    peak, far = opened(law, [1.0, 5.0], p)[0]
    assert peak * p.delta_c / p.G_c == pytest.approx(0.5721, abs=1e-4)
    exponential = opened(LAW["smith_ferrante"], [1.0, 5.0], p)[0]
    assert far / peak < 0.05 * exponential[1] / exponential[0]
    at_peak = 1 + BELL + BELL**2 / 2 + BELL**3 / 6
    assert at_peak == pytest.approx(BELL**4 / 6, rel=1e-12)


def test_toughness_grows_with_the_logarithm_of_the_rate():
    p = parameters(**INTERFACE, rate_toughening=0.3, rate_reference=0.01)
    jump, old = np.array([[0.1], [0.0], [0.0]]), np.array([[0.06], [0.0], [0.0]])
    at = at_rest(jump_old=old, dt=2.0)
    base = LAW["smith_ferrante"]
    begun = base.start(1, p)
    T, new = base.traction(jump, p, begun, at)
    at.before = {"cohesive": Answer(T, new, begun)}
    extra = LAW["rate_toughness"].traction(jump, p, {}, at)[0]
    np.testing.assert_allclose(extra, 0.3 * np.log(1 + 0.02 / 0.01) * T, rtol=1e-12)
    back = at_rest(jump_old=2 * jump, dt=2.0, before=at.before)
    assert not LAW["rate_toughness"].traction(jump, p, {}, back)[0].any(), "closing is not resisted"


@pytest.mark.parametrize("exponent", [0.3, 0.5, 1.0])
def test_toughness_grows_as_a_power_of_the_rate(exponent):
    law = LAW["power_toughness"]
    p = parameters(inv_v_0=50.0, rate_exponent=exponent)
    assert law.growth(np.array([0.02]), p) == pytest.approx(1, rel=0.01)
    slow, fast = law.growth(np.array([20.0, 2000.0]), p)
    assert np.log(fast / slow) / np.log(100) == pytest.approx(exponent, rel=1e-3)
    assert law.growth(np.array([0.0]), p) == 0


# -- blade -----------------------------------------------------------------------------------------
def test_friction_saturates():
    p, law = parameters(mu=0.4, inv_p_s=50.0), LAW["coulomb_saturating"]
    low, half, high = law.strength(np.array([1e-6, 0.02, 1e3]), p, {}, None)
    assert low == pytest.approx(0.4 * 1e-6, rel=1e-3)
    assert half == pytest.approx(0.4 * 0.01)
    assert high == pytest.approx(0.4 / 50.0, rel=1e-4)


def test_adhesion_grows_with_speed_and_with_sliding():
    at = SimpleNamespace(
        touched=np.array([1.0, 1.0, 0.0]), slid=np.array([0.0, 2.0, 2.0]), slip_rate=np.full(3, 0.03)
    )
    p = parameters(tau_v=1e-3, adhesion_reference=0.01, wear=2e-4)
    speed = LAW["adhesion_speed"].strength(np.zeros(3), p, {}, at)
    np.testing.assert_allclose(speed, 1e-3 * np.log(4) * np.array([1, 1, 0]))
    np.testing.assert_allclose(LAW["adhesion_wear"].strength(np.zeros(3), p, {}, at), [0, 4e-4, 0])


def test_a_blunt_tip_is_shorter():
    p = parameters(tip=1.05, blunting=0.5)
    a, b = LAW["blunt_tip"].half_axes(p)
    assert (a, b) == pytest.approx((0.35, 0.7))
    assert a**2 / b == pytest.approx(1.5 * 0.35**2 / 1.05), "the radius has grown by half"


# -- skin and rig ----------------------------------------------------------------------------------
def test_layers_and_serrations():
    at = at_rest(depth=np.array([0.0, 0.5, 5.0]))
    p = parameters(skin_stiffness=2.0, skin_toughness=1.0, skin_thickness=0.5,
                   unevenness=0.4, wavelength=2.0, phase=0.0)  # fmt: skip
    np.testing.assert_allclose(LAW["stiff_skin"].stiffness(p, at), 1 + 2 * np.exp([0, -1, -10]))
    np.testing.assert_allclose(LAW["tough_skin"].toughness(p, at), 1 + np.exp([0, -1, -10]))
    np.testing.assert_allclose(LAW["uneven_toughness"].toughness(p, at), [1.4, 1.0, 0.6], atol=1e-12)
    assert LAW["stiff_skin"].toughness(p, at) == LAW["tough_skin"].stiffness(p, at) == 1.0


def test_the_machine_gives_under_the_true_force():
    model = Model(DEFAULT).with_("machine_compliance", "contact_offset", "force_drift")
    p = parameters(compliance=0.1, offset=-0.2, drift=0.01)
    x, F, t = np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.array([0.0, 50.0])
    shown = model.record(x, F, t, p)
    np.testing.assert_allclose(shown, [[-0.2, 1.0], [0.0, 2.5]])
    assert np.array_equal(Model(DEFAULT).record(x, F, t, p), [x, F])


# -- models ----------------------------------------------------------------------------------------
CANDIDATES = [
    name for name, law in LAW.items() if law.off and name not in (*DEFAULT, "viscous")
]  # fmt: skip


def test_there_are_the_candidates_of_the_catalogue():
    assert len(CANDIDATES) >= 18


@over("name", CANDIDATES)
@pytest.mark.parametrize("base", [DEFAULT, PAPER])
def test_every_candidate_extends_a_model(name, base):
    if name == "compact_cohesion" and base == PAPER:
        # It begins at the default's cohesive law, not at the paper's.
        with refused("with", value="compact_cohesion"):
            Model(base).extended(name)
        return
    model, new = Model(base).extended(name)
    assert name in model.mechanisms
    assert set(new) == set(model.parameters()) - set(Model(base).parameters())
    own = {q.name: q for q in LAW[name].parameters}
    assert any(own[k].off is not None and own[k].off * own[k].factor == value for k, value in new.items())
    assert Model(base).extended(name, name)[0] == model


@pytest.mark.parametrize(
    "base, name",
    [
        (DEFAULT, "viscous"),  # another form of the same term, with no switch of its own
        (Model(DEFAULT).with_("gent").mechanisms, "yeoh"),  # would take the stiffening away
        (Model(DEFAULT).with_("maxwell2").mechanisms, "maxwell"),
    ],
)
def test_what_cannot_be_added_without_effect_is_refused(base, name):
    with refused("with", value=name):
        Model(base).extended(name)


def test_extensions_build_on_one_another():
    model, new = Model(DEFAULT).extended("maxwell", "maxwell2", "mullins", "gent")
    assert "maxwell" not in model.mechanisms and "neo_hookean" not in model.mechanisms
    assert new["g_1"] == new["g_2"] == new["softening"] == new["inv_J_m"] == 0.0
