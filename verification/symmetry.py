"""One cut computed three ways: half a section, the whole of it, and one layer of a solid held flat."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cutbench.case.case import load_case
from cutbench.forms.geometry import Geometry
from cutbench.forms.space import Faces, Space
from cutbench.models3d.extruded import extruded
from cutbench.run.build import Built, build
from cutbench.solver.march import Accepted, Given
from verification.base import Check, Reference

#: A small block, so that the cut opens on the way and the force falls; contact so soft that rounding stays
#: what it is through the fall.
CASE = {
    "element": "P1", "h": "0.8 mm", "width": "12 mm", "height": "8 mm", "depth": "2.4 mm", "mu": 0.2,
    "G_c": "2 J/m^2", "eta_v": "0.02 mm", "energy_step": 0.1, "corner": 0.0625, "shallow": 1,
    "step": "0.1 mm", "penalty": 1000, "stick": 400, "multiplier": "none",
    "with": ["surface_tension", "film"], "gamma_s": "50 mN/m", "film_thickness": "0.07 mm",
}  # fmt: skip
THICKNESS = 0.5


def compute() -> Iterator[Check]:
    flat = load_case("gelatin", CASE)
    half = build(flat)
    travel, force, steps = curve(half)
    top = force.max()
    for name, built, there in (
        ("whole section", build(flat.set(symmetry="full")), lambda u: np.concatenate([u, u * [-1, 1]])),
        ("one layer", layer(flat, half), lambda u: np.pad(u, ((0, 0), (0, 1)))),
    ):
        # Both begin each step from the half's solution: it has to be theirs.
        d, F, _ = curve(built, [replace(s.given, u=there(s.u.reshape(-1, 2)).ravel()) for s in steps])
        yield Check(f"{name}: largest force", "mN", 1e3 * top, 1e3 * F.max(), 1e-6)
        off = np.abs(np.interp(travel, d, F) - force).max()
        yield Check(f"{name}: largest difference of the curves, over it", "1", 0.0, off / top, 1e-6)


def curve(built: Built, given: list[Given] | None = None) -> tuple[np.ndarray, np.ndarray, list[Accepted]]:
    """Travel in mm and force in N of the whole block, and the steps taken, which may be ``given``."""
    steps = list(built.march.steps(given=given))
    travel, force = np.array([(step.travel, step.force) for step in steps if not step.between]).T
    return travel, force * built.geometry.multiplicity, steps


@dataclass(frozen=True)
class Layer(Space):
    """Linear tetrahedra in one layer whose back moves as its front: fields of x and y alone.

    Faces are those of the section, as high as the layer is thick; nothing varies across.
    """

    section: Space

    def faces(self, name: str, degree: int) -> Faces:
        f = self.section.faces(name, degree)

        def deep(values: np.ndarray) -> np.ndarray:
            return np.concatenate([values, np.zeros((3 - len(values), *values.shape[1:]))])

        along, normal = deep(f.tangents[0]), deep(f.normal)
        tangents, dN = np.stack([along, np.cross(normal.T, along.T).T]), np.concatenate([f.dN, 0 * f.dN])
        return replace(f, dN=dN, w=THICKNESS * f.w, X=deep(f.X), normal=normal, tangents=tangents)

    def nodes_on(self, name: str) -> np.ndarray:
        return np.arange(self.X.shape[1]) if name == "front" else self.section.nodes_on(name)


def layer(flat, half: Built) -> Built:
    """The section of ``half`` as a solid, held between two planes."""
    section = half.space
    mesh = extruded(section.mesh, np.array([0.0, THICKNESS]))
    free = Space.build(mesh, 1)
    n = section.X.shape[1]
    solid = Layer(mesh, 1, free.X[:, :n], free.element_nodes % n, free._dofs, section)
    geometry = Geometry(mesh, half.geometry.height, half.geometry.multiplicity / THICKNESS, (("front", 2),))
    return build(replace(flat, dim=3), geometry, solid)


REFERENCE = Reference(
    "symmetry",
    "The onset of a cut through weak gelatin: half a section, the whole, one layer of a solid.",
    "mirror symmetry; plane strain is a solid held between two planes",
    compute,
    seconds=6.0,
)
