"""A section's space drawn out along z: each of its elements is a row of prisms, one a layer; or it stands for
itself, where points move along z, but nothing depends on it.

Along z displacements are quadratic in a layer, through three planes of nodes: its two ends and its middle.
All integrals are taken in these planes, by Simpson's rule: in each the body meets the blade, and opens, as a
section does, point by point, and the planes are joined by what stretches and shears along z. So where nothing
varies along z the block is the section, to rounding. A rule of other points would hold a plane that goes its
own way by less than its share, down to 0.4 of it with Gauss's: cuts then ran in every second plane alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
import skfem

from cutbench.forms.space import INWARD, Faces, Space, Volume
from cutbench.forms.surface import Share, SurfaceForm

#: Simpson's weights in a layer 1 thick, and in its three planes the derivatives of the shape functions that
#: belong to them (plane, function).
WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6
SLOPES = np.array([[-3.0, 4.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -4.0, 3.0]])


@dataclass(frozen=True)
class Prisms(Space):
    """Node a of the section's ``flat`` space has the number k n + a in the plane ``z[k]`` of all
    (2 layers + 1,)."""

    flat: Space
    z: np.ndarray

    @classmethod
    def of(cls, mesh: skfem.MeshTet, flat: Space, z: np.ndarray) -> Prisms:
        """With layers between ``z`` (layers + 1,). ``mesh``: tetrahedra that the prisms can be cut into, for
        pictures."""
        n, layers = flat.X.shape[1], z.size - 1
        z = np.interp(np.arange(2 * layers + 1) / 2, np.arange(layers + 1), z)
        X = np.vstack([np.tile(flat.X, z.size), np.repeat(z, n)])
        first = np.hstack([flat.element_nodes + 2 * k * n for k in range(layers)])
        nodes = np.vstack([first, first + n, first + 2 * n])
        return cls(mesh, flat.order, X, nodes, None, flat, z)

    @property
    def layers(self) -> np.ndarray:
        """How thick each is (layers,), mm."""
        return np.diff(self.z[::2])

    @property
    def widths(self) -> np.ndarray:
        """How much of the block each plane stands for, mm."""
        out = np.zeros(self.z.size)
        for k, part in enumerate(WEIGHTS):
            out[k : k + self.z.size - 2 : 2] += part * self.layers
        return out

    def numbered(self, nodes: np.ndarray) -> np.ndarray:
        """Numbers (…, planes·m) of the section's ``nodes`` (…, m) in all planes, plane by plane."""
        return np.concatenate([nodes + k * self.flat.X.shape[1] for k in range(self.z.size)], axis=-1)

    @property
    def cells(self) -> tuple[str, np.ndarray]:
        """Tetrahedra between the corners of the section's elements in two planes: three of each, that
        conform."""
        n = self.flat.X.shape[1]
        a, b, c = np.sort(self.flat.element_nodes[:3], axis=0)
        one = np.hstack([(a, b, c, c + n), (a, b, b + n, c + n), (a, a + n, b + n, c + n)])
        return "tetra", np.hstack([one + k * n for k in range(self.z.size - 1)])

    @property
    def inside(self) -> np.ndarray:
        z = self.z + INWARD * (self.z.mean() - self.z)
        return np.vstack([np.tile(self.flat.inside, z.size), np.repeat(z, self.flat.X.shape[1])])

    def probes(self, points: np.ndarray) -> sp.csr_matrix:
        flat = self.flat.probes(np.ascontiguousarray(points[:2])).tocoo()
        layer = np.clip(np.searchsorted(self.z[::2], points[2], side="right") - 1, 0, self.layers.size - 1)
        x = ((points[2] - self.z[2 * layer]) / self.layers[layer])[flat.row]
        shapes = ((1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1))
        n, first = self.flat.X.shape[1], 2 * layer[flat.row]
        values = np.concatenate([flat.data * shape for shape in shapes])
        columns = np.concatenate([flat.col + n * (first + k) for k in range(3)])
        size = (points.shape[1], self.X.shape[1])
        return sp.csr_matrix((values, (np.tile(flat.row, 3), columns)), shape=size)

    def volume(self, degree: int, order: int | None = None) -> Volume:
        """The section's rule in each plane of a layer."""
        if order not in (None, self.order):
            raise ValueError("prisms have displacements alone")
        flat, h = self.flat.volume(degree), self.layers
        (nq, ne), own = flat.w.shape, np.eye(3)

        def product(along: np.ndarray, section: np.ndarray) -> np.ndarray:
            """(3, 3) and (nq, nn) to (3 nq, 3 nn)."""
            return np.einsum("sb,qa->sqba", along, section).reshape(3 * nq, -1)

        slopes = [product(own, flat.dphi[:, m]) for m in range(2)] + [product(SLOPES, flat.phi)]
        jinv = np.zeros((3, 3, h.size * ne))
        jinv[:2, :2], jinv[2, 2] = np.tile(flat.jinv, h.size), np.repeat(1 / h, ne)
        w = np.einsum("s,qe,l->sqle", WEIGHTS, flat.w, h).reshape(3 * nq, -1)
        X = np.empty((3, 3, nq, h.size, ne))
        X[:2] = flat.X[:, None, :, None]
        for k in range(3):
            X[2, k] = self.z[k : k + 2 * h.size : 2, None]
        dphi = np.ascontiguousarray(np.stack(slopes, axis=1))
        return Volume(self.element_nodes, product(own, flat.phi), dphi, jinv, w, X.reshape(3, *w.shape))

    def faces(self, name: str, degree: int) -> Faces:
        """The section's lines in each plane, as wide as ``widths``. Nothing is said of slopes along z."""
        f, planes = self.flat.faces(name, degree), self.z.size

        def deep(values: np.ndarray) -> np.ndarray:
            return np.tile(np.concatenate([values, np.zeros((1, *values.shape[1:]))]), planes)

        count = f.size.size
        along, normal = deep(f.tangents[0]), deep(f.normal)
        w = np.tile(f.w, planes) * np.repeat(self.widths, count)
        X = deep(f.X)
        X[2] = np.repeat(self.z, count)
        return Faces(
            name,
            self.numbered(f.nodes),
            np.tile(f.N, planes),
            np.tile(np.concatenate([f.dN, 0 * f.dN]), planes),
            w,
            X,
            normal,
            np.stack([along, np.cross(normal.T, along.T).T]),
            np.tile(f.size, planes),
            np.tile(f.cell, planes),
        )

    def nodes_on(self, name: str) -> np.ndarray:
        """Also on the "middle" plane, and on the "end" of a block, or both ends if it is whole along z."""
        planes = {"middle": [0.0], "end": [-self.z[-1], self.z[-1]]}
        if name in planes:
            return np.flatnonzero(np.isin(self.X[2], planes[name]))
        return np.sort(self.numbered(self.flat.nodes_on(name)))

    def stacked(self, form: SurfaceForm, cut: Faces) -> SurfaceForm:
        """``form`` of the section, whose cut plane has the faces ``cut``, in all planes."""
        count, planes, n = form.dofs.shape[1], self.z.size, cut.size.size
        some = form.part(np.tile(np.arange(count), planes))
        assert isinstance(some, SurfaceForm), "forms of surfaces have parts"
        node, component = np.divmod(form.dofs, 2)
        some.dofs = self.numbered(node) * 3 + np.tile(component, planes)
        share, plane = some.share, np.repeat(np.arange(planes), count)
        # Shares are of columns, or of the points of all columns.
        plane = np.tile(plane, share.whole.size // plane.size)
        wide, (point, face) = self.widths[plane], np.divmod(share.at, n)
        some.share = Share(share.whole * wide, share.slope * wide, (point * planes + plane) * n + face)
        return some


@dataclass(frozen=True)
class Sheared(Prisms):
    """A section whose points move along z, too, all along a line alike: one plane, 1 mm of it."""

    @classmethod
    def over(cls, flat: Space) -> Sheared:
        X = np.vstack([flat.X, np.zeros(flat.X.shape[1])])
        return cls(flat.mesh, flat.order, X, flat.element_nodes, None, flat, np.zeros(1))

    @property
    def dim(self) -> int:
        return 3

    @property
    def widths(self) -> np.ndarray:
        return np.ones(1)

    @property
    def cells(self) -> tuple[str, np.ndarray]:
        return self.flat.cells

    def probes(self, points: np.ndarray) -> sp.csr_matrix:
        return self.flat.probes(np.ascontiguousarray(points[:2]))

    def volume(self, degree: int, order: int | None = None) -> Volume:
        """With gradients in the plane alone."""
        flat = self.flat.volume(degree, order)
        return replace(flat, X=np.concatenate([flat.X, np.zeros((1, *flat.w.shape))]))
