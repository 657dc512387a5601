"""Is the drop of a run's force physical? The path of equilibria at rest, and the limit without viscosity.

A blade that only moves forward jumps over what it cannot follow. ``trace_snap_back`` traces the equilibria
that are jumped over (``solver.arc_length``), for the case without its laws of time, and repeats the run with
less and less viscosity and finer steps. If the path turns back, a jump follows, however fine the steps; what
the blade would give back along the path is the energy that the jump sets free.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import COLOURS, GREY, SINGLE_MM, Look, force_from_zero, new_figure, style
from cutbench.base.progress import OnProgress, silent
from cutbench.base.units import powers_of
from cutbench.case.case import Case
from cutbench.case.numerics import Numerics
from cutbench.run.ledger import Ledger
from cutbench.run.measures import measures
from cutbench.run.remeshing import RemeshedMarch, follows
from cutbench.run.result import SNAP, Result
from cutbench.run.runner import run_case
from cutbench.solver.arc_length import RELEASE, Path
from cutbench.solver.stability import lowest_eigenvalue

#: Viscosities of the limit, in units of the case's; the last one also with half the steps.
VISCOSITY_FACTORS = (0.1, 0.01)
#: A jump spans more elements than this along the cut plane, or it may be theirs.
MIN_JUMP_ELEMENTS = 3.0
#: A path that goes back by less than this part of the blade's thickness does not turn.
MIN_TURN_BACK = 0.01
#: How far the path goes on behind a jump, and how long a cut ends a path without one, in blade thicknesses.
FOLLOWED_BEHIND_JUMP, MAX_PATH_LENGTH = 1.0, 4.0

PHYSICAL, MESH, STABLE, OPEN = "physical", "mesh", "stable", "open"
INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class Jump:
    """A stretch of path that a forward-moving blade jumps over, from its turning point to the same travel.

    Lengths in mm, forces in N, energies in mJ of the whole specimen. ``landed`` is False where the path
    ended before it came back to the travel at which it turned: then the values are those up to its end.
    """

    travel_mm: float
    back_mm: float
    force_N: float
    landing_N: float
    advance_mm: float
    freed_mJ: float
    spent_mJ: Mapping[str, float]
    releases: int
    released_mJ: float
    released_mm: float
    softest_before: float
    softest_after: float
    landed: bool
    first: int = field(repr=False, default=0)
    last: int = field(repr=False, default=0)

    @property
    def drop_rel(self) -> float:
        return 1 - self.landing_N / self.force_N if self.force_N else math.nan


@dataclass(frozen=True)
class SnapBack:
    """``curve``: the path's columns, a value a point. ``limit``: runs, the last with half the steps."""

    case: Case
    curve: Mapping[str, np.ndarray]
    jumps: tuple[Jump, ...]
    stopped: str | None
    limit: tuple[tuple[str, Result], ...]
    run: Result
    seconds: float = 0.0

    @property
    def jump(self) -> Jump | None:
        """The one over which the cut grows most."""
        return max(self.jumps, key=lambda jump: jump.advance_mm, default=None)

    @property
    def verdict(self) -> str:
        """physical, mesh (a jump of few elements), stable (no jump) or open (the path ended too early)."""
        jump = self.jump
        if jump is None:
            return OPEN if self.stopped is not None else STABLE
        if jump.advance_mm > MIN_JUMP_ELEMENTS * self.case.sizes.h_mm:
            return PHYSICAL
        return MESH if jump.landed else OPEN


def rate_independent_case(case: Case) -> Case:
    """``case`` without viscosity, at rest. Raises BadInput where another law of it depends on time.

    A law depends on time only if one of its parameters has time in its unit (beside forces).
    """
    if case.p.slice_push:
        expected = "0: a path of equilibria is of a blade that goes down alone"
        raise BadInput("slice_push", case["slice_push"], expected)
    viscous = [m.name for m in case.model.all if m.regularises]
    for law in case.model.all:
        if law.slot in ("bulk", "cut", "blade", "skin", "support") and law.name not in viscous:
            for q in law.parameters:
                if powers_of(q.unit)[1] and case.values[q.name] != q.off_value:
                    raise BadInput(
                        key="--follow",
                        value=law.name,
                        expected=f"a model at rest: equilibria know no time; try --without {law.name}",
                    )
    changes: dict[str, object] = {"without": viscous} if viscous else {}
    if case.sizes.damping_mm == 0:  # not felt at rest, but a release needs its matrix
        changes["damping"] = Numerics().damping
    return case.set(**changes) if changes else case


