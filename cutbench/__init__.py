"""cutbench: a workbench for cutting soft solids with a blade.

    import cutbench
    result = cutbench.run2d("gelatin", eta_reg="0.5 s", h="0.4 mm")
    result.displacement_mm, result.force_N

What is heavy is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutbench.base.progress import OnProgress, silent

if TYPE_CHECKING:
    from cutbench.base.errors import BadInput, ComputationFailed, CutbenchError
    from cutbench.calibration.fitted import Fit
    from cutbench.calibration.fitting import fit
    from cutbench.case.case import Case, load_case
    from cutbench.case.model import DEFAULT, PAPER, Model
    from cutbench.case.numerics import Numerics
    from cutbench.data.campaign import Campaign, load_campaign
    from cutbench.data.examples import copy_examples
    from cutbench.discovery.search import Discovery, discover
    from cutbench.maps.dataset import load_map
    from cutbench.maps.study import Study, load_study
    from cutbench.maps.sweep import run_study
    from cutbench.mechanisms import use_mechanisms
    from cutbench.run.result import Outcome, Result
    from cutbench.run.runner import run_case

__version__ = "0.1.0"

_WHERE = {
    "base.errors": ("BadInput", "ComputationFailed", "CutbenchError"),
    "calibration.fitted": ("Fit",),
    "calibration.fitting": ("fit",),
    "case.case": ("Case", "load_case"),
    "case.model": ("DEFAULT", "PAPER", "Model"),
    "case.numerics": ("Numerics",),
    "data.campaign": ("Campaign", "load_campaign"),
    "data.examples": ("copy_examples",),
    "discovery.search": ("Discovery", "discover"),
    "maps.dataset": ("load_map",),
    "maps.study": ("Study", "load_study"),
    "maps.sweep": ("run_study",),
    "mechanisms": ("use_mechanisms",),
    "run.result": ("Outcome", "Result"),
    "run.runner": ("run_case",),
}
_MODULE_OF = {name: module for module, names in _WHERE.items() for name in names}

__all__ = [
    "DEFAULT",
    "PAPER",
    "BadInput",
    "Campaign",
    "Case",
    "ComputationFailed",
    "CutbenchError",
    "Discovery",
    "Fit",
    "Model",
    "Numerics",
    "Outcome",
    "Result",
    "Study",
    "copy_examples",
    "discover",
    "fit",
    "known_materials",
    "known_mechanisms",
    "load_campaign",
    "load_case",
    "load_map",
    "load_study",
    "run2d",
    "run3d",
    "run_case",
    "run_study",
    "use_mechanisms",
]


def run2d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] = (),
    on_progress: OnProgress = silent,
    **changes: object,
) -> Result:
    """Cut a material (a name or a TOML file) in plane strain.

    ``changes`` are what ``Case.set`` takes: ``eta_reg="0.5 s"``, ``cohesion=9.0``, ``h="0.2 mm"``,
    ``without="adhesion"``. ``snapshots_mm`` are blade travels at which fields are kept. Raises
    BadInput; how the run ended is in the result's ``outcome``.
    """
    return _cut(source, 2, snapshots_mm, on_progress, changes)


def run3d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] = (),
    on_progress: OnProgress = silent,
    **changes: object,
) -> Result:
    """Cut a material (a name or a TOML file) in three dimensions; takes and raises what ``run2d`` does.

    By default a quarter of the block stands for it all (``symmetry="half"`` or ``"full"`` mesh more).
    """
    return _cut(source, 3, snapshots_mm, on_progress, changes)


def _cut(
    source: str | Path | Case,
    dim: int,
    snapshots_mm: Sequence[float],
    on_progress: OnProgress,
    changes: dict[str, object],
) -> Result:
    from dataclasses import replace

    from cutbench.case.case import Case, load_case
    from cutbench.run.runner import run_case

    if isinstance(source, Case):
        case = replace(source.set(**changes), dim=dim)
    else:
        case = load_case(source, changes, dim=dim)
    return run_case(case, on_progress=on_progress, snapshots_mm=snapshots_mm)


def known_materials() -> dict[str, Case]:
    """The known materials by name, each as the case that ``run2d`` would compute."""
    from cutbench.case.case import load_case
    from cutbench.case.materials import names

    return {name: load_case(name) for name in names()}


def known_mechanisms() -> dict:
    """The known mechanisms by name, in the order of slots."""
    from cutbench.mechanisms import registry

    return dict(registry())


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'cutbench' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"cutbench.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
