"""What every mechanism must satisfy, held over the registry: a new file is tested by being there.

No law is named here. A law is evaluated with exactly the numbers it declares (its parameters and what
it reads), beside the laws of the default model that have other roles.
"""

from __future__ import annotations

import math
import re
import sys
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cutbench.mechanisms import SLOTS, Bulk, registry
from cutbench.mechanisms.base import STEP, Mechanism, Points
from cutbench.model import DEFAULT, PROTOCOL, SPECIMEN, Model
from cutbench.quantities import Parameter, unit_factor, ureg

LAWS = registry()
DECLARED: dict[str, Parameter] = {q.name: q for q in SPECIMEN + PROTOCOL} | {
    q.name: q for law in LAWS.values() for q in law.parameters
}
HEIGHT, DT, N = 21.0, 0.4, 40


def of_slot(slot: str, accept=lambda law: True):
    """Parametrize over the laws of a slot."""
    return pytest.mark.parametrize(
        "law", [pytest.param(law, id=name) for name, law in LAWS.items() if law.slot == slot and accept(law)]
    )


every_law = pytest.mark.parametrize("law", [pytest.param(law, id=name) for name, law in LAWS.items()])


def own(law: Mechanism) -> dict[str, Parameter]:
    return {name: DECLARED[name] for name in law.reads} | {q.name: q for q in law.parameters}


def numbers(law: Mechanism, **changes) -> SimpleNamespace:
    """Typical values, internal units, of what the law declares and of nothing else."""
    values = {name: q.typical * q.factor for name, q in own(law).items()}
    return SimpleNamespace(**(values | changes))


def switched_off(law: Mechanism) -> SimpleNamespace:
    return numbers(law, **{q.name: q.off * q.factor for q in law.parameters if q.off is not None})


def context(law: Mechanism) -> tuple[Mechanism, ...]:
    """The default model's laws of the slot with ``law`` among them, in the order of evaluation."""
    return Model(DEFAULT).with_(law.name).laws(law.slot)


def before(law: Mechanism) -> list[Mechanism]:
    """Those that run before ``law`` and may share something with it."""
    return [other for other in context(law) if other.rank < law.rank]


def rng() -> np.random.Generator:
    return np.random.default_rng(20240611)


def points(n: int, **more) -> Points:
    r = rng()
    X = np.stack([r.uniform(0, 15, n), r.uniform(0, HEIGHT, n), r.uniform(0, 15, n)])
    return Points(X=X, depth=HEIGHT - X[1], dt=DT, speed=0.021, shared={}, **more)


def deformations(n: int = N) -> np.ndarray:
    """F (3, 3, n) with 0.3 < J < 3, far from the identity."""
    F = np.eye(3)[:, :, None] + rng().uniform(-0.35, 0.35, (3, 3, 4 * n))
    J = np.linalg.det(np.moveaxis(F, 2, 0))
    return F[:, :, (J > 0.3) & (J < 3)][:, :, :n]


