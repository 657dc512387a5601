"""Campaigns with a hidden cause, as files that a laboratory could have written; for ``benchmarks.blind``.

Homogeneous tests follow either formulas that the package has not (``benchmarks.formulas``) or one of its
own laws, computed with other steps than a fit's. Cuts are computed by the package with other elements, steps,
contact or cohesive shape than a fit's defaults, by an ellipse, by blades of two thicknesses or by a wedge;
what is hidden in them follows formulas that no candidate has (powers of the speed, a relaxing modulus, a
machine that gives way, a record that begins late or drifts), but for stiffening, which is a candidate's.
Mixed campaigns have a tension test, a hold or a pull-off of the same gel beside the cuts.

Of cuts of the family of measures no curves are given but some numbers, each with its own scatter.

Every campaign has one, three or five specimens that differ by a factor of 1 to 10 %, and noise of which one
half is white and the other extends along the curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.formulas import ALIEN, AREA, FIBRED, LENGTH, Body, FibredBody, alien, ramp
from cutbench.base.errors import ComputationFailed, CutbenchError
from cutbench.base.files import replacing
from cutbench.case.case import Case, load_case
from cutbench.data.campaign import start_case
from cutbench.data.covariance import matern
from cutbench.data.experiment import HOMOGENEOUS
from cutbench.discovery.candidates import family_of
from cutbench.homogeneous import LoadingHistory, respond
from cutbench.homogeneous.stretching import nominal_stress
from cutbench.run.measures import READ_OFF, ForceCurve
from cutbench.run.runner import run_case

Run = Callable[[Case], Any]
Made = tuple[list[str], dict[str, float], list["Curve"]]
Clean = tuple[np.ndarray | None, np.ndarray, np.ndarray]

FAMILIES = ("homogeneous", "cut", "mixed", "measures", "fibres")
#: What is read off cuts of which no curve is given, and the scatter of each number, as a part of it; of a
#: relative fall, of the force.
READ, OFF = ("onset", "peak", "drop", "plateau", "slope", "firmness", "work"), 0.05
SPECIMENS, SCATTER, NOISES = (1, 3, 5), (0.01, 0.1), (0.003, 0.01)
#: What the fit's parameters cannot take up of an effect, in standard deviations of a reading's noise.
SHOWN = (2.0, 100.0)
#: Of the package's own laws, drawn between these.
BY_LAW = (2.5, 25.0)

_VOLUME = ("volume change", "nu")
#: By effect of the formulas: names of the classes of which a right answer names one.
BY_FORMULA = {
    "eight chains": ("strain stiffening",),
    "Fung": ("strain stiffening",),
    "van der Waals": ("strain stiffening",),
    "Zener": ("viscoelasticity",),
    "stretched exponential": ("viscoelasticity",),
    "Zuniga-Beatty": ("softening on unloading",),
    "Elias-Zuniga": ("softening on unloading",),
    "volume": _VOLUME,
    "compliance": ("machine",),
    "gauge": ("machine",),
    "zero": ("reading",),
    "slack": ("reading",),
    "drift": ("reading",),
    "stated nu": _VOLUME,
}
#: Of sheets that are pulled at two angles, and one angle more that is predicted, in degrees. Two that are a
#: quarter turn apart do not tell to which side of 0 fibres lie: a wide strip along one of them is predicted.
ANGLES = ((0, 90, 0), (0, 45, 90), (0, 60, 30), (30, 90, 0))
#: What else may be hidden there.
UNDIRECTED = ("Fung", "Zener", "compliance")
#: The package's own laws that are hidden, by the tests that show them.
LAWS = {
    "bulk": ("gent", "yeoh", "compressible", "maxwell", "maxwell2", "mullins"),
    "joint": ("compact_cohesion", "rate_toughness", "viscous_degraded"),
    "sliding": ("adhesion_speed", "adhesion_wear", "coulomb_saturating"),
}
#: What shows an effect of the formulas; and that there are several tests.
BY_OTHERS, SEVERAL = "formula", "several conditions"
#: Two causes at once, by formulas.
DOUBLE = (
    ("eight chains", "Zener"), ("Fung", "stretched exponential"), ("Zener", "Zuniga-Beatty"),
    ("van der Waals", "Elias-Zuniga"), ("compliance", "Zener"),
)  # fmt: skip
#: Kinds of a body's fitted tests.
MODES = (
    ("uniaxial", "uniaxial"), ("pure_shear", "pure_shear"), ("press", "press"), ("uniaxial", "pure_shear"),
)  # fmt: skip
#: Effects of a speed or a pressure: a single test shows them only if it has several.
STEPPED = ("rate_toughness", "adhesion_speed", "coulomb_saturating")
#: Of a test in steps: the second speed over the first, and the pressures of its parts. Friction and adhesion
#: fit any two pressures, so there are more.
FASTER, PRESSED = 30.0, np.array([1.0, 4.0, 2.0, 0.5])
READINGS = 120

#: By effect of cuts: names of the classes of which a right answer names one.
OF_CUTS = {
    "toughness by speed": ("rate of cutting",),
    "adhesion by speed": ("adhesion by speed",),
    "relaxing modulus": ("viscoelasticity",),
    "stiffening": ("strain stiffening",),
    "blunt tip": ("tool",),
    "compliance": ("machine",),
    "late zero": ("reading",),
    "drift": ("reading",),
}
#: mm/s: three that are fitted, one that is predicted.
SPEEDS = {"slow": 0.005, "middle": 0.021, "fast": 0.08, "other": 0.04}
SIZES = {"width": "20 mm", "length": "30 mm", "height": "14 mm"}
DEPTH_MM, CUT_READINGS = 5.0, 150
#: At this force a machine that gives way has given half a millimetre, for an effect of size 1.
MACHINE_N = 1.2
#: Relaxation time of the gel, s; a cut feels the modulus that is left while its blade goes so far, mm.
TAU_S, WAY_MM = 60.0, 2.0
#: What cuts are computed with in place of the defaults, by turns.
OTHERWISE: tuple[tuple[str, Mapping[str, object]], ...] = (
    ("finer", {"h": "0.045 mm", "step": "0.06 mm", "penalty": 89600, "stick": 35840}),
    ("coarse", {"numerics": "fast"}),
    ("cohesion as printed", {"numerics": "fast", "with": ["smith_ferrante"]}),
    ("material normal", {"normal": "material", "h": "0.1 mm"}),
    ("compact cohesion", {"numerics": "fast", "with": ["compact_cohesion"], "compactness": 0.5}),
)
BLADES = ("ellipse", "two thicknesses", "ellipse", "wedge")
BESIDE = ("tension", "hold", "pull-off")


@dataclass(frozen=True)
class Planned:
    """One case of a benchmark: its ``family``, what is hidden, and how it is shown. ``effects`` is empty
    where nothing is hidden."""

    number: int
    family: str
    effects: tuple[str, ...]
    how: tuple[str, ...] = ()

    @property
    def sort(self) -> str:
        """``none``, ``one``, ``two``, or ``alien`` where no candidate has the effect."""
        if not self.effects:
            return "none"
        return "alien" if self.effects[0] in ALIEN else ("one", "two")[len(self.effects) - 1]

    @property
    def classes(self) -> tuple[tuple[str, ...], ...]:
        """Of each effect, the classes of which a right answer names one."""
        cuts = self.family not in ("homogeneous", "fibres")
        known = {**BY_FORMULA, **dict.fromkeys(FIBRED, ("anisotropy",)), **(OF_CUTS if cuts else {})}
        return tuple(known.get(e) or (family_of(e),) for e in self.effects if e not in ALIEN)


@dataclass(frozen=True)
class Truth:
    """One campaign as it was made.

    ``clean`` has, by test, the time in s, the abscissa and the ordinate (m,) each, as they would be read
    without noise and of a specimen like the mean of all; None for a time that is not recorded.
    ``misfit``: what the fit's parameters cannot take up of the fitted curves, in standard deviations of a
    reading's noise, as a root mean square. ``shown``: the same in standard deviations of all readings
    together, with the scatter between specimens. ``values``: of the parameters that a fit looks for, in
    internal units.
    """

    planned: Planned
    file: Path
    clean: Mapping[str, Clean]
    specimens: int
    scatter: float
    noise: float
    misfit: float
    shown: float
    values: Mapping[str, float] = field(default_factory=dict)


def _as_it_is(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x, y


@dataclass(frozen=True)
class Curve:
    """One test without scatter and noise: time (m,), abscissa (m,) and what the specimen bears, ``y`` (m,).
    ``recorded`` makes what a machine writes down of the last two. ``columns`` (m, k): what the baseline's
    parameters can make of the ordinate. ``header``: lines of the campaign's file. A force counts over the
    ``area``, in mm², where that is given."""

    id: str
    role: str
    time_s: np.ndarray
    x: np.ndarray
    y: np.ndarray
    columns: np.ndarray
    header: Sequence[str]
    recorded: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] = _as_it_is
    pressure: np.ndarray | None = None
    timed: bool = True
    area: float = 1.0

    @property
    def clean(self) -> Clean:
        """Time, abscissa and ordinate (m,) each, as they are read without noise; None for a time that is not
        recorded."""
        x, y = self.recorded(self.x, self.y)
        return self.time_s if self.timed else None, x, y / self.area


# -- what is to be made -----------------------------------------------------------------------------
def plan(family: str, cases: int, seed: int) -> list[Planned]:
    """A fifth hides nothing, an effect of a fifteenth no candidate has; of homogeneous tests a sixth has two.

    The others take turns, in an order of this seed. Of sheets half have fibres, a quarter another effect.
    """
    rng = np.random.default_rng([seed, FAMILIES.index(family)])
    if family == "fibres":
        sheets = [(FIBRED[k % 3],) for k in range(cases // 2)]
        sheets += [(UNDIRECTED[k % 3],) for k in range(cases // 4)]
        sheets += [()] * (cases - len(sheets))
        return [Planned(i, family, sheets[k], (BY_OTHERS,)) for i, k in enumerate(rng.permutation(cases))]
    none, strange = max(1, round(cases / 5)), round(cases / 15)
    two = round(cases / 6) if family == "homogeneous" else 0
    pool = [*BY_FORMULA, *(e for laws in LAWS.values() for e in laws)]
    pool = [*OF_CUTS] if family != "homogeneous" else pool
    order = rng.permutation(len(pool))
    made: list[tuple[str, ...]] = [(pool[order[k % len(pool)]],) for k in range(cases - none - strange - two)]
    made += [()] * none
    made += [(ALIEN[0 if family != "homogeneous" else k % 3],) for k in range(strange)]
    made += [DOUBLE[k % len(DOUBLE)] for k in rng.permutation(max(two, len(DOUBLE)))[:two]]
    first = int(rng.integers(len(OTHERWISE) * len(BLADES) * len(BESIDE)))
    return [
        Planned(i, family, made[k], _how(family, first + i, made[k], rng))
        for i, k in enumerate(rng.permutation(len(made)))
    ]


def _how(family: str, turn: int, effects: Sequence[str], rng: np.random.Generator) -> tuple[str, ...]:
    """Numerics and blade of cuts, and the test beside them; of homogeneous tests what shows the effect, at
    one condition or several."""
    if family == "homogeneous":
        shows = next((s for s, laws in LAWS.items() if {*effects} & {*laws}), BY_OTHERS)
        if (not effects or effects[0] in ALIEN) and rng.random() < 0.6:
            shows = str(rng.choice([*LAWS]))
        return shows, SEVERAL if shows == BY_OTHERS or rng.random() < 0.5 else "one condition"
    numerics, blade = OTHERWISE[turn % len(OTHERWISE)][0], BLADES[turn % len(BLADES)]
    if "blunt tip" in effects and blade == "wedge":
        blade = "ellipse"  # a wedge has an edge, and no tip
    if family in ("cut", "measures"):
        return numerics, blade
    beside = BESIDE[turn % len(BESIDE)]
    if beside == "pull-off" and "toughness by speed" in effects:
        beside = "tension"  # how fast a blade opens the specimen is not stated
    if beside == "pull-off" and "cohesion" in numerics:
        numerics = "finer"  # another cohesive shape would be seen in it
    return numerics, blade, beside


def make(
    planned: Planned, seed: int, folder: Path, truths: Path | None = None, *, run: Run = run_case,
    specimens: int | None = None,
) -> Truth:  # fmt: skip
    """Write one campaign into ``folder``.

    Parameters
    ----------
    planned : Planned
        The case.
    seed : int
        The benchmark's; with the case's number it fixes all that is drawn.
    folder : Path
        Where the campaign's files go.
    truths : Path, optional
        Where computed cuts are left, and taken from if they are there.
    run : callable, optional
        What computes a cut; the package's own run unless given.
    specimens : int, optional
        How many of each test; drawn unless given.

    Raises
    ------
    ComputationFailed
        If cuts cannot be computed with three sets of values.
    """
    rng = np.random.default_rng([seed, FAMILIES.index(planned.family), planned.number])
    drawn = int(rng.choice(SPECIMENS))
    specimens = specimens or drawn
    scatter, noise = float(rng.uniform(*SCATTER)), float(rng.choice(NOISES))
    if planned.family == "fibres":
        head, values, curves = _sheets(planned.effects, noise, rng)
    elif planned.family != "homogeneous":
        head, values, curves = _cuts(planned, rng, truths, run)
    elif planned.how[0] == BY_OTHERS:
        head, values, curves = _by_formula(planned.effects, noise, rng)
    else:
        head, values, curves = _by_law(planned, noise, rng)
    folder.mkdir(parents=True, exist_ok=True)
    text = [f'title = "{planned.family} {planned.number}"', *head]
    for curve in curves:
        if planned.family == "measures":
            text += _measured(curve, rng)
        else:
            text += _written(curve, folder, specimens, scatter, noise, rng)
    file = folder / "campaign.toml"
    file.write_text("\n".join(text) + "\n", encoding="utf-8")
    clean = {c.id: c.clean for c in curves}
    train = [c for c in curves if c.role == "train"]
    return Truth(planned, file, clean, specimens, scatter, noise, missed(train) / noise,
                 shown(train, specimens, scatter, noise), values)  # fmt: skip


def _written(
    c: Curve, folder: Path, specimens: int, scatter: float, noise: float, rng: np.random.Generator
) -> list[str]:
    """The file of one test, and its part of the campaign's."""
    root = np.linalg.cholesky(_noise(c.y.size))
    rows, heads = [], ["rep", *(["t [s]"] * c.timed), "x", "y", *(["p [MPa]"] * (c.pressure is not None))]
    for r in range(specimens):
        x, y = c.recorded(c.x, c.y * (1 + scatter * rng.standard_normal()))
        y = y + noise * np.abs(c.y).max() * (root @ rng.standard_normal(c.y.size))[: y.size]
        values = [*([c.time_s[: y.size]] * c.timed), x, y, *([] if c.pressure is None else [c.pressure])]
        rows += [f"{r}," + ",".join(f"{v:.7g}" for v in row) for row in zip(*values, strict=True)]
    name = c.id.replace(" ", "_") + ".csv"
    (folder / name).write_text("\n".join([",".join(heads), *rows]) + "\n", encoding="utf-8")
    return ["", "[[experiment]]", f'id = "{c.id}"', f'data = "{name}"', f'role = "{c.role}"', *c.header]


