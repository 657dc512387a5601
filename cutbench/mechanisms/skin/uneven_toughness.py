"""Toughness that varies with depth, G_c (1 + A cos(2π depth/Λ + φ)): a cut that leaves serrations.

Fibres, layers or a coarse network make the force saw with the period Λ, at equal δ_c.
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Skin


class UnevenToughness(Skin):
    """A sinusoidal modulation of the work of separation along the cut."""

    name = "uneven_toughness"
    title = "uneven toughness"
    family = "uneven specimen"
    parameters = (
        Parameter.effect(
            "unevenness", "1", "A", "amplitude of the toughness over its mean", high=0.95, typical=0.4
        ),
        Parameter("wavelength", "mm", "Λ", "period along the cut", low=0.1, high=100.0, default=2.0),
        Parameter(
            "phase", "1", "φ", "phase at the top face, radians", low=-7.0, high=7.0, default=0.0, typical=0.5
        ),
    )
    reads = ("height",)

    def groups(self, p):
        return {"unevenness": p.unevenness, "wavelength/H": p.wavelength / p.height}

    def toughness(self, p, at):
        return 1 + p.unevenness * np.cos(2 * np.pi * at.depth / p.wavelength + p.phase)
