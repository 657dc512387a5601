"""A layer under the top face whose effect fades with depth like e^(−depth/thickness)."""

from __future__ import annotations

import numpy as np

from cutbench.base.units import Parameter

THICKNESS = Parameter(
    "skin_thickness", "mm", "ℓ_s", "depth over which it fades", low=0.01, high=20.0, default=0.5
)


def fading(p, at) -> np.ndarray:
    """1 at the top face, towards 0 in the block (N,)."""
    return np.exp(-at.depth / p.skin_thickness)
