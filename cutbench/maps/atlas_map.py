"""A map from the atlas: a whole phase diagram at once, with what is unsure hatched."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

from cutbench.base.errors import BadInput
from cutbench.base.files import write_text
from cutbench.base.toml import line_of
from cutbench.case.case import Case
from cutbench.emulator.atlas import Atlas, Measures, NotInAtlas, depth_of, shipped, values_of
from cutbench.emulator.design_space import BLADES
from cutbench.maps.axes import BOUNDARY
from cutbench.maps.boundary import (
    NORMAL_QUANTILE,
    BoundaryEstimate,
    Index,
    distance_to_boundary,
    levels_of,
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
    """What the runs of a study would give: a map like that of runs, in which no point has one. Raises
    NotInAtlas if a part of it lies outside the atlas."""
    if study.regime.surge_min is not None:
        line = line_of(study.text, "surge", "regime")
        expected = "none where a map is estimated: the atlas knows drops alone"
        raise BadInput("surge", study.regime.surge_min, expected, file=str(study.path), line=line)
    atlas, rows = shipped(), dict[str, MapRow]()
    for mark in study.marks():
        with suppress(NotInAtlas):
            rows |= _rows(atlas, [mark.case], study)
    if study.mode != BOUNDARY:
        return build_map(study, rows | _rows(atlas, [case for _, case in study.points()], study))
    margins, drops = {}, np.full(study.shape, math.nan)
    labels = np.zeros(study.shape, dtype=np.int8)
    for chosen, where, level in _levels(atlas, study):
        margins[chosen], drops[where], labels[where] = level
    data = build_map(study, rows, {}, margins)
    data["drop_rel"].values[...], data["label"].values[...] = drops, labels
    return data


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
    atlas, own = shipped(), study.base.to_dict()["numerics"]
    # A choice that cutbench has had since stands at its default in the atlas.
    theirs = next(iter(BLADES.values())).base.to_dict()["numerics"] | atlas.about["numerics"]
    return study.regime.surge_min is None and own == theirs


def under_way(data: xr.Dataset, drops: np.ndarray | None) -> xr.Dataset:
    """A map with what ``expected_drops`` gives where no run has ended, for pictures; they say that it is
    estimated. The same map where nothing is expected."""
    if drops is None and "drop_rel_expected" not in data:
        return data
    ended = int(((data["outcome"] != 0) & (data["run_id"] != "")).sum())
    runs = ": no run has ended yet" if not ended else f", and {ended} run{'s' * (ended > 1)}"
    data = data.assign_attrs({ESTIMATE: f"An estimate{runs}"})
    if drops is not None:
        missing = data["outcome"] == OUTCOME_FLAGS.index("missing")
        data["drop_rel"] = data["drop_rel"].where(~missing, drops)
    return data


Level = tuple[BoundaryEstimate, np.ndarray, np.ndarray]


def _levels(atlas: Atlas, study: Study) -> Iterator[tuple[Index, tuple[slice | int, ...], Level]]:
    """Of each combination of levels its indices, where it lies in the map, and what is estimated there:
    margins, drops and labels on the lattice of the other axes."""
    for chosen, where in levels_of(study.axes):
        shape = [n for n, k in zip(study.shape, where, strict=True) if isinstance(k, slice)]
        ticks = [np.unique(np.linspace(0, n - 1, PLACES).round().astype(int)) for n in shape]
        along = iter(ticks)
        indices = itertools.product(*([k] if isinstance(k, int) else next(along) for k in where))
        cases = [
            study.case_at([axis.values[i] for axis, i in zip(study.axes, index, strict=True)])
            for index in indices
        ]
        estimates, depths = _measures(atlas, cases)
        columns = *margins_by_atlas(estimates, study.regime.drop), estimates.uncut(depths)
        every = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
        coarse = [len(t) for t in ticks]
        mean, score, drop, uncut = (
            RegularGridInterpolator(ticks, column.reshape(coarse))(every) for column in columns
        )
        away = distance_to_boundary(mean >= 0) / 2
        unsure = (np.abs(score) < NORMAL_QUANTILE) & (away > 1)
        labels = np.where(mean >= 0, LABELS.index(ABRUPT), LABELS.index(SMOOTH))
        labels = np.where(uncut > 0.5, LABELS.index(UNCUT), labels)
        estimate = BoundaryEstimate(mean, spread_of(mean, score), unsure, drop)
        yield chosen, where, (estimate, np.where(uncut > 0.5, np.nan, drop), labels)


def _measures(atlas: Atlas, cases: Sequence[Case]) -> tuple[Measures, np.ndarray]:
    """Of cases, and their depths (p,) in halves of the blade's thickness. Raises NotInAtlas."""
    values = np.array([values_of(case) for case in cases])
    depths = np.array([depth_of(case) for case in cases])
    return atlas.measures(values, depths), depths


def _rows(atlas: Atlas, cases: Sequence[Case], study: Study) -> dict[str, MapRow]:
    """What a map shows of cases, by id. Raises NotInAtlas."""
    rows: dict[str, MapRow] = {}
    m, depths = _measures(atlas, cases)
    drops, uncut = np.clip(m.drop[:, 0], 0.0, 1.0) ** 2, m.uncut(depths) > 0.5
    for case, onset, drop, is_uncut in zip(cases, np.exp(m.onset[:, 0]), drops, uncut, strict=True):
        drop_rel = math.nan if is_uncut else float(drop)
        of_curve = {
            "drop_rel": drop_rel,
            "onset_mm": math.nan if is_uncut else float(onset) * case.values["thickness"] / 2,
        }
        rows[case.id] = MapRow(
            "done", ESTIMATED, case.values["depth"], label(drop_rel, drop=study.regime.drop),
            {**MapRow().measures, **of_curve},
        )  # fmt: skip
    return rows


def write_estimated(study: Study, folder: Path) -> xr.Dataset:
    """``map.nc``, ``map.csv``, ``map.html`` and the pictures of ``estimated_map`` into ``folder``.

    Raises BadInput if a map of runs lies there.
    """
    earlier = folder / "map.nc"
    if earlier.is_file() and not load_map(earlier).attrs[ESTIMATE]:
        raise BadInput("out", str(folder), "a folder without a map of runs: an estimate does not replace it")
    folder.mkdir(parents=True, exist_ok=True)
    data = estimated_map(study).assign_attrs({ESTIMATE: "An estimate: no run of its own"})
    save_map(data, folder)
    save_phase(data, folder)
    write_text(page(data, None), folder / "map.html")
    return data
