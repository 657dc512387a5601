"""One run: march a case to its end, keep the curve, the ledger, the fields and how it ended."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from cutbench.base.compiled import announced
from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import COMPILING, OnProgress, silent
from cutbench.case.case import Case
from cutbench.case.values import check_driven
from cutbench.run.checkpoint import Checkpoint
from cutbench.run.fields import Fields, checked_frames
from cutbench.run.front import Front, Middle
from cutbench.run.ledger import Ledger, freed_rel, jumps_advice, jumps_rel, work_per_travel
from cutbench.run.measures import forward, measures
from cutbench.run.observer import Observer
from cutbench.run.remeshing import Place, RemeshedMarch, Transfer
from cutbench.run.result import OnStep, Result, friction_advice, unwatched
from cutbench.run.self_intersection import SelfIntersection
from cutbench.run.sensitivity import Added, Following, checked
from cutbench.run.stopping_criterion import StoppingCriterion
from cutbench.solver.march import Progress, Stalled

_log = logging.getLogger(__name__)


def run_case(
    case: Case,
    *,
    on_progress: OnProgress = silent,
    on_step: OnStep = unwatched,
    snapshots_mm: Sequence[float] = (),
    frames: int | None = None,
    sensitivities: Sequence[str] = (),
    added: Sequence[Added] = (),
    checkpoint: Checkpoint | None = None,
    effort: float = math.inf,
) -> Result:
    """Compute one case, to its depth or until its transition is known.

    A KeyboardInterrupt ends the run with what it has.

    Parameters
    ----------
    case : Case
        What to compute.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with the blade's time × speed in mm, its end as far as
        that is known, and the force.
    on_step : callable
        Called as ``on_step(row, snapshot)`` with the curve's rows, and the fields at ``snapshots_mm``, as
        they come.
    snapshots_mm : sequence of float, mm
        Fields are kept at the first step at or past each of these travels, and where the run ended before the
        last of them.
    frames : int, optional
        So many fields besides, spread evenly over the run's time as far as it goes, in ``frames`` of the
        result; fewer where it has fewer steps.
    sensitivities : sequence of str
        Names of parameters. The result's ``sensitivities`` then have dF/dθ along the curve, N per internal
        unit, and each snapshot du/dθ.
    added : sequence of Added
        Laws that the case lacks. The result's ``by_added`` then has the derivatives by their strengths, at
        "off".
    checkpoint : Checkpoint, optional
        Keeps the state of the run, which begins from what it holds. Derivatives are not part of it, so a run
        with both begins anew.
    effort : float
        Linear systems that may be factorised; then the run is given up.

    Returns
    -------
    Result
        The curve, the measures and the fields; how the run ended is in its ``outcome``.

    Raises
    ------
    BadInput
        If no law lets the blade meet the specimen, the case's mesh cannot be used, it cannot be
        differentiated by one of the names, or ``frames`` is no number of them.
    ComputationFailed
        If it is given up.

    Examples
    --------
    >>> import cutbench
    >>> quick = {"h": "0.8 mm", "element": "P1", "depth": "0.3 mm"}  # leave these out for a run that cuts
    >>> case = cutbench.load_case("gelatin").set(**quick)
    >>> result = cutbench.run_case(case, snapshots_mm=[0.2])
    >>> result.id == case.id, result.snapshots[0].displacement_mm >= 0.2
    (True, True)
    """
    if not isinstance(case, Case):
        raise BadInput("case", case, "a case, as load_case makes it; run2d and run3d take a material's name")
    check_driven(case.model)
    count, names = checked_frames(frames), checked(case, sensitivities)
    run = _Run(case, names, added, snapshots_mm, count, checkpoint)
    return run.result(*run.march(on_progress, on_step, effort))


class _Run:
    """A case on its way: its march from mesh to mesh, and what looks on."""

    def __init__(
        self,
        case: Case,
        names: Sequence[str],
        added: Sequence[Added],
        snapshots_mm: Sequence[float],
        frames: int,
        checkpoint: Checkpoint | None,
    ):
        self._began, self._before = time.perf_counter(), 0.0
        self._case = case
        self._checkpoint = None if names or added else checkpoint
        kept = self._checkpoint.load() if self._checkpoint is not None else None
        self._meshes = meshes = RemeshedMarch(case, Place(**kept["mesh"]) if kept else None)
        built = meshes.built
        unknowns = built.problem.free.size
        _log.info("%s, run %s: %d unknowns to %g mm", case.name, case.id, unknowns, case.p.depth)
        self._following = Following(built, names, added) if names or added else None
        self._ledger = Ledger(meshes)
        self._fields = Fields(meshes, self._ledger, snapshots_mm, frames, self._following)
        self._stopping = StoppingCriterion(case, built.march.motion, self._ledger)
        beside: list[Observer] = [SelfIntersection(built)]
        if case.dim == 3:
            front = Front(built)
            beside = [front, Middle(built, front)] if built.problem.cut else [front]
        # The fields know a step's row and derivatives: they come last.
        derivatives = [] if self._following is None else [self._following]
        self._observers: list[Observer] = [*derivatives, self._ledger, *beside, self._fields]
        self._begin = None
        if kept:
            self._begin = Progress.of(kept["progress"])
            for observer, state in zip(self._observers, kept["observers"], strict=True):
                observer.restore(state)
            timer, self._before = built.problem.timer, kept["total"]
            for mine, others in ((timer.seconds, kept["seconds"]), (timer.counts, kept["counts"])):
                mine |= {name: mine.get(name, 0) + value for name, value in others.items()}

    def march(self, on_progress: OnProgress, on_step: OnStep, effort: float) -> tuple[bool, str]:
        """Go to the end: whether the user ended it, and why it stalled, if it did. Raises ComputationFailed
        where it takes more than ``effort``."""
        ledger, stopping, checkpoint = self._ledger, self._stopping, self._checkpoint
        reported = 0.0, self._meshes.built.march.motion.end

        def report() -> None:
            nonlocal reported
            done = ledger.last["time_s"] * self._case.p.speed
            reported = done, done if stopping.known() else stopping.mm()
            on_progress(*reported, f"{ledger.last['force_N']:.3g} N")

        def waits() -> None:
            on_progress(*reported, COMPILING)

        if self._begin is not None:
            report()
        interrupted, stalled = False, ""
        try:
            steps = self._meshes.steps(self._begin, self._renewed)
            for step in () if stopping.known() else announced(steps, waits):
                for observer in self._observers:
                    observer.add(step)
                if not step.between:
                    report()
                    on_step(ledger.last, self._fields.newest)
                if checkpoint is not None:
                    checkpoint.offer(self._state(step.progress))
                if stopping.known():
                    break
                if self._meshes.built.problem.timer.counts.get("factorization", 0) > effort:
                    raise ComputationFailed(f"given up at {ledger.last['displacement_mm']:.3g} mm: too long")
        except KeyboardInterrupt:
            interrupted = True
        except Stalled as error:
            stalled, ledger.refused = error.reason, ledger.refused + len(error.refused)
        if checkpoint is not None and (interrupted or self._seconds() > checkpoint.every_s):
            checkpoint.write()
        return interrupted, stalled

    def result(self, interrupted: bool, stalled: str) -> Result:
        """What the march has left behind."""
        case, built, ledger = self._case, self._meshes.built, self._ledger
        curve: dict[str, np.ndarray] = {}
        for observer in self._observers:
            curve |= observer.columns()
        # An interruption can come when some have taken a step in, and others have not.
        steps = min(map(len, curve.values()))
        curve = {name: column[:steps] for name, column in curve.items()}
        if case.model.laws("rig"):
            # Beside the true columns, which all measures use.
            recorded = case.model.record(curve["displacement_mm"], curve["force_N"], curve["time_s"], case.p)
            curve["recorded_displacement_mm"], curve["recorded_force_N"] = recorded
        found = _measures(case, curve, whole=not self._stopping.known())
        for observer in self._observers:
            found |= observer.measures()
        cautions = [*(observer.caution for observer in self._observers)]
        cautions.append(jumps_advice(case, found.get("jumps_rel", 0.0)))
        cautions.append(friction_advice(case, found.get("onset_mm", math.nan)))
        caution = " ".join(filter(None, cautions))
        outcome = self._stopping.outcome(interrupted, stalled, built.march.rules.smallest, caution)
        self._fields.end(early=self._stopping.known() or not outcome.done)
        timer = built.problem.timer
        counts = {
            "steps": steps,
            "iterations": ledger.iterations,
            "rejected_steps": ledger.refused,
            "degrees_of_freedom": int(built.problem.free.size),
            **{f"{name}_calls": count for name, count in timer.counts.items()},
        }
        _log.info("%s: %s, %s", case.name, outcome, counts)
        result = Result(
            case, curve, outcome, {**timer.seconds, "total": self._seconds()}, counts,
            self._fields.snapshots, found, frames=self._fields.frames,
        )  # fmt: skip
        if self._following is not None:
            result.sensitivities, result.by_added = self._following.slopes(steps)
            counts["unresolved_sensitivities"] = self._following.sensitivities.unresolved
        return result

    def _renewed(self, transfer: Transfer) -> None:
        for observer in self._observers:
            observer.renewed(transfer)

    def _seconds(self) -> float:
        """Time that the run took, with what it took before it was resumed."""
        return self._before + time.perf_counter() - self._began

    def _state(self, progress: Progress) -> dict:
        """All that the run needs to go on from here."""
        timer = self._meshes.built.problem.timer
        return {
            "mesh": vars(self._meshes.place),
            "progress": progress.tree(),
            "observers": [observer.state() for observer in self._observers],
            "seconds": {**timer.seconds},
            "counts": {**timer.counts},
            "total": self._seconds(),
        }


def _measures(case: Case, curve: Mapping[str, np.ndarray], whole: bool) -> dict[str, float]:
    """What the curve of a run says: of the way down until the blade first rests or turns."""
    if len(curve["displacement_mm"]) <= 2:
        return {}
    count = forward(curve["displacement_mm"])
    way_down = {name: column[:count] for name, column in curve.items()}
    taken = partial(measures, window_mm=case.unit_mm, height_mm=case.values["height"], whole=whole)
    found = taken(way_down)
    found |= Middle.read(way_down, taken)
    found["energy_mJ"] = float(np.trapezoid(work_per_travel(case, way_down), way_down["displacement_mm"]))
    found["freed_rel"] = freed_rel(case, way_down, found["onset_mm"])
    found["jumps_rel"] = jumps_rel(case, way_down, found["onset_mm"])
    found["closure"] = float(curve["closure"][-1])
    force, reaction = float(curve["force_N"][-1]), float(curve["reaction_N"][-1])
    found["reaction_error"] = abs(reaction - force) / max(abs(force), 1e-300)
    return found