def _measured(c: Curve, rng: np.random.Generator) -> list[str]:
    """A cut of which some numbers are known: its part of the campaign's file."""
    x, y = c.recorded(c.x, c.y)
    thickness = float(c.header[-1].split('thickness = "')[1].split(" ")[0])
    known, curve = [], ForceCurve(np.append(0.0, x), np.append(0.0, y), thickness)
    for name in READ:
        unit, _, read = READ_OFF[name]
        value = read(curve)
        # A relative fall is one of forces that scatter, however small it is.
        sd = OFF * (1.0 if unit == "1" else value)
        if math.isfinite(value) and sd > 0:
            drawn = value + sd * rng.standard_normal()
            ends = f"{drawn:.5g} ± {sd:.3g}" + ("" if unit == "1" else f" {unit}")
            known.append(f'{name} = "{ends}"')
    header = [line for line in c.header if not line.startswith(("columns", "units"))]
    measures = f"measures = {{ {', '.join(known)} }}"
    return ["", "[[experiment]]", f'id = "{c.id}"', f'depth = "{x[-1]:.5g} mm"', *header, measures]


def _noise(n: int) -> np.ndarray:
    """Covariance (n, n) of the noise of readings for a size of 1."""
    s = np.linspace(0, 1, n)
    return 0.5 * np.eye(n) + 0.5 * matern(np.abs(s[:, None] - s), 0.06)


