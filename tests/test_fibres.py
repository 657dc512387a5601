"""Fibres: tension against closed forms, what a part of a specimen stands for, cuts across and along them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from coarse_runs import QUICK
from refusals import refused
from scipy.optimize import minimize

from cutbench.calibration.parameters import free_parameters
from cutbench.case.case import Case, load_case
from cutbench.case.model import Model
from cutbench.data.campaign import Campaign, load_campaign, start_case
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition
from cutbench.discovery import discover
from cutbench.discovery.candidates import candidates
from cutbench.homogeneous import LoadingHistory, predict, respond
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import STEP, Answer, Points
from cutbench.run.build import geometry_of
from cutbench.run.runner import run_case
from cutbench.run.tension import strip_case

LAWS = (registry()["neo_hookean"], registry()["fibres"])
SOFT = Model(("neo_hookean", "fibres"))
STRETCH = np.linspace(0.6, 1.6, 11)
FIBRES = QUICK.set(**{"with": ["fibres"], "g_f": 1.0})


def numbers(angle=0.0, dispersion=0.0, incline=0.0):
    turned = {"fibre_angle": np.radians(angle), "fibre_incline": np.radians(incline), "specimen_angle": 0.0}
    return SimpleNamespace(G=0.02, g_f=1.5, k_2=0.8, fibre_dispersion=dispersion, **turned)


def energy(x, s, m, angle, kappa):
    """Of [[x, s, 0], [0, m, 0], [0, 0, 1/(x m)]], as printed, k₁ = 0.03 MPa."""
    a, b = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    I1, I4 = x**2 + s**2 + m**2 + (x * m) ** -2, (x * a + s * b) ** 2 + (m * b) ** 2
    E = max(kappa * (I1 - 3) + (1 - 3 * kappa) * (I4 - 1), 0)
    return 0.01 * (I1 - 3) + 0.03 / 1.6 * np.expm1(0.8 * E**2)


@pytest.mark.parametrize("kappa", [0.0, 0.15])
@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_tension_at_an_angle(angle, kappa):
    """At constant volume a pulled sheet is narrowed and sheared until its energy is least; P is dΨ/dλ."""
    p = numbers(angle, kappa)
    turned = SimpleNamespace(
        **{**vars(p), "fibre_angle": np.radians(30.0), "specimen_angle": np.radians(30 - angle)}
    )
    for x in (0.8, 1.3, 1.5):
        least = minimize(
            lambda free, x=x: energy(x, *free, angle, kappa), [0.0, x**-0.5], method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-18},
        )  # fmt: skip
        s, m = least.x
        assert (abs(s) > 0.01) == (angle == 45.0 and x > 1)
        F = np.array([[x, s, 0], [0, m, 0], [0, 0, 1 / (x * m)]])[:, :, None]
        P = sum(law.stress(F, p, {}, Points())[0] for law in LAWS)[:, :, 0]
        P = P - P[2, 2] * F[2, 2, 0] * np.linalg.inv(F[:, :, 0]).T
        force = (energy(x + 1e-6, s, m, angle, kappa) - energy(x - 1e-6, s, m, angle, kappa)) / 2e-6
        expected = np.zeros((3, 3))
        expected[0, 0] = force
        np.testing.assert_allclose(P, expected, rtol=0, atol=1e-6 * abs(force))
        history = LoadingHistory.along(np.array([1.0, x]), rest=1.0)
        for said in (p, turned):
            assert respond("uniaxial", history, SOFT, said)[-1] == pytest.approx(force, rel=1e-6)


@pytest.mark.parametrize("kappa", [0.0, 0.15, 1 / 3])
def test_tension_along_the_fibres(kappa):
    P = respond("uniaxial", LoadingHistory.along(STRETCH, rest=1.0), SOFT, numbers(0.0, kappa))
    x, by_I1 = STRETCH, STRETCH - STRETCH**-2
    E = np.maximum(kappa * (x**2 + 2 / x - 3) + (1 - 3 * kappa) * (x**2 - 1), 0)
    slope = 0.03 * E * np.exp(0.8 * E**2) * (2 * kappa * by_I1 + (1 - 3 * kappa) * 2 * x)
    np.testing.assert_allclose(P, 0.02 * by_I1 + slope, rtol=1e-12, atol=1e-15)
    if kappa == 0:
        wide = respond("pure_shear", LoadingHistory.along(STRETCH, rest=1.0), SOFT, numbers())
        np.testing.assert_allclose(wide, 0.02 * (x - x**-3) + slope, rtol=1e-12, atol=1e-15)


def test_fibres_across_the_pull_carry_nothing():
    history = LoadingHistory.along(np.linspace(1.0, 1.6, 7), rest=1.0)
    across = respond("uniaxial", history, SOFT, numbers(90.0))
    np.testing.assert_allclose(across, 0.02 * (history.x - history.x**-2), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kind", ["uniaxial", "pure_shear", "equibiaxial"])
def test_what_is_oblique_in_space_is_sheared_until_its_faces_are_free(kind):
    """With a direction out of the plane, a law for volume change and a memory: P is dΨ/dλ at the least energy
    of all that is free of F, and long after a step the same as without memory."""
    model, p = Model(("neo_hookean", "fibres", "volumetric")), numbers(35.0, 0.1, 25.0)
    p.nu, x = 0.45, np.array([1.0, 1.25])
    F = np.eye(3)[:, :, None] * [[[1.25]], [[1.25 if kind == "equibiaxial" else 1.0]], [[1.0]]]
    places = [(0, 2), (1, 2), (2, 2), *([(0, 1), (1, 1)] if kind == "uniaxial" else [])]

    def stored(free, stretch):
        G = F.copy()
        G[0, 0] = stretch
        for place, value in zip(places, free, strict=True):
            G[place] = value
        return sum(law.energy(G, p, {}, Points())[0] for law in model.laws("bulk"))

    start = [float(i == j) for i, j in places]
    free = minimize(stored, start, (1.25,), "BFGS", options={"gtol": 1e-10}).x
    slope = (stored(free, 1.25 + 1e-5) - stored(free, 1.25 - 1e-5)) / 2e-5
    found = respond(kind, LoadingHistory.along(x, rest=1.0), model, p)[-1]
    assert found == pytest.approx(slope, rel=1e-6)
    p.g_1, p.tau_1 = 0.5, 1.0
    rested = LoadingHistory.along(np.array([1.0, 1.25, 1.25]), np.array([0.0, 1.0, 100.0]), rest=1.0)
    memory = respond(kind, rested, model.with_("maxwell"), p)
    assert memory[-1] == pytest.approx(found, rel=1e-4) and memory[1] > 1.05 * found


def test_derivatives_at_an_angle_are_exact():
    model, p = Model(("neo_hookean", "fibres", "volumetric")), numbers(35.0, 0.1)
    p.nu, history = 0.49, LoadingHistory.along(np.array([1.1, 1.4]), rest=1.0)
    for name, step in (("fibre_angle", 1e-5), ("g_f", 1e-5), ("k_2", 1e-5)):
        values = getattr(p, name) + step * np.array([-1, 1])
        less, more = (
            respond("uniaxial", history, model, SimpleNamespace(**{**vars(p), name: v})) for v in values
        )
        stepped = SimpleNamespace(**{**vars(p), name: getattr(p, name) + 1j * STEP})
        exact = respond("uniaxial", history, model, stepped).imag / STEP
        np.testing.assert_allclose(exact, (more - less) / (2 * step), rtol=1e-6)


def test_beyond_its_reach_the_stress_goes_on_straight():
    """Energy and stress have no seam there."""
    p, law = numbers(), registry()["fibres"]
    x = np.linspace(1.5, 3.0, 301)
    F = np.zeros((3, 3, x.size))
    F[0, 0], F[1, 1], F[2, 2] = x, x**-0.5, x**-0.5
    P, W = law.stress(F, p, {}, Points())[0], law.energy(F, p, {}, Points())
    along = P[0, 0] - P[2, 2] * x**-1.5
    np.testing.assert_allclose(along[1:-1], (W[2:] - W[:-2]) / (x[2:] - x[:-2]), rtol=2e-3)


# -- campaigns ---------------------------------------------------------------------------------------
SHEET = """material = "elastomer"
baseline = ["neo_hookean", "volumetric"]
candidates = ["fibres", "gent"]
"""
STRIP = """
[[experiment]]
id = "{0}"
kind = "uniaxial"
data = "{0}.csv"
columns = {{ stretch = "x", stress = "y", repetition = "r" }}
units = {{ stretch = "1", stress = "MPa" }}
angle = "{1} deg"
"""


def sheet(folder, angles, stress):
    """A campaign of strips that were cut out at ``angles``, with a ``stress(stretch, angle)``."""
    rng, x = np.random.default_rng(1), np.linspace(1.02, 1.5, 30)
    for k, angle in enumerate(angles):
        rows = [
            f"{r},{a:.5g},{b:.6g}"
            for r in range(3)
            for a, b in zip(x, stress(x, angle) * (1 + 0.02 * rng.standard_normal()), strict=True)
        ]
        (folder / f"t{k}.csv").write_text("r,x,y\n" + "\n".join(rows) + "\n")
    text = SHEET + "".join(STRIP.format(f"t{k}", angle) for k, angle in enumerate(angles))
    (folder / "campaign.toml").write_text(text)
    return load_campaign(folder / "campaign.toml")


def reinforced(x, angle):
    """A standard reinforcing sheet (Qiu & Pence 1997), of a quadratic in Ī₄, along and across its fibres."""
    by_fibre = 0.08 * (x**2 - 1) * x if angle == 0 else 0.04 * (1 / x - 1) * -(x**-2.0)
    return 0.06 * (x - x**-2) + by_fibre


def test_an_experiment_says_how_its_specimens_were_cut_out(tmp_path):
    campaign = sheet(tmp_path, (0, 45), lambda x, angle: 0.06 * (x - x**-2))
    first, second = campaign.experiments
    assert (first.angle, second.angle) == (0.0, pytest.approx(np.radians(45)))
    assert campaign.angles == {0, 45}
    model = Model(("neo_hookean", "fibres", "volumetric"))
    p = SimpleNamespace(**{**vars(numbers()), "nu": 0.49})
    turned = SimpleNamespace(**{**vars(p), "fibre_angle": -second.angle})
    alike = predict(second, model, p), predict(first, model, turned)
    np.testing.assert_allclose(*alike, rtol=1e-9)
    assert predict(first, model, p)[-1] > 1.5 * alike[0][-1]
    assert "fibre_angle" in {u.name for u in free_parameters(fibred(campaign))}
    along = sheet(tmp_path, (180, 0), lambda x, angle: 0.06 * (x - x**-2))
    assert "fibre_angle" not in {u.name for u in free_parameters(fibred(along))}


def fibred(campaign):
    """The same with fibres in its baseline."""
    base, _ = start_case("elastomer", baseline=["neo_hookean", "volumetric", "fibres"], kinds=["uniaxial"])
    return replace(campaign, base=base.set(g_f=1.0), candidates=())


def test_fibres_are_asked_for_where_specimens_were_cut_out_at_two_angles(tmp_path):
    for angles, asked in (((0, 90), True), ((0, 0), False), ((0, 180), False)):
        campaign = sheet(tmp_path, angles, lambda x, angle: 0.06 * (x - x**-2))
        found, left_out = candidates(campaign, campaign.base, ())
        assert ("fibres" in {c.name for c in found}) == asked == ("fibres" not in left_out)
    said = " ".join(discover(replace(campaign, candidates=("fibres",)), workers=0).notes)
    assert "fibres" in said and "two angles" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stress", "names"), [(reinforced, True), (lambda x, angle: reinforced(x, 0), False)]
)
def test_hidden_fibres_are_found_and_others_are_not_named(tmp_path, stress, names):
    found = discover(sheet(tmp_path, (0, 90), stress), workers=0)
    assert found.verdict == "mechanism" and ("fibres" in found.names) == names, found.names


def test_a_cut_has_the_angle_of_its_specimen_and_its_own_slice_push_ratio():
    readings = Repetition(np.linspace(0.1, 3, 20), np.linspace(0.1, 1, 20))
    sizes = {"specimen": {"width": 20.0, "length": 30.0, "height": 14.0}, "blade": {"thickness": 0.7}}
    cut = Experiment("cut", "cut", (readings,), speed=0.02, angle=np.radians(30), slice_push=2.0, **sizes)
    plain = replace(cut, id="plain", angle=0.0, slice_push=None)
    base = load_case("gelatin", {"with": "fibres", "g_f": 1.0, "slice_push": 0.5})
    campaign = Campaign("two cuts", base, (cut, plain))
    assert [campaign.case(e)["slice_push"] for e in (cut, plain)] == ["2", "0.5"]
    assert [campaign.case(e)["specimen_angle"] for e in (cut, plain)] == ["30 deg", "0 deg"]
    assert geometry_of(campaign.case(cut)).split and not geometry_of(campaign.case(plain)).split
    with refused("angle", hint="rad"):
        replace(cut, angle=30.0)


# -- parts and wholes --------------------------------------------------------------------------------
def test_what_is_oblique_takes_the_whole():
    def geometry(dim, angle, incline):
        turned = {"fibre_angle": f"{angle} deg", "fibre_incline": f"{incline} deg"}
        small = {"width": "8 mm", "length": "8 mm", "height": "8 mm", "depth": "1 mm", "h": 3.0}
        return geometry_of(load_case("gelatin", {**turned, **small, "with": "fibres", "g_f": 1.0}, dim=dim))

    images = {(0, 0): 4, (90, 0): 4, (0, 90): 4, (90, 30): 2, (30, 0): 1, (0, 30): 1}
    for angles, parts in images.items():
        section = geometry(2, *angles)
        assert section.split == (parts == 1) and section.sheared == (angles[1] == 30)
        assert geometry(3, *angles).multiplicity == parts
    oblique = {"with": "fibres", "g_f": 1.0, "fibre_angle": "30 deg"}
    for symmetry in ("half", "quarter"):
        with refused("symmetry", value=symmetry):
            load_case("gelatin", {**oblique, "symmetry": symmetry}, dim=3)
    with refused("symmetry", value="quarter"):
        load_case(
            "gelatin",
            {**oblique, "fibre_angle": "90 deg", "fibre_incline": "9 deg", "symmetry": "quarter"},
            dim=3,
        )
    with refused("mechanisms"):
        strip_case(load_case("gelatin", oblique, dim=3), notch_mm=2.0)
    # Fibres that are off, or lie in all directions, have none.
    for none in ({"g_f": 0.0}, {"fibre_dispersion": 1 / 3}):
        assert not geometry_of(load_case("gelatin", {**oblique, **none})).split


def test_a_right_angle_is_read_back():
    right = load_case("gelatin", {"with": "fibres", "g_f": 1.0, "fibre_angle": "90 deg"})
    assert Case.from_dict(right.to_dict()).p.fibre_angle == right.p.fibre_angle


@pytest.mark.parametrize("angle", [0, 90])
def test_a_cut_through_fibres_closes(angle):
    result = run_case(FIBRES.set(fibre_angle=f"{angle} deg"))
    assert result.outcome.done and abs(result.measures["closure"]) < 0.01
    assert result.curve["work_fibres_mJ"][-1] > 0


def test_derivatives_know_that_an_angle_decides_what_is_meshed():
    """Half a section has no mirror image where its fibres turn."""
    with refused("sensitivities", value="fibre_angle"):
        run_case(FIBRES, sensitivities=["fibre_angle"])
    step = 1e-4
    found = run_case(FIBRES.set(depth="0.3 mm"), sensitivities=["g_f"])
    less, more = (run_case(FIBRES.set(depth="0.3 mm", g_f=1 + s * step)).force_N[-1] for s in (-1, 1))
    slope = found.sensitivities["g_f"][-1]
    assert slope == pytest.approx((more - less) / (2 * step), rel=1e-3)


def test_mirrored_fibres_give_the_mirrored_cut():
    left, right = (
        run_case(FIBRES.set(fibre_angle=f"{angle} deg", fibre_incline="20 deg", depth="0.3 mm"))
        for angle in (-30, 30)
    )
    np.testing.assert_allclose(left.force_N, right.force_N, rtol=1e-6)


# -- toughness ---------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("angle", "kappa", "part"), [(0, 0.0, 1.0), (90, 0.0, 0.0), (60, 0.0, 0.25), (90, 0.2, 0.2)]
)
def test_fibres_that_cross_the_cut_plane_are_cut(angle, kappa, part):
    """The work of separation is G_c (1 + k N·H N), of a specimen that was turned as of fibres that are."""
    p = numbers(angle, kappa)
    p = SimpleNamespace(**vars(p), G_c=5e-3, delta_c=0.07, beta=1.0, thickness=0.7, fibre_toughening=3.0)
    cohesive, law = registry()["smith_ferrante"], registry()["fibre_toughness"]
    s = np.linspace(0, 40, 20001)[None] * [[p.delta_c], [0], [0]]
    state, at = cohesive.start(s.shape[1], p), Points(jump_old=s, dt=1.0)
    T, new = cohesive.traction(s, p, state, at)
    at.before = {"cohesive": Answer(T, new, state)}
    for said in (p, SimpleNamespace(**{**vars(p), "fibre_angle": 0.0, "specimen_angle": np.radians(-angle)})):
        more = law.traction(s, said, {}, at)[0][0]
        assert np.trapezoid(T[0] + more, s[0]) == pytest.approx(p.G_c * (1 + 3 * part), rel=1e-4)
        assert law.like(said)["G_c"] == pytest.approx(p.G_c * (1 + 3 * part))
    closed = law.traction(-s, p, {}, at)[0][0]
    assert not closed[1:].any()


def test_a_cut_across_fibres_is_that_of_what_is_as_tough():
    turned = {"fibre_angle": "50 deg", "specimen_angle": "-10 deg", "fibre_toughening": 2.0}
    tough = run_case(QUICK.set(**{**turned, "with": "fibre_toughness", "depth": "0.5 mm"}))
    plain = run_case(QUICK.set(depth="0.5 mm", G_c=f"{1e3 * QUICK.p.G_c * 1.5:.9g} J/m^2"))
    np.testing.assert_allclose(
        tough.force_N,
        np.interp(tough.displacement_mm, plain.displacement_mm, plain.force_N),
        rtol=0.01,
        atol=1e-3,
    )
    assert abs(tough.measures["closure"]) < 0.01
