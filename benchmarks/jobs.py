"""The runs that are timed. Plain data, so that the process that starts them stays small."""

from __future__ import annotations

from dataclasses import dataclass, field

#: Element size in mm at which the section has about 2,100 degrees of freedom with P2.
COARSE_MM = 0.58
#: The same for elements as wide as tall.
PRINTED_MM = 0.52
#: Blade travel in mm of every job under --quick.
QUICK_MM = 0.5


@dataclass(frozen=True)
class Job:
    """One run: a material, what is changed (as ``Case.set`` takes it) and the blade travel in mm."""

    name: str
    material: str
    depth_mm: float
    changes: dict[str, object] = field(default_factory=dict)


_COARSE = {"element": "P2", "corner": 0.25, "shallow": 1, "step": "0.1 mm", "h": f"{COARSE_MM:g} mm"}
#: As the source computed: viscosity as printed, the material's normal, elements as wide as tall.
_PRINTED = {
    "element": "P2",
    "h": f"{PRINTED_MM:g} mm",
    "slender": 1,
    "corner": 1,
    "shallow": 1,
    "step": "0.1 mm",
    "normal": "material",
    "with_": "viscous",
}

JOBS = (
    # Whether the ledger closes in a step decides nothing there either.
    Job("gelatin, coarse, as printed", "gelatin", 14.0, {**_PRINTED, "energy_step": 1}),
    Job("gelatin, coarse, as printed, energy held", "gelatin", 14.0, _PRINTED),
    Job("gelatin, coarse", "gelatin", 14.0, _COARSE),
    Job("gelatin, coarse, superlu", "gelatin", 14.0, {**_COARSE, "solver": "superlu"}),
    Job("gelatin", "gelatin", 21.0),
    Job("elastomer", "elastomer", 21.0),
    Job("meat", "meat", 21.0),
)
