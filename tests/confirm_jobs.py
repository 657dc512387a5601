"""A run for other processes: a curve that falls by half."""

from __future__ import annotations

import numpy as np

from cutbench.run.files import write_run
from cutbench.run.result import Outcome, Result


def left(case, folder):
    d = np.array([0.0, 0.5, 0.6, 1.0])
    curve = {"displacement_mm": d, "force_N": np.array([0.0, 1.0, 0.5, 0.5]), "time_s": d}
    curve["cut_length_mm"] = np.array([0.0, 0.0, 0.5, 0.6])
    result = Result(case, curve, Outcome("done", "", "", 1.0), {"total": 2.0}, {"iterations": 3})
    write_run(result, folder, command="test")
    return result
