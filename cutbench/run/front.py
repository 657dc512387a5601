"""The cut's front along the blade, in three dimensions: where it starts, how fast it runs sideways.

The cut plane is read in strips across the blade, each as long as an element along it, or, of a section that
is drawn out, in its planes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from cutbench.forms.base import blend
from cutbench.forms.space import Faces
from cutbench.forms.strips import Strips
from cutbench.run.block_cost import layer_zones
from cutbench.run.build import Built
from cutbench.run.fields import snapshot
from cutbench.run.measures import ONSET
from cutbench.run.observer import Observer
from cutbench.run.remeshing import Transfer
from cutbench.solver.march import Accepted

#: Unit and meaning of each number, in the order in which tables show them.
FRONT: dict[str, tuple[str, str]] = {
    "front_start_z_mm": ("mm", "place where the cut begins, from the middle of the block"),
    "front_start_mm": ("mm", "blade travel at which it begins there"),
    "front_centre_mm": ("mm", "blade travel at which the cut has begun at the middle of the block"),
    "front_edge_mm": ("mm", "blade travel at which it has begun at the block's end"),
    "front_half_mm": ("mm", "blade travel at which it has begun along half of the blade"),
    "front_bridged": (
        "1",
        "part of the blade along which ligaments are left between cuts at the end of the run",
    ),
    "front_layer_zones": ("1", "thickness of the thickest layer along the blade over the cohesive zone"),
    "front_lateral_speed": ("mm/mm", "advance of the front from start to end, per blade travel"),
    "front_von_mises_start_MPa": ("MPa", "largest von Mises stress at the front where and when it starts"),
    "front_von_mises_running_MPa": ("MPa", "the same, mean over the strips that it reaches later"),
    "front_pressure_before_MPa": ("MPa", "largest contact pressure up to the start of the cut"),
    "front_pressure_after_MPa": ("MPa", "largest contact pressure once the cut has reached the end"),
    "front_pressure_end_MPa": ("MPa", "largest contact pressure on the cut faces at the end of the run"),
    "front_pressure_end_place": (
        "1",
        "where that is: 0 at the top edge, 1 at the front, 2 as far ahead of it",
    ),
    "front_pressure_behind_MPa": ("MPa", "mean contact pressure on the middle half of the cut faces, then"),
}
#: Unit and meaning of each number of ``Middle.measures``.
MIDDLE: dict[str, tuple[str, str]] = {
    "middle_onset_mm": ("mm", "blade travel at which the cut has begun in the middle of the block"),
    "middle_peak_N": ("N", "first prominent maximum of the force, were all of the blade as its middle"),
    "middle_max_N": ("N", "largest force, likewise"),
    "middle_steady_N": ("N", "steady force, likewise"),
    "middle_drop_rel": ("1", "relative fall of the force at the transition, likewise"),
}
#: The front is where the damage is neither begun nor complete.
PROCESS_ZONE = (0.05, 0.95)


class Front(Observer):
    """Where the cut's front is along the blade.

    ``z`` (n,) are the middles of the strips in mm; ``onset`` (n,) blade travel in mm, nan where the cut
    has not begun.
    """

    kept = ("onset", "_last", "_peaks", "_pattern", "_stress")

    def __init__(self, built: Built, strips: int | None = None):
        self._built, self._form = built, built.problem.cut
        #: A strip is cut once it is longer by this than at the start, mm.
        self._begun = ONSET * built.case.unit_mm
        self._last = (0.0, np.empty(0))
        self._peaks: list[tuple[float, float]] = []
        self._pattern = np.full(3, math.nan)
        self._stress: dict[int, float] = {}
        self.z = self.onset = np.empty(0)
        if self._form is None:
            return
        self.strips, self._count = Strips(built.space, self._form.faces, folded=True, count=strips), strips
        self.z, self._strip, count = self.strips.z, self.strips.at, self.strips.z.size
        self.onset = np.full(count, math.nan)
        #: What is cut before the run, mm.
        self.before = self.lengths(built.problem.start())
        self._last = (0.0, np.zeros(count))

    def renewed(self, transfer: Transfer) -> None:
        self._built, self._form = transfer.new, transfer.new.problem.cut
        assert self._form is not None, "without a cut no mesh follows one"
        self.strips = Strips(self._built.space, self._form.faces, folded=True, count=self._count)
        self._strip = self.strips.at

    def lengths(self, states: dict[str, dict]) -> np.ndarray:
        """Cut length (n,) of each strip in mm: its cut area over its width."""
        assert self._form is not None, "there are no strips without a cut"
        return self.strips.lengths(self._form.cut_area(states["cohesion"]))

    def add(self, step: Accepted) -> None:
        if step.between:
            return
        blades = [step.states[blade.name]["pressure"] for blade in self._built.blades]
        peak = max((float(np.max(pressure, initial=0.0)) for pressure in blades), default=0.0)
        self._peaks.append((step.travel, peak))
        if self._form is None:
            return
        travel, before = self._last
        lengths = self.lengths(step.states)
        self._pattern = self._pressures(step, lengths)
        now = lengths - self.before
        begun = np.flatnonzero(np.isnan(self.onset) & (now >= self._begun))
        if begun.size:
            part = (self._begun - before[begun]) / np.maximum(now[begun] - before[begun], 1e-300)
            self.onset[begun] = travel + np.clip(part, 0, 1) * (step.travel - travel)
            self._look(self._form.faces, step, begun)
        self._last = (step.travel, now)

    def _pressures(self, step: Accepted, lengths: np.ndarray) -> np.ndarray:
        """Peak of the contact pressure on the cut faces, its place along the cut, and the mean behind it."""
        form = next((blade for blade in self._built.blades if "cut" in blade.faces.parts), None)
        if form is None:
            return np.full(3, math.nan)
        part = form.faces.parts["cut"]
        pressure = np.real(step.states[form.name]["pressure"])[:, part].ravel()
        depth = self._built.case.p.height - form.faces.X[1][:, part].ravel()
        cut = lengths[self._strip] if pressure.size == self._strip.size else np.zeros(pressure.size)
        place = depth / np.where(cut > self._begun, cut, math.nan)
        top = int(np.argmax(pressure))
        inner = (place > 0.25) & (place < 0.75)
        w = form.faces.w[:, part].ravel()[inner]
        mean = float(w @ pressure[inner] / w.sum()) if w.size else math.nan
        return np.array([pressure[top], place[top] if pressure[top] > 0 else math.nan, mean])

    def _look(self, faces: Faces, step: Accepted, begun: np.ndarray) -> None:
        """Largest von Mises stress in the process zone of the strips that have just begun."""
        stress = snapshot(self._built, step).point_data["von_mises"]
        here = blend(faces.N, stress[faces.nodes][None])[0].ravel()
        damage = np.real(step.states["cohesion"]["damage"])
        zone = (damage > PROCESS_ZONE[0]) & (damage < PROCESS_ZONE[1])
        for strip in begun:
            values = here[zone & (self._strip == strip)]
            if values.size:
                self._stress[int(strip)] = float(values.max())

    def measures(self) -> dict[str, float]:
        """The numbers of ``FRONT``; what did not happen is nan."""
        out = dict.fromkeys(FRONT, math.nan) | {"front_layer_zones": layer_zones(self._built.case)}
        if self.onset.size == 0 or np.isnan(self.onset).all():
            return out
        first = int(np.nanargmin(self.onset))
        case = self._built.case
        width, uncut = self.strips.width, np.isnan(self.onset)
        # Strips are folded: what is cut at z is so at -z, and the middle lies between.
        between = np.arange(width.size) < np.flatnonzero(~uncut)[-1]
        reach = case.p.length / 2 + min(case.values.get("overhang", 0.0), 0.0)
        out |= {
            "front_start_z_mm": float(self.z[first]),
            "front_start_mm": float(self.onset[first]),
            "front_centre_mm": float(self.onset[0]),
            "front_edge_mm": float(self.onset[-1]),
            "front_half_mm": self.strips.half(self.onset, reach),
            "front_bridged": float(width[uncut & between].sum() / width.sum()),
            "front_von_mises_start_MPa": self._stress.get(first, math.nan),
            "front_pressure_end_MPa": float(self._pattern[0]),
            "front_pressure_end_place": float(self._pattern[1]),
            "front_pressure_behind_MPa": float(self._pattern[2]),
        }
        # From the start to the strip that comes last: the whole way sideways.
        last = int(np.nanargmax(self.onset))
        wait = self.onset[last] - self.onset[first]
        if wait > 0:
            out["front_lateral_speed"] = float(abs(self.z[last] - self.z[first]) / wait)
        running = [value for strip, value in self._stress.items() if strip != first]
        if running:
            out["front_von_mises_running_MPa"] = float(np.mean(running))
        travel, peak = np.array(self._peaks).T
        out["front_pressure_before_MPa"] = float(peak[travel <= max(self.onset[first], travel[0])].max())
        if not np.isnan(self.onset[-1]) and (after := travel > self.onset[-1]).any():
            out["front_pressure_after_MPa"] = float(peak[after].max())
        return out


class Middle(Observer):
    """What a block's middle carries: the curve of a blade of which all were as its middle is.

    The force per length there, times the length of the block, stands beside a section's force, which has no
    ends.
    """

    kept = ("_rows",)

    def __init__(self, built: Built, front: Front):
        self._front, self._length = front, built.case.p.length
        # A mesh without a split has one side of the cut plane.
        self._sides = 1.0 if built.geometry.split else 2.0
        self._rows: list[tuple[float, float]] = [(0.0, float(front.before[0]))]
        self._on(built)

    def _on(self, built: Built) -> None:
        near = self._front.strips.near
        self._there = {blade.name: np.abs(blade.faces.X[2]) <= near for blade in built.blades}
        self._weights = {blade.name: blade.faces.w for blade in built.blades}

    def renewed(self, transfer: Transfer) -> None:
        self._on(transfer.new)

    def add(self, step: Accepted) -> None:
        if step.between:
            return
        force = 0.0
        for name, there in self._there.items():
            state = step.states[name]
            traction = state["normal_traction"][1] + state["shear"][1]
            force -= float((traction * self._weights[name])[there].sum())
        per_length = force / self._front.strips.width[0]
        cut_mm = float(self._front.lengths(step.states)[0])
        self._rows.append((per_length * self._sides * self._length, cut_mm))

    def columns(self) -> dict[str, np.ndarray]:
        force, cut = np.array(self._rows).T
        return {"middle_force_N": force, "middle_cut_length_mm": cut}

    @staticmethod
    def read(
        curve: Mapping[str, np.ndarray], taken: Callable[[Mapping[str, np.ndarray]], dict[str, float]]
    ) -> dict[str, float]:
        """The numbers of ``MIDDLE``, ``taken`` as those of a curve are; none of a section."""
        if "middle_force_N" not in curve:
            return {}
        columns = {name: curve[f"middle_{name}"] for name in ("force_N", "cut_length_mm")}
        found = taken({"displacement_mm": curve["displacement_mm"], **columns})
        return {name: found[name.removeprefix("middle_")] for name in MIDDLE}


def end_effect(three: dict[str, float], two: dict[str, float]) -> dict[str, float]:
    """3D force over plane-strain force at each stage, from both runs' measures; nan where one lacks it."""
    names = ("peak_N", "max_N", "steady_N", "slope_N_per_mm", "onset_mm")
    pairs = {name.split("_")[0]: (three.get(name, math.nan), two.get(name, math.nan)) for name in names}
    return {f"end_effect_{stage}": a / b if b else math.nan for stage, (a, b) in pairs.items()}
