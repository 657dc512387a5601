"""What ``benchmarks.compare`` runs: commands, the files that they read, and those that are compared."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

HOLD = """base = "gelatin"
[protocol]
depth = "4 mm"
motion = [["0 s", "0 mm"], ["190 s", "4 mm"], ["230 s", "4 mm"], ["270 s", "3.5 mm"]]
[numerics]
h = "0.7 mm"
"""

MAP = """title = "Eight points"
base = "gelatin"
[protocol]
depth = "10 mm"
[numerics]
energy_step = 0.1
corner = 0.125
shallow = 1
step = "0.2 mm"
h = "0.65 mm"
penalty = 16000
stick = 6400
[[axis]]
name = "cohesion"
values = [1.0, 12.5]
[[axis]]
name = "viscosity"
values = [0.01, 5.0]
[[axis]]
name = "adhesion"
values = [0.0, 0.187]
[plot]
x = "cohesion"
y = "viscosity"
panel = "adhesion"
"""

CAMPAIGN = """title = "Made up: a rubber that stiffens and relaxes"
baseline = ["neo_hookean", "volumetric"]
candidates = ["yeoh", "gent", "maxwell"]
[parameters]
G = "15 kPa"
nu = 0.4999
[fit]
free = ["G"]
"""

TEST = """[[experiment]]
id = "{0}"
kind = "uniaxial"
data = "{0}.csv"
columns = {{ time = "time", stretch = "stretch", stress = "stress", repetition = "specimen" }}
"""


def campaign() -> dict[str, str]:
    """The files of a campaign: slow and fast tension of two specimens each, with noise."""
    noise, files = np.random.default_rng(1), {"campaign.toml": CAMPAIGN}
    for name, rate in (("slow", 0.002), ("fast", 0.2)):
        rows = ["specimen,time [s],stretch,stress [kPa]"]
        for specimen, scale in (("A", 0.98), ("B", 1.02)):
            for x in np.linspace(1.02, 1.8, 40):
                t, strain = (x - 1) / rate, x - x**-2
                relaxed = 20 * scale * strain * (1 + 0.15 * (x - 1) ** 2)
                P = relaxed + 6 * strain * -math.expm1(-t / 2) * 2 / t + 0.05 * noise.standard_normal()
                rows.append(f"{specimen},{t:.5f},{x:.5f},{P:.5f}")
        files[f"{name}.csv"] = "\n".join(rows) + "\n"
        files["campaign.toml"] += TEST.format(name)
    return files


@dataclass(frozen=True)
class Job:
    """A command, the files that it reads, and those of its output that are compared."""

    name: str
    command: str
    compared: tuple[str, ...] = ("curve.csv", "run.json")
    files: Mapping[str, str] = field(default_factory=dict)


#: Small enough for coarse elements, and weak enough to be cut within a minute.
BLOCK = "--set width='8 mm' --set length='3 mm' --set height='6 mm' --set cohesion=1.5"
JOBS = (
    Job("gelatin", "run2d gelatin --depth 5"),
    Job("elastomer", "run2d elastomer --depth 5"),
    Job("meat", "run2d meat --depth 5"),
    Job("map", "sweep map.toml --workers 1", ("map.csv",), {"map.toml": MAP}),
    Job("fit", "fit campaign.toml --workers 0", ("fit.json",), campaign()),
    Job("discovery", "discover campaign.toml --workers 0", ("discovery.json",), campaign()),
    Job("block", f"run3d gelatin --depth 1.3 --h 1 --no-plane-strain {BLOCK}"),
    Job("tension", "tension gelatin --notched --h 1 --elongation 7", ("curve.csv", "tension.json")),
    Job("hold", "run2d hold.toml", files={"hold.toml": HOLD}),
    Job("paper", "run2d gelatin --numerics paper --h 0.7 --depth 4"),
)