def rotations(n: int = N) -> np.ndarray:
    Q = np.linalg.qr(rng().normal(size=(n, 3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))[:, None, None]
    return np.moveaxis(Q, 0, 2)


def times(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    return np.einsum("ijn,jkn->ikn", A, B)


def close(a, b, rtol: float, atol: float = 0.0) -> None:
    """Equality relative to the largest entry: components that vanish have no relative error."""
    scale = max(float(np.max(np.abs(a), initial=0)), float(np.max(np.abs(b), initial=0)))
    np.testing.assert_allclose(a, b, rtol=0, atol=rtol * scale + atol)


# -- what a person sees --------------------------------------------------------------------------
@every_law
def test_a_mechanism_describes_itself(law):
    module = sys.modules[type(law).__module__]
    assert module.__name__ == f"cutbench.mechanisms.{law.slot}.{law.name}", "one mechanism a file of its name"
    assert law.slot in SLOTS
    assert re.fullmatch(r"[a-z][a-z0-9_]*", law.name)
    assert 0 < len(law.title.strip()) <= 24, "the title has room in a legend"
    assert len(module.__doc__.strip()) > 20, "the module's docstring gives formula and reference"
    assert type(law).__doc__.strip() and type(law).__doc__ != Mechanism.__doc__


@every_law
def test_parameters_are_complete(law):
    names = [q.name for q in law.parameters]
    assert len(set(names)) == len(names)
    for q in law.parameters:
        assert q.name.isidentifier()
        assert q.symbol.strip() and q.doc.strip()
        assert unit_factor(q.unit) > 0
        for value in (q.typical, q.off, q.default):
            if value is not None:
                q.check(value)
        assert q.typical != q.off, "the typical value must show the effect"
        shown = q.show(q.typical * q.factor)
        assert q.parse(shown) == pytest.approx(q.typical * q.factor, rel=1e-5)


@every_law
def test_what_a_law_reads_is_declared_elsewhere(law):
    assert set(law.reads) <= set(DECLARED)
    assert not set(law.reads) & {q.name for q in law.parameters}


@every_law
def test_a_law_stores_nothing(law):
    assert vars(law) == {}
    law.groups(numbers(law))
    law.start(3, numbers(law))
    assert vars(law) == {}


def test_one_parameter_name_means_one_quantity():
    seen: dict[str, Parameter] = {}
    for law in LAWS.values():
        for q in law.parameters:
            other = seen.setdefault(q.name, q)
            assert (
                ureg.Unit(q.unit if q.unit != "1" else "").dimensionality
                == ureg.Unit(other.unit if other.unit != "1" else "").dimensionality
            ), q.name


# -- units ---------------------------------------------------------------------------------------
#: Size of the old unit in the new one: lengths, times and masses in units that share no factor.
NEW_UNITS = {"[length]": 1e-3, "[time]": 1 / 60, "[mass]": 7.3}


def in_new_units(value, dimension: dict):
    for base, power in dimension.items():
        value = value * NEW_UNITS[base] ** power
    return value


def dimension(unit: str) -> dict:
    return {} if unit == "1" else dict(ureg.Unit(unit).dimensionality)


def rewritten(law: Mechanism, p: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(**{k: in_new_units(v, dimension(own(law)[k].unit)) for k, v in vars(p).items()})


@every_law
def test_groups_do_not_depend_on_the_units(law):
    p = numbers(law)
    here, there = law.groups(p), law.groups(rewritten(law, p))
    assert here.keys() == there.keys()
    for text, value in here.items():
        assert np.isfinite(value)
        assert there[text] == pytest.approx(value, rel=1e-12), text


@every_law
def test_a_parameter_that_switches_off_moves_a_group(law):
    on, off = law.groups(numbers(law)), law.groups(switched_off(law))
    if law.off:
        assert on != off


# -- bulk ----------------------------------------------------------------------------------------
def bulk_points(law, n: int, dt: float = DT) -> Points:
    at = points(n, laws=context(law))
    at.dt = dt
    return at


def shaken(law, n: int, p, dt: float = DT) -> dict:
    """The law's state in the middle of a history."""
    past = rng().permutation(deformations(n), axis=2)
    return law.stress(past, p, law.start(n, p), bulk_points(law, n, dt))[1]


def stress(law, F, p=None, dt: float = DT):
    """After a history that the last axis of F does not know."""
    n, p = F.shape[-1], p or numbers(law)
    return law.stress(F, p, shaken(law, n, p, dt), bulk_points(law, n, dt))[0]


def energy(law, F, p=None):
    n, p = F.shape[-1], p or numbers(law)
    at = bulk_points(law, n)
    new = law.stress(F, p, shaken(law, n, p), at)[1]
    return law.energy(F, p, new, at)


def differences(f, x: np.ndarray, h: float = 1e-5) -> np.ndarray:
    """df/dx (…, 3, 3, n) by central differences of fourth order, x (3, 3, n)."""
    out = []
    for k in range(9):
        e = np.zeros_like(x)
        e[k // 3, k % 3] = h
        out.append((8 * (f(x + e) - f(x - e)) - (f(x + 2 * e) - f(x - 2 * e))) / (12 * h))
    value = np.stack(out, axis=-2)
    return value.reshape(*value.shape[:-2], 3, 3, value.shape[-1])


@of_slot("bulk")
@pytest.mark.parametrize("dim", [2, 3])
def test_bulk_tangent_is_the_derivative_of_the_stress(law, dim):
    F, p = deformations(), numbers(law)
    state, at = shaken(law, N, p), bulk_points(law, N)
    A = law.tangent(F, p, state, at, dim)
    close(A, Bulk.tangent(law, F, p, state, at, dim), 1e-13)
    close(A, differences(lambda F: stress(law, F), F)[:dim, :dim, :dim, :dim], 1e-7)


@of_slot("bulk")
def test_bulk_tangent_is_symmetric(law):
    """The form calls itself symmetric: the solver then sees the upper triangle only."""
    p = numbers(law)
    A = law.tangent(deformations(), p, shaken(law, N, p), bulk_points(law, N), 3)
    assert np.abs(A).max() > 0
    close(A, A.transpose(2, 3, 0, 1, 4), 1e-12)


@of_slot("bulk", lambda law: law.conservative)
def test_bulk_stress_is_the_derivative_of_the_energy(law):
    F = deformations()
    close(stress(law, F), differences(lambda F: energy(law, F), F), 1e-7)


@of_slot("bulk")
def test_bulk_work_has_the_stress_as_its_derivative(law):
    """Where the work is a function of F and the new state; else the ledger integrates the stress."""
    F, p = deformations(), numbers(law)
    state, at = shaken(law, N, p), bulk_points(law, N)
    P, new = law.stress(F, p, state, at)
    if law.work(F, p, new, at) is None:
        assert not law.conservative
        return
    for i in range(3):
        for J in range(3):
            probe = F.astype(complex)
            probe[i, J] += 1j * STEP
            moved = law.stress(probe, p, state, at)[1]
            slope = np.imag(law.work(probe, p, moved, at)) / STEP
            np.testing.assert_allclose(slope, P[i, J], rtol=0, atol=1e-12 * np.abs(P).max())


@of_slot("bulk")
def test_bulk_stress_at_a_known_state_is_that_of_the_step(law):
    F, p = deformations(), numbers(law)
    at = bulk_points(law, N)
    P, new = law.stress(F, p, shaken(law, N, p), at)
    held = Points(**{**vars(at), "held": True, "dt": None})
    again, same = law.stress(F, p, new, held)
    close(again, P, 1e-13)
    for key, value in new.items():
        assert np.array_equal(same[key], value), key


@of_slot("bulk")
def test_bulk_law_is_frame_indifferent(law):
    F, Q = deformations(), rotations()
    close(stress(law, times(Q, F)), times(Q, stress(law, F)), 1e-13)
    close(energy(law, times(Q, F)), energy(law, F), 1e-12)


@of_slot("bulk")
def test_bulk_stress_balances_angular_momentum(law):
    F = deformations()
    P = stress(law, F)
    assert np.abs(P).max() > 0
    tau = times(P, F.transpose(1, 0, 2))
    close(tau, tau.transpose(1, 0, 2), 1e-13)


@of_slot("bulk")
def test_bulk_law_is_at_rest_where_nothing_is_deformed(law):
    F = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, N)).copy()
    p, at = numbers(law), bulk_points(law, N)
    for undeformed in (F, rotations()):
        P, new = law.stress(undeformed, p, law.start(N, p), at)
        assert np.abs(P).max() < 1e-13 * p.G
        assert np.abs(law.energy(undeformed, p, new, at)).max() < 1e-13 * p.G
    if law.conservative:
        assert np.abs(law.tangent(F, p, {}, at, 3)).max() > 0
        assert energy(law, deformations()).min() >= 0


@of_slot("bulk")
def test_bulk_stress_has_the_dimension_of_a_stress(law):
    F, p = deformations(), numbers(law)
    here = in_new_units(stress(law, F, p), dimension("MPa"))
    close(stress(law, F, rewritten(law, p), DT * NEW_UNITS["[time]"]), here, 1e-12)


@of_slot("bulk", lambda law: not law.conservative)
@settings(max_examples=15, deadline=None)
@given(turns=st.lists(st.integers(0, N - 1), min_size=1, max_size=4), dt=st.floats(1e-3, 1e3))
def test_a_cycle_of_the_deformation_never_gives_energy(law, turns, dt):
    """From rest through some deformations and back: what was taken up is at least what is stored."""
    F, p, at = deformations(), numbers(law), bulk_points(law, 1, dt)
    stops = [np.eye(3)[:, :, None], *(F[:, :, [turn]] for turn in turns), np.eye(3)[:, :, None]]
    others = [other for other in context(law) if other.conservative and other.role != "volumetric"]
    state, work, passed = law.start(1, p), 0.0, 0.0
    P = law.stress(stops[0], p, state, at)[0]
    for old, new in pairwise(stops):
        for s in np.linspace(0, 1, 61)[1:]:
            here = (1 - s) * old + s * new
            if not np.linalg.det(here[:, :, 0]) > 0.1:
                return  # no path for a material
            P_new, state = law.stress(here, p, state, at)
            piece = float(((P + P_new) / 2 * (new - old) / 60).sum())
            work, passed, P = work + piece, passed + abs(piece), P_new
    assert others
    assert work >= float(law.energy(stops[0], p, state, at)[0]) - 0.02 * passed


# -- cut -----------------------------------------------------------------------------------------
def jumps(n: int = N, closing: bool = True) -> np.ndarray:
    """Jumps around the cohesive length, some of them closing."""
    size = DECLARED["delta_c"].typical if "delta_c" in DECLARED else 0.1
    jump = rng().uniform(-2, 2, (3, n)) * size
    jump[0] = np.where(jump[0] < 0, 0.02 * jump[0], jump[0]) if closing else np.abs(jump[0])
    return jump


def cut(law, jump, jump_old, states=None, p=None, dt=DT, others=None):
    """Traction of ``law``, the states of it and of those before it by name, and what they share."""
    n = jump.shape[-1]
    at = points(n, jump_old=jump_old)
    at.dt = dt
    new = {}
    for each in [*before(law), law]:
        q = p if each is law and p is not None else (others or {}).get(each.name, numbers(each))
        old = each.start(n, q) if states is None else states[each.name]
        T, new[each.name] = each.traction(jump, q, old, at)
    return T, new, at


def loaded(law, n: int = N):
    """Jumps and states in the middle of a history."""
    first = rng().permutation(jumps(n), axis=1)
    return first, cut(law, first, np.zeros_like(first))[1]


@of_slot("cut")
def test_a_closed_virgin_interface_carries_nothing(law):
    zero = np.zeros((3, N))
    T, _, _ = cut(law, zero, zero)
    assert T.shape == (3, N)
    assert np.array_equal(T, zero)


@of_slot("cut")
def test_cut_traction_can_be_differentiated_by_a_complex_step(law):
    old, states = loaded(law)
    jump, h = jumps(), 1e-7
    for c in range(3):
        e = np.zeros((3, 1))
        e[c] = 1.0
        exact = cut(law, jump + 1j * STEP * e, old, states)[0].imag / STEP
        central = (cut(law, jump + h * e, old, states)[0] - cut(law, jump - h * e, old, states)[0]) / (2 * h)
        close(exact, central, 1e-6)
        assert np.abs(exact).max() > 0


@of_slot("cut")
def test_cut_work_has_the_traction_as_its_derivative(law):
    """Along any history, dW/d⟦u⟧ = T; laws without a work function are left to the ledger's sum."""
    old, states = loaded(law)
    p = numbers(law)
    _, new, at = cut(law, jumps(), old, states)
    if law.work(jumps(), p, new[law.name], at) is None:
        assert law.role != "cohesive", "the ledger needs the work of separation as a function"
        return
    jump = jumps()
    T = cut(law, jump, old, states)[0]
    for c in range(3):
        probe = jump.astype(complex)
        probe[c] += 1j * STEP
        _, moved, at = cut(law, probe, old, states)
        close(law.work(probe, p, moved[law.name], at).imag / STEP, T[c], 1e-12)


histories = st.lists(
    st.tuples(st.floats(-0.02, 3), st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=5
).map(lambda turns: np.array(turns).T[:, :, None] * DECLARED["delta_c"].typical)


def path(history: np.ndarray, substeps: int = 40) -> list[np.ndarray]:
    """A closed path from zero through the turns (3, k, 1) and back to zero, in small steps."""
    turns = np.concatenate([np.zeros((3, 1, 1)), history, np.zeros((3, 1, 1))], axis=1)
    out = [turns[:, 0]]
    for i in range(1, turns.shape[1]):
        for s in np.linspace(0, 1, substeps + 1)[1:]:
            out.append((1 - s) * turns[:, i - 1] + s * turns[:, i])
    return out


@of_slot("cut")
@settings(max_examples=25, deadline=None)
@given(history=histories)
def test_a_cycle_of_the_jump_never_gives_energy(law, history):
    states, T_old, work, passed = None, None, 0.0, 0.0
    steps = path(history)
    for old, jump in pairwise(steps):
        T, states, _ = cut(law, jump, old, states, dt=DT)
        T_old = T if T_old is None else T_old
        piece = float(((T + T_old) / 2 * (jump - old)).sum())
        work, passed, T_old = work + piece, passed + abs(piece), T
    assert work >= -0.02 * passed


@of_slot("cut", lambda law: law.role == "cohesive")
@settings(max_examples=25, deadline=None)
@given(history=histories)
def test_damage_and_dissipation_only_grow(law, history):
    p, zero = numbers(law), np.zeros((3, 1))
    states, damage, lost = None, 0.0, 0.0
    steps = path(history, 5)
    for old, jump in pairwise(steps):
        _, states, at = cut(law, jump, old, states)
        now = float(at.shared["damage"][0])
        assert damage <= now <= 1
        damage = now
        spent = law.work(zero, p, states[law.name], at)
        if spent is not None:  # what is left at zero jump is dissipated
            assert spent[0] >= lost - 1e-14 * p.G_c
            lost = spent[0]


@of_slot("cut", lambda law: law.role == "cohesive")
def test_unloading_is_linear_to_the_origin(law):
    peak = jumps(closing=False)
    T, states, at = cut(law, peak, np.zeros_like(peak))
    damage = at.shared["damage"]
    assert damage.min() > 0
    for part in (0.9, 0.5, 0.1, 0.0):
        back, _, at = cut(law, part * peak, peak, states)
        close(back, part * T, 1e-13)
        assert np.array_equal(at.shared["damage"], damage)


@of_slot("cut", lambda law: law.role == "cohesive")
def test_a_wide_open_cut_is_broken_and_has_cost_the_work_of_separation(law):
    p = numbers(law)
    open_ = np.array([[100 * p.delta_c], [0.0], [0.0]])
    T, states, at = cut(law, open_, np.zeros((3, 1)))
    assert at.shared["damage"][0] == pytest.approx(1, abs=1e-12)
    assert np.abs(T).max() < 1e-12 * p.G_c / p.delta_c
    assert law.work(open_, p, states[law.name], at)[0] == pytest.approx(p.G_c, rel=1e-12)


@of_slot("cut")
def test_cut_traction_has_the_dimension_of_a_stress(law):
    jump, p = jumps(), numbers(law)
    others = {each.name: rewritten(each, numbers(each)) for each in before(law)}
    zero = np.zeros_like(jump)
    L, t = NEW_UNITS["[length]"], NEW_UNITS["[time]"]
    there = cut(law, jump * L, zero, p=rewritten(law, p), dt=DT * t, others=others)[0]
    close(there, in_new_units(cut(law, jump, zero, p=p)[0], dimension("MPa")), 1e-12)


# -- blade ---------------------------------------------------------------------------------------
PRESSURE = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, N - 1)])  # MPa


