"""Coarse cuts of a gel for tests of the emulator, computed once: ``python tests/emulator_runs.py`` makes the
file anew, in some ten minutes of one core."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.stats import qmc

from cutbench.case.case import Case, load_case
from cutbench.run.runner import run_case

FILE = Path(__file__).with_name("emulator_runs.npz")
#: Parameters, their units and ranges: several gels, speeds and tips.
BOX = {
    "G": ("kPa", 5, 13), "G_c": ("J/m^2", 3, 8), "tau_W": ("kPa", 0.5, 4), "eta_reg": ("s", 0.3, 2.4),
    "speed": ("mm/s", 0.005, 0.1), "tip": ("mm", 0.8, 1.6),
}  # fmt: skip
SIZES = {"width": "20 mm", "length": "30 mm", "height": "14 mm", "depth": "5 mm", "numerics": "fast"}
X = np.linspace(0, 5, 101)


def case_of(row: np.ndarray) -> Case:
    """The cut of a row of values, in the units of ``BOX``."""
    values = {name: f"{v!r} {BOX[name][0]}" for name, v in zip(BOX, map(float, row), strict=True)}
    return load_case("gelatin", {**SIZES, **values})


def computed(row: np.ndarray) -> tuple[np.ndarray, float]:
    """Forces (101,) along ``X``, and where the cut begins."""
    run = run_case(case_of(row))
    x, F = run.curve["displacement_mm"], run.curve["force_N"]
    return np.interp(X, x, F), run.measures.get("onset_mm", np.nan)


def kept() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of values (n, 6), forces (n, 101) and onsets (n,) of the file."""
    with np.load(FILE) as data:
        return data["rows"].astype(float), data["forces"].astype(float), data["onsets"].astype(float)


def rows(count: int) -> np.ndarray:
    """Values (n, 6) that fill the box."""
    low, high = (np.log([each[k] for each in BOX.values()]) for k in (1, 2))
    return np.exp(low + (high - low) * qmc.Sobol(len(BOX), seed=7).random(count))


if __name__ == "__main__":
    made = np.float32(rows(64))
    forces, onsets = zip(*map(computed, made), strict=True)
    np.savez_compressed(FILE, rows=made, forces=np.float32(forces), onsets=np.float32(onsets))
