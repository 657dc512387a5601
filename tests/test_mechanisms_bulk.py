"""What every law of the bulk must satisfy, held over the registry."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from law_checks import (
    DT,
    NEW_UNITS,
    N,
    bulk_points,
    close,
    context,
    deformations,
    dimension,
    energy,
    in_new_units,
    numbers,
    of_slot,
    rewritten,
    rotations,
    shaken,
    stress,
    times,
)

from cutbench.mechanisms import Bulk
from cutbench.mechanisms.base import STEP, Points


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
