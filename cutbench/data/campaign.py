"""A campaign: measured tests of one material, where to start, and which mechanisms may explain them.

``load_campaign`` reads TOML strictly; a campaign can be built in Python too, from ``start_case`` and
``Experiment``s. Measured files are only read.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from cutbench.base.display import Displayed
from cutbench.base.errors import BadInput, require
from cutbench.base.sections import SOME, Entry, read_section
from cutbench.base.toml import TomlFile, among, read_toml
from cutbench.base.units import unit_factor
from cutbench.case.case import Case, load_case
from cutbench.case.model import SETS, Model, mechanism
from cutbench.case.motion import Polyline, simplified
from cutbench.case.numerics import KEYS
from cutbench.case.values import names, resolve
from cutbench.data import plausible
from cutbench.data.contact import bounds_by
from cutbench.data.experiment import SLOTS, Experiment
from cutbench.data.experiment_section import blade_units
from cutbench.data.read_experiment import read_experiments
from cutbench.data.repetition import note_on_single_repetition
from cutbench.mechanisms import Tool, Volumetric, registry

#: Places in time at which the way of a blade that holds or returns is read off, before it is simplified.
MOTION = 120
#: Speeds within this factor are one.
EVEN_SPEED = 1.2


def _some_names(raw: object, *, key: str) -> tuple[str, ...]:
    return () if raw == [] else names(raw, key=key)


_BOUNDS = "two values, the lowest and the highest, such as G = ['1 kPa', '900 kPa']"
_FIT = (
    *(Entry(key, _some_names) for key in ("free", "fixed", "own")),
    Entry("bounds", dict, f"of each parameter {_BOUNDS}", default={}),
)
_FILE = (
    Entry("title", str, "a title, such as 'PDMS, three speeds'"),
    Entry("material", str, "a known name or a TOML file"),
    Entry("baseline", names),
    Entry("candidates", _some_names, default="all"),
    Entry("parameters", dict, default={}),
    Entry("numerics", dict, default={}),
    Entry("fit", _FIT, default=read_section({}, _FIT)),
    Entry("experiment", dict, "one or more, each opened with [[experiment]]", needed=True, count=SOME),
)


@dataclass(frozen=True)
class FitPlan:
    """A plan says what a fit may change.

    Attributes
    ----------
    free : tuple of str or None
        Parameters that are fitted; None: the fit chooses.
    fixed : tuple of str
        Parameters that stay as they are.
    own : tuple of str
        Parameters with one value for each experiment.
    bounds : mapping of str to (float, float)
        The lowest and the highest value by parameter, internal units.

    Raises
    ------
    BadInput
        For a parameter that is fixed, and also free or each experiment's own.
    """

    free: tuple[str, ...] | None = None
    fixed: tuple[str, ...] = ()
    own: tuple[str, ...] = ()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.fixed:
            fitted = name in (*(self.free or ()), *self.own)
            require(not fitted, "fixed", name, "a parameter that is not free")
        object.__setattr__(self, "bounds", MappingProxyType(dict(self.bounds)))

    def __reduce__(self):
        return FitPlan, (self.free, self.fixed, self.own, dict(self.bounds))


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Displayed):
    """A campaign holds measured tests of one material, the start of a fit, and candidates for its laws.

    It is checked when it is made. ``load_campaign`` reads one from a TOML file.

    Attributes
    ----------
    title : str
        What it is called.
    base : Case
        The baseline's mechanisms and the start values.
    experiments : tuple of Experiment
        The tests.
    candidates : tuple of str
        Mechanisms that a discovery may add.
    plan : FitPlan
        What a fit may change.
    path : Path or None
        The file that it was read from.
    notes : tuple of str
        What was assumed.
    material : str, Path or None
        The known name or the file of the start values, which may know more than the tests see.

    Raises
    ------
    BadInput
        If two experiments share an id, none is to be fitted, or readings cannot be of the material (see
        ``cutbench.data.plausible``).

    Examples
    --------
    >>> import cutbench
    >>> import numpy as np
    >>> from cutbench.data import Experiment, Repetition, start_case
    >>> stretch = np.linspace(1.02, 1.5, 30)
    >>> stress = 0.01 * (stretch - stretch**-2)  # MPa, of a solid whose shear modulus is 10 kPa
    >>> pulled = Experiment("pulled", "uniaxial", (Repetition(stretch, stress),))
    >>> laws, soft = ["neo_hookean", "volumetric"], {"G": "20 kPa", "nu": 0.499}
    >>> base, _ = start_case(None, baseline=laws, kinds=["uniaxial"], parameters=soft)
    >>> cutbench.Campaign("Pulled", base, (pulled,))
    Campaign: Pulled
      baseline  neo_hookean, volumetric
      pulled    uniaxial, 1 repetition, 30 readings, train
    """

    display_module: ClassVar[str] = "cutbench.data.figure"

    title: str
    base: Case
    experiments: tuple[Experiment, ...]
    candidates: tuple[str, ...] = ()
    plan: FitPlan = field(default_factory=FitPlan)
    path: Path | None = None
    notes: tuple[str, ...] = ()
    material: str | Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "experiments", tuple(self.experiments))
        require(self.experiments, "experiment", "(missing)", "one experiment or more")
        for id, count in Counter(e.id for e in self.experiments).items():
            require(count == 1, "id", id, "each id once")
        for e in self.experiments:
            _check(e, self.base)
        require(self.train, "role", "test in all", "one experiment or more of role 'train'")

    @property
    def model(self) -> Model:
        """The mechanisms of the baseline."""
        return self.base.model

    @property
    def train(self) -> tuple[Experiment, ...]:
        """The experiments that a fit uses."""
        return tuple(e for e in self.experiments if e.role == "train")

    @property
    def test(self) -> tuple[Experiment, ...]:
        """The experiments that are predicted and never fitted."""
        return tuple(e for e in self.experiments if e.role == "test")

    @cached_property
    def angles(self) -> frozenset[int]:
        """The angles of the specimens of fitted tests that show a direction, in degrees of half a turn."""
        shown = (e for e in self.train if e.kind != "sliding")
        return frozenset(round(math.degrees(e.angle)) % 180 for e in shown)

    @property
    def finds_angles(self) -> bool:
        """Whether tests say a direction in the body, and none is meshed by it."""
        return len(self.angles) > 1 and all(e.kind != "cut" for e in self.experiments)

    def experiment(self, id: str) -> Experiment:
        """Return an experiment by its id.

        Parameters
        ----------
        id : str
            What it is called.

        Returns
        -------
        Experiment
            The one of that id.

        Raises
        ------
        BadInput
            If there is none; it names the nearest.
        """
        by_id = {e.id: e for e in self.experiments}
        among("experiment", id, by_id)
        return by_id[id]

    def case(self, experiment: Experiment | str, base: Case | None = None) -> Case:
        """Make the case that computes a ``cut`` test.

        Parameters
        ----------
        experiment : Experiment or str
            The test, or its id.
        base : Case, optional
            The model and its values; those of the campaign unless given.

        Returns
        -------
        Case
            ``base`` with the test's specimen, blade, speed and depth. That of a test with holds, returns or
            several speeds has its motion.

        Raises
        ------
        BadInput
            If they do not fit together.
        """
        e = self.experiment(experiment) if isinstance(experiment, str) else experiment
        return cut_case(e, base or self.base)

    def all_notes(self) -> list[str]:
        """Return what was assumed or is not known, of the campaign and of each experiment.

        Returns
        -------
        list of str
            A sentence each.
        """
        of_tests = [f"'{e.id}': {note}" for e in self.experiments for note in e.notes]
        alone = [
            note_on_single_repetition(e.id) for e in self.experiments if e.curve and len(e.repetitions) == 1
        ]
        return [*self.doubts, *self.notes, *of_tests, *alone]

    @cached_property
    def doubts(self) -> list[str]:
        """Sentences on readings that may well be otherwise, and what settles each."""
        of_tests = [f"'{e.id}': {text}" for e in self.experiments for text in plausible.doubts(e)]
        return of_tests + [f"'{r.name}': {text}" for r, text, _ in plausible.copies(self.experiments)]


def cut_case(experiment: Experiment, base: Case) -> Case:
    """``base`` with the specimen, the blade, the speed and the depth of a ``cut`` test. Raises BadInput."""
    known = base.model.parameters()
    sizes: dict[str, object] = {n: value for n, value in _sizes(experiment).items() if n in known}
    sizes |= {n: f"{math.degrees(angle)!r} deg" for n, angle in base.model.turned(experiment.angle).items()}
    # What was set on the machine is exact; six digits are what a time column gives.
    speed = f"{experiment.speed or float(f'{experiment.travel_speed:.6g}')!r} mm/s"
    if experiment.timed:
        motion = measured_motion(experiment)
        if not experiment.monotone or _uneven(motion):
            sizes["motion"] = motion
    # As far as it was measured, wherever the base ends.
    return base.set(**sizes, speed=speed, until="depth", name=f"{base.name}: {experiment.id}")


def _uneven(motion: Polyline) -> bool:
    """Whether the blade's speed differs between the parts of its way."""
    times, travels = zip(*motion, strict=True)
    speeds = np.diff(travels) / np.diff(times)
    return bool(speeds.max() > EVEN_SPEED * speeds.min())