def missed(curves: Sequence[Curve]) -> float:
    """What no sum of the columns makes of the curves, over the largest value of each: a root mean square."""
    return float(np.sqrt(np.mean(_left(curves, [np.eye(c.y.size) for c in curves]) ** 2)))


def shown(curves: Sequence[Curve], specimens: int, scatter: float, noise: float) -> float:
    """The same in standard deviations of the mean readings, all together."""
    roots = []
    for c in curves:
        y = c.y / np.abs(c.y).max()
        C = (noise**2 * _noise(y.size) + scatter**2 * np.outer(y, y)) / specimens
        roots.append(np.linalg.inv(np.linalg.cholesky(C)))
    return float(np.linalg.norm(_left(curves, roots)))


def _left(curves: Sequence[Curve], roots: Sequence[np.ndarray]) -> np.ndarray:
    values, columns = [], []
    for c, root in zip(curves, roots, strict=True):
        y, size = c.recorded(c.x, c.y)[1], np.abs(c.y).max()
        values.append(root[: y.size, : y.size] @ y / size)
        columns.append(root[: y.size, : y.size] @ c.columns[: y.size] / size)
    # Columns of the same number belong to the same parameters; a test need not show all of them.
    most = max(A.shape[1] for A in columns)
    A = np.concatenate([np.pad(A, ((0, 0), (0, most - A.shape[1]))) for A in columns])
    y = np.concatenate(values)
    size = np.linalg.norm(A, axis=0)
    A = A / np.where(size > 0, size, 1.0)
    return y - A @ np.linalg.lstsq(A, y, rcond=1e-9)[0]


