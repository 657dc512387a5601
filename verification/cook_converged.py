"""Cook's membrane taken to its limit, which a mesh of n = 32 is not yet at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from verification._common import nu_of
from verification.base import Check, Reference
from verification.cook import KAPPA, G, membrane


def compute() -> Iterator[Check]:
    nu = nu_of(KAPPA / G)
    uniform = [membrane(n, "P2P1", nu).tip_mm for n in (16, 32, 64)]
    # The clamped corners are singular: the error falls by a constant factor, not by the element's order.
    first, second = np.diff(uniform)
    limit = uniform[-1] + second / (first / second - 1)
    graded = membrane(48, "P2P1", nu, graded=True).tip_mm
    other = "the same membrane, mesh graded towards the ends of the clamped edge, n = 48"
    yield Check("tip u_y, κ = 400,942 MPa, n = 16, 32, 64 extrapolated", "mm", graded, limit, 5e-4, other)
    least = "literature, 6.89 to 6.90 mm: its upper end"
    yield Check("the limit against the literature", "mm", 6.90, limit, 5e-3, least)


REFERENCE = Reference(
    "cook_converged",
    "Cook's membrane, κ = 400,942 MPa, refined: the limit lies above the literature's values.",
    "two families of meshes with one limit",
    compute,
    laws=("neo_hookean",),
    quick=False,
    seconds=15.0,
)