def sliding(length: float = 1.0, time: float = 1.0) -> Points:
    """Points that slide; ``length`` and ``time`` are the sizes of mm and s in the units to be used."""
    r = rng()
    touched = (np.arange(N) % 2).astype(float)
    slid, rate = r.uniform(0, 5, N) * length, r.uniform(0, 0.05, N) * length / time
    return points(N, touched=touched, slid=slid, slip_rate=rate)


def strength(law, t_N, p=None, at=None):
    return law.strength(t_N, p or numbers(law), law.start(N, p or numbers(law)), at or sliding())


@of_slot("blade")
def test_blade_strength_is_never_negative(law):
    value = strength(law, PRESSURE)
    assert np.shape(value) == (N,)
    assert np.isfinite(value).all() and value.min() >= 0
    if law.role != "contact":
        assert value.max() > 0


@of_slot("blade")
def test_blade_strength_can_be_differentiated_by_a_complex_step(law):
    t_N, h = PRESSURE[1:].min() + PRESSURE, 1e-6
    exact = np.imag(strength(law, t_N + 1j * STEP)) / STEP + np.zeros(N)
    central = (strength(law, t_N + h) - strength(law, t_N - h)) / (2 * h)
    close(exact, central, 1e-6, atol=1e-9)


@of_slot("blade")
def test_blade_strength_has_the_dimension_of_a_stress(law):
    p, MPa = numbers(law), dimension("MPa")
    at = sliding(NEW_UNITS["[length]"], NEW_UNITS["[time]"])
    there = strength(law, in_new_units(PRESSURE, MPa), rewritten(law, p), at)
    close(there, in_new_units(strength(law, PRESSURE, p), MPa), 1e-12)


