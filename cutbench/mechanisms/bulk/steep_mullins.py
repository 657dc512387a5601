"""Softening that begins at once: Mullins softening by the root of the way back from the largest energy,

    η = 1 − ς (r(z) − r(0))/(1 − r(0)),  r = √((z₀ + z)/(1 + z₀ + z)),  z = (W_max − W)/(m G).

Where ``mullins`` bends off smoothly from where the specimen turns, the stress here drops by the root of the
way back, as in Zúñiga & Beatty, Z. angew. Math. Phys. 53 (2002) 794, who have it of strains. The work of its
stress on any path is ς m G times the integral of what is lost over z.
"""

import numpy as np

from cutbench.mechanisms.bulk.mullins import Mullins

#: z₀, from where on it is a root. Below the slope of the stress is finite: with a hundredth of it a cut takes
#: ten times the steps.
BEGINS = 1e-2


def _integral(z):
    """Of √(z/(1 + z))."""
    return np.sqrt(z * (1 + z)) - np.arcsinh(np.sqrt(z))


class SteepMullins(Mullins):
    """As ``mullins``, with a steeper beginning."""

    name = "steep_mullins"
    title = "steep Mullins softening"
    begun = float(np.sqrt(BEGINS / (1 + BEGINS)))

    def lost(self, z):
        z = z + BEGINS
        return (np.sqrt(z / (1 + z)) - self.begun) / (1 - self.begun)

    def fades(self, z):
        z = z + BEGINS
        return 0.5 / (np.sqrt(z) * (1 + z) ** 1.5 * (1 - self.begun))

    def spent(self, z):
        spent = _integral(z + BEGINS) - _integral(BEGINS) - self.begun * z
        return spent / (1 - self.begun)
