"""Stand-ins for the runs of a band, by formula and counted in a file, for worker processes."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
from analytic_runs import note

from cutbench.run.result import Outcome, Result


def leaving_open(case) -> Result:
    """A drop of 0.12 that halves with the surface's length; a whole top is not cut."""
    note(case)
    length = case.p.surface_length / 0.07
    cut = "whole_surface_gradient" not in case.mechanisms
    onset = 3.4 / math.sqrt(length)
    found = {"onset_mm": onset, "peak_N": onset / 3, "drop_rel": 0.12 * length, "peak_mm": math.nan}
    end = onset + 3.5 if cut else case.p.depth
    d = np.array([0.0, end])
    curve = {"displacement_mm": d, "force_N": d, "time_s": d, "cut_length_mm": d}
    outcome = Outcome("done", "made up", "", end)
    return Result(case, curve, outcome, measures=found if cut else dict.fromkeys(found, math.nan))


def falling_short(case) -> Result:
    """The same, but a blunter edge stalls."""
    result = leaving_open(case)
    if case.p.tip < 1:
        result.outcome = Outcome("stalled", "made up", "", 2.0)
    return result


def stopped(case) -> Result:
    """The same, with Ctrl-C in the fourth run."""
    if len(Path(os.environ["FAKE_RUN_LOG"]).read_text(encoding="utf-8").splitlines()) >= 3:
        raise KeyboardInterrupt
    return leaving_open(case)
