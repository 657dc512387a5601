"""Curve and energy balance, a row a step: the blade's work against what each mechanism took up."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cutbench.case.case import Case
from cutbench.run.measures import FRONT, MAX_JUMPS, TRANSITION, at_the_front
from cutbench.run.observer import Observer
from cutbench.run.remeshing import RemeshedMarch
from cutbench.run.result import ALONG, SELF_CONTACT, SNAP, TRANSFER
from cutbench.solver.march import Accepted


class Ledger(Observer):
    """One run's; ``last`` is its last row."""

    kept = (
        "iterations", "refused", "_drags", "_boost", "_rows", "_work", "_blade", "_rested", "_now", "_since",
    )  # fmt: skip

    def __init__(self, meshes: RemeshedMarch):
        self._meshes, built = meshes, meshes.built
        self.iterations = self.refused = 0
        # Points reached against raised damping, and the largest.
        self._drags, self._boost = 0, 0.0
        # Works so far in mJ, by mechanism and of the blade.
        self._work: dict[str, float] = {}
        self._blade = 0.0
        # What steps at rest have taken, which the motion's time does not have, s.
        self._rested = 0.0
        # Since the last row: where the blade is, its work per travel, and what each mechanism took up.
        self._now = (0.0, 0.0)
        self._since: dict[str, float] = {}
        # A curve starts at the origin: nothing touched, nothing spent.
        model = built.case.model
        names = [law.name for slot in ("bulk", "cut", "blade", "support") for law in model.laws(slot)]
        names += [law.name for law in model.laws("skin") if law.surfaces]
        forms = {form.name for form in built.problem.forms}
        own = ((SELF_CONTACT, "self_contact"), (SNAP, "damping"))
        names += [work for work, form in own if form in forms]
        names += [TRANSFER] * meshes.follows
        self._names = names
        row = {"displacement_mm": 0.0, "force_N": 0.0, "time_s": 0.0}
        self._slices = built.case.p.slice_push > 0
        row |= {ALONG: 0.0} if self._slices else {}
        row["cut_length_mm"] = self._cut_length(built.problem.start())
        row |= {f"force_{name}_N": 0.0 for name in names} | {f"work_{name}_mJ": 0.0 for name in names}
        self._rows = [row | {"reaction_N": 0.0, "closure": 0.0}]

    def add(self, step: Accepted) -> None:
        """Take in a step: a row, unless it is between two points of the curve."""
        built = self._meshes.built
        scale = built.geometry.multiplicity
        drive = step.progress.drive * scale
        travel, before = self._now
        self._blade += (before + drive) / 2 * (step.travel - travel)
        self._now = (step.travel, drive)
        self.iterations += step.iterations
        self.refused += len(step.refused)
        if step.step.damping_factor > 1 and not step.between:
            self._drags, self._boost = self._drags + 1, max(self._boost, step.step.damping_factor)
        self._rested += step.dt * (step.given.advance == 0)
        # On a new mesh a mechanism has first to take up again, or to give back, what that has added to it.
        taken = {name: step.work.get(name, 0.0) + step.added.get(name, 0.0) for name in self._names}
        if step.added:
            taken[TRANSFER] = -sum(taken.values())
        for name in self._names:
            done = taken[name] * scale
            self._work[name] = self._work.get(name, 0.0) + done
            self._since[name] = self._since.get(name, 0.0) + done
        if step.between:
            return
        row = {
            "displacement_mm": step.travel,
            "force_N": step.force * scale,
            "time_s": step.pseudo_time_mm / built.march.speed + self._rested,
            "cut_length_mm": self._cut_length(step.states),
        }
        row |= {ALONG: step.along * scale} if self._slices else {}
        travelled = step.travel - self.last["displacement_mm"]
        for name in self._names:
            row[f"force_{name}_N"] = self._since[name] / travelled if travelled else 0.0
        self._since = {}
        row |= {f"work_{name}_mJ": self._work[name] for name in self._names}
        row["reaction_N"] = step.reaction * scale
        defect = self._blade - sum(self._work.values()) + self._work.get(TRANSFER, 0.0)
        row["closure"] = defect / self._blade if self._blade else 0.0
        self._rows.append(row)

    def _cut_length(self, states: dict[str, dict]) -> float:
        """Length of cut plane (3D: mean over the blade) that has lost its cohesion."""
        if "cohesion" not in states:
            return 0.0
        built = self._meshes.built
        form = built.form("cohesion")
        cut = float(form.cut_area(states["cohesion"]).sum())
        if built.case.dim == 3:
            X = form.faces.X[2]
            cut /= np.ptp(built.space.X[2]) if X.size else 1.0
        return cut

    def measures(self) -> dict[str, float]:
        """Those of ``cutbench.run.measures.NOTED`` that the steps tell."""
        snap = self._work.get(SNAP, 0.0) / self._blade if self._blade else 0.0
        found = {"drag_steps": float(self._drags), "drag_boost": self._boost, "snap_rel": snap}
        return found | ({"along_N": max(row[ALONG] for row in self._rows)} if self._slices else {})

    @property
    def farthest(self) -> float:
        """The largest travel so far, mm."""
        return max(row["displacement_mm"] for row in self._rows)

    @property
    def grown_mm(self) -> float:
        """By how much the cut is longer than at the start."""
        return self.last["cut_length_mm"] - self._rows[0]["cut_length_mm"]

    @property
    def last(self) -> dict[str, float]:
        """The row of the last step."""
        return self._rows[-1]

    def columns(self) -> dict[str, np.ndarray]:
        return {key: np.array([row[key] for row in self._rows]) for key in self._rows[0]}


