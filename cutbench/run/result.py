"""What a run leaves behind: its curve, its fields at chosen depths, how it ended and, where it fell short,
what to try; and what it has to say, in one sentence."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, Protocol

import numpy as np

from cutbench.base.display import Displayed
from cutbench.base.versions import versions
from cutbench.case.case import Case
from cutbench.case.motion import TRANSITION
from cutbench.mechanisms.base import Points
from cutbench.run.measures import ABRUPT, ABRUPT_DROP, BRIDGED, KNOWN, UNDECIDED, label

#: Entries of the energy ledger that are no mechanisms: energy lost in jumps, where surfaces press on
#: themselves, and what new meshes add.
SNAP: Final = "snap"
SELF_CONTACT: Final = "self_contact"
TRANSFER: Final = "transfer"

#: Column of the force along the edge, of a blade that slices; it is no entry of the ledger.
ALONG: Final = "force_along_N"

#: Before a parameter's name: the derivative of the displacements by it.
SLOPE = "displacement_by_"


@dataclass
class Snapshot:
    """A snapshot holds the fields of a run at one blade travel.

    ``points`` (n, 3) in mm are the nodes in the reference state, ``cells`` (m, nn) indices into them in
    meshio's order, of ``cell_type`` ``triangle``, ``triangle6``, ``tetra`` or ``tetra10``. ``point_data``
    has ``displacement`` (n, 3) in mm, ``piola`` and ``cauchy`` (n, 9) in MPa row by row, ``von_mises`` (n,)
    in MPa; of a run that is differentiated also du/dθ (n, 3), in mm per internal unit, under ``SLOPE`` and
    the parameter's name. ``faces`` has for ``"cut"`` and ``"top"`` what is known at that face's q quadrature
    points: ``X``, ``x`` (q, 3) in mm in the reference and the current state, ``opening_mm``, ``damage``,
    ``contact_pressure_MPa``, ``tangential_traction_MPa``, ``contact_state``, ``touched``, each (q,) or (q,
    3). ``time_s`` is the run's time, nan where it is not known."""

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
    """A result holds one run: what was asked, its curve, measures and fields, and what it cost.

    n is the number of steps that are kept, the start among them.

    Attributes
    ----------
    case : Case
        What was computed.
    curve : dict of str to ndarray, shape (n,)
        Columns by name, with the unit in the name, a value a step: ``displacement_mm``, ``force_N``,
        ``time_s``, ``cut_length_mm``, the entries of the energy ledger (``force_<name>_N``,
        ``work_<name>_mJ``), the force on the clamped base (``reaction_N``), and the part of the blade's work
        that the ledger leaves open (``closure``).
    outcome : Outcome
        How it ended.
    timings : dict of str to float, s
        Where the time went.
    counts : dict of str to int
        Steps, iterations and the like.
    snapshots : list of Snapshot
        Fields at the travels that were asked for; ``save`` writes them, and the section.
    measures : dict of str to float
        What is read off the curve (``cutbench.run.measures.MEASURES``), such as ``onset_mm`` and
        ``drop_rel``, units in the names; nan where there is none.
    sensitivities : dict of str to ndarray, shape (n,)
        dF/dθ along the curve by parameter, N per internal unit (mm, N, s); at fixed steps.
    id : str
        Which run it is: the id of its case.
    computation : str
        What computed it: this process, unless it is read from a file.
    versions : dict of str to str
        The versions of cutbench and of what it builds on, by the same rule.
    frames : list of Snapshot
        Snapshots spread evenly over the whole run, where they were asked for.
    by_added : list of dict
        As ``sensitivities``, for each of the laws that the case lacks and that the run was asked for.

    Examples
    --------
    >>> import cutbench
    >>> result = cutbench.run2d("gelatin", h="0.8 mm", element="P1", depth="0.3 mm")  # too coarse for use
    >>> result.outcome.done, bool(result.force_N[-1] > 0)
    (True, True)
    >>> result.sentence()
    'not cut to 0.3 mm'
    >>> sorted(result.curve)[:3]
    ['closure', 'cut_length_mm', 'displacement_mm']
    """

    display_module: ClassVar[str] = "cutbench.run.display"

    case: Case
    curve: dict[str, np.ndarray]
    outcome: Outcome
    timings: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    snapshots: list[Snapshot] = field(default_factory=list)
    measures: dict[str, float] = field(default_factory=dict)
    sensitivities: dict[str, np.ndarray] = field(default_factory=dict)
    id: str = ""
    computation: str = ""
    versions: dict[str, str | None] = field(default_factory=dict)
    frames: list[Snapshot] = field(default_factory=list)
    by_added: list[dict[str, np.ndarray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not self.id:
            self.id, self.computation, self.versions = self.case.id, self.case.computation, versions()

    @property
    def name(self) -> str:
        """The name of its material, or of its case file."""
        return self.case.name

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
        """Whether it went to its depth, or at least did not end early with its transition."""
        early = self.outcome.done and self.case.until == TRANSITION
        return not early or self.outcome.reached_mm >= self.case.p.depth * (1 - 1e-9)

    def sentence(self, band: tuple[float, float] | None = None) -> str:
        """Say in words what the run found.

        Parameters
        ----------
        band : tuple of (float, float), optional
            The least and the largest drop over what the model leaves open.

        Returns
        -------
        str
            One sentence without a full stop.
        """
        return run_sentence(self.case, self.outcome, self.measures, band)

    @property
    def ledger(self) -> tuple[str, ...]:
        """The names of the energy ledger's entries, as the curve holds them (``force_<name>_N``)."""
        return ledger_entries(list(self.curve))


def ledger_entries(columns: Sequence[str]) -> tuple[str, ...]:
    """Names between ``force_`` and ``_N``, or ``work_`` and ``_mJ``, in order of appearance."""
    listed = (column for column in columns if column != ALONG)
    matches = [re.fullmatch(r"force_(.+)_N|work_(.+)_mJ", column) for column in listed]
    return tuple(dict.fromkeys(match[1] or match[2] for match in matches if match))


def ordered_columns(columns: Sequence[str]) -> list[str]:
    """The columns of ``curve.csv`` in its stated order; unknown ones stand before the closing two."""
    entries = ledger_entries(columns)
    ledger = [f"force_{m}_N" for m in entries] + [f"work_{m}_mJ" for m in entries]
    leading = ("displacement_mm", "force_N", ALONG, "time_s", "cut_length_mm")
    trailing = ("reaction_N", "closure")
    others = [c for c in columns if c not in (*leading, *ledger, *trailing)]
    return [c for c in (*leading, *ledger, *others, *trailing) if c in columns]


#: What a summary has, in the order in which a person asks: measure, format and unit.
_SUMMARY = {
    "onset": ("onset_mm", ".3g", "mm"),
    "peak": ("peak_N", ".4g", "N"),
    "force falls by": ("drop_rel", ".1%", ""),
    "steady force": ("steady_N", ".4g", "N"),
    "work": ("energy_mJ", ".4g", "mJ"),
    "energy left open": ("closure", ".2%", ""),
}


def summary_lines(result: Result) -> list:
    """A run in a few lines: a head, then pairs of words."""
    case, measures = result.case, result.measures
    lines = [("found", result.sentence())]
    if not result.outcome.done:
        lines.append(("ended", str(result.outcome)))
    cut = np.isfinite(measures.get("onset_mm", np.nan))
    for words, (name, form, unit) in _SUMMARY.items():
        # Without a cut there is no force of cutting.
        if (cut or name in ("energy_mJ", "closure")) and np.isfinite(value := measures.get(name, np.nan)):
            lines.append((words, f"{value:{form}} {unit}".rstrip()))
    steps = f"{len(result.displacement_mm)} steps, {result.timings.get('total', 0):.3g} s"
    return [f"{case.name}, {case.dim}D, run {result.id}", *lines, ("cost", steps)]


#: How a run can end; only ``"done"`` reached what was asked for, its depth or its transition.
OUTCOMES: Final = ("done", "stalled", "interrupted", "failed")


@dataclass(frozen=True)
class Outcome:
    """An outcome says how a run ended and, where it fell short, what to try.

    Attributes
    ----------
    kind : str
        ``done`` (its depth or its transition was reached), ``stalled`` (no smaller step converged),
        ``interrupted`` or ``failed``.
    message : str
        How it ended, in words.
    advice : str
        What to try; empty where nothing needs to be.
    reached_mm : float, mm
        Blade travel at the end.

    Raises
    ------
    ValueError
        For another kind.

    Examples
    --------
    >>> import cutbench
    >>> outcome = cutbench.Outcome("stalled", "no smaller step converges at 3 mm.", "Try a smaller h.", 3.0)
    >>> print(outcome)
    stalled: no smaller step converges at 3 mm. Try a smaller h.
    >>> outcome.done
    False
    """

    kind: str
    message: str
    advice: str = ""
    reached_mm: float = 0.0

    def __post_init__(self):
        if self.kind not in OUTCOMES:
            raise ValueError(f"outcome '{self.kind}' is none of {', '.join(OUTCOMES)}")

    @property
    def done(self) -> bool:
        """Whether the run reached what was asked for, its depth or its transition."""
        return self.kind == "done"

    def __str__(self) -> str:
        return f"{self.kind}: {self.message}" + (f" {self.advice}" if self.advice else "")


def friction_advice(case: Case, onset_mm: float) -> str:
    """What there is to know of a blade that rubs and has not cut; empty for any other."""
    p, none, soft = case.p, np.zeros(1), np.array([case.model.shear_modulus(case.p)])
    at = Points(X=np.zeros((3, 1)), touched=none + 1, slid=none, slip_rate=none, speed=p.speed, dt=1.0)
    laws = [law for law in case.model.laws("blade") if law.role == "friction"]
    rubs = [law.name for law in laws if law.strength(soft, p, law.start(1, p), at)[0] > 0]
    if not rubs or not math.isnan(onset_mm):
        return ""
    return (
        "Friction may hold the surface under the edge, so that it is pressed in and not stretched: a run"
        f" without {' and '.join(rubs)} says whether, and one with a larger slice_push whether drawing the"
        " blade along its edge helps."
    )


def run_sentence(
    case: Case, outcome: Outcome, measures: Mapping[str, float], band: tuple[float, float] | None = None
) -> str:
    """What a run with these ``measures`` found; ``band``: the least and the largest drop over what the model
    leaves open. One that fell short says where; one that ended within its transition, that it did."""
    if outcome.kind == "failed":
        return str(outcome)
    drop, onset = measures.get("drop_rel", math.nan), measures.get("onset_mm", math.nan)
    window, reached = case.values.get("thickness", math.nan), outcome.reached_mm
    end = "" if outcome.done else f", where it {'stalled' if outcome.kind == 'stalled' else 'was stopped'}"
    if math.isnan(drop):
        return f"not cut {'further ' if case.p.precut else ''}to {reached:.3g} mm{end}"
    bridged = measures.get("front_bridged", 0.0)
    what, known = label(drop, bridged=bridged), reached >= (onset + KNOWN * window) * (1 - 1e-9)
    over = ""
    if band is not None:
        low, high = band
        over = f" ({_percent(low, unit=False)} to {_percent(high)} over what the model leaves open)"
        what = UNDECIDED if label(low) != label(high) else what
    falls = f"does not fall; it is cut from {onset:.3g} mm on"
    if drop or over:
        falls = f"falls by {_percent(drop)}{over} within {window:g} mm at {onset:.3g} mm"
    soon = "" if known or what == ABRUPT else " so far"
    tail = f"; abrupt begins at {_percent(ABRUPT_DROP)}" if what == UNDECIDED else ""
    if what == UNDECIDED and bridged > BRIDGED:
        cuts = "uncut material between cuts, which thinner layers may not have"
        tail = f"; {_percent(bridged)} of the blade has {cuts}"
    if not known or not outcome.done:
        tail += f"; known to {reached:.3g} mm{end}"
    return f"{what}{soon}: the force {falls}{tail}"


def _percent(part: float, *, unit: bool = True) -> str:
    """In two digits; in three beside the threshold, so that it is seen on which side."""
    digits = 3 if 0 < abs(part - ABRUPT_DROP) < 5e-3 else 2
    return f"{100 * part:.{digits}g}" + " %" * unit
