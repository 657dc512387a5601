"""What pencil and paper say about a map: force at onset, steady force, stored energy; and where it fails.

For a blade of thickness 2a on a block of height H and length L, with strength σ_c = G_c/(e δ_c):

- Indenting a block as a line load does a half-plane of that depth (Johnson, Contact Mechanics, 1985,
  §2.2, ν = ½): F = k G L d with k = 2π/(ln(2H/a) − ½).
- Onset, when the mean pressure under the blade reaches the strength: F_on = 2a L σ_c at d_on = F_on/(k G L).
- Steady cutting (Atkins, The Science and Engineering of Cutting, 2009): F_s(d) = L G_c (1 + V) + 2 τ_W L d,
  where the viscous part V is the opening's speed 2a/b · v against the term that resists it: over δ_c
  where it fades with the cohesion, V = (η v/δ_c)(2a/b), over the whole opening 2a where it does not.
- Stored energy against what cutting takes: U = F_on²/(2 k G L) must carry the cut a blade's thickness
  further, U ≥ F_s(d_on) · 2a, or the transition is smooth however far the steady force lies below.

Abrupt, then: 1 − F_s(d_on)/F_on ≥ the study's threshold, and U ≥ 2a F_s(d_on).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.case.physics import Physics
from cutbench.maps.dataset import LABELS, physics_by_place, places_of
from cutbench.run.measures import ABRUPT, CLAMP, SMOOTH, TAIL


@dataclass(frozen=True)
class Classical:
    """The classical numbers of one case; forces in N, lengths in mm, energies in mJ."""

    onset_N: float
    onset_mm: float
    steady_N: float  # at the onset
    slope_N_per_mm: float  # of the steady force
    stored_mJ: float
    needed_mJ: float  # to cut a blade's thickness further

    @property
    def drop_rel(self) -> float:
        """Relative fall from the onset to steady cutting; 0 where the stored energy cannot drive it."""
        if self.stored_mJ < self.needed_mJ:
            return 0.0
        return max(0.0, 1 - self.steady_N / self.onset_N)

    def margin(self, threshold: float) -> float:
        """Above 0 where the estimate is abrupt: the smaller logarithm of two ratios that must exceed 1."""
        fall = max(1 - self.steady_N / self.onset_N, 1e-3)
        return min(math.log(fall / threshold), math.log(self.stored_mJ / self.needed_mJ))

    def steady_at(self, travel_mm: float) -> float:
        """Steady force at a blade travel."""
        return self.steady_N + self.slope_N_per_mm * (travel_mm - self.onset_mm)


def classical(case: Case | Physics) -> Classical | None:
    """The estimates for a case; None where its model has no blade or no cohesion."""
    p, tool = case.p, case.model.tool
    if tool is None:
        return None
    a, b = p.thickness / 2, tool.height(p)
    parts = [law.estimate(p, 2 * a / b * p.speed, 2 * a) for law in case.model.all]
    strength, _, work, drag = (sum(each) for each in zip(*parts, strict=True))
    if not strength:
        return None
    k = 2 * math.pi / (math.log(2 * p.height / a) - 0.5)
    onset = 2 * a * p.length * strength
    travel = onset / (k * case.model.shear_modulus(p) * p.length)
    slope = 2 * drag * p.length
    steady = p.length * work + slope * travel
    return Classical(onset, travel, steady, slope, onset * travel / 2, steady * 2 * a)


@dataclass(frozen=True)
class EstimateComparison:
    """Map and estimate side by side, a row for each run that reached its depth.

    ``table`` holds equally long arrays: ``drop``, ``peak_N``, ``steady_N`` of the run (nan where it has
    none), ``drop_estimate``, ``onset_N``, ``steady_estimate_N``, ``abrupt``, ``abrupt_estimate`` (bool).
    """

    axes: dict[str, np.ndarray]
    table: dict[str, np.ndarray]

    @property
    def agreement(self) -> float:
        """Part of the runs whose regime the estimate has right."""
        right = self.table["abrupt"] == self.table["abrupt_estimate"]
        return float(right.mean()) if right.size else math.nan

    def text(self) -> str:
        """Where the estimate fails, in one sentence."""
        t = self.table
        if not t["abrupt"].size:
            return "No run to compare with the classical estimates."
        late = int((t["abrupt_estimate"] & ~t["abrupt"]).sum())
        early = int((~t["abrupt_estimate"] & t["abrupt"]).sum())
        parts = [
            f"The classical estimates have the regime right at {100 * self.agreement:.0f} % of"
            f" {t['abrupt'].size} runs (abrupt where the run is smooth: {late},"
            f" smooth where it is abrupt: {early})"
        ]
        forces = (("peak", "peak_N", "onset_N"), ("steady force", "steady_N", "steady_estimate_N"))
        for name, ours, theirs in forces:
            ratio = t[ours] / t[theirs]
            ratio = ratio[np.isfinite(ratio)]
            if ratio.size:
                low, mid, high = np.quantile(ratio, [0, 0.5, 1])
                parts.append(f"the computed {name} is {mid:.2g} times the estimate ({low:.2g} to {high:.2g})")
        return "; ".join(parts) + "."


def margin_on_grid(data: xr.Dataset, values: Mapping[str, Sequence[float] | np.ndarray]) -> np.ndarray | None:
    """``Classical.margin`` at all combinations of a map's ``values`` by axis, with a length an axis; nan
    where there is none. None where the estimates have no boundary among these."""
    physics, margins = physics_by_place(data), []
    for place in itertools.product(*values.values()):
        try:
            found = classical(physics(dict(zip(values, place, strict=True))))
        except BadInput:
            found = None
        margins.append(math.nan if found is None else found.margin(data.attrs["drop_threshold"]))
    known = np.array(margins)[np.isfinite(margins)]
    if not known.size or not known.min() < 0 <= known.max():
        return None
    return np.reshape(margins, [len(each) for each in values.values()])


def compare(data: xr.Dataset) -> EstimateComparison:
    """Every run of a map that reached its depth against the estimates."""
    places, physics = places_of(data), physics_by_place(data)
    decided = np.isin(data["label"].values, [LABELS.index(ABRUPT), LABELS.index(SMOOTH)])
    keys = ("drop", "peak_N", "steady_N", "drop_estimate", "onset_N", "steady_estimate_N")
    rows, threshold = [], data.attrs["drop_threshold"]
    for here in map(tuple, np.argwhere(decided)):
        values = {name: float(along[here]) for name, along in places.items()}
        case = physics(values)
        if (estimate := classical(case)) is None:
            continue
        # The middle of the travel over which ``cutbench.run.measures.measures`` takes the steady force.
        end = min(case.p.depth, case.p.height - CLAMP * case.p.thickness)
        middle = (1 - TAIL / 2) * (end if end > 0 else case.p.depth)
        rows.append((
            *values.values(), *(data[name].values[here] for name in ("drop_rel", "peak_N", "steady_N")),
            estimate.drop_rel, estimate.onset_N, estimate.steady_at(middle),
            data["label"].values[here] == LABELS.index(ABRUPT), estimate.margin(threshold) >= 0,
        ))  # fmt: skip
    names = *places, *keys, "abrupt", "abrupt_estimate"
    columns = dict(zip(names, np.array(rows, dtype=float).reshape(-1, len(names)).T, strict=True))
    numbers = {key: columns[key] for key in keys}
    regimes = {key: columns[key] > 0 for key in ("abrupt", "abrupt_estimate")}
    return EstimateComparison({name: columns[name] for name in places}, numbers | regimes)