@of_slot("blade", lambda law: law.role == "contact")
@pytest.mark.parametrize("multiplier", [0.0, 0.02])
def test_contact_pressure_keeps_out_and_never_pulls(law, multiplier):
    p, stiffness, h = numbers(law), 3.0, 1e-8
    gap = np.linspace(-0.1, 0.1, 401) + 1e-5
    t_N, slope = law.pressure(gap, multiplier, stiffness, p)
    assert t_N.min() >= 0 and slope.max() <= 0
    assert np.all(np.diff(t_N) <= 0), "the deeper, the harder"
    assert t_N[-1] == 0 and t_N[0] == pytest.approx(multiplier - stiffness * gap[0])
    bracket = np.maximum(multiplier - stiffness * gap, 0)
    assert np.abs(t_N - bracket).max() <= 0.01 * stiffness * p.thickness / 2
    up, down = (law.pressure(gap + s * h, multiplier, stiffness, p)[0] for s in (1, -1))
    central = (up - down) / (2 * h)
    close(slope, central, 1e-5)
    close(law.pressure(gap + 1j * STEP, multiplier, stiffness, p)[0].imag / STEP, slope, 1e-13)


# -- skin ----------------------------------------------------------------------------------------
def factors(law, p) -> np.ndarray:
    """What the law makes of stiffness and toughness (2, N)."""
    at = points(N)
    return np.stack([np.broadcast_to(f(p, at), N) for f in (law.stiffness, law.toughness)])


