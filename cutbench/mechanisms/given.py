"""What belongs to the test, not to a law, and what every law may read: the block and the blade's way."""

from __future__ import annotations

from cutbench.base.units import Parameter

SPECIMEN = (
    Parameter(
        "width",
        "mm",
        "W",
        "specimen across the blade",
        low=0,
        open_low=True,
        default=30.0,
        typical=30.0,
        trial=("with a specimen half as wide", 0.5),
    ),
    Parameter(
        "length", "mm", "L", "specimen along the blade", low=0, open_low=True, default=30.0, typical=30.0
    ),
    Parameter("height", "mm", "H", "specimen height", low=0, open_low=True, default=21.0, typical=21.0),
)
PROTOCOL = (
    Parameter(
        "speed",
        "mm/s",
        "v",
        "blade speed",
        low=0,
        open_low=True,
        default=0.021,
        typical=0.021,
        lever="speed",
        trial=("ten times as fast", 10.0),
    ),
    Parameter(
        "depth",
        "mm",
        "u",
        "blade travel (default: to 4 thicknesses above the base)",
        low=0,
        open_low=True,
        typical=21.0,
    ),
)
