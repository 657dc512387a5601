"""The blade's gap to points of some faces: which can touch it, how far they are, in what direction."""

from __future__ import annotations

import numpy as np

from cutbench.forms.space import Faces
from cutbench.mechanisms.base import STEP

#: Added to the gap beyond the blade's ends, mm.
FAR = 1e6
#: Points farther beside the blade than this cannot touch it within a step, mm.
REACH = 0.25


class ToolGap:
    """Gap of ``kind`` (distance or ellipse) to the blade ``tool``."""

    def __init__(self, kind: str, tool, faces: Faces, height: float):
        self._tool, self._law = tool, tool.number if kind == "ellipse" else tool.distance
        self._faces, self._dim = faces, faces.X.shape[0]
        #: Whether the gradient has length 1.
        self.unit_gradient = kind == "distance"
        # A face belongs to one flank for good: material pressed across the mid-plane is pushed back to
        # its own side, not out on the other.
        middle = faces.X[0].mean(axis=0)
        on_plane = np.abs(middle) < 1e-9 * height
        self._flank = np.sign(np.where(on_plane, -faces.normal[0], middle))
        self._upper, self._lower = faces.X[1].max(axis=0), faces.X[1].min(axis=0)

    def near(self, U: np.ndarray, touched: np.ndarray, p, step) -> np.ndarray:
        """Numbers of the faces that, moved by U (dim, nn, nf), can touch the blade or carry shear."""
        turn = np.real(p.tilt) if self._dim == 3 else 0.0
        X, across = _across(self._faces.X, turn), _across(U, turn)
        left, right = X.min(axis=0) + across.min(axis=0), X.max(axis=0) + across.max(axis=0)
        high, low = self._upper + U[1].max(axis=0), self._lower + U[1].min(axis=0)
        tip = np.real(step.centre[1])
        least, most, top = self._tool.extent(p)
        near = (left < most + REACH) & (right > least - REACH) & (high > tip - REACH)
        near &= low < tip + top + REACH
        return np.flatnonzero(near | (touched.max(axis=0) > 0))

    def at(self, x: np.ndarray, near: np.ndarray, p, step):
        """Gap (nq, nf), gradient (dim, nq, nf) and second derivative (dim, dim, nq, nf) where points of the
        faces ``near`` now are, x (dim, nq, nf)."""
        dim, shape = self._dim, x.shape[1:]
        flank = np.broadcast_to(self._flank[near], shape).ravel()
        turn = p.tilt if dim == 3 else 0.0
        rx = (_across(x, turn) - step.centre[0]).ravel()
        ry = (x[1] - step.centre[1]).ravel()
        beyond = np.real(rx) * flank < 0  # there the gap goes on linearly
        over, foot = np.where(beyond, rx, 0), np.where(beyond, 0, rx)
        foot.real = np.copysign(foot.real, flank)  # -0.0 is on the left flank
        g, n, H = self._law(foot, ry, p)
        g = g + over * n[0]
        n[1] = n[1] + over * H[0, 1]
        H[0, 0] = np.where(beyond, 0, H[0, 0])
        bent = np.flatnonzero(over * H[0, 1])
        if bent.size and not np.iscomplexobj(rx):  # third derivative of the gap, by a complex step
            ahead = self._law(foot[bent], ry[bent] + 1j * STEP, p)[2]
            H[1, 1, bent] += over[bent] * ahead[0, 1].imag / STEP
        if not self.unit_gradient:
            # In mm: on the band the paper's number is 2/a times the distance, to first order.
            g, n, H = (p.thickness / 4 * part for part in (g, n, H))
        gradient = np.zeros((dim, *shape), dtype=n.dtype)
        second = np.zeros((dim, dim, *shape), dtype=n.dtype)
        gradient[:2] = n.reshape(2, *shape)
        second[:2, :2] = H.reshape(2, 2, *shape)
        g = g.reshape(shape)
        if dim == 3:
            if turn != 0:
                c, s = np.cos(turn), np.sin(turn)
                back = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
                gradient = np.einsum("ji,jqf->iqf", back, gradient)
                second = np.einsum("ji,jkqf,kl->ilqf", back, second, back)
            if np.real(p.overhang) < 0:
                # The blade ends inside the block: points beyond it, as they lay before loading, stay free.
                X = self._faces.X[:, :, near]
                along = X[2] * np.cos(np.real(turn)) + X[0] * np.sin(np.real(turn))
                g = np.where(np.abs(along) > np.real(p.length) / 2 + np.real(p.overhang), g + FAR, g)
        return g, gradient, second


def _across(x: np.ndarray, turn) -> np.ndarray:
    """Coordinate across a blade that is turned about the height, for positions or motions x (dim, …)."""
    return x[0] if len(x) == 2 or turn == 0 else x[0] * np.cos(turn) - x[2] * np.sin(turn)
