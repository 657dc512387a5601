"""How large the elements of a built-in mesh are to be, by where they are; the same in 2D and 3D."""

from __future__ import annotations

import numpy as np

#: Growth of the element size with the distance from the cut plane.
GRADING = 0.7
#: The cut surges this many blade thicknesses down, in each of the paper's materials.
SURGE = 3.0


def wanted(
    nearest: np.ndarray,
    deep: np.ndarray,
    h: float,
    *,
    corner: float | None = None,
    reach: float = 0.0,
    shallow: float = 1.0,
    surge: float = 1.0,
    grading: float = GRADING,
) -> np.ndarray:
    """Size of the elements that are ``nearest`` to the cut plane and ``deep`` below the top, all lengths.

    On the cut plane ``h`` times ``shallow`` down to ``surge``, from there in proportion to the depth, ``h``
    at the most; and ``corner`` under the blade, down to ``reach``. Away from each it grows by ``grading``
    times the distance.
    """
    own = h * np.clip(shallow * deep / surge, shallow, 1.0)
    size = own + grading * np.maximum(nearest - own, 0)
    if corner is None:
        return size
    away = np.hypot(nearest, np.maximum(deep - reach, 0))
    return np.minimum(size, corner + grading * np.maximum(away - 2 * corner, 0))
