"""A map from the atlas: a whole phase diagram at once, with what is unsure hatched."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from cutbench.base.errors import BadInput
from cutbench.base.files import write_text
from cutbench.base.toml import line_of
from cutbench.case.case import Case
from cutbench.emulator.atlas import Atlas, Measures, NotInAtlas, depth_of, shipped
from cutbench.maps.axes import BOUNDARY
from cutbench.maps.boundary import (
    NORMAL_QUANTILE,
    BoundaryEstimate,
    distance_to_boundary,
    margins_by_atlas,
    spread_of,
)
from cutbench.maps.dataset import ESTIMATE, LABELS, OUTCOME_FLAGS, MapRow, build_map, load_map, save_map
from cutbench.maps.page import page
from cutbench.maps.phase import save_phase
from cutbench.maps.study import Study
from cutbench.run.measures import ABRUPT, SMOOTH, UNCUT, label

#: Places along each axis of a boundary at which the atlas is asked; between them it is interpolated.
PLACES = 17
#: What a point says that no run has.
ESTIMATED = "estimated"


def estimated_map(study: Study) -> xr.Dataset:
    """What the runs of a study would give.

    Parameters
    ----------
    study : Study
        The study; a boundary that is sought, or points.

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
        line = line_of(study.text, "surge", "regime")
        expected = "none where a map is estimated: the atlas knows drops alone"
        raise BadInput("surge", study.regime.surge_min, expected, file=str(study.path), line=line)
    known = shipped()
    rows = _rows(known, [mark.case for mark in study.marks() if _inside(known, mark.case)], study)
    if study.mode != BOUNDARY:
        return build_map(study, rows | _rows(known, [case for _, case in study.points()], study))
    margins, drops = {}, np.full(study.shape, math.nan)
    labels = np.zeros(study.shape, dtype=np.int8)
    for chosen, where, level in _levels(known, study):
        margins[chosen], drops[where], labels[where] = level
    made = build_map(study, rows, {}, margins)
    made["drop_rel"].values[...], made["label"].values[...] = drops, labels
    return made


def expected_margins(study: Study) -> dict[tuple[int, ...], BoundaryEstimate]:
    """Margins of a boundary that is sought as the atlas has them, by the indices of the levels; none where
    it says nothing of the study, or has other numerics."""
    if not _speaks_of(study):
        return {}
    try:
        return {chosen: level[0] for chosen, _, level in _levels(shipped(), study)}
    except BadInput:
        return {}


def expected_drops(study: Study) -> np.ndarray | None:
    """Relative drops at the points of a study as the atlas has them, shaped as its map; None where it says
    nothing of the study, has other numerics, or the boundary is sought."""
    if study.mode == BOUNDARY or not _speaks_of(study):
        return None
    try:
        return estimated_map(study)["drop_rel"].values
    except BadInput:
        return None


def _speaks_of(study: Study) -> bool:
    """Whether the atlas has the study's measure and its numerics."""
    known, own = shipped(), study.base.to_dict()["numerics"]
    # A choice that cutbench has had since stands at its default in the atlas.
    theirs = known.space.base.to_dict()["numerics"] | known.about["numerics"]
    return study.regime.surge_min is None and own == theirs


def under_way(data: xr.Dataset, drops: np.ndarray | None) -> xr.Dataset:
    """A map with what is expected where no run has ended, for pictures; they say that it is estimated.

    Parameters
    ----------
    data : Dataset
        The map as far as there are runs.
    drops : ndarray, optional
        What ``expected_drops`` gives.

    Returns
    -------
    Dataset
        The same map where nothing is expected.
    """
    if drops is None and "drop_rel_expected" not in data:
        return data
    ended = int(((data["outcome"] != 0) & (data["run_id"] != "")).sum())
    runs = ": no run has ended yet" if not ended else f", and {ended} run{'s' * (ended > 1)}"
    data = data.assign_attrs({ESTIMATE: f"An estimate{runs}"})
    if drops is not None:
        missing = data["outcome"] == OUTCOME_FLAGS.index("missing")
        data["drop_rel"] = data["drop_rel"].where(~missing, drops)
    return data


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
    known_there, depths = _measures(known, cases)
    found = np.stack([*margins_by_atlas(known_there, study.regime.drop), known_there.uncut(depths)], axis=1)
    every = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    coarse = [len(t) for t in ticks]
    mean, score, drop, uncut = (
        RegularGridInterpolator(ticks, column.reshape(coarse))(every) for column in found.T
    )
    spread = spread_of(mean, score)
    away = distance_to_boundary(mean >= 0) / 2
    unsure = (np.abs(score) < NORMAL_QUANTILE) & (away > 1)
    labels = np.where(mean >= 0, LABELS.index(ABRUPT), LABELS.index(SMOOTH))
    labels = np.where(uncut > 0.5, LABELS.index(UNCUT), labels)
    return BoundaryEstimate(mean, spread, unsure, drop), np.where(uncut > 0.5, np.nan, drop), labels


def _measures(known: Atlas, cases: Sequence[Case]) -> tuple[Measures, np.ndarray]:
    """Of cases, and their depths (p,) in halves of the blade's thickness. Raises NotInAtlas."""
    values = np.array([known.values(case) for case in cases])
    depths = np.array([depth_of(case) for case in cases])
    return known.measures(values, depths), depths


def _inside(known: Atlas, case: Case) -> bool:
    try:
        known.values(case)
    except NotInAtlas:
        return False
    return True


def _rows(known: Atlas, cases: Sequence[Case], study: Study) -> dict[str, MapRow]:
    """What a map shows of cases, by id. Raises NotInAtlas."""
    found: dict[str, MapRow] = {}
    if not cases:
        return found
    m, depths = _measures(known, cases)
    drops, uncut = np.clip(m.drop[:, 0], 0.0, 1.0) ** 2, m.uncut(depths) > 0.5
    for case, onset, drop, is_uncut in zip(cases, np.exp(m.onset[:, 0]), drops, uncut, strict=True):
        drop_rel = math.nan if is_uncut else float(drop)
        of_curve = {
            "drop_rel": drop_rel,
            "onset_mm": math.nan if is_uncut else float(onset) * case.values["thickness"] / 2,
        }
        found[case.id] = MapRow(
            "done", ESTIMATED, case.values["depth"], label(drop_rel, drop=study.regime.drop),
            {**MapRow().measures, **of_curve},
        )  # fmt: skip
    return found


def write_estimated(study: Study, folder: Path) -> xr.Dataset:
    """``map.nc``, ``map.csv``, ``map.html`` and the pictures of ``estimated_map`` into ``folder``.

    Raises BadInput if a map of runs lies there.
    """
    there = folder / "map.nc"
    if there.is_file() and not load_map(there).attrs[ESTIMATE]:
        raise BadInput("out", str(folder), "a folder without a map of runs: an estimate does not replace it")
    folder.mkdir(parents=True, exist_ok=True)
    data = estimated_map(study).assign_attrs({ESTIMATE: "An estimate: no run of its own"})
    save_map(data, folder)
    save_phase(data, folder)
    write_text(page(data, None), folder / "map.html")
    return data
