"""The barrier between a point and a segment within d̂, w d̂ b(d/d̂) with b(s) = −(s − 1)² ln s: energy, forces
and tangent by the positions of the point and of the segment's ends."""

from __future__ import annotations

import numpy as np

from cutbench.base.compiled import compiled

#: ∂/∂(point, first, last) of r = point − first and of the segment, last − first, as signs.
_R, _LONG = np.array([1.0, -1.0, 0.0]), np.array([0.0, -1.0, 1.0])
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
#: Of an end of the segment, the first or the last.
_ENDS = np.array([[1.0, -1.0, 0.0], [1.0, 0.0, -1.0]])
# Second derivatives of the cross product long × r = longᵀ T r, of long², and of squared distances from ends.
_DDC = np.kron(np.outer(_LONG, _R), _TURN) + np.kron(np.outer(_LONG, _R), _TURN).T
_DDL = 2 * np.kron(np.outer(_LONG, _LONG), np.eye(2))
_DDQ = np.stack([2 * np.kron(np.outer(signs, signs), np.eye(2)) for signs in _ENDS])

Derivatives = tuple[np.ndarray, np.ndarray, np.ndarray]


def _from_line(r: np.ndarray, long: np.ndarray, tangent: bool) -> Derivatives:
    """Squared distance c²/l from the line through a segment, l = long², and derivatives."""
    c, l = long[0] * r[1] - long[1] * r[0], (long * long).sum(axis=0)
    w = c / l
    dc = np.concatenate([_R[k] * -(_TURN @ long) + _LONG[k] * (_TURN @ r) for k in range(3)])
    dl = np.concatenate([2 * _LONG[k] * long for k in range(3)])
    slope = 2 * w * dc - w * w * dl
    if not tangent:
        return c * w, slope, np.zeros((6, 6, 0))
    turned = dc - w * dl
    curvature = 2 / l * turned[:, None] * turned[None] + 2 * w * _DDC[..., None] - w * w * _DDL[..., None]
    return c * w, slope, curvature


def _from_end(r: np.ndarray, end: int, tangent: bool) -> Derivatives:
    """Squared distance from the first (0) or last (1) ``end`` of the segment, and derivatives."""
    slope = np.concatenate([2 * sign * r for sign in _ENDS[end]])
    curvature = np.repeat(_DDQ[end][..., None], r.shape[1], axis=2) if tangent else np.zeros((6, 6, 0))
    return (r * r).sum(axis=0), slope, curvature


def _by_distance(weight: np.ndarray, d: np.ndarray, found: Derivatives) -> Derivatives:
    """w d̂ b(√q/d̂), from the squared distance q and its derivatives."""
    q, slope, curvature = found
    inside = np.real(q) < d**2
    s = np.sqrt(np.where(inside, q, d**2)) / d
    log = np.log(s)
    first = -2 * (s - 1) * log - (s - 1) ** 2 / s
    by_q = weight * first / (2 * s * d)
    if curvature.shape[-1]:
        second = -2 * log - 4 * (s - 1) / s + (s - 1) ** 2 / s**2
        by_qq = weight * (second / s**2 - first / s**3) / (4 * d**3)
        curvature = by_q * curvature + np.where(inside, by_qq, 0.0) * slope[:, None] * slope[None]
    return -weight * d * (s - 1) ** 2 * log, by_q * slope, curvature


def plain_barrier(x, codes, length, reach, known, tangent):
    """As ``barrier``, for real and complex places."""
    i, e = np.divmod(codes, x.shape[1])
    r, long = x[:, i] - x[:, e], x[:, e + 1] - x[:, e]
    along = np.real((r * long).sum(axis=0)) / np.maximum(np.real((long * long).sum(axis=0)), 1e-300)
    found = _from_line(r, long, tangent)
    for end, clipped in enumerate((along <= 0, along >= 1)):
        for mine, other in zip(found, _from_end(r - end * long, end, tangent), strict=True):
            np.copyto(mine, other, where=clipped[: mine.shape[-1]])
    weight, corner = length[i] / 2, (e > 0) & (np.abs(i - e) > 1)
    less = _by_distance(weight, reach[i], _from_end(r, 0, tangent))
    value, slope, curvature = (
        a - corner[: a.shape[-1]] * b
        for a, b in zip(_by_distance(weight, reach[i], found), less, strict=True)
    )
    force, blocks = np.zeros((x.shape[1], 2), x.dtype), np.zeros((6, 6, known.size if tangent else 0))
    np.add.at(force, np.stack([i, e, e + 1]), slope.reshape(3, 2, -1).transpose(0, 2, 1))
    if tangent:
        here = np.isin(codes, known, assume_unique=True)
        blocks[..., np.searchsorted(known, codes[here])] = curvature[..., here]
    return value.sum(), force, blocks


