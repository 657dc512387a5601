"""What a sweep found, counted: regimes, what the blade did not reach, and what fell short, with reasons."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from cutbench.base.errors import BadInput
from cutbench.base.report import aligned
from cutbench.case.physics import Physics
from cutbench.case.values import CLAMP
from cutbench.maps.dataset import LABELS, NOT_COMPUTED, OUTCOME_FLAGS, axes_of, axis_of, places_of
from cutbench.maps.regimes import kind_sentences
from cutbench.maps.uncertainty import strip_sentences
from cutbench.run.measures import ABRUPT, KNOWN, UNCUT

FILE = "summary.txt"
#: Reasons that are told of each kind of end.
_MAX_REASONS = 3
#: An onset that is foreseen from others' may be so much later.
_ONSET_MARGIN = 1.15


@dataclass(frozen=True)
class Findings:
    """Counts of a map's runs. ``labels`` are those that occur, in their order; ``missing`` runs have not
    ended; ``short`` are those that ended otherwise than they should, by outcome and reason.

    ``open_ended`` runs have an onset and no drop, but end before a drop would be known. ``deepen_mm`` is the
    depth at which they and the uncut are expected to be known, nan where nothing says it, ``deepest_mm`` the
    greatest of the specimen. ``crossed`` runs have a surface that passes through itself. ``marks`` are the
    marked materials' own runs: name, label, drop.
    """

    runs: int
    labels: Mapping[str, int]
    missing: int
    short: Mapping[str, Mapping[str, int]]
    open_ended: int
    deepen_mm: float
    deepest_mm: float
    crossed: int
    marks: tuple[tuple[str, str, float], ...]
    kinds: tuple[str, ...] = ()  # what runs at rest say, in words

    def lines(self) -> list[str]:
        """A table in plain words, one line a finding."""
        rows = [(name, n, f"({self._deepen()})" if name == UNCUT else "") for name, n in self.labels.items()]
        rows += [
            ("open", self.open_ended, f"of them end before a drop is known ({self._deepen()})"),
            ("crossed", self.crossed, "of them pass through themselves"),
            *((kind, sum(reasons.values()), _reasons(reasons)) for kind, reasons in self.short.items()),
            ("to come", self.missing, ""),
        ]
        own = ", ".join(
            f"{name} {label}" + (f" ({drop:.2g})" if math.isfinite(drop) else "")
            for name, label, drop in self.marks
        )
        counted = aligned([(name, f"{count:>5}", note) for name, count, note in rows if count])
        told = [f"own runs, with their drop: {own}"] if own else []
        return [f"  {text}" for text in (*counted, *self.kinds, *told)]

    def _deepen(self) -> str:
        if math.isnan(self.deepen_mm):
            return "a greater depth would tell more"
        if self.deepen_mm > self.deepest_mm:
            return f"by the others' trend {self.deepen_mm:.3g} mm would do: more than the specimen has"
        return f'by the others\' trend depth = "{self.deepen_mm:.3g} mm" would do'


def _reasons(reasons: Mapping[str, int]) -> str:
    told = [f"{n} × {reason}" for reason, n in reasons.items()]
    more = [f"and {len(told) - _MAX_REASONS} other reasons"] if len(told) > _MAX_REASONS else []
    return f"({'; '.join(told[:_MAX_REASONS] + more)})"


def findings(data: xr.Dataset) -> Findings:
    """Count a map, complete or not; a run that is at two of its points is one."""
    ids = data["run_id"].values.ravel()
    _, first = np.unique(ids, return_index=True)
    first = np.array([i for i in sorted(first) if ids[i]], dtype=int)

    def values(name: str) -> np.ndarray:
        return data[name].values.ravel()[first]

    label = np.array([LABELS[k] for k in values("label")], dtype=object)
    outcome = np.array([OUTCOME_FLAGS[k] for k in values("outcome")], dtype=object)
    counted = Counter(label)
    short: dict[str, Counter[str]] = {}
    for kind, message in zip(outcome, values("message"), strict=True):
        if kind not in ("done", "missing"):
            # Numbers tell runs apart, not reasons.
            reason = re.sub(r"\d[\d.]*(e[-+]?\d+)?", "…", str(message)) or "no reason given"
            short.setdefault(kind, Counter())[reason] += 1
    physics = _physics(data)
    thickness = _thickness(data, physics)[first]
    known = values("onset_mm") + KNOWN * thickness
    reached = values("reached_mm")
    told = ~np.isin(label, [ABRUPT, NOT_COMPUTED])
    early = told & (reached < known * (1 - 1e-6))
    uncut = label == UNCUT
    deepen = [*known[early], *(_extrapolated_onsets(data, first, uncut) + KNOWN * thickness[uncut])]
    crossed = values("crossed_mm") if "crossed_mm" in data else np.full(first.size, np.nan)
    high = vars(physics.p).get("height", math.nan) if physics else math.nan
    marks = (
        (str(name), LABELS[int(k)], float(drop))
        for name, k, drop in zip(
            data["mark"].values, data["mark_label"].values, data["mark_drop_rel"].values, strict=True
        )
    ) if "mark" in data.coords else ()  # fmt: skip
    return Findings(
        first.size,
        {name: counted[name] for name in LABELS if name != NOT_COMPUTED and counted[name]},
        int((outcome == "missing").sum()),
        {kind: dict(short[kind].most_common()) for kind in OUTCOME_FLAGS if kind in short},
        int(early.sum()),
        float(np.ceil(10 * np.nanmax(deepen)) / 10) if np.isfinite(deepen).any() else math.nan,
        high - CLAMP * float(np.nanmax(thickness, initial=0.0)),
        int(np.isfinite(crossed).sum()),
        tuple(marks),
        tuple(kind_sentences(data)),
    )


def boundary_sentences(data: xr.Dataset) -> list[str]:
    """How well a boundary is known that was sought, and what it owes to numerics and model, in sentences."""
    strips = strip_sentences(data)
    if "margin" not in data:
        return strips
    unsure, sides = float(data["unsure"].mean()), (data["margin"] >= 0).values
    if sides.all() or not sides.any():
        return ["no boundary: one regime on the whole map", *strips]
    known = f"not known to the tolerance (95 %) on {100 * unsure:.2g} % of the map"
    return [f"boundary: {known if unsure else 'known to the tolerance everywhere (95 %)'}", *strips]


def summary_text(data: xr.Dataset, more: Sequence[str] = ()) -> str:
    """What ``summary.txt`` holds: the title, the findings, and ``more`` lines."""
    found = findings(data)
    told = [*found.lines(), *boundary_sentences(data), *more]
    return "\n".join([data.attrs["title"], f"{found.runs} runs", *told])


def _physics(data: xr.Dataset) -> Physics | None:
    try:
        return Physics.from_dict(json.loads(data.attrs["base_case"]))
    except BadInput:
        return None  # of laws that this cutbench does not have


def _thickness(data: xr.Dataset, physics: Physics | None) -> np.ndarray:
    """The blade's, mm, at each point of a map (n,); nan without one."""
    if "thickness" in axes_of(data):
        return places_of(data)["thickness"].ravel()
    blade = vars(physics.p).get("thickness", math.nan) if physics else math.nan
    return np.full(data["label"].size, blade)


def _extrapolated_onsets(data: xr.Dataset, points: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Onsets, mm, of the ``points`` (flat) at ``where``: the others' logarithm is linear over the axes in
    their own scales; nan where too few have one."""
    axes = [axis_of(data, name) for name in axes_of(data)]
    at = places_of(data)
    columns = [np.array([axis.place(v) if axis.values[-1] > axis.values[0] else 0.0
                         for v in at[axis.name].ravel()[points]]) for axis in axes]  # fmt: skip
    x = np.stack([np.ones(points.size), *columns], axis=1)
    onset = data["onset_mm"].values.ravel()[points]
    has = np.isfinite(onset)
    if has.sum() < x.shape[1] + 1:
        return np.full(int(where.sum()), np.nan)
    slope = np.linalg.lstsq(x[has], np.log(onset[has]), rcond=None)[0]
    return _ONSET_MARGIN * np.maximum(
        np.exp(x[where] @ slope), data["reached_mm"].values.ravel()[points][where]
    )
