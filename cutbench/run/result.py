"""What a run leaves behind: its curve, its fields at chosen depths, and how it ended."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Protocol

import numpy as np

from cutbench.base.display import Displayed
from cutbench.base.versions import versions
from cutbench.case.case import Case
from cutbench.case.motion import TRANSITION
from cutbench.run.outcome import Outcome
from cutbench.run.sentence import run_sentence

_LEADING = ("displacement_mm", "force_N", "time_s", "cut_length_mm")
_TRAILING = ("reaction_N", "closure")

#: Entries of the energy ledger that are no mechanisms: energy lost in jumps, where surfaces press on
#: themselves, and what new meshes add.
SNAP: Final = "snap"
SELF_CONTACT: Final = "self_contact"
TRANSFER: Final = "transfer"


#: Before a parameter's name: the derivative of the displacements by it.
SLOPE = "displacement_by_"


@dataclass
class Snapshot:
    """Fields at one blade travel.

    Of a run that is differentiated, ``point_data`` holds du/dθ (n, 3) too, in mm per internal unit, under
    ``SLOPE`` and the parameter's name.

    ``points`` (n, 3) are reference positions in mm, ``cells`` (m, nn) index them in meshio's order
    for ``cell_type`` (triangle, triangle6, tetra, tetra10). ``point_data`` holds ``displacement``
    (n, 3) mm, ``piola`` and ``cauchy`` (n, 9) MPa row by row, ``von_mises`` (n,) MPa. ``faces``
    maps ``"cut"`` and ``"top"`` to arrays at that face's quadrature points: ``X``, ``x`` (q, 3) mm in the
    reference and the current state, ``opening_mm``, ``damage``, ``contact_pressure_MPa``,
    ``tangential_traction_MPa``, ``contact_state``, ``touched``, each (q,) or (q, 3). ``time_s`` is the
    run's time, nan where it is not known.
    """

    displacement_mm: float
    points: np.ndarray
    cells: np.ndarray
    cell_type: str
    point_data: dict[str, np.ndarray] = field(default_factory=dict)
    faces: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    time_s: float = math.nan

    @property
    def current(self) -> np.ndarray:
        """Deformed positions (n, 3) in mm."""
        return self.points + self.point_data["displacement"]


class OnStep(Protocol):
    """Called after each step with its row of the curve and, where fields are kept, the snapshot."""

    def __call__(self, row: Mapping[str, float], snapshot: Snapshot | None) -> None: ...


def unwatched(row: Mapping[str, float], snapshot: Snapshot | None) -> None:
    """Nobody looks."""


@dataclass(repr=False)
class Result(Displayed):
    """One run: what was asked (``case``), what came out, and what it cost.

    ``curve`` maps column names (units in the name) to arrays of one length, a value a step;
    ``timings`` are seconds, ``counts`` integers (steps, iterations, …), ``measures`` floats whose
    unit is in their name. ``id``, ``computation`` and ``versions`` say which run it is and what computed
    it: this process, unless they are read from a file.
    """

    display_module: ClassVar[str] = "cutbench.run.display"

    case: Case
    curve: dict[str, np.ndarray]
    outcome: Outcome
    timings: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    snapshots: list[Snapshot] = field(default_factory=list)
    measures: dict[str, float] = field(default_factory=dict)
    #: dF/dθ (n,) along the curve by parameter, N per internal unit (mm, N, s); at fixed steps.
    sensitivities: dict[str, np.ndarray] = field(default_factory=dict)
    id: str = ""
    computation: str = ""
    versions: dict[str, str | None] = field(default_factory=dict)
    #: Snapshots spread evenly over the whole run, where they were asked for.
    frames: list[Snapshot] = field(default_factory=list)
    #: As ``sensitivities``, of each that a run was asked for laws that it has not.
    by_added: list[dict[str, np.ndarray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.id:
            self.id, self.computation, self.versions = self.case.id, self.case.computation, versions()

    @property
    def displacement_mm(self) -> np.ndarray:
        """Blade travel (n,) in mm."""
        return self.curve["displacement_mm"]

    @property
    def force_N(self) -> np.ndarray:
        """Force on the blade (n,) in N."""
        return self.curve["force_N"]

    @property
    def whole(self) -> bool:
        """Whether it is not one that ended with its transition, before its depth."""
        early = self.outcome.done and self.case.until == TRANSITION
        return not early or self.outcome.reached_mm >= self.case.p.depth - 1e-9

    def sentence(self, band: tuple[float, float] | None = None) -> str:
        """What it found; ``band``: the least and the largest drop over what the model leaves open."""
        return run_sentence(self.case, self.outcome, self.measures, band)

    @property
    def ledger(self) -> tuple[str, ...]:
        """Names of the energy ledger's entries, as the curve holds them (``force_<name>_N``)."""
        return ledger_entries(list(self.curve))


def ledger_entries(columns: Sequence[str]) -> tuple[str, ...]:
    """Names between ``force_`` and ``_N``, or ``work_`` and ``_mJ``, in order of appearance."""
    names: dict[str, None] = {}
    for column in columns:
        for head, tail in (("force_", "_N"), ("work_", "_mJ")):
            # "force_N" itself has no name between head and tail.
            if column.startswith(head) and column.endswith(tail) and len(column) > len(head) + len(tail):
                names[column[len(head) : -len(tail)]] = None
    return tuple(names)


def ordered_columns(columns: Sequence[str]) -> list[str]:
    """The columns of ``curve.csv`` in its stated order; unknown ones stand before the closing two."""
    entries = ledger_entries(columns)
    ledger = [f"force_{m}_N" for m in entries] + [f"work_{m}_mJ" for m in entries]
    known = [*_LEADING, *ledger, *_TRAILING]
    others = [c for c in columns if c not in known]
    return [c for c in (*_LEADING, *ledger, *others, *_TRAILING) if c in columns]
