"""From what the blade's laws answer at points to nodal forces, local matrices and the new state; with the
return mapping of friction and adhesion."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cutbench.base.compiled import choose, compiled, shared


class Contact(NamedTuple):
    """N = nq·count points of ``count`` faces, whose shape functions and weights are Na (nq, nn, count) and w
    (nq, count): gaps g (N,) with their ``gradient`` (dim, N), unit normals n with the derivative dn, the
    direction ``push`` of the pressure t_N, whose derivative by the gap is dp. ``turns``: it turns by dn. Of
    dn nothing is asked without a tangent. ``axes``: 0, 1, …, one for each dimension, so that compilers know
    how many there are."""

    axes: tuple[int, ...]
    near: np.ndarray
    Na: np.ndarray
    w: np.ndarray
    g: np.ndarray
    gradient: np.ndarray
    n: np.ndarray
    dn: np.ndarray
    push: np.ndarray
    turns: bool
    t_N: np.ndarray
    dp: np.ndarray


class Sliding(NamedTuple):
    """Way (dim, N) past the blade, stiffness (N,) against it, the laws' shares (laws, N) of the strength, the
    derivative of that by the rate, empty where it has none; the ``shear`` (dim, nq, nf) that the step begins
    with."""

    slip: np.ndarray
    stick: np.ndarray
    parts: np.ndarray
    by_rate: np.ndarray
    dt: float
    shear: np.ndarray
    touched: np.ndarray
    release: float


class Found(NamedTuple):
    """What is filled in at the faces ``near``: local vectors (nd, nf), matrices (nd, nd, nf), and new states
    (…, nq, nf), of each of the three nothing if it is empty. ``slid`` and Θ come with their old values."""

    vector: np.ndarray
    matrix: np.ndarray
    pressure: np.ndarray
    active: np.ndarray
    normal_traction: np.ndarray
    shear: np.ndarray
    shares: np.ndarray
    slid: np.ndarray
    touched: np.ndarray

    @classmethod
    def of(cls, vector=None, matrix=None, **states: np.ndarray) -> Found:
        """Of what is given."""
        kind = next(iter(states.values()), vector).dtype
        acts = {"vector": vector, "matrix": matrix}
        given = {name: array for name, array in acts.items() if array is not None}
        return nothing(kind)._replace(**given, **states)


@lru_cache
def nothing(kind: np.dtype) -> Found:
    """Where nothing is filled in, for numbers of one kind."""
    return Found(*(np.zeros(dim * (0,), kind) for dim in (2, 3, 2, 2, 3, 3, 3, 2, 2)))


@shared
def way(axes, n, slip):
    """Length of what of ``slip`` is along the blade, whose normal is n, at one point or at many."""
    along = slip[0] * n[0]
    for i in range(1, len(axes)):
        along = along + slip[i] * n[i]
    square = 0.0 * along
    for i in range(len(axes)):
        part = slip[i] - n[i] * along
        square = square + part * part
    return np.sqrt(choose(square.real > 0, square, 0.0))


@shared
def returned(axes, n, dn, shear, slip, stick, strength, by_rate, dt, traction, D, tangent, rated):
    """Return mapping at one point (compiled), or at many along the last axis of all.

    ``shear`` that the step begins with and ``slip`` (dim,) past the blade, whose normal n has the derivative
    dn; ``stick`` in MPa/mm. Fills ``traction`` (dim,) and, with ``tangent``, its derivative D (dim, dim),
    where ``rated`` with that of the strength ``by_rate``. The way slid is the answer.
    """
    dim = len(axes)
    pulled, along = n[0] * (shear[0] - stick * slip[0]), n[0] * slip[0]
    for i in range(1, dim):
        pulled = pulled + n[i] * (shear[i] - stick * slip[i])
        along = along + n[i] * slip[i]
    square = 0.0 * pulled
    for i in range(dim):
        traction[i] = shear[i] - stick * slip[i] - n[i] * pulled  # the trial
        square = square + traction[i] * traction[i]
    moved = way(axes, n, slip)
    size = np.sqrt(choose(square.real > 0, square, 1.0))
    slips = size.real > strength.real
    ratio = choose(square.real > 0, choose(slips, strength / size, 1.0), 0.0)
    if tangent:
        for k in range(dim):
            turned = (traction[0] + n[0] * pulled) * dn[0, k]
            for i in range(1, dim):
                turned = turned + (traction[i] + n[i] * pulled) * dn[i, k]
            for i in range(dim):
                D[i, k] = stick * n[i] * n[k] - dn[i, k] * pulled - n[i] * turned
            D[k, k] = D[k, k] - stick
            stretch = traction[0] * D[0, k]
            for i in range(1, dim):
                stretch = stretch + traction[i] * D[i, k]
            stretch = choose(slips, stretch, 0.0) / (size * size)
            for i in range(dim):
                D[i, k] = ratio * (D[i, k] - traction[i] * stretch)
        if rated:
            # In small steps this is what resists most: the strength grows with Δs/Δt.
            harder = choose(moved.real > 0, by_rate, 0.0) / (dt * choose(moved.real > 0, moved, 1.0) * size)
            harder = choose(slips, harder, 0.0)
            for k in range(dim):
                longer = slip[k] - n[k] * along
                for i in range(dim):
                    longer = longer - (slip[i] - n[i] * along) * dn[i, k] * along
                for i in range(dim):
                    D[i, k] = D[i, k] + traction[i] * harder * longer
    for i in range(dim):
        traction[i] = ratio * traction[i]
    return moved


def pressed_plain(contact: Contact, sliding: Sliding, found: Found) -> None:
    c, s, near = contact, sliding, contact.near
    (dim, size), (nq, nn, count) = c.n.shape, c.Na.shape
    tangent, keeps = found.matrix.size > 0, found.pressure.size > 0
    normal = c.t_N * c.push
    kind = found.vector.dtype
    traction, D = np.zeros((dim, size), kind), np.zeros((dim, dim, size), kind)
    touched = s.touched[:, near].ravel()
    if len(s.parts):
        strength = s.parts.sum(axis=0)
        shear, rated = s.shear[:, :, near].reshape(dim, -1), s.by_rate.size > 0
        moved = returned(
            c.axes, c.n, c.dn, shear, s.slip, s.stick, strength, s.by_rate, s.dt, traction, D, tangent, rated
        )
        if keeps:
            found.shear[:, :, near] = traction.reshape(dim, nq, count)
            shares = s.parts / np.where(strength.real > 0, strength, 1.0)
            found.shares[:, :, near] = shares.reshape(-1, nq, count)
            # What passes the blade at a distance does not rub.
            rubs = (touched.real > 0) | (c.t_N.real > 0)
            found.slid[:, near] += np.where(rubs, moved, 0).reshape(nq, count)
    if keeps:
        if np.real(s.release) > 0:
            found.touched[:, near] *= (c.g.real < np.real(s.release)).reshape(nq, count)
        found.pressure[:, near] = c.t_N.reshape(nq, count)
        found.active[:, near] = (c.t_N.real > 0).reshape(nq, count)
        found.normal_traction[:, :, near] = normal.reshape(dim, nq, count)
    if not found.vector.size:
        return
    total = (normal + traction).reshape(dim, nq, count) * c.w
    found.vector[:, near] = -np.einsum("qaf,dqf->daf", c.Na, total).reshape(-1, count)
    if tangent:
        D += c.dp * c.push[:, None] * c.gradient[None]
        if c.turns:
            D += c.t_N * c.dn
        D = D.reshape(dim, dim, nq, count) * c.w
        NN = c.Na[:, :, None] * c.Na[:, None]
        found.matrix[:, :, near] = -sandwich(D, NN).reshape(dim * nn, dim * nn, count)


def sandwich(D: np.ndarray, NM: np.ndarray) -> np.ndarray:
    """Σ_q D_ik (N_a M_b): (i, k, q, f), (q, a, b, f) to (i, a, k, b, f)."""
    return np.einsum("ikqf,qabf->iakbf", D, NM)


@compiled(pressed_plain)
def pressed(contact, sliding, found):
    axes, near, Na, w, g, gradient, n, dn, push, turns, t_N, dp = contact
    slip, stick, parts, by_rate, dt, old, touched, release = sliding
    vector, matrix, pressure, active, normal_traction, shear, shares, slid, touches = found
    dim, (nq, nn, count) = len(axes), Na.shape
    laws, tangent, rated = len(parts), matrix.size > 0, by_rate.size > 0
    size, acts, keeps = nq * count, vector.size > 0, pressure.size > 0
    kind = vector.dtype
    force = np.empty((dim, size), kind)  # times weights
    slope = np.empty((dim, dim, size if tangent else 0), kind)
    # Views of the arrays at each point would take longer than what is done with them.
    normal, gone = np.zeros(dim, kind), np.zeros(dim, kind)
    last, traction = np.zeros(dim, kind), np.zeros(dim, kind)
    turn, D = np.zeros((dim, dim), kind), np.zeros((dim, dim), kind)
    for q in range(nq):
        for j in range(count):
            f, k = near[j], q * count + j
            if laws > 0:
                strength = 0.0
                for law in range(laws):
                    strength += parts[law, k]
                for i in range(dim):
                    normal[i], gone[i], last[i] = n[i, k], slip[i, k], old[i, q, f]
                    if tangent:
                        for m in range(dim):
                            turn[i, m] = dn[i, m, k]
                rate = by_rate[k] if rated else 0.0
                moved = returned(
                    axes, normal, turn, last, gone, stick[k], strength, rate, dt, traction, D, tangent, rated
                )
                for law in range(laws if keeps else 0):
                    shares[law, q, f] = parts[law, k] / (strength if strength.real > 0 else 1.0)
                if keeps and (touched[q, f].real > 0 or t_N[k].real > 0):
                    slid[q, f] += moved
            if keeps:
                if release > 0 and not g[k].real < release:
                    touches[q, f] = 0.0
                pressure[q, f], active[q, f] = t_N[k], 1.0 if t_N[k].real > 0 else 0.0
                for i in range(dim):
                    shear[i, q, f], normal_traction[i, q, f] = traction[i], t_N[k] * push[i, k]
            for i in range(dim):
                force[i, k] = (t_N[k] * push[i, k] + traction[i]) * w[q, j]
                if tangent:
                    for m in range(dim):
                        whole = dp[k] * push[i, k] * gradient[m, k] + D[i, m]
                        if turns:
                            whole += t_N[k] * dn[i, m, k]
                        slope[i, m, k] = whole * w[q, j]
    if not acts:
        return
    # Faces innermost: they stand side by side.
    V, K = np.zeros((dim * nn, count), kind), np.zeros((dim * nn, dim * nn, count if tangent else 0), kind)
    for i in range(dim):
        for a in range(nn):
            for q in range(nq):
                for j in range(count):
                    V[i * nn + a, j] -= Na[q, a, j] * force[i, q * count + j]
            for m in range(dim if tangent else 0):
                for b in range(nn):
                    for q in range(nq):
                        for j in range(count):
                            part = Na[q, a, j] * Na[q, b, j]
                            K[i * nn + a, m * nn + b, j] -= part * slope[i, m, q * count + j]
    for i in range(dim * nn):
        for j in range(count):
            vector[i, near[j]] = V[i, j]
        for m in range(dim * nn if tangent else 0):
            for j in range(count):
                matrix[i, m, near[j]] = K[i, m, j]
