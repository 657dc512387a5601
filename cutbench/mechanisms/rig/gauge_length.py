"""Grips that feed or hold specimen: the recorded displacement is 1 + s times that of the stated length."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Rig


class GaugeLength(Rig):
    """A specimen that is longer or shorter between the grips than was stated."""

    name = "gauge_length"
    title = "length between grips"
    family = "machine"
    rank = -1  # what the machine gives is no part of the specimen
    kinds = ("uniaxial", "equibiaxial", "pure_shear")
    parameters = (
        Parameter.effect(
            "longer", "1", "s", "part by which it is longer than stated", low=-0.25, high=0.25, typical=0.05
        ),
    )

    def groups(self, p):
        return {"s": p.longer}

    def record(self, displacement, force, time, p):
        return displacement * (1 + p.longer), force
