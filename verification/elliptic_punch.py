"""A flat elliptic punch, pressed so deep that it is no parabola any more."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from verification._punch import approach, indented
from verification.base import Check, Reference

#: Half-thickness a and tip b of the blade in mm: slopes stay small. Half-width of the contact, about.
HALF, TIP, CONTACT = 1.0, 0.01, 0.8
TRAVEL = 0.03
#: Points of the Gauss–Chebyshev rule.
POINTS = 200


def steepness(x):
    """f'(x)/x of the punch f = b (1 − √(1 − x²/a²))."""
    return TIP / (HALF * np.sqrt(HALF**2 - x**2))


def force(c: float, modulus: float) -> float:
    """F = E*/2 ∫ x f'(x)/√(c² − x²) dx, with x = c sin θ."""
    inner = quad(lambda t: (c * np.sin(t)) ** 2 * steepness(c * np.sin(t)), -np.pi / 2, np.pi / 2)[0]
    return modulus / 2 * inner


def pressure(x, c: float, modulus: float) -> np.ndarray:
    """p = E*/(2π) √(c² − x²) ⨍ f'(s)/(√(c² − s²) (s − x)) ds; the principal value of 1/(s − x) alone is 0."""
    x = np.atleast_1d(np.clip(np.abs(x), 0, c))
    s = c * np.cos((2 * np.arange(POINTS) + 1) * np.pi / (2 * POINTS))
    near, far = steepness(x)[:, None], steepness(s)[None]
    gap = s[None] - x[:, None]
    close = np.abs(gap) < 1e-9 * c
    slope = x[:, None] * TIP / (HALF * (HALF**2 - x[:, None] ** 2) ** 1.5)
    quotient = np.where(close, slope, (far - near) / np.where(close, 1.0, gap))
    inner = np.pi / POINTS * (far + x[:, None] * quotient).sum(axis=1)
    return modulus / (2 * np.pi) * np.sqrt(c**2 - x**2) * inner


def compute() -> Iterator[Check]:
    got = indented(HALF, TIP, CONTACT, TRAVEL)
    E = got.modulus
    c = brentq(lambda c: force(c, E) - got.force, 0.01 * HALF, 0.999 * HALF, xtol=1e-12)

    def at(x: float) -> float:
        return float(pressure(x, c, E)[0])

    shape = pressure(got.x.ravel(), c, E).reshape(got.x.shape)
    peak = pressure(c * np.linspace(0, 1, 2001), c, E).max()
    moment = quad(lambda x: at(x) * x**2, -c, c)[0] / got.force
    yield Check("∫ p x² dx/F", "mm^2", moment, got.half_width**2 / 4, 0.005)
    yield Check("largest pressure", "kPa", 1e3 * peak, 1e3 * got.by_face(got.pressure).max(), 0.005)
    yield Check("pressure along the punch, r.m.s. error", "1", 0.0, got.misfit(lambda x: shape), 0.005)
    below = approach(at, c, got.depth, E, got.nu)
    yield Check("approach of the surface and a point below", "µm", 1e3 * below, 1e3 * got.approach, 0.005)


REFERENCE = Reference(
    "elliptic_punch",
    "A flat ellipse, b = a/100, in contact over 0.8 of its half-width on a large block of gelatin.",
    "integral equation of plane contact (Johnson, Contact Mechanics, 1985, section 2.7), Gauss–Chebyshev",
    compute,
    laws=("neo_hookean",),
    seconds=3.0,
)
