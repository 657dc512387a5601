"""A map from the atlas: a whole phase diagram at once, with what is unsure hatched."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator
from scipy.stats import norm

from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.emulator.atlas import REACH, Atlas, shipped, values_of
from cutbench.emulator.groups import Groups
from cutbench.maps.axes import BOUNDARY
from cutbench.maps.boundary import BoundaryEstimate, distances, margin
from cutbench.maps.dataset import LABELS, MapRow, build_map, save_map
from cutbench.maps.phase import save_phase
from cutbench.maps.study import Study
from cutbench.run.measures import ABRUPT, MEASURES, SMOOTH, UNCUT

#: Places along each axis of a boundary at which the atlas is asked; between them it is interpolated.
PLACES = 17
#: Id of what no run has.
ESTIMATED = "estimated"


def estimated_map(study: Study, atlas: Callable[[str], Atlas] = shipped) -> xr.Dataset:
    """What the runs of a study would give.

    Parameters
    ----------
    study : Study
        The study; a boundary that is sought, or points.
    atlas : callable
        The atlas of a kind of blade; those that the package brings along unless given.

    Returns
    -------
    Dataset
        A map like that of runs, in which no point has one.

    Raises
    ------
    NotInAtlas
        If a part of it lies outside the atlas.
    """
    if study.regime.surge_min is not None:
        raise BadInput("surge", study.regime.surge_min, "no [regime] surge where a map is estimated")
    tool = study.base.model.tool
    known = atlas(tool.name if tool else "")
    marks = [mark.case for mark in study.marks()]
    rows = {c.id: row for c, row in zip(marks, _rows(known, marks, study, strict=False), strict=True)}
    if study.mode != BOUNDARY:
        cases = [case for _, case in study.points()]
        ids = {index: case.id for index, case in study.points()}
        rows |= {case.id: row for case, row in zip(cases, _rows(known, cases, study), strict=True)}
        return build_map(study, rows, ids)
    margins, drops = {}, np.full(study.shape, math.nan)
    labels = np.zeros(study.shape, dtype=np.int8)
    for chosen, where, level in _levels(known, study):
        margins[chosen], drops[where], labels[where] = level
    made = build_map(study, rows, {}, margins)
    made["drop_rel"].values[...], made["label"].values[...] = drops, labels
    return made


def expected_margins(study: Study) -> dict[tuple[int, ...], BoundaryEstimate]:
    """Margins of a boundary that is sought as the atlas has them, by the indices of the levels; none where
    it says nothing of the study."""
    tool = study.base.model.tool
    if study.regime.surge_min is not None or tool is None:
        return {}
    try:
        return {chosen: level[0] for chosen, _, level in _levels(shipped(tool.name), study)}
    except BadInput:
        return {}


Where = tuple[slice | int, ...]
Level = tuple[BoundaryEstimate, np.ndarray, np.ndarray]


def _levels(known: Atlas, study: Study) -> Iterator[tuple[tuple[int, ...], Where, Level]]:
    """Of each combination of levels its indices, where it lies in the map, and what is estimated there."""
    free = [k for k, axis in enumerate(study.axes) if axis.continuous]
    levels = [k for k in range(len(study.axes)) if k not in free]
    for chosen in np.ndindex(*(study.shape[k] for k in levels)):
        fixed = dict(zip(levels, chosen, strict=True))
        where = tuple(fixed.get(k, slice(None)) for k in range(len(study.axes)))
        yield chosen, where, _level(known, study, free, fixed)


def _level(known: Atlas, study: Study, free: Sequence[int], fixed: dict[int, int]) -> Level:
    """Of one combination of levels: margins, drops and labels on the lattice of the other axes."""
    shape = [study.shape[k] for k in free]
    ticks = [np.unique(np.linspace(0, n - 1, PLACES).round().astype(int)) for n in shape]
    indices = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(free))
    cases = []
    for index in indices:
        at = fixed | dict(zip(free, map(int, index), strict=True))
        cases.append(study.case_at([axis.values[at[k]] for k, axis in enumerate(study.axes)]))
    mean, score, drop, uncut = _margins(known, cases, study.regime.drop)
    found = np.stack([mean, score, drop, uncut], axis=1)
    every = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    coarse = [len(t) for t in ticks]
    mean, score, drop, uncut = (
        RegularGridInterpolator(ticks, column.reshape(coarse))(every) for column in found.T
    )
    spread = np.abs(mean / np.where(score == 0, 1e-9, score))
    away = distances(mean >= 0) / 2
    unsure = (np.abs(score) < norm.ppf(0.975)) & (away > 1)
    label = np.where(uncut > 0.5, LABELS.index(UNCUT), LABELS.index(SMOOTH))
    label = np.where((uncut <= 0.5) & (mean >= 0), LABELS.index(ABRUPT), label)
    return BoundaryEstimate(mean, spread, unsure), np.where(uncut > 0.5, np.nan, drop), label


def _margins(
    known: Atlas, cases: Sequence[Case], threshold: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Margins of cases, how many standard deviations these are from 0, drops, and the probability that a case
    is not cut; (p,) each. Raises NotInAtlas."""
    depths = []
    for case in cases:
        units = Groups.of(case)
        assert units is not None, "it has a place in the atlas"
        depths.append(min(case.values["depth"] / units.length(case.values), REACH))
    m = known.measures(np.array([known.values(case) for case in cases]), np.array(depths))
    drop = np.clip(m.drop[:, 0], 0.01, 1.0) ** 2
    margins = margin(drop, drop, np.zeros(drop.size, dtype=bool), drop=threshold)
    return margins, m.falls(threshold), drop, m.uncut(np.array(depths))


def _rows(known: Atlas, cases: Sequence[Case], study: Study, strict: bool = True) -> list[MapRow]:
    """Of each case what a map shows; nothing of one outside the atlas, unless ``strict``."""
    found = []
    for case in cases:
        try:
            values_of(known.box, case)
            said = known.estimate(case)
        except BadInput:
            if strict:
                raise
            found.append(MapRow())
            continue
        label = UNCUT if said.verdict == UNCUT else ABRUPT if said.drop.value >= study.regime.drop else SMOOTH
        measured = dict.fromkeys(MEASURES, math.nan) | {
            "drop_rel": said.drop.value, "onset_mm": said.onset_mm.value, "peak_N": said.peak_N.value,
            "steady_N": said.steady_N.value,
        }  # fmt: skip
        found.append(
            MapRow("done", ESTIMATED, case.values["depth"], label, {**MapRow().measures, **measured})
        )
    return found


def write_estimated(study: Study, folder: Path) -> xr.Dataset:
    """``map.nc``, ``map.csv``, ``phase.png`` and ``phase.svg`` of ``estimated_map`` into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    data = estimated_map(study)
    save_map(data, folder)
    save_phase(data, folder)
    return data
