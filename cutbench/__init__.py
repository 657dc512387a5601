"""cutbench: a workbench for cutting soft solids with a blade.

    import cutbench
    result = cutbench.run2d("gelatin", eta_reg="0.5 s", h="0.4 mm")
    result.displacement_mm, result.force_N

What is heavy is loaded when it is first used.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cutbench.case import Case, load_case
    from cutbench.errors import BadInput, ComputationFailed, CutbenchError
    from cutbench.model import DEFAULT, PAPER, Model
    from cutbench.numerics import Numerics
    from cutbench.result import Outcome, Result
    from cutbench.run import run_case
    from cutbench.study import Study, load_study
    from cutbench.sweep import run_study

__version__ = "0.1.0"

_WHERE = {
    "case": ("Case", "load_case"),
    "errors": ("BadInput", "ComputationFailed", "CutbenchError"),
    "model": ("DEFAULT", "PAPER", "Model"),
    "numerics": ("Numerics",),
    "result": ("Outcome", "Result"),
    "run": ("run_case",),
    "study": ("Study", "load_study"),
    "sweep": ("run_study",),
}
_MODULE_OF = {name: module for module, names in _WHERE.items() for name in names}

__all__ = [
    "DEFAULT",
    "PAPER",
    "BadInput",
    "Case",
    "ComputationFailed",
    "CutbenchError",
    "Model",
    "Numerics",
    "Outcome",
    "Result",
    "Study",
    "known_materials",
    "known_mechanisms",
    "load_case",
    "load_study",
    "run2d",
    "run3d",
    "run_case",
    "run_study",
]


def run2d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] = (),
    on_step: Callable[[float, dict], None] | None = None,
    **changes: object,
) -> Result:
    """Cut a material (a name or a TOML file) in plane strain.

    ``changes`` are what ``Case.set`` takes: ``eta_reg="0.5 s"``, ``cohesion=9.0``, ``h="0.2 mm"``,
    ``without="adhesion"``. ``snapshots_mm`` are blade travels at which fields are kept. Raises
    BadInput; how the run ended is in the result's ``outcome``.
    """
    return _cut(source, 2, snapshots_mm, on_step, changes)


def run3d(
    source: str | Path | Case,
    *,
    snapshots_mm: Sequence[float] = (),
    on_step: Callable[[float, dict], None] | None = None,
    **changes: object,
) -> Result:
    """Cut a material (a name or a TOML file) in three dimensions; takes and raises what ``run2d`` does.

    By default a quarter of the block stands for it all (``symmetry="half"`` or ``"full"`` mesh more).
    """
    return _cut(source, 3, snapshots_mm, on_step, changes)


def _cut(
    source: str | Path | Case,
    dim: int,
    snapshots_mm: Sequence[float],
    on_step: Callable[[float, dict], None] | None,
    changes: dict[str, object],
) -> Result:
    from dataclasses import replace

    from cutbench.case import Case, load_case
    from cutbench.run import run_case

    if isinstance(source, Case):
        case = replace(source.set(**changes), dim=dim)
    else:
        case = load_case(source, changes, dim=dim)
    return run_case(case, on_step=on_step, snapshots_mm=snapshots_mm)


def known_materials() -> dict[str, Case]:
    """The known materials by name, each as the case that ``run2d`` would compute."""
    from cutbench.case import load_case
    from cutbench.materials import names

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
