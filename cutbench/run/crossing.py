"""Whether material beside the blade passes through itself: nothing keeps the top face off the cut faces."""

from __future__ import annotations

import numpy as np

from cutbench.forms.space import Faces
from cutbench.run.build import Built

#: So far from the plane of the cut the top is looked at, in blade thicknesses.
WIDE = 5.0


def crosses(built: Built, u: np.ndarray) -> bool:
    """Whether the line of the top and the cut face of a section, moved by ``u`` (ndof,), crosses itself.

    On the side x ≥ 0. False in three dimensions, which are not looked at.
    """
    space = built.space
    if space.dim == 3:
        return False
    faces = built.form("blade").faces if built.case.model.laws("blade") else None
    if faces is None or not {"top", "cut"} <= faces.parts.keys():
        return False
    top, cut = _nodes(faces, "top"), _nodes(faces, "cut")
    top = top[(space.X[0, top] >= 0) & (space.X[0, top] < WIDE * built.case.p.thickness)]
    # From the top's far end to the corner, and down the cut.
    top, cut = top[np.argsort(-space.X[0, top])], cut[np.argsort(-space.X[1, cut])]
    line = np.concatenate([top[top != cut[0]], cut])
    return crosses_itself((space.X + u[: space.X.size].reshape(-1, 2).T)[:, line])


def _nodes(faces: Faces, name: str) -> np.ndarray:
    return np.unique(faces.nodes[:, faces.parts[name]])


def crosses_itself(x: np.ndarray) -> bool:
    """Whether two segments of a line through the points x (2, n) meet that are not neighbours."""
    a, b = x[:, :-1], x[:, 1:]

    def side(p):
        # On which side of each segment (rows) each of the points p (2, n) lies (columns).
        d = b - a
        return d[0][:, None] * (p[1] - a[1][:, None]) - d[1][:, None] * (p[0] - a[0][:, None])

    parts = side(a) * side(b) < 0  # segment j has its ends on two sides of segment i
    apart = np.triu(np.ones(parts.shape, bool), 2)
    return bool((parts & parts.T & apart).any())
