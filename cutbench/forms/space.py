"""Discrete space of a straight-sided simplex mesh: degrees of freedom, quadrature, faces.

Free of dimension. Arrays run over quadrature points q, then elements e (last, contiguous), so that
laws work on long vectors and element matrices come from a few large matrix products:
with the reference gradients constant, K_ij = D (A pushed to the reference element).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.spatial import cKDTree
from skfem.quadrature import get_quadrature

from cutbench.base.compiled import compiled

KINDS = {
    (2, 1): skfem.ElementTriP1,
    (2, 2): skfem.ElementTriP2,
    (3, 1): skfem.ElementTetP1,
    (3, 2): skfem.ElementTetP2,
}

#: What meshio calls them. scikit-fem numbers edges as 01, 12, 02 and 03, 13, 23: meshio's order for both.
CELLS = {(2, 1): "triangle", (2, 2): "triangle6", (3, 1): "tetra", (3, 2): "tetra10"}

#: Part of the way to the middle of its element by which a node is moved to find it.
INWARD = 1e-6
#: Elements among which a point is looked for, by their centres, before all of them; and how far outside, in
#: units of an element, it may be.
NEAREST, OUTSIDE = (3, 12), 1e-6

#: Arrays of ``Faces`` that have one column a face.
FACE_ARRAYS = ("nodes", "N", "dN", "w", "X", "normal", "tangents", "size", "cell")


def determinants(A: np.ndarray) -> np.ndarray:
    """Of matrices (n, d, d) with d up to 3. NumPy's go by logarithms, and round otherwise in another size."""
    if A.shape[1] < 3:
        return A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0] if A.shape[1] == 2 else A[:, 0, 0]
    return np.einsum("ni,ni->n", A[:, 0], np.cross(A[:, 1], A[:, 2]))


@dataclass(frozen=True)
class Volume:
    """Quadrature on elements. nq points, ne elements, nn nodes an element."""

    nodes: np.ndarray  # (nn, ne)
    phi: np.ndarray  # (nq, nn) shape functions
    dphi: np.ndarray  # (nq, dim, nn) reference gradients
    jinv: np.ndarray  # (dim, dim, ne): dξ_M/dX_J
    w: np.ndarray  # (nq, ne) weights in mm^dim
    X: np.ndarray  # (dim, nq, ne) reference positions

    def some(self, which: np.ndarray) -> Volume:
        """Of the elements ``which`` alone."""
        return _selected(self, ("nodes", "jinv", "w", "X"), which)


@dataclass(frozen=True)
class Faces:
    """Quadrature on named sets of faces. nn nodes a face, nf faces."""

    name: str
    nodes: np.ndarray  # (nn, nf)
    N: np.ndarray  # (nq, nn, nf) shape functions
    dN: np.ndarray  # (dim-1, nq, nn, nf) derivatives along the face's two (3D) tangents
    w: np.ndarray  # (nq, nf)
    X: np.ndarray  # (dim, nq, nf)
    normal: np.ndarray  # (dim, nf) outward, reference
    tangents: np.ndarray  # (dim-1, dim, nf) unit tangents, reference
    size: np.ndarray  # (nf,) diameter in mm
    cell: np.ndarray  # (nf,) diameter in mm of the element behind
    sets: tuple[tuple[str, slice], ...] = ()  # names and places of the sets that were joined

    @property
    def parts(self) -> dict[str, slice]:
        """Which faces belong to which named set of the mesh."""
        return dict(self.sets or ((self.name, slice(0, self.size.size)),))

    def from_others(self, others: Faces, values: np.ndarray) -> np.ndarray:
        """``values`` (…, nq·nf) at the points of ``others``, on another mesh of the same section, at ours: on
        a line between two neighbours. Of a section that is drawn out, in each of its planes.
        """
        out = np.empty((*values.shape[:-1], self.w.size))
        for name, part in self.parts.items():
            axis = int(np.argmax(np.ptp(self.X[:2, :, part], axis=(1, 2))))
            for old, new in zip(others.in_planes(name), self.in_planes(name), strict=True):
                s_old, s = others.X[axis].ravel()[old], self.X[axis].ravel()[new]
                order = np.argsort(s_old, kind="stable")
                for row in np.ndindex(*values.shape[:-1]):
                    out[row][new] = np.interp(s, s_old[order], values[row][old[order]])
        return out

    def in_planes(self, name: str) -> list[np.ndarray]:
        """The numbers of a part's points, those of each plane along z by themselves: a section is one."""
        numbers = np.arange(self.w.size).reshape(self.w.shape)[:, self.parts[name]].ravel()
        if self.X.shape[0] == 2:
            return [numbers]
        plane = np.unique(np.round(self.X[2].ravel()[numbers], 9), return_inverse=True)[1]
        return [numbers[plane == k] for k in range(plane.max() + 1)]

    def some(self, which: np.ndarray) -> Faces:
        """Of the faces ``which``, in rising order, alone."""
        ends = ((name, np.searchsorted(which, (at.start, at.stop))) for name, at in self.parts.items())
        sets = tuple((name, slice(int(a), int(b))) for name, (a, b) in ends)
        return replace(_selected(self, FACE_ARRAYS, which), sets=sets)

    @classmethod
    def joined(cls, sets: Sequence[Faces]) -> Faces:
        """Several sets as one, in their order: forms then work on all of them at once."""
        if len(sets) == 1:
            return sets[0]
        ends = np.cumsum([0, *(each.size.size for each in sets)])
        places = tuple((f.name, slice(int(a), int(b))) for f, a, b in zip(sets, ends, ends[1:], strict=False))
        arrays = {name: np.concatenate([getattr(f, name) for f in sets], axis=-1) for name in FACE_ARRAYS}
        return cls("+".join(f.name for f in sets), **arrays, sets=places)