@of_slot("skin")
def test_a_skin_scales_and_never_turns_round(law):
    p = numbers(law)
    assert factors(law, p).min() > 0
    assert np.array_equal(factors(law, switched_off(law)), np.ones((2, N)))


@of_slot("skin")
def test_a_skin_does_not_depend_on_the_units(law):
    at, p = points(N), rewritten(law, numbers(law))
    at.X, at.depth = at.X * NEW_UNITS["[length]"], at.depth * NEW_UNITS["[length]"]
    there = np.stack([np.broadcast_to(f(p, at), N) for f in (law.stiffness, law.toughness)])
    close(there, factors(law, numbers(law)), 1e-12)


# -- rig -----------------------------------------------------------------------------------------
def recorded(law, p, length: float = 1.0, time: float = 1.0, force: float = 1.0) -> np.ndarray:
    x = np.linspace(0, 21, N)
    return np.stack(law.record(x * length, np.sin(x) * force, x / 0.021 * time, p))


@of_slot("rig")
def test_a_rig_that_is_off_records_what_happened(law):
    x = np.linspace(0, 21, N)
    assert np.array_equal(recorded(law, switched_off(law)), [x, np.sin(x)])


@of_slot("rig")
def test_a_rig_does_not_depend_on_the_units(law):
    L, t, F = NEW_UNITS["[length]"], NEW_UNITS["[time]"], in_new_units(1.0, dimension("N"))
    here, there = recorded(law, numbers(law)), recorded(law, rewritten(law, numbers(law)), L, t, F)
    close(there[0], here[0] * L, 1e-12)
    close(there[1], here[1] * F, 1e-12)


