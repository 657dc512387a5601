"""How large the elements of a built-in mesh are to be, by where they are; the same in 2D and 3D."""

from __future__ import annotations

from typing import Any

import numpy as np

from cutbench.case.numerics import Numerics
from cutbench.case.tuning import MeshTuning

STANDARD = MeshTuning()


def chosen(part: float, h: float, thickness: float, rule: tuple[float, float]) -> float:
    """``part``, or where it is 0 what ``rule`` says, in units of ``h``: so much, but not less than so much of
    the blade's ``thickness``; lengths in mm."""
    return part or min(1.0, max(rule[0], rule[1] * thickness / h))


def under_tip(numerics: Numerics, thickness: float, radius: float) -> float:
    """Size of the elements under the tip, mm, of a blade so thick with an edge of that ``radius``."""
    h, tuning = numerics.sizes(thickness).h_mm, numerics.tuning.mesh
    size = chosen(numerics.corner, h, thickness, tuning.corner) * h
    return size if numerics.corner else min(size, max(radius / tuning.edge[0], tuning.edge[1] * h))


def near_blade(numerics: Numerics, thickness: float, radius: float) -> dict[str, Any]:
    """Arguments of ``wanted``, by the choices of ``numerics``, for a blade so thick with an edge of that
    ``radius``, both in mm."""
    h, tuning = numerics.sizes(thickness).h_mm, numerics.tuning.mesh
    return {
        "corner": under_tip(numerics, thickness, radius),
        "shallow": chosen(numerics.shallow, h, thickness, tuning.shallow),
        "surge": tuning.surge * thickness,
        "rim": tuning.rim * thickness,
        "tuning": tuning,
    }


def wanted(
    nearest: np.ndarray,
    deep: np.ndarray,
    h: float,
    *,
    corner: float | None = None,
    reach: float = 0.0,
    shallow: float = 1.0,
    surge: float = 1.0,
    rim: float = 0.0,
    tuning: MeshTuning = STANDARD,
    outside: np.ndarray | float = 0.0,
    largest: float = np.inf,
) -> np.ndarray:
    """Size of the elements that are ``nearest`` to the cut plane and ``deep`` below the top, all lengths.

    On the cut plane ``h`` times ``shallow`` down to ``surge``, from there in proportion to the depth, ``h``
    or what is ``largest`` there at the most; and ``corner`` under the blade, down to ``reach``. Away from
    each it grows by ``tuning.grading`` times the distance; so it does where they are that far ``outside`` of
    what is to be fine, above or below.
    And in any case ``tuning.on_rim`` times ``h`` times ``shallow`` on the top, out to ``rim`` and a quarter
    of that down.
    """
    grading = tuning.grading
    beside = np.hypot(np.maximum(nearest - rim, 0), np.maximum(deep - rim / 4, 0))
    nearest = np.hypot(nearest, outside)
    own = np.minimum(h * np.clip(shallow * deep / surge, shallow, 1.0), largest)
    size = own + grading * np.maximum(nearest - own, 0)
    if rim > 0:
        size = np.minimum(size, tuning.on_rim * h * shallow + grading * beside)
    if corner is None:
        return size
    away = np.hypot(nearest, np.maximum(deep - reach, 0))
    return np.minimum(size, corner + grading * np.maximum(away - 2 * corner, 0))
