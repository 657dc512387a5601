"""One run: march a case to its end, keep the curve, the ledger, the fields and how it ended."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cutbench.base.compiled import announced
from cutbench.base.progress import COMPILING, OnProgress, silent
from cutbench.case.case import Case
from cutbench.case.values import check_driven
from cutbench.run.build import Built
from cutbench.run.checkpoint import Checkpoint
from cutbench.run.fields import add_slopes, snapshot
from cutbench.run.frames import Frames, checked_frames
from cutbench.run.front import Front
from cutbench.run.ledger import Ledger
from cutbench.run.measures import forward, measures
from cutbench.run.outcome import Outcome
from cutbench.run.released_energy import freed_rel
from cutbench.run.remeshing import Place, RemeshedMarch, Transfer
from cutbench.run.result import OnStep, Result, Snapshot, unwatched
from cutbench.run.self_intersection import SelfIntersection
from cutbench.run.sensitivity import Added, Following, checked
from cutbench.run.stopping_criterion import StoppingCriterion
from cutbench.solver.march import Accepted, Progress, Stalled

_log = logging.getLogger(__name__)

#: What to try when a run stalls, by a word of the reason.
_ADVICE = {
    "inverted": "Elements under the tip turn inside out: try a smaller h, a blunter tip, or element = 'P1'.",
    "invert": "Elements under the tip turn inside out: try a smaller h, a blunter tip, or element = 'P1'.",
    "energy": "The cut jumps: try a smaller step_min, or more viscosity (eta_reg).",
    "damage": "The cut jumps: try a larger damage_step, a smaller step_min, or more viscosity (eta_reg).",
    "singular": "The equations lost their solution: try a smaller h, or damping_mm = 1e-3.",
    "residual": "Newton's method does not converge: try a smaller h or penalty, or damping_mm = 1e-3.",
}

#: Said of a run whose surface passes through itself.
SELF_INTERSECTION_ADVICE = (
    "(Beside the blade the surface passes through itself: nothing keeps one part of it off another.)"
)


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

    Returns
    -------
    Result
        The curve, the measures and the fields; how the run ended is in its ``outcome``.

    Raises
    ------
    BadInput
        If no law lets the blade meet the specimen, the case's mesh cannot be used, it cannot be
        differentiated by one of the names, or ``frames`` is no number of them.

    Examples
    --------
    >>> import cutbench
    >>> quick = {"h": "0.8 mm", "element": "P1", "depth": "0.3 mm"}  # leave these out for a run that cuts
    >>> case = cutbench.load_case("gelatin").set(**quick)
    >>> result = cutbench.run_case(case, snapshots_mm=[0.2])
    >>> result.id == case.id, result.snapshots[0].displacement_mm >= 0.2
    (True, True)
    """
    began = time.perf_counter()
    check_driven(case.model)
    album = Frames(checked_frames(frames))
    names = checked(case, sensitivities)
    kept = checkpoint.load() if checkpoint is not None and not (names or added) else None
    meshes = RemeshedMarch(case, Place(**kept["mesh"]) if kept else None)
    built = meshes.built
    _log.info("%s, run %s: %d unknowns to %g mm", case.name, case.id, built.problem.free.size, case.p.depth)
    slopes = [np.zeros(len(names) + sum(len(each.names) for each in added))]
    following = Following(built, names, added) if names or added else None
    follower = None if following is None else following.sensitivities

    def moved(transfer: Transfer) -> None:
        if following is not None:
            following.go_on(transfer.new, transfer.displacements, transfer.states)

    ledger = Ledger(meshes)
    front = Front(built) if built.space.dim == 3 else None
    crossing, ending = SelfIntersection(), StoppingCriterion(case, built.march.motion, ledger)
    wanted = sorted(snapshots_mm)
    pictures: list[Snapshot] = []
    interrupted, stalled, seen = False, "", 0
    last: tuple[Built, Accepted] | None = None
    keeper = _Keeper(meshes, ledger, front, crossing, pictures, album, began)

    reported = 0.0, built.march.motion.end

    def report() -> None:
        nonlocal reported
        now = ledger.last
        done = now["time_s"] * case.p.speed
        reported = done, done if ending.known() else ending.mm()
        on_progress(*reported, f"{now['force_N']:.3g} N")

    def picture_of(then: Built, step: Accepted) -> Snapshot:
        picture = snapshot(then, step)
        picture.time_s = ledger.last["time_s"]
        return picture

    def waits() -> None:
        on_progress(*reported, COMPILING)

    if kept:
        keeper.restore(kept)
        wanted = [d for d in wanted if d > ledger.farthest + 1e-9]
        report()
    try:
        begin = Progress.of(kept["progress"]) if kept else None
        steps = meshes.steps(begin, moved)
        for step in () if ending.known() else announced(steps, waits):
            built = meshes.built
            if follower is not None:
                since = time.perf_counter()
                slope = follower.add(step)
                built.problem.timer.add("sensitivities", since)
            ledger.add(step)
            crossing.add(built, step)
            if not step.between:
                last = built, step
                if follower is not None:
                    slopes.append(slope)
                if front is not None:
                    front.add(step)
                marked = wanted and step.travel >= wanted[0] - 1e-9
                framed = album.wants(ledger.last["time_s"])
                if marked or framed:
                    picture = picture_of(built, step)
                    if follower is not None:
                        add_slopes(picture, built, names, follower.displacements()[: len(names)])
                    if framed:
                        album.add(picture)
                    if marked:
                        pictures.append(picture)
                        wanted = [d for d in wanted if d > step.travel + 1e-9]
                report()
                on_step(ledger.last, pictures[-1] if len(pictures) > seen else None)
                seen = len(pictures)
            if checkpoint is not None and follower is None:
                checkpoint.offer(keeper.state(step.progress))
            if ending.known():
                break
    except KeyboardInterrupt:
        interrupted = True
    except Stalled as error:
        stalled, ledger.refused = error.reason, ledger.refused + len(error.refused)
    built = meshes.built
    if checkpoint is not None and (interrupted or keeper.seconds() > checkpoint.every_s):
        checkpoint.write()
    curve = ledger.columns()
    if case.model.laws("rig"):
        # Beside the true columns, which all measures use.
        recorded = case.model.record(curve["displacement_mm"], curve["force_N"], curve["time_s"], case.p)
        curve["recorded_displacement_mm"], curve["recorded_force_N"] = recorded
    if front is not None and front.middle is not None:
        curve |= front.middle.columns()
    reached = float(curve["displacement_mm"][-1])
    outcome = _outcome(built, reached, interrupted, stalled, crossing.now, ending)
    short = wanted and (ending.known() or not outcome.done)
    if last is not None and short and (not pictures or pictures[-1].displacement_mm < last[1].travel):
        pictures.append(picture_of(*last))
    shown = album.ended(ledger.last["time_s"], None if last is None else partial(picture_of, *last))
    timer = built.problem.timer
    timings = {**timer.seconds, "total": keeper.seconds()}
    counts = {
        "steps": len(curve["displacement_mm"]),
        "iterations": ledger.iterations,
        "rejected_steps": ledger.refused,
        "degrees_of_freedom": int(built.problem.free.size),
        **{f"{name}_calls": count for name, count in timer.counts.items()},
    }
    found = {}
    if len(curve["displacement_mm"]) > 2:
        # Measures are those of the way down until the blade first rests or turns.
        down = forward(curve["displacement_mm"])
        way_down = {name: column[:down] for name, column in curve.items()}
        taken = partial(
            measures, window_mm=case.values.get("thickness", 0.7), height_mm=case.values["height"],
            whole=not ending.known(),
        )  # fmt: skip
        found = taken(way_down) | ledger.noted()
        if front is not None and front.middle is not None:
            found |= front.middle.measures(way_down["displacement_mm"], taken)
        found["freed_rel"] = freed_rel(case, way_down, found["onset_mm"])
        found["closure"] = float(curve["closure"][-1])
        found["reaction_error"] = float(
            abs(curve["reaction_N"][-1] - curve["force_N"][-1]) / max(abs(curve["force_N"][-1]), 1e-12)
        )
    if front is not None:
        found |= front.measures()
    else:
        found |= crossing.measures()
    _log.info("%s: %s, %s", case.name, outcome, counts)
    by_name: dict[str, np.ndarray] = {}
    by_added: list[dict[str, np.ndarray]] = []
    if following is not None and follower is not None:
        # An interruption can come between a step's derivatives and its row.
        table = np.array(slopes)[: counts["steps"]] * built.geometry.multiplicity
        by_name, by_added = following.split(table)
        counts["unresolved_sensitivities"] = follower.unresolved
    return Result(
        case, curve, outcome, timings, counts, pictures, found, by_name, frames=shown, by_added=by_added
    )


