"""Sliding past the blade: return mapping of the tangential traction of friction and adhesion.

What a law's strength depends on — pressure and Θ — is that of the last converged step. The paper does so
with Θ; with the pressure too, friction no longer feeds back on contact within a step, and runs with
Coulomb friction get through onsets at which they stall otherwise. Refining the step removes the lag.
"""

from __future__ import annotations

import numpy as np

from cutbench.mechanisms.base import STEP, Points


def shear(laws, stick, X, near, t_N, n, slip, dn, p, state, step, tangent) -> dict[str, np.ndarray]:
    """``traction`` (dim, nq, nf), the laws' ``shares`` of it (laws, nq, nf), the ``advance`` of the way slid
    (nq, nf); with ``tangent`` also D (dim, dim, nq, nf), the traction's derivative. Strengths add up.

    ``stick`` in MPa/mm; ``slip`` (dim, nq, nf) of the material past the blade, whose normal n has the
    derivative dn. ``state`` is that of all faces, X and the rest belong to those ``near``.
    """
    dim = len(n)
    v = state["shear"][:, :, near] - stick * slip
    nv = (n * v).sum(axis=0)
    trial = v - n * nv
    m2 = (trial * trial).sum(axis=0)
    m = np.sqrt(np.where(m2.real > 0, m2, 1.0))
    tangential = slip - n * (n * slip).sum(axis=0)
    s2 = (tangential * tangential).sum(axis=0)
    distance = np.sqrt(np.where(s2.real > 0, s2, 0.0))
    known, touched, way = (state[key][:, near] for key in ("pressure", "touched", "slid"))
    rate = distance / step.dt
    at = Points(X=X, touched=touched, slid=way, slip_rate=rate, speed=p.speed, dt=step.dt)
    parts = np.stack([law.strength(known, p, state, at) + 0 * t_N for law in laws])
    strength = parts.sum(axis=0)
    slips = m.real > strength.real
    ratio = np.where(slips, strength / m, 1.0)
    ratio = np.where(m2.real > 0, ratio, 0.0)
    traction = ratio * trial
    total = np.where(strength.real > 0, strength, 1.0)
    # What passes the blade at a distance does not rub.
    rubs = (np.real(at.touched) > 0) | (np.real(t_N) > 0)
    out = {"traction": traction, "shares": parts / total, "advance": np.where(rubs, distance, 0)}
    if not tangent:
        return out
    nn = n[:, None] * n[None]
    dv = (v[:, None] * dn).sum(axis=0)
    dtrial = stick * nn - dn * nv - n[:, None] * dv[None]
    for i in range(dim):
        dtrial[i, i] -= stick
    e = trial / m
    along = np.where(slips, (e[:, None] * dtrial).sum(axis=0), 0.0)
    D = ratio * (dtrial - e[:, None] * along[None])
    faster = Points(**{**vars(at), "slip_rate": at.slip_rate + 1j * STEP})
    by_rate = sum(np.imag(law.strength(known, p, state, faster)) for law in laws) / STEP
    by_rate = np.where(slips & (distance > 0), by_rate, 0.0)
    if by_rate.any():
        # In small steps this is what resists most: the strength grows with Δs/Δt.
        s = tangential / np.where(distance > 0, distance, 1.0)
        longer = s - (s[:, None] * dn).sum(axis=0) * (n * slip).sum(axis=0)
        D = D + e[:, None] * (by_rate / step.dt * longer)[None]
    out["D"] = D
    return out
