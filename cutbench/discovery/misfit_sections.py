"""Where a model fails: by experiment and regime, with the bias and its significance."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from cutbench.calibration.fitting import ComparedCurve
from cutbench.calibration.posterior import Estimated
from cutbench.data.experiment import HOMOGENEOUS, Experiment
from cutbench.data.measures import MeasuredCut


@dataclass(frozen=True)
class Section:
    """Readings of an experiment from ``first`` (a grid number) on. ``bias``: measured less computed, mean,
    in its unit; ``z``: over its standard deviation by scatter, noise and mesh."""

    experiment: Experiment
    regime: str
    start: float
    end: float
    bias: float
    z: float
    first: int

    @property
    def wrong(self) -> bool:
        """Whether it is off by three standard deviations of its mean."""
        return abs(self.z) >= 3.0

    @property
    def range(self) -> str:
        if isinstance(self.experiment, MeasuredCut):
            return str(self.experiment.measures[self.first])
        unit = "" if self.experiment.x_unit == "1" else f" {self.experiment.x_unit}"
        return f"{self.start:.3g} to {self.end:.3g}{unit}"

    @property
    def place(self) -> str:
        """Where it lies, in words."""
        return f"{f'{self.regime}, ' if self.regime else ''}{self.experiment.x_name} {self.range}"

    def in_mm_and_N(self) -> tuple[float, float, float] | None:
        """From, to and bias of a cut, or of a stretched specimen whose length and area are known."""
        e = self.experiment
        if e.kind == "cut" and e.curve:
            return self.start, self.end, self.bias
        length, area = e.specimen.get("length"), e.specimen.get("area")
        if e.kind in HOMOGENEOUS and length and area:
            return (self.start - 1) * length, (self.end - 1) * length, self.bias * area
        return None


def sections(fitted: Estimated) -> list[Section]:
    """Of all fitted tests, the most significant first."""
    found, p = [], fitted.posterior.predictions
    for e in fitted.posterior.tests:
        grid, w, r = p.grids[e.id], fitted.w.tests[e.id], -fitted.at.residual[e.id]
        curve = ComparedCurve(
            e, grid.x, grid.mean, grid.deviation, grid.mean - r, fitted.at.onset_mm[e.id], p.thickness_mm(e)
        )
        masks = curve.regimes() or _sections_of_one_sign(r)
        if isinstance(e, MeasuredCut):
            masks = {m.name: grid.x == number for m, number in zip(e.measures, grid.x, strict=True)}
        for name, mask in masks.items():
            i, mean = np.flatnonzero(mask), mask / mask.sum()
            sd, bias = float(np.sqrt(mean @ w.noise @ mean)), float(mean @ r)
            start, end = float(grid.x[i[0]]), float(grid.x[i[-1]])
            found.append(Section(e, name.split("#")[0], start, end, bias, bias / sd, int(i[0])))
    return sorted(found, key=lambda s: (-abs(s.z), s.experiment.id, s.start))


def _sections_of_one_sign(r: np.ndarray) -> dict[str, np.ndarray]:
    """Sections of one sign, those shorter than a twelfth of the readings joined with the one before."""
    least = max(2, int(0.08 * r.size))
    smooth = np.convolve(np.pad(r, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    edges = [0]
    for c in np.flatnonzero(np.diff(np.sign(smooth)) != 0) + 1:
        if c - edges[-1] >= least and r.size - c >= least:
            edges.append(int(c))
    number, ends = np.arange(r.size), itertools.pairwise([*edges, r.size])
    return {f"#{k}": (number >= a) & (number < b) for k, (a, b) in enumerate(ends)}