@dataclass(frozen=True)
class Space:
    """Displacement space: node numbering of a Lagrange element of order 1 or 2."""

    mesh: skfem.Mesh
    order: int
    X: np.ndarray  # (dim, nnode) positions
    element_nodes: np.ndarray  # (nn, ne)
    _dofs: object = field(repr=False)

    @property
    def dim(self) -> int:
        return self.mesh.dim()

    @property
    def ndof(self) -> int:
        return self.X.shape[1] * self.dim

    @classmethod
    def build(cls, mesh: skfem.Mesh, order: int) -> Space:
        basis = skfem.Basis(mesh, KINDS[mesh.dim(), order](), intorder=1)
        return cls(mesh, order, basis.doflocs, basis.element_dofs, basis.dofs)

    @property
    def cells(self) -> tuple[str, np.ndarray]:
        """What pictures show of the elements: a kind, as meshio calls it, and numbers of nodes (k, n)."""
        return CELLS[self.dim, self.order], self.element_nodes

    @property
    def inside(self) -> np.ndarray:
        """The nodes (dim, nnode), a little into an element of their own side: on a split plane two are at one
        place.
        """
        mesh, nodes = self.mesh, self.element_nodes
        element = np.zeros(self.X.shape[1], int)
        element[nodes] = np.arange(nodes.shape[1])
        return self.X + INWARD * (mesh.p[:, mesh.t].mean(axis=1)[:, element] - self.X)

    def probes(self, points: np.ndarray) -> sp.csr_matrix:
        """Matrix (n, nnode) from nodal values to those at ``points`` (dim, n). Raises ValueError for a point
        that is in no element.
        """
        centres, origin, jinv = self._finder
        points, count = np.ascontiguousarray(points), origin.shape[1]
        (dim, n), left = points.shape, np.arange(points.shape[1])
        element, xi, depth = np.zeros(n, int), np.zeros((dim, n)), np.full(n, -np.inf)
        # Beside a large element there are many small ones, with nearer centres.
        for few in (*NEAREST, count):
            some = np.ascontiguousarray(points[:, left])
            near = centres.query(some.T, range(1, min(few, count) + 1))[1] if few < count else None
            near = np.tile(np.arange(count), (left.size, 1)) if near is None else near
            found = _deepest(some, np.ascontiguousarray(near.T), origin, jinv)
            element[left], xi[:, left], depth[left] = found
            left = left[found[2] < -OUTSIDE]
            if left.size == 0:
                break
        if depth.min(initial=0.0) < -OUTSIDE:
            raise ValueError("a point is in no element")
        shape, nodes = KINDS[self.dim, self.order](), self.element_nodes[:, element]
        values = np.stack([shape.lbasis(xi, i)[0] for i in range(nodes.shape[0])])
        rows = np.broadcast_to(np.arange(points.shape[1]), nodes.shape)
        size = (points.shape[1], self.X.shape[1])
        return sp.csr_matrix((values.ravel(), (rows.ravel(), nodes.ravel())), shape=size)

    @cached_property
    def _finder(self) -> tuple[cKDTree, np.ndarray, np.ndarray]:
        """Of the elements: their centres, first corners (dim, ne), and dξ/dX (dim, dim, ne)."""
        corners = self.mesh.p[:, self.mesh.t]
        jac = np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0)
        jinv = np.moveaxis(np.linalg.inv(jac), 0, 2)
        first, jinv = np.ascontiguousarray(corners[:, 0]), np.ascontiguousarray(jinv)
        return cKDTree(corners.mean(axis=1).T), first, jinv

    def volume(self, degree: int, order: int | None = None) -> Volume:
        """Quadrature exact to ``degree``; ``order`` evaluates another Lagrange order (the pressure's)."""
        mesh, dim = self.mesh, self.dim
        element = KINDS[dim, order or self.order]()
        nodes = self.element_nodes if order in (None, self.order) else mesh.t
        xi, w = get_quadrature(element.refdom, degree)
        pairs = [element.lbasis(xi, i) for i in range(nodes.shape[0])]
        phi = np.stack([value for value, _ in pairs], axis=1)
        dphi = np.stack([grad for _, grad in pairs], axis=-1).transpose(1, 0, 2)  # to (nq, dim, nn)
        corners = mesh.p[:, mesh.t]  # (dim, dim+1, ne)
        jac = corners[:, 1:] - corners[:, :1]  # dX_J/dξ_M
        by_element = np.moveaxis(jac, 2, 0)
        size = np.abs(determinants(by_element))
        jinv = np.ascontiguousarray(np.moveaxis(np.linalg.inv(by_element), 0, 2))
        X = corners[:, 0][:, None] + np.einsum("jme,mq->jqe", jac, xi)
        return Volume(nodes, phi, np.ascontiguousarray(dphi), jinv, np.outer(w, size), X)

    def faces(self, name: str, degree: int) -> Faces:
        """Quadrature on the boundary called ``name`` in the mesh."""
        # The mesh's own orientation flags, where it has them, are not needed on the boundary.
        facets, rule = np.asarray(self.mesh.boundaries[name]), face_quadrature(self.dim, degree)
        basis = skfem.FacetBasis(self.mesh, KINDS[self.dim, self.order](), facets=facets, quadrature=rule)
        value = np.stack([np.asarray(b[0]) for b in basis.basis])  # (nn_e, nf, nq)
        grad = np.stack([np.asarray(b[0].grad) for b in basis.basis])  # (nn_e, dim, nf, nq)
        # Of an element's nodes only those on the face have shape functions that do not vanish there.
        on_face = np.abs(value).max(axis=2) > 1e-12  # (nn_e, nf)
        count = int(on_face.sum(axis=0)[0])
        local = np.argsort(~on_face, axis=0, kind="stable")[:count]  # (nn, nf)
        column = np.arange(local.shape[1])
        nodes = basis.element_dofs[local, column]
        N = value[local, column].transpose(2, 0, 1)  # (nn, nf, nq) -> (nq, nn, nf)
        slope = grad[local, :, column]  # (nn, nf, dim, nq)
        corners = self.mesh.p[:, self.mesh.facets[:, facets]]  # (dim, dim, nf)
        edges = corners[:, 1:] - corners[:, :1]  # (dim, dim-1, nf)
        tangents = [edges[:, 0] / np.linalg.norm(edges[:, 0], axis=0)]
        normal = np.ascontiguousarray(np.asarray(basis.normals)[:, :, 0])
        if self.dim == 3:
            tangents.append(np.cross(normal.T, tangents[0].T).T)
        dN = np.stack([np.einsum("afdq,df->qaf", slope, t) for t in tangents])
        behind = self.mesh.p[:, self.mesh.t[:, self.mesh.f2t[0, facets]]]
        diameter, cell = (
            np.linalg.norm(c[:, :, None] - c[:, None], axis=0).max(axis=(0, 1)) for c in (corners, behind)
        )
        w, X = np.asarray(basis.dx).T, np.asarray(basis.global_coordinates()).transpose(0, 2, 1)
        nodes, N, dN, w, X = (np.ascontiguousarray(a) for a in (nodes, N, dN, w, X))
        return Faces(name, nodes, N, dN, w, X, normal, np.stack(tangents), diameter, cell)

    def nodes_on(self, name: str) -> np.ndarray:
        """Node numbers on the boundary called ``name``."""
        return np.unique(self.faces(name, 2).nodes)


