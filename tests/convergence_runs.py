"""Stand-ins for runs whose measures tend to a limit with the element size, for worker processes."""

from __future__ import annotations

import numpy as np

from cutbench.run.result import Outcome, Result


def converging(case) -> Result:
    """Onset 3 − h, peak 1 − h², in mm and N; a slope only along the material's normal."""
    h = case.sizes.h_mm
    d = np.array([0.0, case.p.depth])
    curve = {"displacement_mm": d, "force_N": d, "time_s": d / case.p.speed, "cut_length_mm": d}
    found = {"onset_mm": 3 - h, "peak_N": 1 - h**2, "drop_rel": 0.004 * h, "steady_N": 1.0, "closure": 0.001}
    found["slope_N_per_mm"] = 0.05 if case.numerics.normal != "material" else float("nan")
    return Result(case, curve, Outcome("done", "", "", case.p.depth), {"total": 1.0}, {}, [], found)


def uncut(case) -> Result:
    """The same of a blade that does not get through the top."""
    whole = converging(case)
    whole.measures.update(dict.fromkeys(("onset_mm", "drop_rel", "steady_N"), float("nan")))
    return whole
