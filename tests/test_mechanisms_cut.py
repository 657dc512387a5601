"""What every law of the cut must satisfy, held over the registry."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from law_checks import (
    DECLARED,
    DT,
    NEW_UNITS,
    N,
    before,
    close,
    cut,
    dimension,
    in_new_units,
    jumps,
    loaded,
    numbers,
    of_slot,
    rewritten,
)

from cutbench.mechanisms.base import STEP


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
        now = float(states[law.name]["damage"][0])
        assert damage <= now <= 1
        damage = now
        spent = law.work(zero, p, states[law.name], at)
        if spent is not None:  # what is left at zero jump is dissipated
            assert spent[0] >= lost - 1e-14 * p.G_c
            lost = spent[0]


@of_slot("cut", lambda law: law.role == "cohesive")
def test_unloading_is_linear_to_the_origin(law):
    peak = jumps(closing=False)
    T, states, _ = cut(law, peak, np.zeros_like(peak))
    damage = states[law.name]["damage"]
    assert damage.min() > 0
    for part in (0.9, 0.5, 0.1, 0.0):
        back, kept, _ = cut(law, part * peak, peak, states)
        close(back, part * T, 1e-13)
        assert np.array_equal(kept[law.name]["damage"], damage)


@of_slot("cut", lambda law: law.role == "cohesive")
def test_a_wide_open_cut_is_broken_and_has_cost_the_work_of_separation(law):
    p = numbers(law)
    open_ = np.array([[100 * p.delta_c], [0.0], [0.0]])
    T, states, at = cut(law, open_, np.zeros((3, 1)))
    assert states[law.name]["damage"][0] == pytest.approx(1, abs=1e-12)
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
