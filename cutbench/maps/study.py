"""A study: a base case, the axes over which it is varied, how, and how its regimes are told apart.

``load_study`` reads TOML strictly: whatever it would have to guess or ignore is refused, with the
file, the line, the key, the value, and what would be right.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cutbench.base.errors import require
from cutbench.base.sections import SOME, Entry, read_section
from cutbench.base.toml import TomlFile, read_toml
from cutbench.case import materials
from cutbench.case.case import CASE_SECTIONS, Case, load_case
from cutbench.case.model import Model
from cutbench.case.motion import TRANSITION
from cutbench.case.physics import Physics
from cutbench.case.values import check_driven, names, parameter_of, section_changes
from cutbench.maps.axes import (
    BOUNDARY,
    GRID,
    MODES,
    SAMPLE,
    Axis,
    coarse_to_fine,
    read_axes,
    sobol,
    switched,
)
from cutbench.maps.marked_materials import Mark, read_mark
from cutbench.maps.study_sections import (
    PLOT,
    REGIME,
    SAMPLES,
    UNCERTAINTY,
    Doubtful,
    Plot,
    Regime,
    Search,
    read_plot,
    read_search,
)
from cutbench.run.measures import ONSET

#: Sections that are for some modes alone.
_FOR_MODES = {"sample": (SAMPLE,), "boundary": (BOUNDARY,), "uncertainty": (GRID, BOUNDARY)}
_FILE = (
    Entry("title", str, "a title, such as 'Smooth and abrupt cutting'"),
    Entry("mode", default=GRID, choices=MODES),
    Entry("base", str, f"a material ({', '.join(materials.names())}) or a case file", needed=True),
    Entry("mechanisms", names),
    *(Entry(section, dict, default={}) for section in CASE_SECTIONS),
    Entry("axis", dict, "sections written [[axis]], each with name and values", needed=True, count=SOME),
    Entry("sample", SAMPLES),
    Entry("boundary", dict, default={}),
    Entry("regime", REGIME, default=read_section({}, REGIME)),
    Entry("uncertainty", UNCERTAINTY, default={"runs": 0, "bands": 0}),
    Entry("plot", PLOT, default=read_section({}, PLOT)),
)


Startable = TypeVar("Startable", Case, Physics)


@dataclass(frozen=True, repr=False)
class Study:
    """A study says over which parameters cuts are computed for a map, and how the map is drawn.

    It is checked when it is read.

    Attributes
    ----------
    path : Path
        The file that it was read from.
    title : str
        What it is called.
    text : str
        The text of the file.
    base : Case
        The case that its points differ from.
    axes : tuple of Axis
        What is varied.
    grid : tuple of Case
        Its cases; none where a boundary is sought, for which cases are asked for on the way.
    regime : Regime
        What tells smooth from abrupt.
    plot : Plot
        Which axes a picture shows, and which materials it marks.
    mode : str
        ``grid``, ``sobol`` (samples) or ``boundary``.
    samples : tuple of tuple of float
        Values by axis, in the axes' units, where they do not lie on a grid.
    search : Search or None
        How a boundary is sought.
    start : Case or None
        The base before the study's changes.
    changes : mapping of str to object
        The study's changes, as ``Case.set`` takes them.
    doubtful : Doubtful
        How the uncertainty of the map is found.

    Examples
    --------
    >>> import tempfile
    >>> import cutbench
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     examples = cutbench.copy_examples(folder + "/examples")
    ...     study = cutbench.load_study(examples / "regimes.toml")
    >>> [axis.name for axis in study.axes], study.shape, len(study.cases())
    (['cohesion', 'viscosity', 'adhesion'], (3, 4, 3), 36)
    """

    path: Path
    title: str
    text: str
    base: Case
    axes: tuple[Axis, ...]
    grid: tuple[Case, ...]
    regime: Regime
    plot: Plot
    mode: str = GRID
    samples: tuple[tuple[float, ...], ...] = ()
    search: Search | None = None
    start: Case | None = None
    changes: Mapping[str, object] = field(default_factory=dict)
    doubtful: Doubtful = field(default_factory=Doubtful)

    def __repr__(self) -> str:
        axes = [f"  {a.name}  {a.values[0]:g} to {a.values[-1]:g}" for a in self.axes]
        return "\n".join([f"Study: {self.title}", f"  base  {self.base.name}, {self.mode}", *axes])

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of points along each axis; without a grid, the number of points."""
        return tuple(len(axis.values) for axis in self.axes) if self.on_grid else (len(self.grid),)

    @property
    def on_grid(self) -> bool:
        """Whether points are numbered by their place on each axis, or one after the other."""
        return self.mode in (GRID, BOUNDARY)

    def points(self) -> Iterator[tuple[tuple[int, ...], Case]]:
        """Iterate over all points that are known beforehand, row by row.

        Returns
        -------
        iterator of (tuple of int, Case)
            The index of each point on the axes, and its case.
        """
        if self.mode == BOUNDARY:
            return iter(())
        return zip(np.ndindex(self.shape), self.grid, strict=True)

    def cases(self) -> list[Case]:
        """Return all cases, on a grid coarse to fine: any beginning is spread over the whole map.

        Returns
        -------
        list of Case
            In the order in which they are run.
        """
        return [self.grid[i] for i in self._order]

    @cached_property
    def _order(self) -> tuple[int, ...]:
        return coarse_to_fine(self.shape) if self.mode == GRID else tuple(range(len(self.grid)))

    def case_at(self, values: Sequence[float]) -> Case:
        """Make the case at a place of the map.

        Parameters
        ----------
        values : sequence of float
            A value for each axis, in the axis' unit.

        Returns
        -------
        Case
            The study's case with these values.

        Raises
        ------
        BadInput
            If they do not fit one another.
        """
        return case_at(self.start or self.base, self.changes, self.axes, values)

    def marks(self) -> tuple[Mark, ...]:
        """Return the marked materials on the study's axes.

        Returns
        -------
        tuple of Mark
            Names, places and cases.

        Raises
        ------
        BadInput
            For a material that is not there, or that this study cannot run.
        """
        return self._marks

    @cached_property
    def _marks(self) -> tuple[Mark, ...]:
        marks: dict[str, Mark] = {}
        for source in self.plot.mark:
            with TomlFile(self.path, {}, self.text).at("plot"):
                mark = read_mark(source, self.path.parent, self.base, self.axes, self.case_at)
                alike = mark.name in marks
                require(not alike, "mark", source, f"materials of different names: two are '{mark.name}'")
                marks[mark.name] = mark
        return tuple(marks.values())


