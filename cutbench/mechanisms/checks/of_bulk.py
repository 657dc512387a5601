"""What every law of the bulk must satisfy."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from cutbench.mechanisms.base import MODULUS, STEP, Bulk, Points
from cutbench.mechanisms.checks.base import ROUNDING, NotTested, check, close
from cutbench.mechanisms.checks.trial import (
    DT,
    NEW_UNITS,
    N,
    Trial,
    deformations,
    in_new_units,
    rng,
    rotations,
    times,
)


def _differences(f: Callable, x: np.ndarray, h: float = 1e-5) -> np.ndarray:
    """df/dx (…, 3, 3, n) by central differences of fourth order, x (3, 3, n)."""
    out = []
    for k in range(9):
        e = np.zeros_like(x)
        e[k // 3, k % 3] = h
        out.append((8 * (f(x + e) - f(x - e)) - (f(x + 2 * e) - f(x - 2 * e))) / (12 * h))
    value = np.stack(out, axis=-2)
    return value.reshape(*value.shape[:-2], 3, 3, value.shape[-1])


@check("bulk")
def stress_is_the_energys_derivative(t: Trial) -> None:
    """P = dΨ/dF, where the law is conservative, and of its work, where that is a function."""
    F, p, law = deformations(), t.numbers(), t.law
    if law.conservative:
        close(t.stress(F), _differences(t.energy, F), 1e-7, what="the stress and dΨ/dF by differences")
    state, at = t.shaken(), t.bulk_points()
    P, new = law.stress(F, p, state, at)
    if law.work(F, p, new, at) is None:
        assert not law.conservative, "a conservative law knows its work: its energy"
        raise NotTested("it is not conservative, and has no work()")
    for i, J in np.ndindex(3, 3):
        probe = F.astype(complex)
        probe[i, J] += 1j * STEP
        slope = np.imag(law.work(probe, p, law.stress(probe, p, state, at)[1], at)) / STEP
        close(slope, P[i, J], 0, 1e-12 * np.abs(P).max(), what="the stress and the work's derivative")


@check("bulk")
def tangent_is_the_stress_derivative(t: Trial) -> None:
    """dP/dF is that of the stress, and symmetric."""
    F, p = deformations(), t.numbers()
    state, at = t.shaken(), t.bulk_points()
    for dim in (2, 3):
        A = t.law.tangent(F, p, state, at, dim)
        by_step = Bulk.tangent(t.law, F, p, state, at, dim)
        close(A, by_step, 1e-13, what="the tangent and the stress's complex step")
        by_differences = _differences(t.stress, F)[:dim, :dim, :dim, :dim]
        close(A, by_differences, 1e-7, what="the tangent and dP/dF by differences")
    assert np.abs(A).max() > 0, "the tangent is 0"
    close(A, A.transpose(2, 3, 0, 1, 4), 1e-12, what="the tangent and its transpose")


@check("bulk")
def known_state_is_kept(t: Trial) -> None:
    """With at.held the state given is that of F itself."""
    F, p, at = deformations(), t.numbers(), t.bulk_points()
    P, new = t.law.stress(F, p, t.shaken(), at)
    again, same = t.law.stress(F, p, new, Points(**{**vars(at), "held": True, "dt": None}))
    close(again, P, 1e-13, what="the stresses of one state, new and held")
    for key, value in new.items():
        close(same[key], value, ROUNDING, what=f"the state '{key}' with at.held, and what was given")


@check("bulk")
def is_frame_indifferent(t: Trial) -> None:
    """A turned body has turned stresses and the same energy; stresses balance angular momentum."""
    F, Q = deformations(), rotations()
    close(t.stress(times(Q, F)), times(Q, t.stress(F)), 1e-13, what="a turned body's and turned stresses")
    close(t.energy(times(Q, F)), t.energy(F), 1e-12, what="energies of a body and of the same, turned")
    tau = times(t.stress(F), F.transpose(1, 0, 2))
    assert np.abs(tau).max() > 0, "the stress is 0 at any deformation"
    close(tau, tau.transpose(1, 0, 2), 1e-13, what="Kirchhoff's stress P Fᵀ and its transpose")


@check("bulk", applies=lambda law: law.conservative)
def directions_are_told(t: Trial) -> None:
    """Its energy knows a direction if and only if it is directed, and is mirrored as it says."""
    F, here = deformations(), t.energy(deformations())
    assert np.allclose(t.energy(times(F, rotations())), here, 1e-10, 1e-14) != bool(t.law.directed), (
        "'directed' says whether its energy has a direction"
    )
    for same, axis in zip(t.law.mirrored(t.numbers()), 1 - 2 * np.eye(3), strict=True):
        assert same == np.allclose(t.energy(axis[:, None, None] * F * axis[:, None]), here, 1e-10, 1e-14), (
            "mirrored() says what reversing an axis leaves"
        )


@check("bulk")
def is_at_rest_undeformed(t: Trial) -> None:
    """No stress and no energy without deformation; energies of conservative laws are not negative."""
    one = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, N)).copy()
    law, p, at = t.law, t.numbers(), t.bulk_points()
    size = np.abs(t.stress(deformations())).max()
    for undeformed in (one, rotations()):
        P, new = law.stress(undeformed, p, law.start(N, p), at)
        energy = np.abs(law.energy(undeformed, p, new, at)).max()
        assert np.abs(P).max() < 1e-13 * size, f"there is a stress of {np.abs(P).max():.2g} MPa at rest"
        assert energy < 1e-13 * size, f"there is an energy of {energy:.2g} mJ/mm³ at rest"
    if law.conservative:
        assert np.abs(law.tangent(one, p, {}, at, 3)).max() > 0, "it has no stiffness at rest"
        assert t.energy(deformations()).min() >= 0, "its energy is below 0 at some deformation"


@check("bulk", applies=lambda law: law.adds_stiffness)
def modulus_is_that_of_small_shear(t: Trial) -> None:
    """Its shear modulus is the slope of its stress at rest, and G where it declares that."""
    p, law = t.numbers(), t.law
    said, slope = law.shear_modulus(p), Bulk.shear_modulus(law, p)
    close(said, slope, 1e-6, what="shear_modulus() and the stress in a small shear over that")
    if any(q.name == MODULUS for q in law.parameters):
        what = f"its shear modulus at small strain and {MODULUS}, which others take for it"
        close(said, getattr(p, MODULUS), 1e-6, what=what)


@check("bulk")
def stress_has_its_dimension(t: Trial) -> None:
    """Stresses change with the units as stresses do."""
    F, p = deformations(), t.numbers()
    there = t.stress(F, t.rewritten(p), DT * NEW_UNITS["[time]"])
    close(there, in_new_units(t.stress(F, p), "MPa"), 1e-12, what="stresses, and those from other units")


@check("bulk", applies=lambda law: not law.conservative)
def dissipation_is_not_negative(t: Trial) -> None:
    """On closed paths of the deformation a law takes up at least what it stores."""
    F, law, p, r, one = deformations(), t.law, t.numbers(), rng(), np.eye(3)[:, :, None]
    for dt in np.geomspace(1e-3, 1e3, 7):
        stops = [one, *(F[:, :, [k]] for k in r.integers(0, N, r.integers(1, 5))), one]
        path = [(1 - s) * a + s * b for a, b in pairwise(stops) for s in np.linspace(0, 1, 61)[1:]]
        if min(np.linalg.det(here[:, :, 0]) for here in path) <= 0.1:
            continue  # no path for a material
        at = t.bulk_points(1, dt)
        state, work, passed, old = law.start(1, p), 0.0, 0.0, one
        P = law.stress(one, p, state, at)[0]
        for here in path:
            P_new, state = law.stress(here, p, state, at)
            piece = float(((P + P_new) / 2 * (here - old)).sum())
            work, passed, P, old = work + piece, passed + abs(piece), P_new, here
        assert work >= float(law.energy(one, p, state, at)[0]) - 0.02 * passed, (
            "on a closed path it gives more work than it was given"
        )
