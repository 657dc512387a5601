"""Reading a user's mesh file with meshio, and refusing it with what is wrong."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np

from cutbench.base.errors import BadInput

Refuse = Callable[[str, str], BadInput]


def refusal(path: str) -> Refuse:
    """Makes the error for a file: what was found there and what would be right."""

    def refuse(value: str, expected: str) -> BadInput:
        return BadInput(file=str(path), key="mesh", value=value, expected=expected)

    return refuse


def read_file(path: str, refuse: Refuse) -> meshio.Mesh:
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


def compact(raw: meshio.Mesh, points: np.ndarray, used: np.ndarray, kinds: tuple[str, ...]) -> meshio.Mesh:
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
