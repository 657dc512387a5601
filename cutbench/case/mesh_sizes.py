"""How large the elements of a built-in mesh are to be, by where they are; the same in 2D and 3D."""

from __future__ import annotations

import numpy as np

from cutbench.case.numerics import Numerics

#: Growth of the element size with the distance from the cut plane.
GRADING = 0.7
#: The cut surges this many blade thicknesses down, in each of the paper's materials.
SURGE = 3.0
#: So far from the cut plane, in blade thicknesses, the top is finer still, by this: it goes over the tip and
#: then folds in beside the blade.
RIM = 4 / 7
ON_RIM = 0.8
#: Where no size is chosen, it is this part of h under the tip, but not below this part of the blade's
#: thickness: 8 µm for 0.7 mm. And the same where the cut surges.
UNDER_TIP = (1 / 16, 1 / 89.6)
AT_SURGE = (1 / 4, 1 / 22.4)


def chosen(part: float, h: float, thickness: float, rule: tuple[float, float]) -> float:
    """``part``, or where it is 0 what ``rule`` says, in units of ``h``; both in mm."""
    return part or min(1.0, max(rule[0], rule[1] * thickness / h))


def near_blade(numerics: Numerics, thickness: float) -> dict[str, float]:
    """Arguments of ``wanted`` for a blade so thick, in mm, by the choices of ``numerics``."""
    h = numerics.h_mm
    return {
        "corner": chosen(numerics.corner, h, thickness, UNDER_TIP) * h,
        "shallow": chosen(numerics.shallow, h, thickness, AT_SURGE),
        "surge": SURGE * thickness,
        "rim": RIM * thickness,
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
    grading: float = GRADING,
    outside: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Size of the elements that are ``nearest`` to the cut plane and ``deep`` below the top, all lengths.

    On the cut plane ``h`` times ``shallow`` down to ``surge``, from there in proportion to the depth, ``h``
    at the most; and ``corner`` under the blade, down to ``reach``. Away from each it grows by ``grading``
    times the distance; so it does where they are that far ``outside`` of what is to be fine, above or below.
    And in any case 0.8 times ``h`` times ``shallow`` on the top, out to ``rim`` and a quarter of that down.
    """
    beside = np.hypot(np.maximum(nearest - rim, 0), np.maximum(deep - rim / 4, 0))
    nearest = np.hypot(nearest, outside)
    own = h * np.clip(shallow * deep / surge, shallow, 1.0)
    size = own + grading * np.maximum(nearest - own, 0)
    if rim > 0:
        size = np.minimum(size, ON_RIM * h * shallow + grading * beside)
    if corner is None:
        return size
    away = np.hypot(nearest, np.maximum(deep - reach, 0))
    return np.minimum(size, corner + grading * np.maximum(away - 2 * corner, 0))
