"""Hertz's line contact: a rigid cylinder on a half-space."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutbench.mechanisms.blade._rigid import SKIN
from verification._punch import approach, indented
from verification.base import Check, Reference

#: The blade as a cylinder: b = a = 1 mm. Half-width of the contact over the radius: small strains.
RADIUS, CONTACT = 1.0, 0.02
TRAVEL = 1.5e-3


def compute() -> Iterator[Check]:
    R = RADIUS * (1 + SKIN)
    got = indented(RADIUS, RADIUS, CONTACT, TRAVEL)
    E = got.modulus
    c = np.sqrt(4 * got.force * R / (np.pi * E))
    peak = 2 * got.force / (np.pi * c)

    def pressure(x):
        return peak * np.sqrt(np.maximum(1 - (x / c) ** 2, 0))

    yield Check("half-width of the contact, c = √(4 F R/(π E*))", "mm", c, got.half_width, 2e-3)
    yield Check("largest pressure, 2 F/(π c)", "kPa", 1e3 * peak, 1e3 * got.by_face(got.pressure).max(), 2e-3)
    yield Check("pressure against √(1 − x²/c²), r.m.s. error", "1", 0.0, got.misfit(pressure), 0.005)
    expected = approach(pressure, c, got.depth, E, got.nu)
    yield Check("approach of the surface and a point below", "µm", 1e3 * expected, 1e3 * got.approach, 5e-3)


REFERENCE = Reference(
    "hertz",
    "A blade with b = a as a cylinder on a large block of gelatin: contact and approach for its force.",
    "Hertz; approach from Flamant's stresses (Johnson, Contact Mechanics, 1985, sections 2.5, 4.2)",
    compute,
    laws=("neo_hookean",),
    seconds=2.0,
)
