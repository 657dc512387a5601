"""The three homogeneous ways to stretch a sheet: what is held, what is free, what is measured.

F = diag(λ, second, third) with one free stretch a = exp(b); its face carries no stress. In all three
the nominal stress is P₁₁, the force over the undeformed area. At constant volume and for neo-Hooke
P₁₁ = G(λ − λ⁻²), G(λ − λ⁻⁵) and G(λ − λ⁻³) (Treloar 1944, 10.1039/TF9444000059).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Mode:
    """``second``: power of λ in F₂₂, None where it is free like F₃₃; ``lateral``: power of λ in the free
    stretch at constant volume."""

    second: int | None
    lateral: float

    def deformation(self, stretch: np.ndarray, free: np.ndarray) -> np.ndarray:
        """F (3, 3, N) for λ and the free stretch (N,)."""
        none = np.zeros(free.size)
        second = free if self.second is None else stretch**self.second
        # Stacked, so that symbols may stand for numbers.
        parts = [stretch, none, none, none, second, none, none, none, free]
        return np.stack(parts).reshape(3, 3, free.size)


MODES = {"uniaxial": Mode(None, -0.5), "equibiaxial": Mode(1, -2.0), "pure_shear": Mode(0, -1.0)}
