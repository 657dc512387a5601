"""What the front has to spare where it is fastest: energy that only viscosity and damping take.

Cutting that is steady spends what the blade does on the cut, on friction and on what it stores. Where the
elastic body gives back more than that, the front goes ahead until viscosity takes the difference. At rest it
jumps, and the difference is what the limit point frees: the area between the path of equilibria, which turns
back there, and the blade's travel at which it does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cutbench.case.case import Case
from cutbench.run.measures import FRONT, at_the_front
from cutbench.run.result import SNAP


def freed_rel(case: Case, curve: Mapping[str, np.ndarray], onset_mm: float) -> float:
    """What viscosity and damping take per area cut where the front is fastest, in units of the toughness.

    ``curve`` is that of a blade which only moves forward, with its ledger. nan where nothing is cut, or
    cutting takes no work.
    """
    window = case.values.get("thickness", math.nan)
    toughness = sum(law.estimate(case.p, 0.0, 0.0).work for law in case.model.laws("cut"))
    d, c = curve["displacement_mm"], curve["cut_length_mm"]
    start, speed = at_the_front(d, c, window, onset_mm)
    area = speed * FRONT * window * case.values["length"]
    if not area * toughness > 0:
        return math.nan
    names = (SNAP, *(law.name for law in case.model.all if law.regularises))
    lost = sum(curve[key] for name in names if (key := f"work_{name}_mJ") in curve)
    spent = np.interp([start, start + FRONT * window], d, np.broadcast_to(lost, d.shape))
    return float((spent[1] - spent[0]) / (area * toughness))
