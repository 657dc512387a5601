"""What a cut's exact derivative is worth beyond its transition: ``python -m benchmarks.stairs``.

The force of a gelatin cut by ln G_c along the travel: exactly, and by central differences over 1, 3 and 10 %.
Where the front has run, the computed force answers to a parameter in small jumps: differences see them, an
exact derivative does not.

    python -m benchmarks.stairs [--material NAME] [--depth MM] [--speed MM_PER_S] [--json FILE]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.tools import facts
from cutbench.base.errors import BadInput
from cutbench.base.files import write_json
from cutbench.case.case import Case, load_case
from cutbench.run.runner import run_case

PARTS = (0.01, 0.03, 0.1)
PLACES = 29


def forces(case: Case, factor: float, at: np.ndarray) -> np.ndarray:
    """N, of the case with ``factor`` times its toughness, at travels (n,) in mm."""
    curve = run_case(case.set(G_c=f"{1e3 * case.values['G_c'] * factor!r} J/m^2")).curve
    return np.interp(at, curve["displacement_mm"], curve["force_N"])


def measured(case: Case) -> dict[str, np.ndarray]:
    """By name, along the travel."""
    run = run_case(case, sensitivities=("G_c",))
    x, at = run.displacement_mm, np.linspace(0, case.p.depth, PLACES)[1:]
    found = {
        "displacement_mm": at,
        "force_N": np.interp(at, x, run.force_N),
        "exact_N": np.interp(at, x, run.sensitivities["G_c"]) * case.values["G_c"],
    }
    for part in PARTS:
        plus, minus = (forces(case, 1 + sign * part, at) for sign in (1, -1))
        found[f"over_{100 * part:.0f}_per_cent_N"] = (plus - minus) / (2 * part)
    return found


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.stairs", description=__doc__.split("\n")[0])
    parser.add_argument("--material", default="gelatin")
    parser.add_argument("--depth", type=float, default=7.0, metavar="MM")
    parser.add_argument("--speed", type=float, default=0.021, metavar="MM_PER_S")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    try:
        case = load_case(asked.material, {"depth": f"{asked.depth} mm", "speed": f"{asked.speed} mm/s"})
    except BadInput as error:
        parser.error(str(error))
    table = measured(case)
    print("dF/d ln G_c in N, along the travel")
    print("  ".join(f"{name:>21}" for name in table))
    for row in zip(*table.values(), strict=True):
        print("  ".join(f"{value:21.3f}" for value in row))
    if asked.json is not None:
        write_json({"machine": facts(), **{name: list(column) for name, column in table.items()}}, asked.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
