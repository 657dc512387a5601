"""A wedge so blunt that strains are small, pressed into a half-space: its flanks, and its edge alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cutbench.mechanisms.blade._rigid import SKIN
from verification._common import parameters
from verification._punch import pressed
from verification.base import Check, Reference

#: Rise of the flanks, half the thickness and the radii of edge and shoulder in mm; half-width of the contact.
RISE, HALF, EDGE, SHOULDER, CONTACT = 0.02, 1.0, 0.05, 0.3, 0.3
TRAVEL = 0.03
#: The edge alone: its radius is so large that the flanks, which rise more, are never met.
ROUND_RISE, ROUND, ROUND_CONTACT, ROUND_TRAVEL = 0.1, 1.0, 0.02, 1.5e-3


def compute() -> Iterator[Check]:
    got = pressed("wedge", wedge(RISE, EDGE), CONTACT, TRAVEL, RISE)
    E, tan = got.modulus, math.tan(RISE)
    # The second moment of arcosh(c/x) is c²/6 of its integral.
    c = got.half_width * math.sqrt(6 / 4)

    # At the apex, which is no point but an edge, the formula has no limit.
    away = got.x.min(axis=0) > 4 * EDGE * tan + c / 20

    def pressure(x):
        return E * tan / np.pi * np.arccosh(np.maximum(c / np.maximum(np.abs(x), 1e-9), 1))

    yield Check("force per half-width of the contact, E* tan β", "N/mm^2", E * tan, got.force / c, 0.005)
    flank = replace(got, **{k: getattr(got, k)[:, away] for k in ("x", "pressure", "weight")})
    what = "pressure of the flanks against arcosh(c/x), r.m.s. error"
    yield Check(what, "1", 0.0, flank.misfit(pressure), 0.01)
    edge = pressed("wedge", wedge(ROUND_RISE, ROUND), ROUND_CONTACT, ROUND_TRAVEL, ROUND_CONTACT / ROUND)
    # The rounding of contact makes the edge rounder by the skin.
    radius = ROUND + SKIN * HALF
    half = math.sqrt(4 * edge.force * radius / (np.pi * edge.modulus))
    yield Check("the edge alone: half-width, √(4 F r/(π E*))", "mm", half, edge.half_width, 2e-3)


def wedge(rise: float, edge: float):
    """Parameters of gelatin and a wedge whose flanks rise by the angle ``rise``."""
    angle = math.pi - 2 * rise
    return parameters("gelatin", thickness=2 * HALF, angle=angle, edge_radius=edge, shoulder=SHOULDER)


REFERENCE = Reference(
    "blunt_wedge",
    "A wedge of 178 degrees on a large block of gelatin, and one whose edge alone touches.",
    "Johnson, Contact Mechanics, 1985, sections 5.2 (wedge) and 4.2 (cylinder)",
    compute,
    laws=("neo_hookean",),
    seconds=5.0,
)