def case_at(
    start: Startable, changes: Mapping[str, object], axes: Sequence[Axis], values: Sequence[float]
) -> Startable:
    """``start`` with ``changes`` and the values of the axes, the switched mechanisms first.

    Groups among the changes are solved anew: they hold along the axes. What ``changes`` say about a
    mechanism that is switched out goes with it; an axis that sets something of it is refused.
    """
    switches = {a.mechanism: bool(v) for a, v in zip(axes, values, strict=True) if a.mechanism}
    model = start.model
    for name, on in switches.items():
        if on:
            model = model.with_(name)
        elif name in model.mechanisms:
            model = model.without(name)
    mine = dict(changes)
    if switches:
        mine["mechanisms"] = model.mechanisms
        here, elsewhere = model.parameters(), start.model.with_(*switches).parameters()
        for key in changes:
            sets = parameter_of(key)
            if sets in elsewhere and sets not in here:
                del mine[key]
    own = {a.name: a.text(v) for a, v in zip(axes, values, strict=True) if not a.mechanism}
    return start.set(**mine, **own)


def load_study(path: str | Path) -> Study:
    """Read a study of a map from a TOML file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Study
        Checked, with its cases.

    Raises
    ------
    BadInput
        For every error that a person can make in it, with file and line.

    Examples
    --------
    >>> import tempfile
    >>> import cutbench
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     examples = cutbench.copy_examples(folder + "/examples")
    ...     study = cutbench.load_study(examples / "boundary.toml")
    >>> study.mode, study.base.name
    ('boundary', 'gelatin')
    """
    file = read_toml(path, "axis")
    with file.at():
        top = read_section(file.table, _FILE)
        for section, modes in _FOR_MODES.items():
            only = f"it only where mode = {' or '.join(map(repr, modes))}"
            require(section not in file.table or top["mode"] in modes, section, f"[{section}]", only)
        points = top["sample"] or top["mode"] != SAMPLE
        require(points, "sample", "(missing)", "[sample] with points = 100 or so")
        start = _base(file, top)
    mode, whole = top["mode"], start.model.with_(*switched(top["axis"]))
    changes, places = section_changes(file, {section: top[section] for section in CASE_SECTIONS}, whole)
    with file.at(places):
        base = start.set(mechanisms=whole.mechanisms, **changes)
    axes = read_axes(file, top["axis"], base.model, changes, mode)
    with file.at("regime"):
        regime = _regime(top["regime"], base)
    with file.at("plot"):
        plot = read_plot(top["plot"], axes)
    with file.at("boundary"):
        search = read_search(top["boundary"], axes) if mode == BOUNDARY else None
    samples: tuple[tuple[float, ...], ...] = ()
    if mode == SAMPLE:
        points, seeds = top["sample"].values()
        samples = tuple(place for seed in seeds for place in sobol(axes, points, seed))
    with file.at(places):
        at = samples or itertools.product(*_grid(axes, ends=mode == BOUNDARY))
        cases = tuple(case_at(start, changes, axes, values) for values in at)
        for model in {case.model for case in cases}:
            check_driven(model)
    study = Study(
        file.path, top["title"] or file.path.stem, file.text, base, axes, () if mode == BOUNDARY else cases,
        regime, plot, mode, samples, search, start, changes, Doubtful(**top["uncertainty"]),
    )  # fmt: skip
    study.marks()  # what is wrong with one is said before anything is run
    return study