@lru_cache(maxsize=64)  # asked for each case of a search
def measured_motion(experiment: Experiment) -> Polyline:
    """The way of the blade in a test with holds or returns: that of the repetitions' mean.

    It begins in the time that the blade takes from the top to where the first reading found it.
    """
    grid = experiment.on_grid(MOTION)
    assert grid.time_s is not None, "a motion is measured in a timed test"
    travel = np.clip(grid.x, 0.0, experiment.reach)
    first = lead_s(experiment)
    points = [(first + float(t), float(d)) for t, d in zip(grid.time_s - grid.time_s[0], travel, strict=True)]
    return simplified(((0.0, 0.0), *(points if first else points[1:])))


def lead_s(experiment: Experiment) -> float:
    """Seconds from contact to the first reading, at the test's speed; none within a hundredth of a mm."""
    first = float(np.mean([r.x[0] for r in experiment.repetitions]))
    return first / (experiment.speed or experiment.travel_speed) if first > 0.01 else 0.0


def _sizes(experiment: Experiment) -> dict[str, str]:
    """Specimen, blade and depth of a cut as ``Case.set`` takes them."""
    sizes = {**experiment.specimen, **experiment.blade, "depth": experiment.reach}
    if experiment.slice_push is not None:
        sizes["slice_push"] = experiment.slice_push
    units = dict.fromkeys(sizes, "mm") | {"slice_push": "1"} | blade_units()
    return {
        name: f"{float(value) / unit_factor(units[name])!r} {units[name]}".removesuffix(" 1")
        for name, value in sizes.items()
    }


