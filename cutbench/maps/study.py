"""A study: a base case, the axes over which it is varied, how, and how its regimes are told apart.

``load_study`` reads TOML strictly: whatever it would have to guess or ignore is refused, with the
file, the line, the key, the value, and what would be right.
"""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.toml import among, line_of, located, read_toml, refuse_other, written
from cutbench.case import materials
from cutbench.case.case import Case, load_case
from cutbench.case.model import Model, section_of
from cutbench.case.motion import TRANSITION
from cutbench.case.physics import Physics
from cutbench.case.values import check_driven, names, parameter_of
from cutbench.maps.axes import (
    BOUNDARY,
    GRID,
    MODES,
    SAMPLE,
    Axis,
    read_axes,
    refuse_unknown,
    switched,
)
from cutbench.maps.marked_materials import Mark, read_mark
from cutbench.maps.sampling import coarse_to_fine, sobol
from cutbench.maps.study_sections import (
    Doubtful,
    Plot,
    Regime,
    Search,
    read_plot,
    read_regime,
    read_sample,
    read_search,
    read_section,
    read_uncertainty,
)
from cutbench.run.measures import ONSET

_SECTIONS = ("parameters", "specimen", "blade", "protocol", "numerics")
_OWN = ("axis", "sample", "boundary", "regime", "uncertainty", "plot")
_TOP = ("title", "mode", "base", "mechanisms", *_SECTIONS, *_OWN)


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
        found: list[Mark] = []
        for source in self.plot.mark:
            try:
                mark = read_mark(source, self.path.parent, self.base, self.axes, self.case_at)
                if mark.name in [other.name for other in found]:
                    raise BadInput("mark", source, f"materials of different names: two are '{mark.name}'")
            except BadInput as error:
                if error.file is not None:  # in the material's own file
                    raise
                named = error.key in ("mark", "material")
                expected = error.expected if named else f"a material that this study can run: {error}"
                raise BadInput(
                    "mark", source, expected, file=str(self.path), line=line_of(self.text, "mark", "plot")
                ) from error
            found.append(mark)
        return tuple(found)


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
    kept = dict(changes)
    if switches:
        kept["mechanisms"] = model.mechanisms
        here, elsewhere = model.parameters(), start.model.with_(*switches).parameters()
        for key in changes:
            sets = parameter_of(key)
            if sets in elsewhere and sets not in here:
                del kept[key]
    own = {a.name: a.text(v) for a, v in zip(axes, values, strict=True) if not a.mechanism}
    return start.set(**kept, **own)


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
    path = Path(path)
    table, text = _read(path)
    refuse_other(table, path, "axis")
    with located(path, text):
        refuse_unknown(table, _TOP)
        title = table.get("title", path.stem)
        written("title", title, "a title, such as 'Smooth and abrupt cutting'")
        mode = table.get("mode", GRID)
        among("mode", mode, MODES)
        for section, owner in (("sample", SAMPLE), ("boundary", BOUNDARY)):
            if section in table and mode != owner:
                raise BadInput(section, f"[{section}]", f"it only where mode = '{owner}'")
        start = _base(table, path)
    switches = switched(table)
    whole = start.model.with_(*switches) if switches else start.model
    changes = _changes(table, path, text, whole)
    with located(path, text):
        base = start.set(mechanisms=whole.mechanisms, **changes)
    axes = read_axes(table, path, text, base.model, changes, mode)
    with located(path, text, "regime"):
        regime = _regime(table, base)
    with located(path, text, "uncertainty"):
        doubtful = _doubtful(table, mode)
    with located(path, text, "plot"):
        plot = read_plot(read_section(table, "plot"), axes)
    search: Search | None = None
    samples: tuple[tuple[float, ...], ...] = ()
    if mode == BOUNDARY:
        with located(path, text, "boundary"):
            search = read_search(read_section(table, "boundary"), axes)
    elif mode == SAMPLE:
        with located(path, text, "sample"):
            points, seeds = read_sample(read_section(table, "sample"))
            samples = tuple(place for seed in seeds for place in sobol(axes, points, seed))
    places = samples or itertools.product(*_grid(axes, ends=mode == BOUNDARY))
    with located(path, text):
        cases = tuple(case_at(start, changes, axes, values) for values in places)
        for model in {case.model for case in cases}:
            check_driven(model)
    study = Study(
        path, title, text, base, axes, () if mode == BOUNDARY else cases, regime, plot, mode, samples,
        search, start, changes, doubtful,
    )  # fmt: skip
    study.marks()  # what is wrong with one is said before anything is run
    return study


