"""Cut a material by its name, its file or its case, in two dimensions or three."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, silent
from cutbench.case.case import Case, load_case
from cutbench.run.result import Result
from cutbench.run.runner import run_case


@watched("mm")
def run2d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] = (),
    frames: int | None = None,
    on_progress: OnProgress = silent,
    **changes: object,
) -> Result:
    """Cut a material (a name or a TOML file) in plane strain.

    ``changes`` are what ``Case.set`` takes: ``eta_reg="0.5 s"``, ``cohesion=9.0``, ``h="0.2 mm"``,
    ``without="adhesion"``. ``snapshots_mm`` are blade travels at which fields are kept, ``frames``
    how many are, spread evenly over the run, for an animation. Raises BadInput; how the run ended is in
    the result's ``outcome``.
    """
    return _cut(source, 2, snapshots_mm, frames, on_progress, changes)


@watched("mm")
def run3d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] = (),
    frames: int | None = None,
    on_progress: OnProgress = silent,
    **changes: object,
) -> Result:
    """Cut a material (a name or a TOML file) in three dimensions; takes and raises what ``run2d`` does.

    By default a quarter of the block stands for it all (``symmetry="half"`` or ``"full"`` mesh more).
    """
    return _cut(source, 3, snapshots_mm, frames, on_progress, changes)


def _cut(
    source: str | Path | Case,
    dim: int,
    snapshots_mm: Sequence[float],
    frames: int | None,
    on_progress: OnProgress,
    changes: dict[str, object],
) -> Result:
    if isinstance(source, Case):
        case = replace(source.set(**changes), dim=dim)
    else:
        case = load_case(source, changes, dim=dim)
    return run_case(case, on_progress=on_progress, snapshots_mm=snapshots_mm, frames=frames)