class _Keeper:
    """All of a run's state between two steps, as a tree of arrays, and back."""

    def __init__(
        self,
        meshes: RemeshedMarch,
        ledger: Ledger,
        front: Front | None,
        crossing: SelfIntersection,
        pictures: list[Snapshot],
        album: Frames,
        began: float,
    ):
        self._meshes, self._ledger, self._front, self._pictures = meshes, ledger, front, pictures
        self._crossing, self._album = crossing, album
        self._began, self._before = began, 0.0

    def seconds(self) -> float:
        """Time that the run took, with what it took before it was resumed."""
        return self._before + time.perf_counter() - self._began

    def state(self, progress: Progress) -> Callable[[], dict]:
        """The tree of this moment; made when it is asked for, of what no later step changes."""
        timer = self._meshes.built.problem.timer
        parts = {
            "mesh": vars(self._meshes.place),
            "progress": progress.tree(),
            "ledger": self._ledger.state(),
            "front": None if self._front is None else self._front.state(),
            "crossing": self._crossing.state(),
            "seconds": {**timer.seconds},
            "counts": {**timer.counts},
            "total": self.seconds(),
        }
        kept = {"snapshots": list(self._pictures), "frames": list(self._album.kept)}
        return lambda: {**parts, **{name: [vars(each) for each in those] for name, those in kept.items()}}

    def restore(self, tree: dict) -> None:
        timer = self._meshes.built.problem.timer
        self._ledger.restore(tree["ledger"])
        if self._front is not None:
            self._front.restore(tree["front"])
        self._crossing.restore(tree["crossing"])
        for mine, kept in ((timer.seconds, tree["seconds"]), (timer.counts, tree["counts"])):
            for name, value in kept.items():
                mine[name] = mine.get(name, 0) + value
        self._before = tree["total"]
        self._pictures[:] = [Snapshot(**picture) for picture in tree["snapshots"]]
        self._album.kept[:] = [Snapshot(**picture) for picture in tree["frames"] if self._album.count]


def _outcome(
    built: Built, reached: float, interrupted: bool, stalled: str, crossed: bool, ending: StoppingCriterion
) -> Outcome:
    motion = built.march.motion
    depth = motion.depth
    if interrupted:
        return Outcome(
            "interrupted",
            f"stopped by the user at {reached:.3f} mm of {depth:g} mm",
            "The curve up to there is kept.",
            reached,
        )
    if not stalled:
        caution = SELF_INTERSECTION_ADVICE if crossed else ""
        if ending.known():
            return Outcome("done", str(ending), caution, reached)
        if motion.points:
            deepest = max(travel for _, travel in motion.points)
            text = f"went the whole way, {deepest:g} mm deep, to {reached:g} mm at last"
            return Outcome("done", text, caution, reached)
        return Outcome("done", f"reached {depth:g} mm", caution, reached)
    advice = next((text for word, text in _ADVICE.items() if word in stalled), _ADVICE["residual"])
    return Outcome(
        "stalled",
        f"no step above {built.march.rules.smallest:g} mm converges at {reached:.3f} mm of {depth:g} mm"
        f" ({stalled})",
        advice,
        reached,
    )