# -- homogeneous tests by formulas ------------------------------------------------------------------
def _by_formula(effects: tuple[str, ...], noise: float, rng: np.random.Generator) -> Made:
    """The campaign's head, the true values, and four tests of a body, of which the last two are predicted."""
    strange = effects if effects and effects[0] in ALIEN else ()
    modes = MODES[int(rng.integers(len(MODES)))]
    far = rng.uniform(1.7, 2.6)
    if "press" in modes:
        far = 1 / (0.6 + 0.5 * far)  # to between 0.7 and 0.5 of the height
    ways = (
        ("slow", modes[0], "train", ramp(0.005, far, back=True)),
        ("fast", modes[1], "train", ramp(0.2, 1 + 0.8 * (far - 1), back=True)),
        ("middle", modes[0], "test", ramp(0.03, 1 + 0.9 * (far - 1))),
        ("hold", modes[1], "test", ramp(0.3, 1 + 0.7 * (far - 1), hold=60.0)),
    )
    for _ in range(50):
        body = Body(() if strange else effects, rng)
        how = {"size": 1.0, "waves": rng.uniform(2, 5), "phase": rng.uniform(0, 6)}
        how["size"] = float(rng.uniform(0.05, 0.25))
        curves = [_pulled(body, *way, strange[0] if strange else "", how) for way in ways]
        if not effects or SHOWN[0] < missed(curves[:2]) / noise < SHOWN[1]:
            break
    head = ['material = "elastomer"', 'baseline = ["neo_hookean", "volumetric"]', "[parameters]"]
    head.append(f'G = "{1e3 * body.G * rng.uniform(0.7, 1.4):.3g} kPa"')
    return [*head, f"nu = {body.stated_nu:.4f}"], {"G": body.G}, curves


