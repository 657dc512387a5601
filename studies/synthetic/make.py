"""Makes the readings of this folder: computed on a fine mesh, with noise. Run from anywhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.synthetic import Noise, Test, clean, experiment
from cutbench.case.case import load_case

#: Gelatin with a slender blade and a weak cut plane.
TRUTH = load_case("gelatin").set(
    tip="3 mm",
    cohesion=2.0,
    tau_W="2 kPa",
    eta_reg="5 s",
    h="0.35 mm",
    step="0.05 mm",
    penalty=560,
    stick=224,
    multiplier="none",
    normal="material",
)
TESTS = (Test("slow", speed=0.021, reach=2.0), Test("fast", speed=0.1, reach=2.0))


def main() -> None:
    rng = np.random.default_rng(7)
    for test in TESTS:
        made = experiment(TRUTH, test, clean(TRUTH, test), Noise(), rng)
        lines = ["# synthetic: computed, not measured", "specimen,u [mm],F [N]"]
        for r in made.repetitions:
            lines += [f"{r.name},{x:.5f},{F:.6f}" for x, F in zip(r.x, r.y, strict=True)]
        path = Path(__file__).with_name(f"{test.id}.csv")
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
