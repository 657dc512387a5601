"""Compliance of frame, load cell and grips: the crosshead records the blade's travel plus C F."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Rig


class MachineCompliance(Rig):
    """Recorded displacement grows with the force."""

    name = "machine_compliance"
    title = "machine compliance"
    family = "machine"
    parameters = (Parameter.effect("compliance", "mm/N", "C_m", "machine's compliance", typical=0.05),)
    reads = ("G", "length")

    def groups(self, p):
        return {"C_m G L": p.compliance * p.G * p.length}

    def record(self, displacement, force, time, p):
        return displacement + p.compliance * force, force