def trace_snap_back(case: Case, run: Result, *, on_progress: OnProgress = silent) -> SnapBack:
    """Trace the equilibria that a ``run`` jumps over, and repeat it with less viscosity.

    The path is that of the case at rest, without its laws of time. If it turns back, a jump follows, however
    fine the steps. ``on_progress(done, total, text)`` has travels in mm and the force. A KeyboardInterrupt
    ends the path with what it has, and leaves the limit out. Raises BadInput where a law besides viscosity
    depends on time."""
    began = time.perf_counter()
    curve, stopped = trace_path(rate_independent_case(case), on_progress)
    jumps = tuple(jumps_of(curve, case.p.thickness))
    farthest = max((jump.travel_mm for jump in jumps), default=0.0)
    # Where nothing is cut there is no onset.
    farthest = np.fmax(farthest, run.measures.get("onset_mm", math.nan))
    depth = min(case.p.depth, float(farthest) + 4 * FOLLOWED_BEHIND_JUMP * case.p.thickness)
    runs = []
    if stopped != INTERRUPTED:
        with contextlib.suppress(KeyboardInterrupt):
            for text, changed in viscosity_limit_cases(case, depth):
                runs.append((text, run_case(changed)))
    return SnapBack(case, curve, jumps, stopped, tuple(runs), run, time.perf_counter() - began)


def viscosity_limit_cases(case: Case, depth: float) -> list[tuple[str, Case]]:
    """Cases of less and less viscosity, up to ``depth`` mm of travel, and the last with half the steps."""
    fade = [q for law in case.model.all if law.regularises for q in law.parameters]
    eta = {q: v for q in fade if q.off is not None and (v := case.values[q.name]) != q.off_value}
    factors = VISCOSITY_FACTORS if eta else (1.0,)
    cases = []
    for factor in factors:
        values = {**case.values, "depth": depth} | {q.name: factor * value for q, value in eta.items()}
        text = f"viscosity × {factor:g}" if eta else "no viscosity"
        cases.append((text, replace(case, values=values)))
    text, last = cases[-1]
    # The steps that a run chooses follow these.
    finer = replace(
        last, numerics=last.numerics.finer(step=0.5, step_min=0.5, damage_step=0.5, energy_step=0.5)
    )
    return [*cases, (f"{text}, half the steps", finer)]


def trace_path(case: Case, on_progress: OnProgress = silent) -> tuple[dict[str, np.ndarray], str | None]:
    """The path of a case without time: columns by name, and why it stopped (None: it did not).

    It ends a blade thickness behind its first jump of more than ``MIN_JUMP_ELEMENTS`` elements, at the case's
    depth, or where a cut without one is ``MAX_PATH_LENGTH`` thicknesses long.
    """
    # One mesh, with small elements as far down as a path goes.
    around = MAX_PATH_LENGTH + FOLLOWED_BEHIND_JUMP if follows(case) else 0.0
    meshes = RemeshedMarch(replace(case, numerics=replace(case.numerics, around=around)))
    built = meshes.built
    problem, march = built.problem, built.march
    rules = case.numerics.tuning.path.sized(case.unit_mm)
    path = Path(problem, march.centre0, case.p.depth, march.bottom, rules, march.newton)
    scale, thickness = built.geometry.multiplicity, case.p.thickness
    work = {name: 0.0 for name in Ledger(meshes).last if name.startswith("work_")}
    row = {"displacement_mm": 0.0, "force_N": 0.0, "cut_length_mm": 0.0, "released": 0.0, "softest": math.nan}
    rows = [row | work]
    farthest, turned, after = 0.0, None, 0
    try:
        for point in path:
            for name, done in point.work.items():
                work[f"work_{name}_mJ"] = work.get(f"work_{name}_mJ", 0.0) + done * scale
            row = {
                "displacement_mm": point.travel,
                "force_N": point.force * scale,
                "cut_length_mm": point.broken,
                "released": float(point.by == RELEASE),
                "softest": math.nan,
            }
            back = farthest - point.travel
            # Around the first turning point alone: a factorization and some solves each.
            if point.by != RELEASE and after < 5 and point.broken > rules.begun:
                row["softest"] = lowest_eigenvalue(problem, point)
                after += back > 0
            rows.append(row | work)
            on_progress(point.travel, case.p.depth, f"{row['force_N']:.3g} N")
            farthest = max(farthest, point.travel)
            if turned is None and back > MIN_TURN_BACK * thickness:
                turned = farthest
            if turned is not None and point.travel > turned + FOLLOWED_BEHIND_JUMP * thickness:
                grown = max((jump.advance_mm for jump in jumps_of(_columns(rows), thickness)), default=0.0)
                if grown > MIN_JUMP_ELEMENTS * case.sizes.h_mm:
                    break
            if point.broken > MAX_PATH_LENGTH * thickness:
                break
    except KeyboardInterrupt:
        return _columns(rows), INTERRUPTED
    return _columns(rows), path.stopped