def _plain_deepest(points, near, origin, jinv):
    xi = np.einsum("mjkn,jkn->mkn", jinv[:, :, near], points[:, None] - origin[:, near])
    depth = np.minimum(xi.min(axis=0), 1 - xi.sum(axis=0))
    best = depth.argmax(axis=0), np.arange(points.shape[1])
    return near[best], xi[:, *best], depth[best]


@compiled(_plain_deepest)
def _deepest(points, near, origin, jinv):
    """Of the elements ``near`` (k, n) the one that each of the ``points`` (dim, n) is deepest in; where in
    it, in reference coordinates, and how deep. Elements have a first corner ``origin`` and dξ/dX ``jinv``."""
    dim, n = points.shape
    element, where, depth = np.zeros(n, np.int64), np.zeros((dim, n)), np.full(n, -np.inf)
    xi = np.zeros(dim)
    for i in range(n):
        for e in near[:, i]:
            least, rest = np.inf, 1.0
            for m in range(dim):
                xi[m] = 0.0
                for j in range(dim):
                    xi[m] += jinv[m, j, e] * (points[j, i] - origin[j, e])
                least = min(least, xi[m])
                rest -= xi[m]
            if min(least, rest) > depth[i]:
                element[i], where[:, i], depth[i] = e, xi, min(least, rest)
    return element, where, depth