def _sheets(effects: tuple[str, ...], noise: float, rng: np.random.Generator) -> Made:
    """The same of a sheet out of which specimens were cut at two angles, and at one that is predicted."""
    angles, far = ANGLES[int(rng.integers(len(ANGLES)))], rng.uniform(1.3, 1.9)
    ways = [
        ("first", "uniaxial", "train", ramp(0.005, far, back=True)),
        ("second", "uniaxial", "train", ramp(0.1, 1 + 0.9 * (far - 1), back=True)),
        (
            "third",
            "pure_shear" if 0 in np.diff(sorted(angles)) else "uniaxial",
            "test",
            ramp(0.02, 1 + 0.8 * (far - 1)),
        ),
    ]
    for _ in range(50):
        body, curves = FibredBody(effects, rng), []
        for way, angle in zip(ways, angles, strict=True):
            body.angle = math.radians(angle)
            made = _pulled(body, *way, "", {})
            curves.append(replace(made, header=[*made.header, f'angle = "{angle} deg"']))
        if not effects or SHOWN[0] < missed(curves[:2]) / noise < SHOWN[1]:
            break
    head = ['material = "elastomer"', 'baseline = ["neo_hookean", "volumetric"]', "[parameters]"]
    return (
        [*head, f'G = "{1e3 * body.G * rng.uniform(0.7, 1.4):.3g} kPa"', "nu = 0.4999"],
        {"G": body.G},
        curves,
    )


