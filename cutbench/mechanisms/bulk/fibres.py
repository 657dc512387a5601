"""Fibres: Ψ = k₁/(2 k₂) [exp(k₂ E²) − 1], E = κ (Ī₁ − 3) + (1 − 3κ) (Ī₄ − 1), where E is above 0.

Gasser, Ogden & Holzapfel, J. R. Soc. Interface 3 (2006) 15, 10.1098/rsif.2005.0073, with one family of
fibres. As there it is isochoric, Ī₄ = J^(−2/3) |F a|² the squared stretch along the fibres' mean direction

    a = (cos θ cos φ, sin θ cos φ, sin φ),

x across the cut plane, y against the blade's way and z along its edge; where there is no blade x is pulled
or pressed and z is the sheet's normal. A specimen that was cut out of the body at an angle α
(``specimen_angle``) has θ − α for θ. κ is their dispersion: 0 where all are parallel, 1/3 where they have
no direction. E is the mean strain of the fibres; below 0 they buckle and carry nothing. Beyond k₂ E² = 6
the stress grows with the slope that it has there: a trial state may lie beyond. That strong fibres are
isochoric costs volume: those that are pulled can give way by swelling what holds them (Helfenstein et al.,
Int. J. Solids Struct. 47 (2010) 2056, 10.1016/j.ijsolstr.2010.04.005).
"""

import numpy as np

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Bulk
from cutbench.mechanisms.bulk._isotropic import Kinematics
from cutbench.mechanisms.bulk.fung import STEEP


def direction(p):
    """a in the specimen."""
    turned = p.fibre_angle - p.specimen_angle
    in_plane = np.cos(p.fibre_incline)
    return np.cos(turned) * in_plane, np.sin(turned) * in_plane, np.sin(p.fibre_incline)


class Fibres(Bulk):
    """Stiffens along its fibres as they are stretched."""

    name = "fibres"
    title = "fibres"
    family = "anisotropy"
    adds_stiffness = False
    directed = "specimen_angle"
    reads = ("G",)
    parameters = (
        Parameter.effect("g_f", "1", "k₁/G", "stiffness k₁ of the fibres, over G", high=1000.0, typical=1.0),
        Parameter.positive("k_2", "1", "k₂", "how soon stretched fibres stiffen", high=1000.0, default=1.0),
        Parameter(
            "fibre_dispersion",
            "1",
            "κ",
            "dispersion of the fibres: 0 where they are parallel",
            low=0.0,
            high=1 / 3,
            default=0.0,
            typical=0.1,
            sought=False,
        ),
        Parameter(
            "fibre_angle",
            "deg",
            "θ",
            "angle of the fibres, in the section, to the direction across the cut plane",
            low=-180.0,
            high=180.0,
            default=0.0,
            typical=30.0,
        ),
        Parameter(
            "fibre_incline",
            "deg",
            "φ",
            "angle of the fibres out of the section, towards the blade's edge",
            low=-180.0,
            high=180.0,
            default=0.0,
            typical=20.0,
            sought=False,
        ),
        Parameter(
            "specimen_angle",
            "deg",
            "α",
            "angle, in the section, at which the specimen was cut out: from where fibre_angle counts to"
            " across the cut plane, or to the pull",
            low=-180.0,
            high=180.0,
            default=0.0,
            typical=45.0,
            sought=False,
        ),
    )

    def groups(self, p):
        return {"k_1/G (fibres)": p.g_f, "k_2 (fibres)": p.k_2}

    def mirrored(self, p):
        # A mirror leaves what lies in it or across it, and what has no direction.
        oblique = (
            p.g_f * (1 - 3 * p.fibre_dispersion) * np.minimum(abs(a), 1 - abs(a)) for a in direction(p)
        )
        return tuple(bool(np.all(each < 1e-12)) for each in oblique)

    def _strain(self, k, p):
        """E (N,), what of it is up to k₂ E² = 6, and F H and r, H = κ 1 + (1 − 3κ) a⊗a: dE/dF is
        2 J^(−2/3) (F H − r C)."""
        a, kappa = direction(p), p.fibre_dispersion
        along = sum(k.F[:, J] * a[J] for J in range(3))
        FH = kappa * k.F + (1 - 3 * kappa) * np.stack([along * each for each in a], axis=1)
        trace = (k.F * FH).sum(axis=(0, 1))
        # At rest, up to rounding, they resist.
        E = np.where(np.real(k.j * trace) > 1 - 1e-12, k.j * trace - 1, 0)
        return E, np.minimum(E, np.sqrt(STEEP / p.k_2)), FH, trace / (3 * k.J)

    def energy(self, F, p, state, at):
        E, inside, _, _ = self._strain(Kinematics(F), p)
        beyond = np.exp(STEEP) * (E - inside) * (inside + (1 + 2 * STEEP) * (E - inside) / 2)
        return p.g_f * p.G * (np.expm1(p.k_2 * inside * inside) / (2 * p.k_2) + beyond)

    def stress(self, F, p, state, at):
        k = Kinematics(F)
        E, inside, FH, r = self._strain(k, p)
        slope = inside * np.exp(p.k_2 * inside * inside) + np.exp(STEEP) * (1 + 2 * STEEP) * (E - inside)
        return 2 * p.g_f * p.G * slope * k.j * (FH - r * k.C), {}
