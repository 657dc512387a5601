"""Reading a user's mesh file with meshio, and refusing it with what is wrong; of sections and blocks."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable
from pathlib import Path

import meshio
import numpy as np
import skfem
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from skfem.io.meshio import from_meshio

from cutbench.base.errors import BadInput

Refuse = Callable[[str, str], BadInput]
#: Cells by their dimension, as meshio calls them.
CELLS = ("vertex", "line", "triangle", "tetra")
#: By dimension: what a file may hold, what its facets are called and made of.
_ALONE = {2: "three-node triangles and lines", 3: "four-node tetrahedra and triangles"}
_FACET = {2: ("line", "edges"), 3: ("face", "triangles")}
_LOOSE = {
    2: ("a line that is on no triangle", "lines along edges of triangles"),
    3: ("a face that is on no tetrahedron", "triangles that are faces of tetrahedra"),
}


def refusal(path: str) -> Refuse:
    """Makes the error for a file: what was found there and what would be right."""

    def refuse(value: str, expected: str) -> BadInput:
        return BadInput("mesh", value, expected, file=str(path))

    return refuse


def _read(path: str, refuse: Refuse) -> meshio.Mesh:
    """The file as meshio reads it. Raises BadInput if it cannot."""
    # meshio writes to the terminal and leaves by sys.exit where a reader fails; its own words are kept.
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            return meshio.read(Path(path))
    except meshio.ReadError as error:
        known = "a mesh format that meshio reads, with its usual suffix, such as .msh or .vtu"
        raise refuse(Path(path).name, known) from error
    except (SystemExit, Exception) as error:
        why = said.getvalue().strip() or f"{type(error).__name__}: {error}"
        raise refuse(Path(path).name, f"a mesh file that meshio can read ({why})") from error


def read_simplices(path: str, dim: int, refuse: Refuse) -> skfem.Mesh:
    """Triangles (``dim`` 2) or tetrahedra (3) and their named facets. Raises BadInput for anything else."""
    raw = _read(path, refuse)
    kinds, solid = [block.type for block in raw.cells], CELLS[dim]
    if solid not in kinds or set(kinds) - set(CELLS[: dim + 1]):
        raise refuse(
            f"cells: {', '.join(dict.fromkeys(kinds)) or 'none'}",
            f"{_ALONE[dim]} alone (cutbench adds the nodes of quadratic elements)",
        )
    points = np.asarray(raw.points, dtype=float)
    used = np.unique(raw.cells_dict[solid])
    if not np.isfinite(points[used]).all():
        raise refuse("a coordinate that is not a number", "finite coordinates in mm")
    if points.shape[1] > dim and (away := np.ptp(points[used, dim])) > 1e-9 * np.ptp(points[used]):
        raise refuse(f"z over a range of {away:g} mm", "a plane mesh: x across the cut, y up, one z")
    try:
        raw = _compact(raw, points[used, :dim], used, CELLS[dim - 1 : dim + 1])
    except ValueError as error:
        raise refuse(*_LOOSE[dim]) from error
    try:
        return from_meshio(raw)
    except Exception as error:  # whatever a file can hold that scikit-fem did not expect
        what = (
            "a plane mesh of triangles with named lines"
            if dim == 2
            else "a mesh of tetrahedra with named faces"
        )
        raise refuse(str(error) or type(error).__name__, what) from error


def named_facets(
    mesh: skfem.Mesh, wanted: Iterable[str], refuse: Refuse, of: str = ""
) -> dict[str, np.ndarray]:
    """The facets called ``wanted`` in the file; ``of`` says of what. Raises BadInput if one is missing.

    Sorted, and without orientation: the same block gives the same numbers from any file format.
    """
    named, wanted, what = mesh.boundaries or {}, list(wanted), f"{_FACET[mesh.dim()][0]}s named"
    if missing := [name for name in wanted if name not in named]:
        found = ", ".join(sorted(named)) or "none"
        raise refuse(f"{what}: {found}", f"{what} {', '.join(wanted)}{of} ({', '.join(missing)} missing)")
    return {name: np.unique(np.asarray(named[name])) for name in wanted}


def check_facets(
    mesh: skfem.Mesh, name: str, axis: int, where: float, refuse: Refuse, side: float = 0.0
) -> None:
    """The facets called ``name`` must be flat, at their place, and all that the boundary has there: with a
    ``side``, on elements of x > 0 or of x < 0. Raises BadInput."""
    facets, (what, parts) = mesh.boundaries[name], _FACET[mesh.dim()]
    eps = 1e-6 * mesh.p[1].max()
    place = f"{what} '{name}' at {'xyz'[axis]} = {where:g} mm"
    if facets.size == 0:
        raise refuse(f"{what} '{name}' has no {parts}", place)
    off = np.abs(mesh.p[axis][mesh.facets] - where).max(axis=0)
    if (worst := off[facets].max()) > eps:
        raise refuse(f"{what} '{name}' off by {worst:g} mm", place)
    there = np.flatnonzero((off <= eps) & (mesh.f2t[1] == -1))
    if side:
        there = there[side * mesh.p[0, mesh.t[:, mesh.f2t[0, there]]].mean(axis=0) > 0]
        place += f" on the elements of x {'<' if side < 0 else '>'} 0"
    if lost := np.setdiff1d(there, facets).size:
        raise refuse(f"{what} '{name}' without {lost} of {there.size} {parts} there", f"{place}, complete")
    if extra := np.setdiff1d(facets, there).size:
        raise refuse(f"{what} '{name}' with {extra} {parts} too many", place)


def pieces(edges: np.ndarray, nodes: int) -> int:
    """How many connected parts ``edges`` (2, n) make of so many ``nodes``."""
    joined = coo_matrix((np.ones(edges.shape[1]), edges), shape=(nodes, nodes))
    return connected_components(joined, directed=False)[0]


def _compact(raw: meshio.Mesh, points: np.ndarray, used: np.ndarray, kinds: tuple[str, ...]) -> meshio.Mesh:
    """``raw`` on the points ``used`` alone, with its cells of ``kinds`` and what is said about them.

    Points of the drawing that belong to no element would be unknowns without an equation. Raises ValueError
    with the kind of a cell that hangs on such a point.
    """
    number = np.full(len(raw.points), -1)
    number[used] = np.arange(used.size)
    cells, keep = [], []
    for block in raw.cells:
        keep.append(block.type in kinds)
        if keep[-1]:
            if (number[block.data] < 0).any():
                raise ValueError(block.type)
            cells.append((block.type, number[block.data]))

    def kept(parts: list) -> list:
        return [part for part, here in zip(parts, keep, strict=True) if here]

    return meshio.Mesh(
        points,
        cells,
        field_data=raw.field_data,
        cell_data={name: kept(parts) for name, parts in raw.cell_data.items()},
        cell_sets={name: kept(parts) for name, parts in raw.cell_sets.items()},
    )