def start_case(
    material: str | Path | None,
    *,
    baseline: Iterable[str] | None = None,
    kinds: Iterable[str] = ("cut",),
    parameters: Mapping[str, object] | None = None,
    name: str = "start",
) -> tuple[Case, tuple[str, ...]]:
    """Make the case that a campaign starts from, with notes on what was added to it.

    A baseline without a law for volume change gets the default one: a soft solid hardly changes its
    volume, and a run without such a law has no unique answer. Raises BadInput.
    """
    notes: tuple[str, ...] = ()
    seen = {slot for kind in kinds for slot in SLOTS[kind]} | {"bulk"}
    own = None if material is None else load_case(material)
    if baseline is None:
        baseline = ("default",) if own is None else tuple(m.name for m in own.model.all if m.slot in seen)
    listed = (baseline,) if isinstance(baseline, str) else tuple(baseline)
    if len(listed) == 1 and listed[0] in SETS:
        listed = tuple(m for m in SETS[listed[0]] if registry()[m].slot in seen)
    for each in listed:
        mechanism(each, key="baseline")
    try:
        model = Model(listed)
    except BadInput as error:
        raise BadInput("baseline", error.value, error.expected) from error
    if not any(isinstance(m, Volumetric) for m in model.laws("bulk")):
        added = next(n for n in SETS["default"] if isinstance(registry()[n], Volumetric))
        model = model.with_(added)
        notes += (f"'{added}' added to the baseline: it has no law for volume change",)
    if own is not None and material is not None:
        case = load_case(material, {"mechanisms": model.mechanisms, **(parameters or {})})
        if unused := own.values.keys() & blade_units().keys() - case.values.keys() if "blade" in seen else ():
            blade = next(law.name for law in own.model.laws("blade") if isinstance(law, Tool))
            names_ = " and ".join(sorted(unused))
            notes += (f"the material's {names_} count for nothing: its '{blade}' is not in the baseline",)
        return case, notes
    values = resolve({}, dict(parameters or {}), model)
    return Case(name=name, dim=2, mechanisms=model.mechanisms, values=values), notes


def all_candidates(baseline: Model, kinds: Iterable[str]) -> tuple[str, ...]:
    """Every registered mechanism that is not in ``baseline`` and that tests of these ``kinds`` can show."""
    seen = {slot for kind in kinds for slot in SLOTS[kind]}
    return tuple(n for n, m in registry().items() if n not in baseline.mechanisms and m.slot in seen)


