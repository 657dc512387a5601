"""Stand-ins for a computation: curves by formula, in no time, counted in a file. For tests of sweeps.

Functions at the top level of a module, so that worker processes can import them.
"""

from __future__ import annotations

import os
import signal
import time

import numpy as np

from cutbench.run.result import Outcome, Result

#: Axes of a study: 24 points, both regimes among them.
AXES = """[[axis]]
name = "cohesion"
from = 1.0
to = 30.0
points = 4
scale = "log"
[[axis]]
name = "viscosity"
values = [0.01, 0.2, 5.0]
scale = "log"
[[axis]]
name = "adhesion"
values = [0.0, 0.187]
"""


def drop_of(case) -> float:
    """Relative drop of the stand-in: large for little cohesion, viscosity and adhesion."""
    p = case.p
    sigma = p.G_c / p.delta_c
    viscosity = p.eta_reg * p.speed / p.delta_c
    adhesion = case.values.get("tau_W", 0.0) / sigma
    return 0.9 / (1 + (viscosity / 0.4) ** 0.9) / (1 + 9 * adhesion) / (1 + (sigma / p.G / 14) ** 2)


def fake_run(case) -> Result:
    """``computed``, after leaving its id and taking its time."""
    note(case)
    time.sleep(float(os.environ.get("FAKE_RUN_S", 0)))
    return computed(case)


def computed(case) -> Result:
    """Rise to 1 N, hold it to 4 mm, fall by ``drop_of(case)`` within 0.2 mm, hold, then rise slowly.

    Long enough held, the mean force over half a blade thickness falls by just as much.
    """
    drop = drop_of(case)
    d = np.array([0.0, 3.0, 4.0, 4.2, 5.5, case.p.depth])
    F = np.array([0.0, 1.0, 1.0, 1.0 - drop, 1.0 - drop, 1.2 - drop])
    curve = {
        "displacement_mm": d,
        "force_N": F,
        "time_s": d / case.p.speed,
        "cut_length_mm": np.array([0.0, 0.0, 0.0, 2 * drop, 2 * drop + 1, case.p.depth - 2]),
    }
    outcome = Outcome("done", "reached the full depth", "", case.p.depth)
    return Result(case, curve, outcome, {"total_s": 0.0}, {"steps": 6}, [], {})


def note(case) -> None:
    """Append the run's id to the file that counts (appending a short line is atomic)."""
    if path := os.environ.get("FAKE_RUN_LOG"):
        with open(path, "a", encoding="utf-8") as file:
            file.write(case.id + "\n")


def unlucky_run(case) -> Result:
    """Raises for one third of the runs."""
    if int(case.id, 16) % 3 == 0:
        note(case)
        raise FloatingPointError("the matrix is singular")
    return fake_run(case)


def deadly_run(case) -> Result:
    """Takes its process down, as the out-of-memory killer does: one run does always, another once."""
    sigma = case.p.G_c / case.p.delta_c / case.p.G
    viscosity = case.p.eta_reg * case.p.speed / case.p.delta_c
    smooth = not case.values.get("tau_W")
    always, once = (smooth and sigma > 25 and viscosity < 0.1), (smooth and sigma < 1.5 and viscosity > 1)
    mark = f"{os.environ['FAKE_RUN_LOG']}.{case.id}"
    if always or (once and not os.path.exists(mark)):
        note(case)
        open(mark, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return fake_run(case)


def stopped_run(case) -> Result:
    """Ctrl-C on the third run."""
    with open(os.environ["FAKE_RUN_LOG"], encoding="utf-8") as file:
        if len(file.readlines()) >= 2:
            raise KeyboardInterrupt
    return fake_run(case)


def threads_run(case) -> Result:
    """Notes how many threads BLAS was given, in place of the id."""
    with open(os.environ["FAKE_RUN_LOG"], "a", encoding="utf-8") as file:
        file.write(f"threads={os.environ.get('OMP_NUM_THREADS')}\n")
    return computed(case)
