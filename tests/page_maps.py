"""Maps of stand-in runs for tests of the page: a grid in three axes, and a boundary that is sought."""

from __future__ import annotations

from pathlib import Path

import analytic_runs
import numpy as np

from cutbench.maps.study import load_study
from cutbench.maps.sweep import run_study

TITLE = "Cohesion </script> & viscosity"
GRID = f"""title = "{TITLE}"
base = "gelatin"
{analytic_runs.AXES}[plot]
mark = ["gelatin", "elastomer"]
"""
SOUGHT = GRID.replace("points = 4\n", "").replace("base", 'mode = "boundary"\nbase').replace(
    "values = [0.01, 0.2, 5.0]", "from = 0.01\nto = 5.0"
) + '[boundary]\nruns = 40\n'  # fmt: skip

SAMPLED = GRID.replace("values = [0.01, 0.2, 5.0]", "from = 0.01\nto = 5.0").replace(
    "points = 4\n", "").replace("base", 'mode = "sobol"\nbase') + "[sample]\npoints = 9\n"  # fmt: skip
ONE_AXIS = """title = "One axis"
base = "gelatin"
[[axis]]
name = "viscosity"
values = [0.01, 0.2, 5.0]
scale = "log"
[plot]
mark = ["gelatin"]
"""
SWITCH = ONE_AXIS.replace("[plot]", '[[axis]]\nmechanism = "adhesion"\n[plot]')


def split_run(case):
    """The stand-in, with a ledger whose parts make up the force; one of them gives back at the end."""
    result = analytic_runs.computed(case)
    force = result.curve["force_N"]
    steps = (force + np.roll(force, 1)) / 2  # the mean over the step that ends there
    steps[0] = 0
    given = 0.75 * steps
    given[-1] *= -1
    result.curve |= {"force_neo_hookean_N": given, "force_adhesion_N": steps - given}
    result.measures |= {"closure": 1e-3}
    return result


def swept(folder: Path, text: str, run=split_run) -> Path:
    """``folder`` with the map and the page of a study of stand-in runs, and no pictures."""
    (folder / "study.toml").write_text(text, encoding="utf-8")
    run_study(load_study(folder / "study.toml"), folder, workers=0, run=run, pictures=False)
    return folder