def _regime(part: Mapping[str, Any], base: Case) -> Regime:
    """What ``[regime]`` says, for runs of ``base`` and their like."""
    length, usual = part["onset_length"], ONSET * base.unit_mm
    if base.until == TRANSITION:
        expected = f"at most {usual:g} mm: a run until its transition ends behind the onset by that length"
        require((length or usual) <= usual * (1 + 1e-9), "onset_length", f"{length} mm", expected)
    return Regime(part["drop"], part["surge"], length, part["rest"])


def _grid(axes: Sequence[Axis], ends: bool) -> list[tuple[float, ...]]:
    """The values on each of the ``axes``; with ``ends`` of a continuous one its ends and its middle, which
    stand for all that a search may ask for."""

    def of(values: tuple[float, ...]) -> tuple[float, ...]:
        return values[0], values[len(values) // 2], values[-1]

    return [of(axis.values) if ends and axis.continuous else axis.values for axis in axes]


def _base(file: TomlFile, top: Mapping[str, Any]) -> Case:
    """The case that a study begins from, with its mechanisms."""
    case = load_case(materials.find(file.beside(top["base"]), key="base"))
    if top["mechanisms"] is None:
        return case
    # What the laws need and the base does not have is given beside them, in a section or along an axis.
    needed = Model(top["mechanisms"]).parameters().keys() - case.values.keys()
    asked = {key: raw for section in CASE_SECTIONS for key, raw in top[section].items()}
    for axis in top["axis"]:
        ends = axis.get("values", [axis.get("from")])
        asked[str(axis.get("name"))] = ends[0] if isinstance(ends, list) and ends else None
    values = {key: raw for key, raw in asked.items() if key in needed and raw is not None}
    return case.set(mechanisms=top["mechanisms"], **values)