def _regime(table: dict, base: Case) -> Regime:
    """What ``[regime]`` says, for runs of ``base`` and their like."""
    regime = read_regime(read_section(table, "regime"))
    usual = ONSET * base.unit_mm
    if base.until == TRANSITION and (regime.onset_length_mm or usual) > usual * (1 + 1e-9):
        expected = f"at most {usual:g} mm: a run until its transition ends behind the onset by that length"
        raise BadInput("onset_length", f"{regime.onset_length_mm:g} mm", expected)
    return regime


def _doubtful(table: dict, mode: str) -> Doubtful:
    """What ``[uncertainty]`` says, if there is one."""
    if "uncertainty" not in table:
        return Doubtful()
    if mode not in (GRID, BOUNDARY):
        raise BadInput("uncertainty", "[uncertainty]", f"it only where mode = '{GRID}' or '{BOUNDARY}'")
    return read_uncertainty(read_section(table, "uncertainty"))


def _grid(axes: Sequence[Axis], ends: bool) -> list[tuple[float, ...]]:
    """The values on each of the ``axes``; with ``ends`` of a continuous one its ends and its middle, which
    stand for all that a search may ask for."""

    def of(values: tuple[float, ...]) -> tuple[float, ...]:
        return values[0], values[len(values) // 2], values[-1]

    return [of(axis.values) if ends and axis.continuous else axis.values for axis in axes]


def _read(path: Path) -> tuple[dict, str]:
    """``read_toml``, with the line where a list or a string was left open, not the one after it."""
    try:
        return read_toml(path)
    except BadInput as error:
        if error.key != "TOML" or error.line is None:
            raise
        lines = path.read_text(encoding="utf-8").splitlines()
        for n in range(min(error.line, len(lines)) - 1, 0, -1):
            try:
                tomllib.loads("\n".join(lines[:n]))
            except tomllib.TOMLDecodeError:
                continue
            # Line n + 1 begins what cannot be read; a new statement below it was none of its lines.
            if re.match(r"\s*([\w\"'.-]+\s*=|\[)", lines[error.line - 1]) and n + 1 < error.line:
                while not lines[n].split("#")[0].strip():
                    n += 1
                raise BadInput(
                    "TOML", lines[n].strip(), error.expected, file=error.file, line=n + 1
                ) from error
            break
        raise


def _base(table: dict, path: Path) -> Case:
    if "base" not in table:
        raise BadInput("base", "(missing)", f"a material ({', '.join(materials.names())}) or a case file")
    source = table["base"]
    if not isinstance(source, str):
        raise BadInput("base", source, "a material's name or a case file")
    near = path.parent / source
    try:
        case = load_case(near if near.is_file() else source)
    except BadInput as error:
        if error.file is not None:  # in the case file itself
            raise
        raise BadInput("base", source, error.expected) from error
    if "mechanisms" not in table:
        return case
    # What the laws need and the base does not have is given beside them, in a section or along an axis.
    needed = Model(names("mechanisms", table["mechanisms"])).parameters().keys() - case.values.keys()
    asked = [part for section in _SECTIONS if isinstance(part := table.get(section), dict)]
    for axis in table.get("axis", []) if isinstance(table.get("axis"), list) else []:
        if isinstance(axis, dict) and isinstance(ends := axis.get("values", [axis.get("from")]), list):
            asked.append({str(axis.get("name")): ends[0] if ends else None})
    given = {key: raw for part in asked for key, raw in part.items() if key in needed and raw is not None}
    return case.set(mechanisms=table["mechanisms"], **given)


def _changes(table: dict, path: Path, text: str, model: Model) -> dict[str, object]:
    """What the sections set, as ``Case.set`` takes it."""
    known = model.parameters()
    changes: dict[str, object] = {}
    for section in _SECTIONS:
        with located(path, text, section):
            part = read_section(table, section)
            for key, raw in part.items():
                if key in known and section_of(key) != section:
                    raise BadInput(key, raw, f"it in [{section_of(key)}], not in [{section}]")
                if key in ("motion", "until") and section != "protocol":
                    raise BadInput(key, raw, f"it in [protocol], not in [{section}]")
                if key in ("name", "with", "with_", "without", "mechanisms"):
                    raise BadInput(key, raw, f"a quantity in [{section}]")
                if key in changes:
                    raise BadInput(key, raw, "each quantity once")
            changes |= part
    return changes
