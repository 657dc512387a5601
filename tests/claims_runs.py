"""Stand-ins for the runs behind claims: curves by formula. Top-level functions, for worker processes."""

from __future__ import annotations

import os

import numpy as np

from cutbench.run.result import Outcome, Result
from studies.paper.observed import COLUMNS


def cut(case) -> Result:
    """Linear elements of 1 mm or more drop by half at a peak that moves with b; all else is smooth."""
    note(case)
    n, p = case.numerics, case.p
    coarse = n.element == "P1" and case.sizes.h_mm >= 1 and n.normal == "material"
    drop = 0.5 if coarse else 0.05
    peak = 5.0 - p.tip  # b = 0.85 mm gives 4.15 mm
    d = np.array([0.0, peak - 0.4, peak, peak + 0.5, p.depth])
    F = np.array([0.0, 0.9, 1.0, 1.0 - drop, 1.5]) * p.G / 0.0075
    curve = {
        "displacement_mm": d,
        "force_N": F,
        "time_s": d / p.speed,
        "cut_length_mm": np.array([0.0, 0.0, 0.2, 1.0, p.depth - peak]),
        "work_coulomb_mJ": 0.3 * d,
        "work_adhesion_mJ": d,
    }
    curve |= {name: np.full(5, 0.1) for name in COLUMNS}
    curve["damage_at_widest"] = np.array([0.0, 0.5, 0.9, 1.0, 1.0])
    found = {"peak_mm": peak, "peak_N": F[2], "drop_rel": drop, "onset_mm": peak - 0.2, "steady_N": F[-1]}
    found |= {"slope_N_per_mm": 0.05, "max_N": F[-1]}
    return Result(case, curve, Outcome("done", "reached", "", p.depth), {"total": 0.0}, {}, [], found)


def strip(case) -> Result:
    """A strip of 3 G."""
    note(case)
    d = np.array([0.0, case.p.depth])
    curve = {"displacement_mm": d, "force_N": case.p.G * d}
    outcome = Outcome("done", "reached", "", case.p.depth)
    return Result(case, curve, outcome, {}, {}, [], {"modulus_MPa": 3 * case.p.G, "max_N": case.p.G})


def block(case) -> Result:
    """A block whose cut starts at the middle with the paper's elements, at the end with others."""
    made = cut(case)
    first, last = (3.0, 4.0) if case.numerics.element == "P1" else (4.0, 3.0)
    z = 0.5 if case.numerics.element == "P1" else 14.0
    front = {"start_z_mm": z, "centre_mm": first, "edge_mm": last, "von_mises_start_MPa": 0.03}
    front |= {"von_mises_running_MPa": 0.031, "pressure_before_MPa": 0.27, "pressure_after_MPa": 0.2}
    made.measures.update({f"front_{name}": value for name, value in front.items()})
    return made


def notched(case) -> Result:
    """A notched strip that runs at a tenth of its length and holds half of what a whole one does."""
    made = strip(case)
    made.measures.update({"onset_mm": 3.0, "max_N": 0.5 * case.p.G})
    return made


def third_is_stopped(case) -> Result:
    """Ctrl-C in the third run."""
    with open(os.environ["CLAIMS_LOG"], encoding="utf-8") as file:
        if len(file.readlines()) >= 2:
            raise KeyboardInterrupt
    return cut(case)


def fails(case) -> Result:
    raise FloatingPointError("the matrix is singular")


def note(case) -> None:
    if path := os.environ.get("CLAIMS_LOG"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(case.id + "\n")