# -- all slots -----------------------------------------------------------------------------------
def answer(law: Mechanism, p: SimpleNamespace) -> np.ndarray:
    """The law's flux at fixed, lively kinematics, for parameters ``p``."""
    if law.slot == "bulk":
        return stress(law, deformations(), p)
    if law.slot == "cut":
        old, states = loaded(law)
        return cut(law, jumps(), old, states, p=p)[0]
    if law.slot == "blade":
        flux = strength(law, PRESSURE, p)
        if law.role == "contact":
            flux = flux + law.pressure(np.linspace(-0.1, 0.1, N) + 1e-5, 0.0, 3.0, p)[0]
            flux = np.concatenate([flux, law.half_axes(p)])
        return flux
    if law.slot == "support":
        return np.array([law.compliance(p)])
    return factors(law, p) if law.slot == "skin" else recorded(law, p)


def together(model: Model, slot: str, p: SimpleNamespace) -> np.ndarray:
    """What all laws of a slot answer together."""
    laws = model.laws(slot)
    if slot == "skin":
        return math.prod([factors(law, p) for law in laws], start=np.ones((2, N)))
    if slot == "rig":
        x = np.linspace(0, 21, N)
        return np.stack(model.record(x, np.sin(x), x / 0.021, p))
    if slot == "support":
        return np.array([sum(law.compliance(p) for law in laws)])
    if slot == "cut":
        # The state of a slot is one dictionary: laws name theirs differently.
        states = {k: v for law in laws for k, v in law.start(N, p).items()}
        total = np.zeros((3, N))
        for old, jump in pairwise([np.zeros((3, N)), rng().permutation(jumps(), axis=1), jumps()]):
            at, total, new = points(N, jump_old=old), np.zeros((3, N)), {}
            for law in laws:
                T, more = law.traction(jump, p, states, at)
                total, new = total + T, new | more
            states = new
        return total
    if slot == "bulk":
        at, past = points(N, laws=laws), rng().permutation(deformations(), axis=2)
        states = {k: v for law in laws for k, v in law.stress(past, p, law.start(N, p), at)[1].items()}
        F = deformations()
        parts = [(law.stress(F, p, states, at)[0], law.tangent(F, p, states, at, 3)) for law in laws]
        return np.concatenate([sum(part[i] for part in parts).reshape(-1, N) for i in range(2)])
    flux = sum(law.strength(PRESSURE, p, {}, sliding()) for law in laws)
    contact = next(law for law in laws if law.role == "contact")
    pressure = contact.pressure(np.linspace(-0.1, 0.1, N) + 1e-5, 0.0, 3.0, p)[0]
    return np.concatenate([flux, pressure, contact.half_axes(p)])