def _pulled(
    body: Body, id: str, mode: str, role: str, way: tuple[np.ndarray, np.ndarray], strange: str, how: dict
) -> Curve:
    t, stretch = way
    P = body.force(mode, t, stretch) * (alien(strange, _gone(stretch), how) if strange else 1.0)

    def recorded(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return body.recorded(mode, t, x, y)

    u = recorded(stretch, P)[0]
    header = [
        f'kind = "{mode.replace("press", "uniaxial")}"',
        'columns = { time = "t", displacement = "x", force = "y", repetition = "rep" }',
        'units = { displacement = "mm", force = "N" }',
        f'specimen = {{ length = "{LENGTH:g} mm", area = "{AREA:g} mm^2" }}',
    ]
    column = body.stated(mode, 1 + u / LENGTH)[:, None] * AREA
    made = Curve(id, role, t, stretch, P, column, header, recorded)
    return replace(made, y=P * AREA, recorded=lambda x, y: recorded(x, y / AREA), area=AREA)


def _gone(x: np.ndarray) -> np.ndarray:
    """The part of its way that a test has gone."""
    way = np.append(0.0, np.cumsum(np.abs(np.diff(x))))
    return way / max(way[-1], 1e-300)


# -- homogeneous tests by the package's own laws ----------------------------------------------------
@dataclass(frozen=True)
class _Test:
    """``program``: monotone, cycle (there and back), hold, or steps (four parts, slow and fast by turns,
    those of a sliding test each at its own pressure). ``speed`` in mm/s, or 1/s of stretch; ``reach``: mm, or
    the stretch."""

    id: str
    kind: str
    speed: float
    reach: float
    role: str = "train"
    program: str = "monotone"
    pressure: float = 0.0

    @property
    def rest(self) -> float:
        return 1.0 if self.kind in HOMOGENEOUS else 0.0

    def way(self) -> tuple[np.ndarray, np.ndarray]:
        """Abscissa and time (n,) of the readings."""
        x = self.rest + (self.reach - self.rest) * np.arange(1, READINGS + 1) / READINGS
        t = np.abs(x - self.rest) / self.speed
        if self.program == "cycle":
            x = np.append(x[1::2], x[-3::-2])
            t = np.cumsum(np.abs(np.diff(np.append(self.rest, x)))) / self.speed
        if self.program == "hold":
            t = np.append(t[1::2], t[-1] * (1 + np.arange(1, READINGS // 2 + 1) / 6))
            x = np.append(x[1::2], np.full(READINGS // 2, x[-1]))
        if self.program == "steps":
            t = np.cumsum(
                np.diff(x, prepend=self.rest)
                / (self.speed * np.where(_quarter(x.size) % 2 == 0, 1.0, FASTER))
            )
        return x, t

    def pressed(self, n: int) -> np.ndarray:
        """Contact pressure (n,) in MPa."""
        steps = self.program == "steps" and self.kind == "sliding"
        return self.pressure * (PRESSED[_quarter(n)] if steps else np.ones(n))

    def curve(self, case: Case) -> np.ndarray:
        """The ordinate (n,) in MPa, in steps of half a fit's length."""
        x, t = self.way()
        history = LoadingHistory.along(x, t, self.rest, self.pressed(x.size))
        if self.kind in HOMOGENEOUS:
            return nominal_stress(self.kind, history, case.model, case.p, largest=0.01, fewest=7)[:, 0]
        return respond(self.kind, history, case.model, case.p)


def _quarter(n: int) -> np.ndarray:
    """In which quarter of a test each of its readings (n,) lies, from 0."""
    return 4 * np.arange(n) // n


def _by_law(planned: Planned, noise: float, rng: np.random.Generator) -> Made:
    """The campaign's head, the true values, and its tests."""
    (shows, conditions), effect = planned.how, planned.effects[0] if planned.effects else ""
    tests = _tests(effect, shows, conditions == SEVERAL, rng)
    head, values, base = _start(shows, [t.kind for t in tests], rng)
    plain = {t.id: t.curve(base) for t in tests}
    wanted = noise * math.exp(rng.uniform(*np.log(BY_LAW)))

    def curves(changed: Mapping[str, np.ndarray]) -> list[Curve]:
        return [_law_curve(t, changed[t.id], plain[t.id]) for t in tests]

    def size_of(made: Sequence[Curve]) -> float:
        return missed([c for c in made if c.role == "train"])

    if not effect:
        return head, values, curves(plain)
    if effect in ALIEN:
        how = {"size": 1.0, "waves": rng.uniform(2, 5), "phase": rng.uniform(0, 6)}

        def at(size: float) -> list[Curve]:
            sized = {**how, "size": size}
            return curves({t.id: plain[t.id] * alien(effect, _gone(t.way()[0]), sized) for t in tests})

        return head, values, at(min(wanted / max(size_of(at(0.01)), 1e-9) * 0.01, 0.4))
    return head, values, _as_strong(_stronger(effect, base, tests, curves, rng), size_of, wanted)


def _as_strong(
    at: Callable[[float], list[Curve]], size_of: Callable[[Sequence[Curve]], float], wanted: float
) -> list[Curve]:
    """Curves whose effect is as large as wanted to a tenth, or as near to that as the law and its bounds
    allow."""
    size, low, high = 1.0, 0.0, None
    found: list[tuple[float, list[Curve]]] = []
    for _ in range(12):
        try:
            curves = at(size)
        except CutbenchError:
            high = size
        else:
            got = size_of(curves)
            found.append((abs(math.log(max(got, 1e-9) / wanted)), curves))
            if found[-1][0] < 0.1:
                break
            low, high = (size, high) if got < wanted else (low, size)
        # A law that saturates has its largest effect somewhere: it is passed, and remembered.
        size = (low + high) / 2 if high is not None else 3 * size
    return min(found, key=lambda each: each[0])[1] if found else at(low)


def _stronger(
    effect: str, base: Case, tests: Sequence[_Test], curves: Callable, rng: np.random.Generator
) -> Callable[[float], list[Curve]]:
    """The tests' curves with the effect, as a function of its size in units of what is typical."""
    model, new = base.model.extended(effect)
    known, shapes, sign = model.parameters(), {}, rng.choice([-1, 1])
    total = max(t.way()[1][-1] for t in tests)
    for name in new:
        q = known[name]
        if q.off is None:
            if q.unit == "s":
                shapes[name] = total * 10 ** rng.uniform(-1.2, 0) * (8 if name.endswith("2") else 1)
            elif q.unit == "mm/s":
                shapes[name] = min(t.speed for t in tests) * 10 ** rng.uniform(-0.7, 0.7)
            else:
                shapes[name] = q.typical * q.factor * 10 ** rng.uniform(-0.3, 0.3)

    def at(size: float) -> list[Curve]:
        strong = {}
        for name in (n for n in new if known[n].off is not None):
            low, high = known[name].bounds
            both = math.isfinite(low) and low == -high
            value = known[name].typical * known[name].factor * size * (sign if both else 1)
            strong[name] = float(np.clip(value, low, high))
        values = {**base.values, **new, **shapes, **strong}
        case = replace(base, mechanisms=model.mechanisms, values=values)
        return curves({t.id: t.curve(case) for t in tests})

    return at


def _start(
    shows: str, kinds: Sequence[str], rng: np.random.Generator
) -> tuple[list[str], dict[str, float], Case]:
    """The campaign's head, the true values, which are others than the start's, and the case without an
    effect."""
    laws, values = {
        "bulk": (["neo_hookean", "volumetric"], {"G": f"{rng.uniform(100, 600):.4g} kPa"}),
        "joint": (["neo_hookean", "volumetric", "stiff_cohesion"],
                  {"G_c": f"{rng.uniform(8, 30):.4g} J/m^2", "delta_c": f"{rng.uniform(0.05, 0.1):.4g} mm"}),
        "sliding": (["neo_hookean", "volumetric", "contact", "coulomb", "adhesion"],
                    {"mu": f"{rng.uniform(0.2, 0.5):.4g}", "tau_W": f"{rng.uniform(5, 20):.4g} kPa"}),
    }[shows]  # fmt: skip
    fixed = {"nu": "0.49"} if shows == "bulk" else {}
    base, _ = start_case("elastomer", baseline=laws, kinds=kinds, parameters={**values, **fixed})
    head = ['material = "elastomer"', f"baseline = {laws}".replace("'", '"'), "[parameters]"]
    for name, text in {**values, **fixed}.items():
        number, _, unit = text.partition(" ")
        away = 1.0 if name in fixed else rng.uniform(0.8, 1.25)
        value = f"{float(number) * away:.4g}"
        head.append(f'{name} = "{value} {unit}"' if unit else f"{name} = {value}")
    return head, {name: base.values[name] for name in values}, base


def _law_curve(t: _Test, y: np.ndarray, plain: np.ndarray) -> Curve:
    x, time_s = t.way()
    columns = [plain]
    if t.kind == "sliding":
        columns = [t.pressed(x.size), np.ones(x.size)]
    elif t.kind == "separation":  # in proportion, and along the opening
        columns = [plain, x * np.gradient(plain, x)]
    what, unit = ("stretch", "1") if t.kind in HOMOGENEOUS else ("displacement", "mm")
    pressed = t.kind == "sliding"
    header = [
        f'kind = "{t.kind}"',
        f'columns = {{ time = "t", {what} = "x", stress = "y", repetition = "rep"'
        + ', pressure = "p"' * pressed + " }",
        f'units = {{ {what} = "{unit}", stress = "MPa" }}',
    ]  # fmt: skip
    return Curve(t.id, t.role, time_s, x, y, np.column_stack(columns), header,
                 pressure=t.pressed(x.size) if pressed else None)  # fmt: skip


def _tests(effect: str, shows: str, many: bool, rng: np.random.Generator) -> list[_Test]:
    """One condition, or several and one that is predicted."""
    slow = 10 ** rng.uniform(-3, -2)
    alone = "steps" if not many and (rng.random() < 0.5 or effect in STEPPED) else "monotone"
    if shows == "bulk":
        reach = rng.uniform(1.8, 3.0)
        program = "cycle" if rng.random() < 0.5 or effect == "mullins" else "monotone"
        first = _Test("tension", "uniaxial", slow, reach, program=program)
        if not many:
            return [first]
        if rng.random() < 0.5:
            hold = "cycle" if effect == "mullins" else "hold"
            return [first, _Test("fast", "uniaxial", 30 * slow, reach, program=program),
                    _Test("other", "uniaxial", 10 * slow, reach, "test", hold)]  # fmt: skip
        return [first, _Test("shear", "pure_shear", slow, reach),
                _Test("biaxial", "equibiaxial", slow, 1 + 0.6 * (reach - 1), "test")]  # fmt: skip
    if shows == "joint":
        first = _Test("slow", "separation", slow, 0.5)
        if not many:
            return [replace(first, program=alone)]
        return [first, _Test("fast", "separation", 30 * slow, 0.5),
                _Test("other", "separation", 10 ** rng.uniform(-0.5, 2) * slow, 0.5, "test")]  # fmt: skip
    pressure = rng.uniform(0.01, 0.05)
    first = _Test("slow", "sliding", slow, 10.0, pressure=pressure)
    if not many:
        return [replace(first, program=alone)]
    return [
        first,
        _Test("fast", "sliding", 30 * slow, 10.0, pressure=pressure),
        _Test("pressed", "sliding", slow, 10.0, pressure=4 * pressure),
        _Test("pressed less", "sliding", slow, 10.0, pressure=0.3 * pressure),
        _Test("other", "sliding", 10 ** rng.uniform(-0.5, 2) * slow, 20.0, "test", pressure=2 * pressure),
    ]


# -- cuts -------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Gel:
    """What a cut specimen is of: modulus in kPa, toughness in J/m², adhesion in kPa; ``size``: of the
    effect."""

    G: float
    toughness: float
    adhesion: float
    size: float
    effects: tuple[str, ...] = field(default=())

    def case(self, speed: float, thickness: float, blade: str, choices: Mapping[str, object]) -> Case:
        """The specimen cut at ``speed`` (mm/s), with the effect in its values."""
        relative, toughness, adhesion, modulus = speed / SPEEDS["slow"], self.toughness, self.adhesion, self.G
        tip, more, laws = 1.5 * thickness, dict[str, object](), list(choices.get("with", ()))
        for effect in self.effects:
            if effect == "toughness by speed":
                toughness *= relative ** (0.25 * self.size)
            elif effect == "adhesion by speed":
                adhesion *= relative ** (0.5 * self.size)
            elif effect == "relaxing modulus":
                modulus *= 1 + self.size * math.exp(-WAY_MM / speed / TAU_S)
            elif effect == "stiffening":
                laws, more = [*laws, "fung"], {"b_fung": 0.4 * self.size}
            elif effect == "blunt tip":
                tip /= 1 + 1.5 * self.size
        sharp = {"tip": f"{tip} mm"} if blade != "wedge" else {}
        laws += ["wedge"] * (blade == "wedge")
        values = {
            **SIZES, "speed": f"{speed} mm/s", "depth": f"{DEPTH_MM} mm", "eta_reg": "0.8 s", **sharp,
            "thickness": f"{thickness} mm", "G_c": f"{toughness} J/m^2", "tau_W": f"{adhesion} kPa",
            "G": f"{modulus} kPa", **more,
        }  # fmt: skip
        return load_case("gelatin", {**choices, **values, **({"with": laws} if laws else {})})

    def recorded(self, x: np.ndarray, F: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Travel and force (m,) of a cut as a machine writes them down."""
        largest = F.max()
        for effect in self.effects:
            if effect == "compliance":
                x = x + 0.5 * self.size * (np.maximum(F, 0.0) / MACHINE_N) ** 0.8
                # A machine never goes back: where the force falls fast, the specimen runs on at a stand.
                ahead = np.diff(np.maximum.accumulate(x), prepend=0.0) > 0
                x, F = x[ahead], F[ahead]
            elif effect == "late zero":
                x = x - 0.5 * self.size
            elif effect == "drift":
                F = F + 0.25 * self.size * largest * (x / speed) / (DEPTH_MM / SPEEDS["slow"])
            elif effect in ALIEN:
                F = F * (1 + 0.25 * self.size * np.sin(2 * np.pi * x / 1.3 + 20 * speed))
        return x[x > 0], F[x > 0]


def computed(case: Case, truths: Path | None, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Travel and force (n,) of a cut, out of the folder ``truths`` or computed and left there. Raises
    ComputationFailed."""
    file = truths / f"{case.id}.npz" if truths is not None else None
    if file is not None and file.exists():
        with np.load(file) as data:
            return data["x"], data["F"]
    result = run(case)
    if not result.outcome.done:
        raise ComputationFailed(f"a cut of the benchmark: {result.outcome}", result)
    x, F = result.curve["displacement_mm"], result.curve["force_N"]
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as draft, open(draft, "wb") as to:
            np.savez(to, x=x, F=F)
    return x, F


def _cuts(planned: Planned, rng: np.random.Generator, truths: Path | None, run: Run) -> Made:
    """The campaign's head, the true values, four cuts of which the last is predicted, and what is beside
    them."""
    numerics, blade, *beside = planned.how
    choices = dict(OTHERWISE)[numerics]
    for attempt in range(3):
        draw = np.exp(rng.normal(0, [0.2, 0.2, 0.3]))
        gel = Gel(8.0 * draw[0], 5.0 * draw[1], 1.5 * draw[2], float(rng.uniform(0.6, 1.2)), planned.effects)
        gel = replace(gel, G=float(f"{gel.G:.4g}"), toughness=float(f"{gel.toughness:.4g}"))
        try:
            curves = [_cut(gel, id, blade, choices, truths, run) for id in SPEEDS]
            break
        except CutbenchError:
            if attempt == 2:
                raise
    head = ['material = "gelatin"']
    if blade == "wedge":
        laws = ["wedge" if m == "contact" else m for m in load_case("gelatin").mechanisms]
        head.append(f"baseline = {laws}".replace("'", '"'))
    head += ["[parameters]", f'G = "{gel.G * rng.uniform(0.8, 1.25):.3g} kPa"']
    head.append(f'G_c = "{gel.toughness * rng.uniform(0.8, 1.25):.3g} J/m^2"')
    values = {"G": 1e-3 * gel.G, "G_c": 1e-3 * gel.toughness, "tau_W": 1e-3 * gel.adhesion}
    return head, values, [*(_beside(gel, kind) for kind in beside), *curves]


def _cut(
    gel: Gel, id: str, blade: str, choices: Mapping[str, object], truths: Path | None, run: Run
) -> Curve:
    speed = SPEEDS[id]
    thickness = 1.0 if blade == "two thicknesses" and id in ("middle", "other") else 0.7
    x = np.linspace(0, DEPTH_MM, CUT_READINGS + 1)[1:]
    F = np.interp(x, *computed(gel.case(speed, thickness, blade, choices), truths, run))
    plain = computed(replace(gel, effects=()).case(speed, thickness, blade, choices), truths, run)
    at = gel.recorded(x, F, speed)[0]
    column = np.interp(at, *plain)
    tip = f', tip = "{1.5 * thickness:g} mm"' if blade != "wedge" else ""
    header = [
        'kind = "cut"', f'speed = "{speed} mm/s"',
        'columns = { displacement = "x", force = "y", repetition = "rep" }',
        'units = { displacement = "mm", force = "N" }',
        "specimen = { " + ", ".join(f'{k} = "{v}"' for k, v in SIZES.items()) + " }",
        f'blade = {{ thickness = "{thickness} mm"{tip} }}',
    ]  # fmt: skip
    # Forces in proportion, and a whole curve along its travel, are what the baseline's values can change. A
    # test beside the cuts has columns of its own.
    none = np.zeros_like(at)
    columns = np.column_stack([none, none, column, at * np.gradient(column, at)])
    return Curve(id, "test" if id == "other" else "train", x / speed, x, F, columns, header,
                 lambda x, F: gel.recorded(x, F, speed), timed=False)  # fmt: skip


def _beside(gel: Gel, kind: str) -> Curve:
    """A test of the same gel that is no cut, by formulas; the pull-off by the cohesive law."""
    if kind == "pull-off":
        case = replace(gel, effects=()).case(0.01, 0.7, "ellipse", {})
        test = _Test(kind, "separation", 0.01, 0.5)
        y = test.curve(case)
        return _law_curve(test, y, y)
    stiff, relaxing = "stiffening" in gel.effects, "relaxing modulus" in gel.effects
    laws = ("Fung",) * stiff + ("stretched exponential",) * relaxing + ("volume",)
    body = Body(laws, np.random.default_rng(0))
    body.G, body.nu, body.stated_nu = 1e-3 * gel.G * (1 + gel.size * relaxing), 0.49, 0.49
    body.b, body.tau, body.spread, body.part = 0.4 * gel.size, TAU_S, 1.0, gel.size / (1 + gel.size)
    way = ramp(0.006, 1.6, back=True) if kind == "tension" else ramp(0.06, 1.5, hold=300.0)
    return _pulled(body, kind, "uniaxial", "train", way, "", {})
