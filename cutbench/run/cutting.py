"""Cut a material by its name, its file or its case, in two dimensions or three."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, silent
from cutbench.base.threads import sharing, threads_of_a_run
from cutbench.case.case import Case, case_of, warn_of_doubts
from cutbench.run.result import Result
from cutbench.run.runner import run_case

#: Fields are kept so many times on the way down, by dimension, unless it is said where.
SNAPSHOTS = {2: 4, 3: 12}


def usual_snapshots_mm(case: Case) -> list[float]:
    """Travels at which fields are kept unless it is said where: in a block the front runs sideways within a
    short way, so that it has more."""
    parts = SNAPSHOTS[case.dim]
    return [case.p.depth * (k + 1) / parts for k in range(parts)]


@watched("mm")
def run2d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] | None = None,
    frames: int | None = None,
    on_progress: OnProgress = silent,
    **changes: object,
) -> Result:
    """Cut a material with a blade in plane strain.

    Parameters
    ----------
    source : str, Path or Case
        A material's name, a TOML file or a case.
    snapshots_mm : sequence of float, mm, optional
        Blade travels at which fields are kept, in ``snapshots`` of the result, and the end of a run that does
        not come so far. Every quarter of the depth unless given (onset and peak are not known beforehand);
        ``()`` for none.
    frames : int, optional
        How many fields are kept besides, spread evenly over the run, for an animation.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with travels in mm and the force.
    **changes : object
        What differs from the source, by keyword; all is text with a unit, or a number where there is none.

        Material: ``G``, ``tau_W`` (kPa), ``nu``, ``G_c`` (J/m^2), ``delta_c``, ``surface_length`` (mm),
        ``beta``, ``onset_stiffness``, ``mu``, ``eta_reg`` (s). Blade: ``thickness``, ``tip``, ``overhang``
        (mm), ``tilt``, ``incline`` (deg). Specimen: ``width``, ``length``, ``height``, ``precut`` (mm).
        Protocol: ``speed`` (mm/s), ``depth`` (mm), ``slice_push`` (speed along the edge over speed down),
        ``until`` (``"depth"`` or ``"transition"``), ``motion``. Parameters of other laws have theirs.

        Dimensionless groups in place of one of these: ``cohesion``, ``viscosity``, ``adhesion``,
        ``friction``, ``opening``, ``sharpness``.

        Laws: ``with_``, ``without`` and ``mechanisms``, a name or several. ``name``: what the run is called.

        Numerics: ``numerics`` (``"converged"``, ``"fast"``, ``"paper"``), or single ones such as ``h``,
        ``step`` (blade thicknesses, or text with a unit), ``element``; the reference has a table of them.

    Returns
    -------
    Result
        The curve, the measures and the fields; how the run ended is in its ``outcome``.

    Raises
    ------
    BadInput
        For a source or a change that cannot be used.

    Examples
    --------
    >>> import cutbench
    >>> quick = {"h": "0.8 mm", "element": "P1", "depth": "0.3 mm"}  # leave these out for a run that cuts
    >>> result = cutbench.run2d("gelatin", eta_reg="0.5 s", **quick)
    >>> print(result.outcome)
    done: reached 0.3 mm
    >>> result.displacement_mm.shape == result.force_N.shape
    True
    >>> [f"{snapshot.displacement_mm:.2f}" for snapshot in result.snapshots][-1]
    '0.30'
    """
    return _cut(source, 2, snapshots_mm, frames, on_progress, changes)


@watched("mm")
def run3d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] | None = None,
    frames: int | None = None,
    threads: int | None = None,
    on_progress: OnProgress = silent,
    **changes: object,
) -> Result:
    """Cut a material with a blade in three dimensions.

    By default a quarter of the block stands for it all (``symmetry="half"`` or ``"full"`` mesh more).

    Parameters
    ----------
    source : str, Path or Case
        A material's name, a TOML file or a case.
    snapshots_mm : sequence of float, mm, optional
        As for ``run2d``; every twelfth of the depth unless given.
    frames : int, optional
        How many fields are kept besides, spread evenly over the run, for an animation.
    threads : int, optional
        How many share the work, as many as there are cores unless given. Results are equal up to rounding.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with travels in mm and the force.
    **changes : object
        As for ``run2d``.

    Returns
    -------
    Result
        The curve, the measures and the fields; how the run ended is in its ``outcome``.

    Raises
    ------
    BadInput
        For a source or a change that cannot be used.

    Examples
    --------
    >>> import cutbench
    >>> small = {"width": "10 mm", "length": "10 mm", "height": "5 mm", "thickness": "1 mm"}
    >>> quick = {"numerics": "fast", "h": "2 mm", "element": "P1", "depth": "0.05 mm"}  # too coarse for use
    >>> result = cutbench.run3d("gelatin", **small, **quick)
    >>> result.case.dim, result.outcome.done
    (3, True)
    """
    if threads is not None and (not isinstance(threads, int) or threads < 1):
        raise BadInput("threads", threads, "a whole number, 1 or more")
    with sharing(threads or threads_of_a_run()):
        return _cut(source, 3, snapshots_mm, frames, on_progress, changes)


def _cut(
    source: str | Path | Case,
    dim: int,
    snapshots_mm: Sequence[float] | None,
    frames: int | None,
    on_progress: OnProgress,
    changes: dict[str, object],
) -> Result:
    case = case_of(source, changes, dim=dim)
    warn_of_doubts(case, 4)
    snapshots_mm = usual_snapshots_mm(case) if snapshots_mm is None else snapshots_mm
    for travel in snapshots_mm:
        if isinstance(travel, bool) or not isinstance(travel, (int, float, np.number)):
            raise BadInput("snapshots_mm", travel, "travels in mm, numbers such as snapshots_mm=[1.5, 3]")
    return run_case(case, on_progress=on_progress, snapshots_mm=snapshots_mm, frames=frames)
