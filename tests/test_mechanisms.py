"""What every mechanism must satisfy, held over the registry: a new file is tested by being there.

No law is named here. A law is evaluated with exactly the numbers it declares (its parameters and what
it reads), beside one law of every other role that runs before it in its slot.
"""

from __future__ import annotations

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
from cutbench.model import PROTOCOL, SPECIMEN
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


def before(law: Mechanism) -> list[Mechanism]:
    """One law of every other role that runs before ``law`` and may share something with it."""
    found = {}
    for other in LAWS.values():
        if other.slot == law.slot and other.rank < law.rank and other.role != law.role:
            found.setdefault(other.role, other)
    return list(found.values())


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
    assert law.title.strip()
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
def stress(law, F, p=None):
    n = F.shape[-1]
    p = p or numbers(law)
    return law.stress(F, p, law.start(n, p), points(n))[0]


def energy(law, F, p=None):
    n = F.shape[-1]
    p, at = p or numbers(law), points(n)
    new = law.stress(F, p, law.start(n, p), at)[1]
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
    state, at = law.start(N, p), points(N)
    A = law.tangent(F, p, state, at, dim)
    close(A, Bulk.tangent(law, F, p, state, at, dim), 1e-13)
    close(A, differences(lambda F: stress(law, F), F)[:dim, :dim, :dim, :dim], 1e-7)


@of_slot("bulk", lambda law: law.conservative)
def test_bulk_stress_is_the_derivative_of_the_energy(law):
    F = deformations()
    close(stress(law, F), differences(lambda F: energy(law, F), F), 1e-7)


@of_slot("bulk")
def test_bulk_law_is_frame_indifferent(law):
    F, Q = deformations(), rotations()
    close(stress(law, times(Q, F)), times(Q, stress(law, F)), 1e-13)
    if law.conservative:
        close(energy(law, times(Q, F)), energy(law, F), 1e-12)


@of_slot("bulk")
def test_bulk_stress_balances_angular_momentum(law):
    F = deformations()
    tau = times(stress(law, F), F.transpose(1, 0, 2))
    close(tau, tau.transpose(1, 0, 2), 1e-13)


@of_slot("bulk")
def test_bulk_law_is_at_rest_where_nothing_is_deformed(law):
    F = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, N)).copy()
    stiffness = np.abs(law.tangent(F, numbers(law), law.start(N, numbers(law)), points(N), 3)).max()
    assert stiffness > 0
    assert np.abs(stress(law, F)).max() < 1e-14 * stiffness
    assert np.abs(stress(law, rotations())).max() < 1e-14 * stiffness
    if law.conservative:
        assert np.abs(energy(law, F)).max() < 1e-14 * stiffness
        assert energy(law, deformations()).min() >= 0


@of_slot("bulk")
def test_bulk_stress_has_the_dimension_of_a_stress(law):
    F, p = deformations(), numbers(law)
    here = in_new_units(stress(law, F, p), dimension("MPa"))
    close(stress(law, F, rewritten(law, p)), here, 1e-12)


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


def sliding() -> Points:
    r = rng()
    touched = (np.arange(N) % 2).astype(float)
    return points(N, touched=touched, slid=r.uniform(0, 5, N), slip_rate=r.uniform(0, 0.05, N))


def strength(law, t_N, p=None):
    return law.strength(t_N, p or numbers(law), law.start(N, p or numbers(law)), sliding())


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
    there = strength(law, in_new_units(PRESSURE, MPa), rewritten(law, p))
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


# -- rig -----------------------------------------------------------------------------------------
@of_slot("rig")
def test_a_rig_that_is_off_records_what_happened(law):
    x = np.linspace(0, 21, 50)
    shown = law.record(x, np.sin(x), x / 0.021, switched_off(law))
    assert np.array_equal(shown[0], x) and np.array_equal(shown[1], np.sin(x))


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
        return flux
    x = np.linspace(0, 21, N)
    return np.stack(law.record(x, np.sin(x), x / 0.021, p))


@every_law
def test_parameters_can_be_differentiated_by_a_complex_step(law):
    """Sensitivities come from the law itself, whatever its parameter."""
    p = numbers(law)
    for name, value in vars(p).items():
        h = 1e-6 * value
        exact = np.imag(answer(law, numbers(law, **{name: value + 1j * STEP}))) / STEP
        up, down = (answer(law, numbers(law, **{name: value + s * h})) for s in (1, -1))
        close(exact * value, (up - down) / (2 * h) * value, 1e-6, atol=1e-8 * np.abs(up).max())


@every_law
def test_a_law_that_is_off_changes_nothing_to_the_bit(law):
    if not law.off:
        assert all(q.off is None for q in law.parameters)
        return
    beside = {}
    for other in LAWS.values():
        if other.slot == law.slot and other.role not in (law.role, "contact"):
            beside.setdefault(other.role, other)
    without = [answer(other, numbers(other)) for other in beside.values()]
    flux = answer(law, switched_off(law))
    assert np.isfinite(flux).all()
    for place in range(len(without) + 1):
        with_ = [*without[:place], flux, *without[place:]]
        assert np.array_equal(sum(with_), sum(without) if without else np.zeros_like(flux))
    assert not np.array_equal(answer(law, numbers(law)), flux), "the typical value shows nothing"
