"""Force curves as ``map.html`` holds them: the force, and by mechanism its mean over a stretch of travel."""

from __future__ import annotations

import heapq

import numpy as np
from scipy.integrate import cumulative_trapezoid

from cutbench.mechanisms import registry
from cutbench.run.figures.curve import NEGLIGIBLE, NO_MECHANISM, smooth_force
from cutbench.run.measures import forward
from cutbench.run.result import Result

#: A curve is thinned until what is drawn is so near to it, relative to its largest force; to so many points
#: at the most.
CURVE_TOLERANCE, MAX_CURVE_POINTS = 0.005, 120
#: Numbers of a curve are whole multiples of its largest force divided by this.
STEPS = 2000
#: Shares that are small throughout, together; and what the energy balance leaves of the mean force.
OTHERS, REST = "others", "rest"


def curve_of(result: Result, points: int = MAX_CURVE_POINTS) -> dict | None:
    """Travel ``d`` (mm), ``force`` over it and, until the blade first rests, ``mean`` and its ``split``.

    Forces are whole numbers, times ``scale`` N. A mechanism's share is the slope of its work over ``window``
    mm of travel, half a blade's thickness, and ``mean`` that of the blade's own: with ``REST`` the shares add
    up to it exactly, at every point. ``error`` is how far thinning has moved a line, relative to the largest
    force or share.
    None of a run without travel.
    """
    d, force = result.displacement_mm, result.force_N
    if d.size < 2:
        return None
    down, window = forward(d), result.case.values.get("thickness", 0.7) / 2
    travel = d[:down]
    shares = _shares(result, travel, window) if down > 1 else {}
    mean = smooth_force(travel, cumulative_trapezoid(force[:down], travel, initial=0), window, travel)
    lines = np.zeros((d.size, 2 + len(shares)))
    lines[:, 0] = force
    for k, share in enumerate([mean, *shares.values()], start=1):
        lines[:down, k], lines[down:, k] = share, share[-1]
    # Of a curve that is zero throughout nothing is lost by any scale.
    largest = float(np.max(np.abs(lines))) or 1.0
    keep, error = thinned(d, lines / largest, CURVE_TOLERANCE, points)
    keep = np.union1d(keep, [down - 1])
    scale = float(f"{largest / STEPS:.4g}")
    whole = np.rint(lines[keep] / scale).astype(int)
    first = keep < down
    split = {name: whole[first, k] for k, name in enumerate(shares, start=2)}
    if shares:
        split[REST] = whole[first, 1] - sum(split.values())
    return {
        "scale": scale,
        "window": window,
        "error": float(f"{error:.2g}"),
        "d": [float(f"{v:.5g}") for v in d[keep]],
        "force": whole[:, 0].tolist(),
        "mean": whole[first, 1].tolist(),
        "split": {name: share.tolist() for name, share in split.items() if np.any(share)},
    }


def titles_of(names: list[str]) -> dict[str, str]:
    """How a page calls the entries of a ledger."""
    known = NO_MECHANISM | {OTHERS: "others, each small", REST: "left by the energy balance"}
    laws = registry()
    return {n: known.get(n) or (laws[n].title if n in laws else n.replace("_", " ")) for n in names}


def _shares(result: Result, travel: np.ndarray, window: float) -> dict[str, np.ndarray]:
    """Mean force of each entry of the ledger (N) at each point of the travel."""
    largest = float(np.max(np.abs(result.force_N)))
    shares, small = {}, np.zeros(travel.size)
    for name in result.ledger:
        work = result.curve.get(f"work_{name}_mJ")
        if work is None:
            # An entry's force is that of the step which ends there: work adds up over steps.
            steps = result.curve[f"force_{name}_N"][1 : travel.size]
            work = np.concatenate([[0.0], np.cumsum(np.diff(travel) * steps)])
        share = smooth_force(travel, np.asarray(work, dtype=float)[: travel.size], window, travel)
        if np.max(np.abs(share)) < NEGLIGIBLE * largest:
            small += share
        else:
            shares[name] = share
    return shares | ({OTHERS: small} if np.any(small) else {})


def thinned(x: np.ndarray, lines: np.ndarray, near: float, points: int) -> tuple[np.ndarray, float]:
    """Which points of polygons over ``x`` (n,) stay ``near`` to ``lines`` (n, k), and how near they are.

    The farthest first (Douglas & Peucker 1973), ``points`` at the most.
    """
    lines = lines.reshape(x.size, -1)
    kept, spans = [0, x.size - 1], [_farthest(x, lines, 0, x.size - 1)]
    while len(kept) < points and -spans[0][0] > near:
        _, first, middle, last = heapq.heappop(spans)
        kept.append(middle)
        for ends in ((first, middle), (middle, last)):
            heapq.heappush(spans, _farthest(x, lines, *ends))
    return np.unique(kept), -spans[0][0]


def _farthest(x: np.ndarray, lines: np.ndarray, first: int, last: int) -> tuple[float, int, int, int]:
    """Minus the distance of the farthest point between two, and where it is."""
    if last - first < 2:
        return 0.0, first, first, last
    run = x[last] - x[first]
    part = (x[first + 1 : last] - x[first]) / run if run > 0 else np.zeros(last - first - 1)
    straight = lines[first] + part[:, None] * (lines[last] - lines[first])
    away = np.abs(lines[first + 1 : last] - straight).max(axis=1)
    k = int(np.argmax(away))
    return -float(away[k]), first, first + 1 + k, last
