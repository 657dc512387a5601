"""Drift of the load cell: the recorded force is the true one plus D t, t from the first contact."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Rig


class ForceDrift(Rig):
    """A zero of the force that moves at a constant rate."""

    name = "force_drift"
    title = "load-cell drift"
    family = "reading"
    cause = "reading"
    rank = 2  # the machine gives under the true force
    parameters = (Parameter.effect("drift", "N/s", "D", "rate of the force's zero", low=None, typical=5e-4),)
    reads = ("G", "length", "height", "speed")

    def groups(self, p):
        return {"D H/(v G L^2)": p.drift * p.height / (p.speed * p.G * p.length**2)}

    def record(self, displacement, force, time, p):
        return displacement, force + p.drift * time