def load_campaign(path: str | Path) -> Campaign:
    """Read a campaign from a TOML file, with the data that it names.

    Parameters
    ----------
    path : str or Path
        The file; it names the files of its data beside it.

    Returns
    -------
    Campaign
        Checked, with the readings.

    Raises
    ------
    BadInput
        For every error that a person can make, with file and line.

    Examples
    --------
    >>> import tempfile
    >>> import cutbench
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     examples = cutbench.copy_examples(folder + "/examples")
    ...     campaign = cutbench.load_campaign(examples / "rubber" / "treloar.toml")
    >>> [experiment.kind for experiment in campaign.experiments]
    ['uniaxial', 'pure_shear', 'equibiaxial']
    """
    file = read_toml(path, "experiment")
    with file.at():
        top = read_section(file.table, _FILE)
    places: dict[str, int] = {}
    experiments: list[Experiment] = []
    for number, part in enumerate(top["experiment"]):
        with file.at("experiment", number):
            for experiment in read_experiments(part, file.path.parent):
                require(experiment.id not in places, "id", experiment.id, "each id once")
                places[experiment.id] = number
                experiments.append(experiment)
    for r, expected, noisy in plausible.copies(experiments):
        if noisy:
            raise r.wrong("data", r.name, expected, 0)
    kinds = list(dict.fromkeys(e.kind for e in experiments))
    sizes = next((_sizes(e) for e in experiments if e.kind == "cut"), {})
    base, notes, material = _start(file, top, kinds, sizes)
    with file.at():
        candidates = _candidates(top["candidates"], base.model, kinds)
    with file.at("fit"):
        felt = (e for e in experiments if "rig" in SLOTS[e.kind] and e.mounted and e.curve)
        bounds = bounds_by([r for e in felt for r in e.repetitions])
        plan = _plan(top["fit"], base.model, candidates, bounds)
    for experiment in experiments:
        with file.at("experiment", places[experiment.id]):
            _check(experiment, base)
    cuts = (cut_case(e, base) for e in experiments if e.kind == "cut")
    notes += tuple(dict.fromkeys(sentence for cut in cuts for sentence in cut.doubts))
    title = top["title"] or file.path.stem
    with file.at():
        return Campaign(title, base, tuple(experiments), candidates, plan, file.path, notes, material)


def _check(experiment: Experiment, base: Case) -> None:
    """Raise BadInput if a test cannot be of the material, or cannot be computed."""
    plausible.refuse_implausible(experiment, base)
    if experiment.kind == "cut":
        for name in experiment.blade.keys() - base.model.parameters().keys():
            tool = next(law.name for law in base.model.laws("blade") if isinstance(law, Tool))
            others = [law.name for law in registry().values() if name in [q.name for q in law.parameters]]
            expected = (
                f"a size of the baseline's blade, '{tool}'; a baseline with {' or '.join(others)} has it"
            )
            raise BadInput(f"blade.{name}", f"{experiment.blade[name]:g}", expected)
        cut_case(experiment, base)


def _start(
    file: TomlFile, top: Mapping[str, Any], kinds: list[str], sizes: Mapping[str, str]
) -> tuple[Case, tuple[str, ...], str | Path | None]:
    """The start case, each of whose faults is placed where it is written, notes, and the material's name or
    file; ``sizes`` are those of a cut."""
    wanted = "a known name or a file with start values, or a section [parameters]"
    with file.at():
        require(top["material"] or top["parameters"], "material", "(missing)", wanted)
    for key, raw in top["parameters"].items():
        with file.at("parameters"):
            require(key not in KEYS, key, raw, "it in [numerics], not in [parameters]")
    with file.at("numerics"):
        read_section(top["numerics"], [Entry(key, object) for key in KEYS])
    source = top["material"] and file.beside(top["material"])
    parameters, name = top["parameters"], file.path.stem
    with file.at("parameters"):
        case, notes = start_case(
            source, baseline=top["baseline"], kinds=kinds, parameters=parameters, name=name
        )
    with file.at("numerics"):
        known = case.model.parameters()
        sizes = {k: v for k, v in sizes.items() if k in known}
        return case.set(**sizes, **top["numerics"]), notes, source


def _candidates(listed: str | tuple[str, ...], baseline: Model, kinds: Iterable[str]) -> tuple[str, ...]:
    if listed in ("all", ("all",)):
        return all_candidates(baseline, kinds)
    for name in listed:
        mechanism(name, key="candidates")
        other = name not in baseline.mechanisms
        require(other, "candidates", name, "a mechanism that is not in the baseline")
        require(listed.count(name) == 1, "candidates", name, "each candidate once")
    return tuple(listed)


def _plan(part: Mapping[str, Any], baseline: Model, candidates: tuple[str, ...], usual: Mapping) -> FitPlan:
    """What the section [fit] says: free, fixed, own (lists of parameters), bounds (low, high with units);
    ``usual`` are bounds that hold where none are written."""
    offered = {q.name: q for name in reversed(candidates) for q in registry()[name].parameters}
    known = offered | baseline.parameters()
    for key, listed in part.items():
        for name in listed or ():
            among(key, name, known)
    bounds = {name: pair for name, pair in usual.items() if name in known}
    for name, raw in part["bounds"].items():
        low, high = Entry(name, known[name], _BOUNDS, count=(2, 2)).read(raw)
        require(low < high, name, raw, "the lowest value first, and below the highest")
        bounds[name] = (low * known[name].factor, high * known[name].factor)
    return FitPlan(part["free"], part["fixed"] or (), part["own"] or (), bounds)
