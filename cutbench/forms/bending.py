"""Bending stiffness of a surface and nothing else: ½ B ∫ (dθ/dS)² dA.

θ is its angle and S the length before loading; in space dθ/dS is the sum for both directions. A surface that
stays flat stores nothing, however it is stretched along itself. Koiter's (n·Δ₀φ)² is the same where nothing
is stretched, but is (λ dθ/dS)²: squeezed to λ = 0.3, as surfaces are beside a tip, it would resist folds with
a tenth of B, just where it is needed.

At each node Σ w e, over the edges to its neighbours: e is an edge's direction, w its length before loading
times its weight in the Laplacian of linear pieces with lumped mass, whose limit this is where little is
turned (Ciarlet, Raviart, in: Mathematical Aspects of Finite Elements, 1974). On a line that is e₂ − e₁, as
long as 2 sin(θ/2); in space the part along the mean normal counts. Edges of a surface are free. Where the top
meets the cut plane it goes on beyond it as far as that is whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from cutbench.forms.base import component_major
from cutbench.forms.space import Faces, determinants
from cutbench.forms.surface import Rim, Share, SurfaceForm, edge_of
from cutbench.mechanisms.base import Skin


class BendingForm(SurfaceForm):
    """On one surface: the top, or a side of the cut plane."""

    def __init__(
        self,
        name: str,
        law: Skin,
        faces: Faces,
        X: np.ndarray,
        mirrors: Sequence[tuple[np.ndarray, int]] = (),
        rim: Rim | None = None,
    ):
        """``X`` (dim, nnode) positions of all nodes; ``mirrors``: nodes on planes of symmetry, each with the
        component that is zero there; ``rim``: where the surface goes on across the cut plane."""
        # A surface that lies in a mirror is not continued by it.
        ends = [at for at, _ in mirrors if not np.isin(faces.nodes, at).all()]
        mirrors = list(mirrors)
        if rim is not None:
            ends += [rim.plus] if rim.minus is None else [rim.plus, rim.minus]
            mirrors += [(rim.plus, 0)] if rim.minus is None else []
        rings = Rings.of(subdivided(faces.nodes, X), X, np.concatenate([np.zeros(0, int), *ends]))
        if rim is not None and rim.minus is not None:
            rings = rings.joined(rim.plus, rim.minus)
        dim, centres = X.shape[0], rings.nodes[0, 0]
        keep, share = np.ones((dim, centres.size)), Share.all_of(centres.size)
        for at, component in mirrors:
            keep[component, np.isin(centres, at)] = 0.0
        if rim is not None:
            _, column, joint = np.intersect1d(centres, rim.plus, return_indices=True)
            share = share.until_cut(column, rim.points[joint])
        super().__init__(name, law, component_major(rings.nodes.reshape(-1, centres.size), dim), share)
        # Lines in space are strips of which nothing varies across: the faces say how wide they are.
        width = faces.w.sum() / rings.total
        # Differences first: edges are thousands of times shorter than the block.
        away = X[:, rings.nodes] - X[:, rings.nodes[:, :1]]
        self._arrays: tuple[np.ndarray, ...] = (away, rings.weights, rings.slopes, rings.area / width, keep)

    def coefficient(self, p):
        return self.law.bending(p)

    def part(self, columns):
        some = super().part(columns)
        some._arrays = tuple(np.ascontiguousarray(a[..., columns]) for a in self._arrays)
        return some

    def _turned(self, U):
        """By how much the surface turns at each node, times the node's area: a vector (dim, n); the edges'
        directions and lengths; and in space the surface's tangents, its normal, and what that was divided by.
        """
        away, weights, slopes, _, keep = self._arrays
        u = U.reshape(away.shape)
        x = away + (u - u[:, :, :1])
        edges = np.where(weights == 0, 1.0, x)
        lengths = np.sqrt((edges * edges).sum(axis=0))
        edges = edges / lengths
        turned = keep * (weights * edges).sum(axis=(1, 2))
        if not len(slopes):
            return turned, edges, lengths, None
        t = [(slope * x).sum(axis=(1, 2)) for slope in slopes]
        normal = keep * np.cross(t[0], t[1], axis=0)
        size = np.sqrt((normal * normal).sum(axis=0))
        return turned, edges, lengths, (t, normal / size, size)

    def energies(self, U):
        turned, *_, frame = self._turned(U)
        square = (turned * turned).sum(axis=0) if frame is None else (turned * frame[1]).sum(axis=0) ** 2
        return square / (2 * self._arrays[3])

    def forces(self, U, there):
        _, weights, slopes, area, keep = self._arrays
        turned, edges, lengths, frame = self._turned(U)
        scale = there / area
        if frame is not None:
            t, n, size = frame
            along = (turned * n).sum(axis=0)
            scale, turned, rest = scale * along, n, keep * (turned - along * n) / size
        # The derivative of a direction is across it; what is kept of the sum is kept of its derivative.
        across = turned[:, None, None] - edges * (turned[:, None, None] * edges).sum(axis=0)
        pull = scale * weights / lengths * across
        pull[:, :, 0] -= pull.sum(axis=2)
        if frame is not None:
            for slope, turn in zip(
                slopes, (np.cross(t[1], rest, axis=0), np.cross(rest, t[0], axis=0)), strict=True
            ):
                pull = pull + scale * slope * turn[:, None, None]
        return pull.reshape(U.shape)


@dataclass(frozen=True)
class Rings:
    """Nodes of a surface with their neighbours: one block (1, nn, n), each column a node and its neighbours,
    some more than once, or two blocks, where a node at the rim of one surface meets one at the rim of
    another.

    ``weights`` of the edges from the first of a block, times their lengths; ``slopes`` (2 or 0, …): the
    derivatives along two directions of the surface; ``area`` (n,) of each node, ``total`` of the surface.
    """

    nodes: np.ndarray
    weights: np.ndarray
    slopes: np.ndarray
    area: np.ndarray
    total: float

    @classmethod
    def of(cls, pieces: np.ndarray, X: np.ndarray, ends: np.ndarray) -> Rings:
        """Of the nodes inside the surface, and of those at its edge which are in ``ends``, as half of a
        ring."""
        corners = pieces.shape[0]
        edges = np.moveaxis(X[:, pieces[1:]] - X[:, pieces[:1]], 2, 0)  # (n, dim, m)
        # Gradients of the barycentric coordinates in the plane of each piece.
        squares = np.einsum("ndi,ndj->nij", edges, edges)
        inverse = np.linalg.inv(squares) @ np.swapaxes(edges, 1, 2)  # (n, m, dim)
        gradient = np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)  # (n, m+1, dim)
        volume = np.sqrt(determinants(squares)) / math.factorial(corners - 1)
        tables = [-np.einsum("nid,njd,n->ijn", gradient, gradient, volume)]
        if corners == 3:
            one = edges[0, :, 0] / np.linalg.norm(edges[0, :, 0])
            other = np.cross(np.cross(one, edges[0, :, 1]), one)
            for axis in (one, other / np.linalg.norm(other)):
                tables.append(
                    np.broadcast_to(np.einsum("njd,d,n->jn", gradient, axis, volume), tables[0].shape)
                )
        size, shape = X.shape[1], tables[0].shape
        at = (np.broadcast_to(i, shape).ravel() for i in (pieces[:, None], pieces[None]))
        rows, columns = at
        maps = [sp.csr_matrix((table.ravel(), (rows, columns)), shape=(size, size)) for table in tables]
        part_of = _voronoi(
            tables[0], np.linalg.norm(X[:, pieces[:, None]] - X[:, pieces[None]], axis=0), volume
        )
        area = np.bincount(pieces.ravel(), part_of.ravel(), minlength=size)
        edge = edge_of(pieces)[0]
        kept = np.setdiff1d(pieces, edge[:, ~np.isin(edge, ends).all(axis=0)])
        width = int(np.diff(maps[0].indptr)[kept].max(initial=1))
        nodes, values = np.tile(kept, (width, 1)), np.zeros((len(maps), width, kept.size))
        for column, node in enumerate(kept):
            part = slice(maps[0].indptr[node], maps[0].indptr[node + 1])
            ring = maps[0].indices[part]
            order = np.argsort(ring != node, kind="stable")
            nodes[: ring.size, column] = ring[order]
            values[:, : ring.size, column] = [each.data[part][order] for each in maps]
        weights = values[0] * np.linalg.norm(X[:, nodes] - X[:, nodes[:1]], axis=0)
        return cls(nodes[None], weights[None], values[1:, None], area[kept], float(volume.sum()))

    def joined(self, plus: np.ndarray, minus: np.ndarray) -> Rings:
        """With the nodes ``plus`` and those at the same places, ``minus``, as one."""
        centres = self.nodes[0, 0]
        of = {node: column for column, node in enumerate(centres)}
        pairs = np.array([(of[a], of[b]) for a, b in zip(plus, minus, strict=True) if a in of], int).reshape(
            -1, 2
        )
        single = np.setdiff1d(np.arange(centres.size), pairs)
        first, second = np.append(single, pairs[:, 0]), np.append(single, pairs[:, 1])
        once = np.arange(first.size) < single.size

        def both(values):
            return np.concatenate([values[..., first], np.where(once, 0.0, values[..., second])], axis=-3)

        nodes = np.concatenate([self.nodes[..., first], self.nodes[..., second]])
        area = self.area[first] + np.where(once, 0.0, self.area[second])
        return Rings(nodes, both(self.weights), both(self.slopes), area, self.total)


def subdivided(nodes: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Flat simplices (m+1, n) between the nodes of linear or quadratic faces (nn, nf)."""
    corners = X.shape[0]
    c, middle = nodes[:corners], nodes[corners:]
    if not len(middle):
        return c

    def between(i, j):
        """Numbers (nf,) of the nodes half way between two corners."""
        away = np.linalg.norm(X[:, middle] - (X[:, c[i]] + X[:, c[j]])[:, None] / 2, axis=0)
        return np.take_along_axis(middle, away.argmin(axis=0)[None], axis=0)[0]

    if corners == 2:
        m = between(0, 1)
        return np.hstack([np.stack([c[0], m]), np.stack([m, c[1]])])
    a, b, d = between(1, 2), between(2, 0), between(0, 1)
    return np.hstack([np.stack(t) for t in ((c[0], d, b), (c[1], a, d), (c[2], b, a), (a, b, d))])


def _voronoi(weights: np.ndarray, lengths: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Parts (m+1, n) of the pieces that are nearest to each of their corners, from the ``weights`` and
    ``lengths`` (m+1, m+1, n) of their edges; half of an obtuse triangle is that corner's (Meyer, Desbrun,
    Schröder, Barr, in: Visualization and Mathematics III, 2003). With them a bowl has its curvature on every
    mesh."""
    m = len(weights) - 1
    parts = (weights * lengths**2).sum(axis=1) / (2 * m)
    if m == 1:
        return parts
    own = np.einsum("iin->in", weights)
    obtuse = own < own.sum(axis=0) / 2  # half the cotangent of the corner's angle is below 0
    return np.where(obtuse.any(axis=0), np.where(obtuse, 0.5, 0.25) * volume, parts)
