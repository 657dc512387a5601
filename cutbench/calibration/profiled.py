"""The profile likelihood of one parameter: how χ² rises along it when all others are fitted again."""

from __future__ import annotations

import numpy as np
from scipy import stats

from cutbench.base.errors import ComputationFailed
from cutbench.calibration import lm
from cutbench.calibration.fitted import LEVEL, Profile
from cutbench.calibration.inverse import Inverse

#: All but one parameter again, for each point of a profile.
AGAIN = lm.Settings(promise=0.1, evaluations=6)


def profiled(
    inverse: Inverse, whitened: lm.Residual, label: str, best: lm.Minimum, covariance: np.ndarray,
    dof: np.ndarray,
) -> tuple[Profile, int]:  # fmt: skip
    """χ² along the parameter ``label``, on each side until it has risen by t² (times the excess of χ² over
    what noise explains) or three tries are spent; and how many evaluations that took.

    ``whitened``: residuals and derivatives by q. ``covariance`` (k, k) and ``dof`` (k,) are those of
    ``best``. Raises KeyboardInterrupt.
    """
    evaluations = 0

    def rise(q: float) -> float:
        """χ² above its minimum with the parameter at ``q`` and all others fitted again."""
        nonlocal evaluations
        low, high = (b.copy() for b in inverse.bounds)
        start = best.q + covariance[:, k] / covariance[k, k] * (q - best.q[k])
        low[k] = high[k] = start[k] = q
        found = lm.minimise(whitened, start, low, high, AGAIN)
        evaluations += found.evaluations
        if found.message == lm.INTERRUPTED:
            raise KeyboardInterrupt
        return found.chi2 - best.chi2

    k = [u.label for u in inverse.unknowns].index(label)
    u = inverse.unknowns[k]
    t = stats.t.ppf((1 + LEVEL) / 2, dof[k])
    t, sd = t * np.sqrt(best.excess), np.sqrt(covariance[k, k])
    low, high = inverse.bounds
    points, ends = [(best.q[k], 0.0)], {}
    for side in (-1, 1):
        q, way, before = best.q[k], t * sd, (best.q[k], 0.0)
        ends[side] = np.nan
        for _ in range(3):
            q = float(np.clip(best.q[k] + side * way, low[k], high[k]))
            try:
                risen = rise(q)
            except ComputationFailed:
                break
            points.append((q, risen))
            if risen >= t**2:
                # The root of χ² is close to linear.
                a, b = np.sqrt(max(before[1], 0.0)), np.sqrt(risen)
                ends[side] = before[0] + (q - before[0]) * (t - a) / (b - a)
                break
            before, way = (q, risen), way * min(1.15 * t / max(np.sqrt(max(risen, 0.0)), t / 3), 3.0)
    points.sort()
    values = np.array([u.value(q) for q, _ in points])
    ends = {side: u.value(q) if np.isfinite(q) else np.nan for side, q in ends.items()}
    return Profile(label, values, np.array([risen for _, risen in points]), ends[-1], ends[1]), evaluations