@compiled(plain_barrier)
def barrier(x, codes, length, reach, known, tangent):
    """Energy, forces on the points (n, 2) and tangents (6, 6, k) of the pairs ``known`` (k,), none without
    ``tangent``.

    ``codes`` (m,), rising, are number of the point times n + that of the segment, of what is nearer than
    ``reach`` d̂ (n,) on the line x (2, n), whose points stand for ``length`` (n,) of it: w is half of that.
    A corner between two segments that both count counts once less.
    """
    n = x.shape[1]
    total, force, blocks = 0.0, np.zeros((n, 2)), np.zeros((6, 6, known.size if tangent else 0))
    g, turned, points = np.zeros(6), np.zeros(6), np.zeros(3, np.int64)
    at = 0
    for code in codes:
        i, e = code // n, code % n
        points[0], points[1], points[2] = i, e, e + 1
        while at < known.size and known[at] < code:
            at += 1
        bends = tangent and at < known.size and known[at] == code
        r0, r1, d = x[0, i] - x[0, e], x[1, i] - x[1, e], reach[i]
        l0, l1 = x[0, e + 1] - x[0, e], x[1, e + 1] - x[1, e]
        l = l0 * l0 + l1 * l1
        along = (r0 * l0 + r1 * l1) / max(l, 1e-300)
        for part in range(2):  # the whole, and less the corner: not beside the point, nor at the line's end
            if part == 1 and not (e > 0 and abs(i - e) > 1):
                break
            line = part == 0 and 0 < along < 1
            end = 1 if part == 0 and along >= 1 else 0
            w = 0.0
            if line:
                w = (l0 * r1 - l1 * r0) / l
                q = w * w * l
                for k in range(3):
                    turned[2 * k] = -_R[k] * l1 + _LONG[k] * (r1 - 2 * w * l0)
                    turned[2 * k + 1] = _R[k] * l0 - _LONG[k] * (r0 + 2 * w * l1)
                    g[2 * k] = 2 * w * (turned[2 * k] + w * _LONG[k] * l0)
                    g[2 * k + 1] = 2 * w * (turned[2 * k + 1] + w * _LONG[k] * l1)
            else:
                a, b = r0 - end * l0, r1 - end * l1
                q = a * a + b * b
                for k in range(3):
                    g[2 * k], g[2 * k + 1] = 2 * _ENDS[end, k] * a, 2 * _ENDS[end, k] * b
            if not q < d * d:
                continue
            weight = (0.5 - part) * length[i]
            s = np.sqrt(q) / d
            log = np.log(s)
            first = -2 * (s - 1) * log - (s - 1) ** 2 / s
            by_q = weight * first / (2 * s * d)
            total -= weight * d * (s - 1) ** 2 * log
            for k in range(6):
                force[points[k // 2], k % 2] += by_q * g[k]
            if not bends:
                continue
            second = -2 * log - 4 * (s - 1) / s + (s - 1) ** 2 / s**2
            by_qq = weight * (second / s**2 - first / s**3) / (4 * d**3)
            for k in range(6):
                for m in range(6):
                    if line:
                        bent = 2 / l * turned[k] * turned[m] + 2 * w * _DDC[k, m] - w * w * _DDL[k, m]
                    else:
                        bent = _DDQ[end, k, m]
                    blocks[k, m, at] += by_q * bent + by_qq * g[k] * g[m]
    return total, force, blocks
