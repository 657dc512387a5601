"""What belongs to the test, not to a law, and what every law may read: the block and the blade's way."""

from __future__ import annotations

from cutbench.base.units import Parameter

SPECIMEN = (
    Parameter.positive(
        "width",
        "mm",
        "W",
        "specimen across the blade",
        default=30.0,
        trial=("with a specimen half as wide", 0.5),
    ),
    Parameter.positive("length", "mm", "L", "specimen along the blade", default=30.0),
    Parameter.positive("height", "mm", "H", "specimen height", default=21.0),
    Parameter(
        "precut", "mm", "c_0", "depth to which it is cut before the test", low=0, default=0.0, typical=5.0
    ),
)
PROTOCOL = (
    Parameter.positive(
        "speed", "mm/s", "v", "blade speed", default=0.021, lever="speed", trial=("ten times as fast", 10.0)
    ),
    Parameter.positive(
        "depth", "mm", "u", "blade travel (default: to 4 thicknesses above the base)", typical=21.0
    ),
)
