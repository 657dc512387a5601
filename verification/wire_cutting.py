"""A wire that cuts steadily: the cut closes behind it, so that only separation and sliding take energy.

A face slides along the wire by the arc s on which they touch; each length of cut has two faces, so
F/L = G_c + 2 τ_W s. With s = R, an arc of one radian, that is Γ + 2 τ_W R.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutbench.case.case import load_case
from cutbench.run.result import Snapshot
from verification._common import blade_work, finished, rate
from verification.base import Check, Reference

#: The elastomer, with a pre-cut that spares the wire the way in.
COARSE = {
    "with": "wire", "without": "surface_gradient", "thickness": "1 mm", "tau_W": "4 kPa", "mu": 0,
    "eta_reg": "0 s", "width": "12 mm", "height": "12 mm", "precut": "2 mm", "h": "0.25 mm",
    "corner": 0.5, "shallow": 1, "around": 0, "step": "0.1 mm", "energy_step": 0.3, "depth": "5.2 mm",
}  # fmt: skip
#: Travel over which it is steady, mm, and how often the arc is looked at.
FROM, TO, EVERY = 3.0, 5.0, 0.1


def compute() -> Iterator[Check]:
    case = load_case("elastomer", COARSE)
    result = finished(case, snapshots_mm=list(np.arange(FROM, TO, EVERY)))
    curve, p = result.curve, case.p

    def grows(values: np.ndarray) -> float:
        return rate(values, curve, FROM, TO)

    force, stored = (
        grows(blade_work(curve)),
        grows(curve["work_neo_hookean_mJ"] + curve["work_volumetric_mJ"]),
    )
    separated = grows(curve["work_stiff_cohesion_mJ"]) / grows(curve["cut_length_mm"])
    arc = float(np.mean([touching(picture) for picture in result.snapshots]))
    rubbed, cut = 2 * p.tau_W * arc * p.length, p.G_c * p.length
    yield Check("work of separation per length of the cut, G_c L", "N", cut, separated, 0.01)
    yield Check("work of adhesion per travel, 2 τ_W s L", "N", rubbed, grows(curve["work_adhesion_mJ"]), 0.08)
    what = "force less the growth of stored energy, (G_c + 2 τ_W s) L"
    yield Check(what, "N", cut + rubbed, force - stored, 0.02)
    yield Check("force, if the base were far", "N", cut + rubbed, force, 0.1)


def touching(picture: Snapshot) -> float:
    """Length of one face, mm, that touches the wire."""
    face = picture.faces["cut"]
    order = np.argsort(face["X"][:, 1])
    way = np.hypot(*np.diff(face["x"][order], axis=0).T)
    on = face["contact_pressure_MPa"][order] > 0
    return float(way @ ((on[1:] + 0.0) + on[:-1]) / 2)


REFERENCE = Reference(
    "wire_cutting",
    "A wire of 1 mm cuts the elastomer in plane strain, with adhesion.",
    "energy balance; Kamyab, Chakrabarti and Williams, J. Mater. Sci. 33 (1998) 2763: F/L = Γ + 2 τ_W R",
    compute,
    laws=("stiff_cohesion", "adhesion"),
    quick=False,
    seconds=15.0,
)
