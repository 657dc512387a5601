"""The barrier between parts of a surface: smooth, exact in its tangent, without a share in free motion."""

from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.case.model import Model
from cutbench.case.tuning import SelfContactTuning
from cutbench.forms.assembly import Pattern
from cutbench.forms.self_contact import SelfContactForm
from cutbench.run.build import build
from cutbench.run.runner import run_case
from verification import crease

P, EPS = SimpleNamespace(G=0.02, nu=0.49), 1e-30
TUNING = SelfContactTuning(part=0.5, reach=0.1)


def form_on(X, **changes):
    tuning = SelfContactTuning(**{**vars(TUNING), **changes})
    return SelfContactForm([np.arange(X.shape[1])], X, Model(("neo_hookean",)).laws("bulk"), 1.0, tuning)


def pocket(seed=0):
    """A line of unequal segments, and displacements that fold it until it nearly meets itself."""
    rng = np.random.default_rng(seed)
    s = np.cumsum(rng.uniform(0.6, 1.4, 80)) / 8
    X = np.stack([s, 0 * s])
    turned = np.pi * np.clip((s - s[35]) / (s[45] - s[35]), 0, 1)
    x = np.cumsum(np.stack([np.cos(turned), np.sin(turned)]) * np.diff(s, prepend=0), axis=1)
    # What goes back is brought near to what goes forth.
    x[1, 45:] *= 0.04 / x[1, 45:].mean()
    x[1, 36:45] *= 0.5
    x[1] += 0.005 * rng.uniform(-1, 1, 80)
    return X, (x - X).T.ravel()


def evaluated(form, u):
    if not np.iscomplexobj(u):
        form.learn(u)
    local = form.evaluate(u, P, {}, None)
    pattern = Pattern(
        u.size, np.zeros(0, int), {form.name: form.dofs}, True, couples={form.name: form.couples}
    )
    if np.iscomplexobj(u):
        return pattern.vector(form.name, local.vector)
    data = np.zeros(pattern.indices.size)
    pattern.add(data, form.name, local.matrix)
    K = pattern.csr(data).toarray()
    return pattern.vector(form.name, local.vector), K + np.triu(K, 1).T


@pytest.mark.parametrize("seed", range(4))
def test_forces_and_tangent_are_derivatives_of_the_energy(seed):
    X, u = pocket(seed)
    form = form_on(X)
    force, K = evaluated(form, u)
    assert sum(form.stored(u, P, {}).values()) > 0 and not form.crosses(u)
    for k in range(3):
        v = np.random.default_rng(k).normal(size=u.size)
        ahead = evaluated(form, u + 1j * EPS * v)
        np.testing.assert_allclose(ahead.imag / EPS, K @ v, rtol=0, atol=1e-9 * np.abs(K @ v).max())
        slope = (
            sum(form.stored(u + 1e-7 * v, P, {}).values()) - sum(form.stored(u - 1e-7 * v, P, {}).values())
        ) / 2e-7
        assert slope == pytest.approx(force @ v, rel=1e-4)


def test_rigid_motions_meet_no_force():
    X, u = pocket()
    force, K = evaluated(form_on(X), u)
    x = X + u.reshape(-1, 2).T
    turn = np.stack([-x[1], x[0]]).T.ravel()
    scale = np.abs(force).max() * np.abs(x).max()
    for motion in (np.tile([1.0, 0.0], X.shape[1]), np.tile([0.0, 1.0], X.shape[1]), turn):
        assert abs(force @ motion) < 1e-10 * scale
    np.testing.assert_allclose(K @ np.tile([1.0, 0.0], X.shape[1]), 0, atol=1e-10 * np.abs(K).max())


def test_nothing_is_in_the_way_of_what_is_apart():
    X, u = pocket()
    form = form_on(X)
    assert sum(form.stored(0 * u, P, {}).values()) == 0 and not form.learn(0 * u)
    assert form.room(0 * u, 1e-3 * u) == np.inf
    # Halved along itself it is still apart.
    halved = np.stack([-0.45 * X[0], 0 * X[0]]).T.ravel()
    assert sum(form.stored(halved, P, {}).values()) == 0


def test_steps_end_before_lines_touch():
    X, u = pocket()
    form = form_on(X)
    ends = [0.8 * form.room(u, du) for du in np.random.default_rng(0).normal(size=(20, u.size))]
    assert max(ends) < 1
    for du in np.random.default_rng(0).normal(size=(20, u.size)):
        part = form.room(u, du)
        assert 0 < part < 1 and not form.crosses(u + part * du)
    down = np.zeros_like(u)
    down[2 * 60 + 1] = -0.2  # the far part through the near one
    assert form.crosses(u + down) and not form.crosses(u + form.room(u, down) * down)


@pytest.mark.parametrize("gap", [0.004, 0.01, 0.016])
def test_two_flats_press_the_same_on_every_mesh(gap):
    """Per length, of both: over a long gap the energy is that of the formula, whatever faces what."""

    def energy(n, m):
        s, t = np.linspace(0, 4, n + 1), 4 * np.linspace(0, 1, m + 1) ** 1.2
        flat = np.stack([np.append(s, 4.1 + t), np.zeros(n + m + 2)])
        back = np.stack([np.append(s, t[::-1]), np.repeat([0.0, gap], [n + 1, m + 1])])
        return sum(form_on(flat, reach=0.02, part=10.0).stored((back - flat).T.ravel(), P, {}).values())

    s = gap / 0.02
    exact = 4 * P.G * 0.02 * -((s - 1) ** 2) * np.log(s)
    for n, m in ((20, 20), (40, 20), (40, 60), (90, 70)):
        # What stands at the turn, 0.1 mm long, counts too.
        assert energy(n, m) == pytest.approx(exact, rel=0.04)


@pytest.fixture(scope="module")
def folded():
    """An elastomer whose plane opens below the tip: the cap above folds in beside the blade."""
    coarse = {"h": "0.3 mm", "corner": 0.2, "shallow": 1, "step": "0.1 mm", "energy_step": 0.2}
    return run_case(
        load_case("elastomer", {**coarse, "penalty": "4000 1/mm", "stick": "1600 1/mm", "depth": "3.55 mm"})
    )


def test_what_folds_in_beside_the_blade_is_not_in_one_place_twice(folded):
    assert folded.outcome.done and folded.measures["onset_mm"] < 3.45
    assert np.isnan(folded.measures["crossed_mm"]) and folded.measures["crossed_mm2"] == 0
    assert abs(folded.measures["closure"]) < 0.01
    stored = folded.curve["work_self_contact_mJ"]
    assert 0 < stored.max() < 0.01 * folded.measures["energy_mJ"]


def test_it_can_be_left_out():
    case = load_case("gelatin", {"h": "2 mm", "element": "P1"})
    names = [[f.name for f in build(case.set(self_contact=sc)).problem.forms] for sc in ("on", "off")]
    assert "self_contact" in names[0] and "self_contact" not in names[1]


def test_a_crease_is_in_balance_at_the_strain_of_the_literature():
    assert crease.balance(0.04)[0] == pytest.approx(crease.CRITICAL, rel=0.02)