@every_law
def test_parameters_can_be_differentiated_by_a_complex_step(law):
    """Sensitivities come from the law itself, whatever its parameter."""
    p = numbers(law)
    for name, value in vars(p).items():
        size = value or 1.0
        h = 1e-6 * size
        exact = np.imag(answer(law, numbers(law, **{name: value + 1j * STEP}))) / STEP
        up, down = (answer(law, numbers(law, **{name: value + s * h})) for s in (1, -1))
        close(exact * size, (up - down) / (2 * h) * size, 1e-6, atol=1e-8 * np.abs(up).max())


def off_values(law: Mechanism) -> dict[str, float]:
    return {q.name: q.off * q.factor for q in law.parameters if q.off is not None}


def switches(law: Mechanism) -> dict[str, float]:
    """Off values (internal units) of what the law adds to the law of its role that it generalises, if any."""
    known = Model(DEFAULT).parameters()
    return {k: v for k, v in off_values(law).items() if k not in known} or off_values(law)


def typical(model: Model) -> dict[str, float]:
    return {name: q.typical * q.factor for name, q in model.parameters().items()}


@every_law
def test_a_law_that_is_off_changes_nothing_to_the_bit(law):
    """A model with the law at its off values answers as the one without it."""
    if not law.off:
        assert all(q.off is None for q in law.parameters)
        return
    model, new = Model(DEFAULT).with_(law.name), switches(law)
    # A law with parameters of its own leaves what it replaces; one without is compared with nothing.
    own_switch = not set(new) & set(Model(DEFAULT).parameters())
    base = Model(DEFAULT) if own_switch else model.without(law.name)
    values = typical(model)
    off = together(model, law.slot, SimpleNamespace(**(values | new)))
    absent = together(base, law.slot, SimpleNamespace(**values))
    assert np.isfinite(off).all()
    assert np.array_equal(off, absent)
    assert not np.array_equal(together(model, law.slot, SimpleNamespace(**values)), off), "it shows nothing"


@every_law
def test_a_law_shows_at_once_when_it_is_no_longer_off(law):
    """The derivative at off is finite and does not vanish: absent mechanisms can be scored by it."""
    off = switches(law)
    for name, value in off.items():
        p = numbers(law, **off)
        setattr(p, name, value + 1j * STEP)
        slope = np.imag(answer(law, p)) / STEP
        assert np.isfinite(slope).all()
        assert np.abs(slope).max() > 0