def _columns(rows: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
    return {name: np.array([row.get(name, 0.0) for row in rows]) for name in rows[-1]}


def jumps_of(curve: Mapping[str, np.ndarray], thickness: float) -> list[Jump]:
    """What a blade that only moves forward jumps over, in the order of the path.

    From each turning point to the first point of the path at the same travel again; loops that go back by
    less than ``MIN_TURN_BACK`` blade thicknesses are left out.
    """
    d, released = curve["displacement_mm"], curve["released"] > 0
    jumps, i = [], 0
    while i < d.size - 1:
        if d[i + 1] >= d[i] and not released[i + 1]:
            i += 1
            continue
        ahead = np.flatnonzero((d[i + 1 :] > d[i] + 1e-12 * d[-1]) & ~released[i + 1 :])
        last = i + 1 + int(ahead[0]) if ahead.size else d.size - 1
        back = float(d[i] - d[i : last + 1].min())
        if back > MIN_TURN_BACK * thickness or released[i + 1 : last + 1].any():
            jumps.append(_jump(curve, i, last, ahead.size > 0))
        i = last
    return jumps


def _jump(curve: Mapping[str, np.ndarray], first: int, last: int, landed: bool) -> Jump:
    """From point ``first`` of the path to between the last two, where it ``landed``, or to its end."""
    d, F, c, soft = (curve[name] for name in ("displacement_mm", "force_N", "cut_length_mm", "softest"))
    part = (d[first] - d[last - 1]) / (d[last] - d[last - 1]) if landed else 1.0

    def at(values: np.ndarray) -> float:
        return float(values[last - 1] + part * (values[last] - values[last - 1]))

    released = curve["released"] > 0
    inside = np.flatnonzero(released[: last + 1])
    inside = inside[inside > first]
    computed = np.flatnonzero(np.isfinite(soft))
    before, after = computed[computed < first], computed[(computed >= first) & (computed < last)]
    spent = {n[5:-3]: at(v) - float(v[first]) for n, v in curve.items() if n.startswith("work_")}
    return Jump(
        travel_mm=float(d[first]),
        back_mm=float(d[first] - d[first : last + 1].min()),
        force_N=float(F[first]),
        landing_N=at(F),
        advance_mm=at(c) - float(c[first]),
        freed_mJ=-float(np.trapezoid(np.append(F[first:last], at(F)), np.append(d[first:last], at(d)))),
        spent_mJ=spent,
        releases=int((np.diff(np.concatenate([[0], released[first : last + 1]])) > 0).sum()),
        released_mJ=spent.get(SNAP, 0.0),
        released_mm=float((c[inside] - c[inside - 1]).sum()),
        softest_before=float(soft[before[-1]]) if before.size else math.nan,
        softest_after=float(soft[after[0]]) if after.size else math.nan,
        landed=landed,
        first=first,
        last=last,
    )


def as_seen_by_advancing_blade(followed: SnapBack) -> dict[str, np.ndarray]:
    """The path as a blade sees it that only moves forward, at rest between jumps: columns of a curve."""
    curve = followed.curve
    d = curve["displacement_mm"]
    keep = np.flatnonzero((d >= np.maximum.accumulate(d)) & (curve["released"] == 0))
    columns = {name: curve[name][keep] for name in ("displacement_mm", "force_N", "cut_length_mm")}
    for jump in followed.jumps:
        if jump.landed:
            at = int(np.searchsorted(columns["displacement_mm"], jump.travel_mm, side="right"))
            values = {
                "displacement_mm": jump.travel_mm,
                "force_N": jump.landing_N,
                "cut_length_mm": float(curve["cut_length_mm"][jump.first]) + jump.advance_mm,
            }
            columns = {name: np.insert(column, at, values[name]) for name, column in columns.items()}
    return columns


def limit_rows(followed: SnapBack) -> list[dict[str, object]]:
    """Onset, peak and drop with less and less viscosity, and of the path, over one stretch of travel."""
    viscous = [SNAP, *(law.name for law in followed.case.model.all if law.regularises)]
    rows = []
    for text, result in (("as asked", followed.run), *followed.limit):
        spent = [result.curve[key][-1] for name in viscous if (key := f"work_{name}_mJ") in result.curve]
        rows.append((text, result.measures, str(result.outcome), float(sum(spent))))
    shape, p = as_seen_by_advancing_blade(followed), followed.case.p
    if shape["displacement_mm"].size > 2:
        of_path = measures(shape, window_mm=p.thickness, height_mm=p.height)
        rows.append(("path at rest", of_path, followed.stopped or "done", 0.0))
    return [
        {"what": text, "outcome": outcome, "to_viscosity_mJ": spent}
        # Steady force and slope mean nothing here; these are measures of the transition.
        | {key: each.get(key, math.nan) for key in ("drop_rel", "onset_mm", "peak_N", "peak_mm")}
        for text, each, outcome, spent in rows
    ]


def sentence(followed: SnapBack) -> str:
    """What was found, in words."""
    jump, h = followed.jump, followed.case.sizes.h_mm
    end_mm = float(followed.curve["displacement_mm"][-1])
    drop = followed.run.measures.get("drop_rel", math.nan)
    asked = (
        f"As asked, the force falls by {drop:.0%}." if math.isfinite(drop) else "As asked, nothing is cut."
    )
    if followed.verdict == STABLE:
        return (
            f"No jump: equilibrium at rest goes forward all the way to {end_mm:.2f} mm of travel. {asked}"
            " What falls, falls in a stable way."
        )
    if jump is None:
        return f"Open: the path ended at {end_mm:.2f} mm before it turned ({followed.stopped}). {asked}"
    end = "" if jump.landed else f", where the path ended ({followed.stopped})"
    signs = ""
    if math.isfinite(jump.softest_before) and math.isfinite(jump.softest_after):
        signs = (
            f"; the tangent's lowest eigenvalue goes from {jump.softest_before:.2g} to"
            f" {jump.softest_after:.2g} there"
        )
    what = (
        f"at {jump.travel_mm:.3f} mm equilibrium at rest turns back by {jump.back_mm:.2f} mm{signs}."
        f" The force jumps from {jump.force_N:.3g} to {jump.landing_N:.3g} N ({jump.drop_rel:.0%}){end},"
        f" the cut grows by {jump.advance_mm:.2f} mm ({jump.advance_mm / h:.1f} elements), and"
        f" {jump.freed_mJ:.3g} mJ are set free"
    )
    heads = {
        PHYSICAL: "The jump is physical: ",
        MESH: f"A jump of fewer than {MIN_JUMP_ELEMENTS:g} elements, which may be theirs (try a smaller h): ",
        OPEN: "Open: ",
    }
    parts = ""
    if jump.releases:
        parts = (
            f" No equilibrium was near at {jump.releases} place(s) of this stretch, and the body was let go:"
            f" {jump.released_mm:.2f} mm of the cut's growth, {jump.released_mJ:.2g} mJ."
        )
    return f"{heads[followed.verdict]}{what}.{parts} {asked}"


def describe_followed(followed: SnapBack) -> dict[str, object]:
    """The content of follow.json."""
    jump = followed.jump

    def plain(one: Jump) -> dict[str, object]:
        of_jump = {k: v for k, v in vars(one).items() if k not in ("first", "last")}
        return of_jump | {"drop_rel": one.drop_rel}

    return {
        "schema": 1,
        "verdict": followed.verdict,
        "text": sentence(followed),
        "case": followed.case.to_dict(),
        "jump": None if jump is None else plain(jump),
        "jumps": [plain(one) for one in followed.jumps],
        "limit": limit_rows(followed),
        "path": {
            "points": int(followed.curve["force_N"].size),
            "to_mm": float(followed.curve["displacement_mm"][-1]),
            "cut_length_mm": float(followed.curve["cut_length_mm"][-1]),
            "stopped": followed.stopped,
            "released_points": int((followed.curve["released"] > 0).sum()),
            "without": [m.name for m in followed.case.model.all if m.regularises],
        },
        "seconds": followed.seconds,
    }


def plot_followed(followed: SnapBack) -> Figure:
    """Force against travel of the runs and of the path, above the eigenvalue against the cut's length.

    The largest jump is drawn as an arrow; the area between it and the path, as far as it is above the path's
    way back, is the energy set free.
    """
    soft = np.isfinite(followed.curve["softest"])
    with style():
        figure = new_figure(SINGLE_MM, 118 if soft.any() else 82)
        if soft.any():
            top, low = figure.subplots(2, 1, height_ratios=(2.2, 1))
            _eigenvalue(low, followed.curve, followed.jump)
        else:
            top = figure.subplots()
        _forces(top, followed)
        figure.align_ylabels()
        figure.suptitle(followed.case.name, x=0.02, ha="left")
        names = top.get_legend_handles_labels()
        figure.legend(*names, loc="outside lower center", ncols=2, columnspacing=1.2)
    return figure


def _forces(axes: Axes, followed: SnapBack) -> None:
    path, jump = followed.curve, followed.jump
    d, F, let_go = path["displacement_mm"], path["force_N"], path["released"] > 0
    end = 1.15 * float(d.max())
    if jump is not None:
        part = slice(jump.first, jump.last + 1)
        axes.fill(
            np.append(d[part], d[jump.first]), np.append(F[part], F[jump.first]),
            color=COLOURS["sky"], alpha=0.35, lw=0, label=f"set free, {jump.freed_mJ:.2g} mJ",
        )  # fmt: skip
    looks: tuple[Look, ...] = (
        {"color": COLOURS["black"], "ls": "-"}, {"color": COLOURS["orange"], "ls": (0, (5, 1.5)), "lw": 1.0},
        {"color": COLOURS["green"], "ls": (0, (1, 1.2)), "lw": 1.0},
        {"color": COLOURS["purple"], "ls": "-.", "lw": 1.0},
    )  # fmt: skip
    for (text, run), look in zip((("as asked", followed.run), *followed.limit), looks, strict=False):
        within = run.displacement_mm <= end
        axes.plot(run.displacement_mm[within], run.force_N[within], label=text, **look)
    resting = np.where(let_go, np.nan, F)
    axes.plot(d, resting, color=COLOURS["blue"], ls="-", lw=1.4, label="equilibria at rest")
    if let_go.any():
        wide = let_go | np.append(let_go[1:], False)
        axes.plot(
            d, np.where(wide, F, np.nan), color=COLOURS["blue"], ls=":", marker=".", ms=2.5, lw=1.0,
            label="none near: let go",
        )  # fmt: skip
    if jump is not None:
        axes.annotate(
            "", (jump.travel_mm, jump.landing_N), (jump.travel_mm, jump.force_N),
            arrowprops={"arrowstyle": "-|>", "color": COLOURS["vermilion"], "lw": 1.4, "shrinkA": 0},
        )  # fmt: skip
        axes.plot([jump.travel_mm], [jump.force_N], "o", color=COLOURS["vermilion"], label="turning point")
    force_from_zero(axes, "blade travel (mm)")
    axes.set_xlim(right=end)


def _eigenvalue(axes: Axes, path: Mapping[str, np.ndarray], jump: Jump | None) -> None:
    finite = np.isfinite(path["softest"])
    axes.axhline(0, color=GREY, lw=0.6)
    length, softest = path["cut_length_mm"][finite], path["softest"][finite]
    axes.plot(length, softest, color=COLOURS["blue"], ls="-", marker=".", ms=3)
    if jump is not None:
        axes.axvline(float(path["cut_length_mm"][jump.first]), color=COLOURS["vermilion"], ls="--", lw=0.9)
    axes.set_xlabel("length of the cut (mm)")
    axes.set_ylabel(r"eigenvalue ($\lambda/G$)")