def _selected(parts, names: Sequence[str], which: np.ndarray):
    """``parts`` with the columns ``which`` of its arrays ``names``."""
    # A selection along the last axis is not contiguous by itself, and every product would pay for it.
    return replace(parts, **{name: np.ascontiguousarray(getattr(parts, name)[..., which]) for name in names})


def face_quadrature(dim: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights on the reference face, exact to ``degree``.

    Gauss–Lobatto on lines; on triangles the rule of Cohen, Joly, Roberts and Tordjman to degree 5, above that
    Gauss–Lobatto on three quadrilaterals. All have points on corners and edges, so that contact cannot be
    missed where two faces meet.
    """
    if dim == 3 and degree <= LUMPED:
        return _lumped()
    if dim == 3:
        # Straight-sided quadrilaterals add one to the degree in each direction.
        return _triangle(*_lobatto((degree + 5) // 2))
    x, w = _lobatto(max(2, (degree + 4) // 2))
    return x[None], w


def _lobatto(n: int) -> tuple[np.ndarray, np.ndarray]:
    """n points on [0, 1] with both ends, exact to degree 2n − 3."""
    legendre = np.polynomial.legendre.Legendre.basis(n - 1)
    x = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
    return (x + 1) / 2, 1 / (n * (n - 1) * legendre(x) ** 2)


#: Degree to which the rule with cubic, mass-lumped elements' nodes is exact; their places along an edge and
#: beside a corner's median, and weights at corners, on edges and inside (Cohen, Joly, Roberts and
#: Tordjman, SIAM J. Numer. Anal. 38 (2001) 2047).
LUMPED = 5
ALONG, BESIDE = 0.2934695559090402, 0.2073451756635909
WEIGHTS = 0.007436456512410291, 0.02442084061702551, 0.1103885289202054


def _lumped() -> tuple[np.ndarray, np.ndarray]:
    """12 points: the corners, two on each edge, three inside."""
    corners, pairs = np.eye(3), [(i, j) for i in range(3) for j in range(3) if i != j]
    edges = [(1 - ALONG) * corners[i] + ALONG * corners[j] for i, j in pairs]
    inside = [BESIDE + (1 - 3 * BESIDE) * corner for corner in corners]
    places = np.concatenate([corners, edges, inside])
    return places[:, 1:].T.copy(), np.repeat(WEIGHTS, (3, 6, 3))


def _triangle(x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rule (x, w) in both directions of the three quadrilaterals from corner to centroid."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    centre = corners.mean(axis=0)
    s, t = (a.ravel() for a in np.meshgrid(x, x))
    points, weights = [], []
    for i in range(3):
        a, b, c = corners[i], (corners[i] + corners[i - 2]) / 2, (corners[i] + corners[i - 1]) / 2
        along, across, bend = b - a, c - a, a - b - c + centre
        points.append(a[:, None] + np.outer(along, s) + np.outer(across, t) + np.outer(bend, s * t))
        u = along[:, None] + np.outer(bend, t)
        v = across[:, None] + np.outer(bend, s)
        weights.append(np.outer(w, w).ravel() * np.abs(u[0] * v[1] - u[1] * v[0]))
    # Quadrilaterals share points on their common edges.
    at = np.hstack(points)
    _, first, place = np.unique(np.round(at, 12), axis=1, return_index=True, return_inverse=True)
    return at[:, first], np.bincount(place.ravel(), np.concatenate(weights))