def work_per_travel(case: Case, curve: Mapping[str, np.ndarray]) -> np.ndarray:
    """Of the blade (n,), mJ/mm: its force and, where it slices, what its way along the edge adds."""
    return curve["force_N"] + case.p.slice_push * curve.get(ALONG, 0.0)


def jumps_rel(case: Case, curve: Mapping[str, np.ndarray], onset_mm: float) -> float:
    """Part of the blade's work behind the transition that damping takes: the front jumps from element to
    element where these are large against the cohesive zone. nan where the curve ends within a thickness."""
    d, start = curve["displacement_mm"], onset_mm + TRANSITION * case.unit_mm
    key = f"work_{SNAP}_mJ"
    if not d[-1] - start >= case.unit_mm or key not in curve:
        return math.nan
    per_travel = work_per_travel(case, curve)
    force, lost = (np.interp(start, d, column) for column in (per_travel, curve[key]))
    behind = d > start
    blade = np.trapezoid(np.append(force, per_travel[behind]), np.append(start, d[behind]))
    return float((curve[key][-1] - lost) / blade) if blade > 0 else math.nan


def jumps_advice(case: Case, part: float) -> str:
    """What there is to know of a run that loses this ``part`` in jumps; empty if that is little."""
    if not part > MAX_JUMPS:
        return ""
    detail, zones = case.sizes.detail_mm, case.numerics.tuning.mesh.detail[1]
    better = min(detail / 2, zones * case.model.cohesive_zone(case.p))
    return (
        f"Behind the transition {part:.0%} of the work goes into jumps of the front from element to element:"
        f" detail = '{better:.2g} mm' would resolve them."
    )


def freed_rel(case: Case, curve: Mapping[str, np.ndarray], onset_mm: float) -> float:
    """What viscosity and damping take per area cut where the front is fastest, in units of the toughness.

    Cutting that is steady spends what the blade does on the cut, on friction and on what it stores. Where the
    elastic body gives back more than that, the front goes ahead until viscosity takes the difference. At rest
    it jumps, and the difference is what the limit point frees: the area between the path of equilibria, which
    turns back there, and the blade's travel at which it does.

    ``curve`` is that of a blade which only moves forward, with its ledger. nan where nothing is cut, or
    cutting takes no work.
    """
    window = case.values.get("thickness", math.nan)
    toughness = sum(law.estimate(case.p, 0.0, 0.0).work for law in case.model.laws("cut"))
    d, c = curve["displacement_mm"], curve["cut_length_mm"]
    start, speed = at_the_front(d, c, window, onset_mm)
    area = speed * FRONT * window * case.values["length"]
    if not area * toughness > 0:
        return math.nan
    names = (SNAP, *(law.name for law in case.model.all if law.regularises))
    lost = sum(curve[key] for name in names if (key := f"work_{name}_mJ") in curve)
    spent = np.interp([start, start + FRONT * window], d, np.broadcast_to(lost, d.shape))
    return float((spent[1] - spent[0]) / (area * toughness))
