"""Whether readings can be what they are said to be: a column, a specimen, a load cell, of this material.

What cannot be is refused. What may well be otherwise is a doubt: a sentence with file, line and the key that
settles it, to be read before any mechanism is believed. Each test is far enough from what real specimens do
that none of them meets it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from cutbench.base.errors import require
from cutbench.case.case import Case
from cutbench.data.covariance import roughness
from cutbench.data.repetition import SAME_SPEED, Repetition
from cutbench.mechanisms.base import Blade, Points

if TYPE_CHECKING:
    from cutbench.data.experiment import Experiment

#: Nominal stress of neo-Hooke at constant volume over G, by the stretch.
NEO_HOOKE: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "uniaxial": lambda x: x - x**-2,
    "equibiaxial": lambda x: x - x**-5,
    "pure_shear": lambda x: x - x**-3,
}
#: A modulus this many times that of the material, or as little of it, is not believed; so a shear or cohesive
#: strength.
MAX_MODULUS_RATIO, MAX_STRENGTH_RATIO = 100.0, 300.0
#: Titles of columns that count up as a specimen is pressed, and of measures that follow its deformation.
_PRESSED = re.compile(r"compress|comprim|stauch|druck", re.IGNORECASE)
_TRUE = re.compile(r"\b(true|log|logarithmic|hencky|cauchy|wahre[rs]?)\b", re.IGNORECASE)
#: Readings that agree to this part of the largest are the same ones, but for rounding.
SAME = 2e-4
#: A first reading without load that is farther from rest than this part of the way has another zero.
MAX_ZERO_OFFSET = 0.2
#: Readings of one value, to all digits, that make an end of a range, and the part of the way that they take.
AT_END, END_WAY = 5, 0.02
#: Readings on either side that say how it went before and goes on, and at most how much faster or slower.
BESIDE, AS_BEFORE = 5, 3.0


# -- readings that no machine makes -------------------------------------------------------------------
#: A step of so many times those before it, and those around it, is looked at; by so many a reading may miss
#: where it should be.
OUTLIER_STEPS, RETURN_STEPS = 15.0, 3.0
#: By which a decimal point is lost, or a sign between thousands is taken for one.
POWERS_OF_TEN = np.array([10.0, 100.0, 1e3, 1e4, 1e-1, 1e-2, 1e-3])


def check_steps(read: Mapping[str, np.ndarray], files: np.ndarray, lines: np.ndarray) -> None:
    """Raise BadInput for the first recorded travel or time of ``read`` (n,) that lies far from where those
    before it go, as where a decimal point was lost, with its place in ``files`` and ``lines`` (n,).

    A jump is a step many times as large as those before it, which go one way: what rests, as before the step
    of a relaxation, has no pace to be measured against. It is refused where it ends a power of ten from where
    the readings were going, at a pace so many times theirs, or where the next are back; another step that
    stays may be the test's own.
    """
    for role in ("displacement", "stretch", "strain", "time"):
        if role not in read or read[role].size < 2 * BESIDE:
            continue
        for at, times, goes in _places_off(read[role], read.get("time") if role != "time" else None):
            # A time that runs back is another fault, and a last one may be late.
            late = role == "time" and (read[role][at] <= goes or at == read[role].size - 1)
            expected = (
                f"about {goes:.6g}, where the readings before it go: this is {times:.2g} of their steps."
                " Was a decimal point lost, or is a sign between thousands taken for one?"
            )
            require(late, role, f"{read[role][at]:.6g}", expected, files[at], int(lines[at]))


def _places_off(x: np.ndarray, time: np.ndarray | None) -> Iterator[tuple[int, float, float]]:
    """Readings that jump, by how many steps, and where they should be, seen from those before or behind."""
    steps = np.abs(np.diff(x))
    if time is not None and np.all(np.diff(time) > 0):
        # Where readings are farther apart in time, they are in travel too.
        steps = np.minimum(steps, steps * np.median(np.diff(time)) / np.diff(time))
    usual = median_filter(steps, 2 * BESIDE + 1, mode="mirror")
    wide = (steps > OUTLIER_STEPS * usual) & (usual > 0)
    for way in (1, -1):
        z, size = x[::way], steps[::way]
        for j in map(int, np.flatnonzero(wide[::way])):
            before = np.diff(z[max(j - BESIDE, 0) : j + 1])
            step = float(before.mean()) if before.size > 1 else 0.0
            # Of readings that go one way, the steps sum up to most of their sizes' sum.
            one_way = abs(before.sum()) >= 0.7 * np.abs(before).sum()
            if step == 0 or not one_way or size[j] <= OUTLIER_STEPS * abs(step):
                continue
            # Three readings may lie off before the rest is back.
            goes, near, later = z[j] + step, RETURN_STEPS * abs(step), z[j + 2 : j + 5]
            back = np.abs(later - z[j]) < near * np.arange(2, 2 + later.size)
            moved = np.abs(z[j + 1] / POWERS_OF_TEN - goes) < near
            if later.size:
                pace = abs(z[j + 2] - z[j + 1]) / abs(step) / POWERS_OF_TEN
                moved &= (pace < RETURN_STEPS) & (pace > 1 / RETURN_STEPS)
            shifted = moved.any() and abs(goes) > RETURN_STEPS * near and way > 0
            if shifted or back.any():
                yield j + 1 if way > 0 else x.size - 2 - j, size[j] / abs(step), goes


# -- what a column is ---------------------------------------------------------------------------------
def refuse_misread(kind: str, repetitions: Iterable[Repetition], written: Mapping[str, object]) -> None:
    """Raise BadInput where a column cannot be what it is read as; ``written`` is what the campaign says."""
    for r in (r for r in repetitions if kind in NEO_HOOKE and np.isfinite([r.x, r.y]).all()):
        _refuse_other_measure(r, written)
        (way, load), far, pressed = _roles(r), _far(kind, r), _named_pressed(r)
        if pressed and way and r.channels[way].factor is None and r.x[far] > 1 and r.y[far] > 0:
            raise r.wrong(f"columns.{way}", pressed, _pressed_or_pulled(r, way, load), far)


def _refuse_other_measure(r: Repetition, written: Mapping[str, object]) -> None:
    """A strain is 0 and a stretch 1 where there is no load; true ones are said to be so."""
    for role, name, other in (("stress", "cauchy", "nominal"), ("strain", "true", "engineering")):
        if role in r.channels and role not in written and _TRUE.search(r.channels[role].title):
            expected = f"{role} = '{name}' beside it, as its title says, or {role} = '{other}' if it is that"
            raise r.wrong(f"columns.{role}", r.channels[role].title, expected)
    first = slice(max(BESIDE, r.x.size // 10))
    slope, load = np.polyfit(r.x[first], r.y[first], 1) if np.ptp(r.x[first]) > 0 else (np.nan, np.nan)
    for role, other, at in (("strain", "stretch", 2.0), ("stretch", "strain", 0.0)):
        off = max(abs(r.x[0] - at), abs(-load / (slope or np.nan) - at))
        if role in r.channels and off < MAX_ZERO_OFFSET:
            title = r.channels[role].title
            expected = f"columns = {{ {other} = '{title}' }}: without load it is {at / 2:g}"
            raise r.wrong(f"columns.{role}", title, expected, 0)


def _named_pressed(r: Repetition) -> str | None:
    """The title that says that a specimen is pressed."""
    return next((c.title for c in r.channels.values() if _PRESSED.search(c.title)), None)


def _pressed_or_pulled(r: Repetition, way: str, load: str) -> str:
    return f"{_factors(r, way, load)} if the specimen is pressed, factors = {{ {way} = 1 }} if it is pulled"


def way_fault(kind: str, r: Repetition) -> tuple[str, str, str, int] | None:
    """What is wrong with a test whose way out, from rest to the farthest reading, gives work."""
    x, far = r.x - (kind in NEO_HOOKE), _far(kind, r)
    work = np.trapezoid(np.append(0.0, r.y[: far + 1]), np.append(0.0, x[: far + 1]))
    if work >= 0:
        return None
    key, unit = ("force", "N") if kind == "cut" else ("stress" if kind in NEO_HOOKE else "traction", "MPa")
    at, said = next(chain(_position(kind, r), _jumps(kind, r)), (int(np.argmin(r.y * np.sign(x))), ""))
    out = f"a {key} that takes work on the way out, here it gives {-work:.3g}; "
    way = f"if a sensor counts the other way, write {_turned(kind, r, x[far] > 0)}"
    return key, f"{r.y[at]:.6g} {unit}", out + (said or way), at


def _far(kind: str, r: Repetition) -> int:
    """The reading farthest from rest."""
    return int(np.argmax(np.abs(r.x - (kind in NEO_HOOKE))))


def _turned(kind: str, r: Repetition, up: bool) -> str:
    """The factors of the sensor that counts the other way: one of which nobody spoke, the likelier first."""
    way, load = _roles(r)
    known = [role for role in (way, load) if role in r.channels] or [load]
    choices = [role for role in known if role in r.channels and r.channels[role].factor is None] or known
    pressed = up and (_named_pressed(r) or _looks_pressed(kind, r.x, np.abs(r.y)))
    first = way if pressed or (kind == "cut" and not up) else load
    choices.sort(key=lambda role: role != first)
    if kind not in NEO_HOOKE:
        return _factors(r, choices[0])
    become = {role: "pressed" if (role == way) == up else "pulled" for role in choices}
    return ", or ".join(f"{_factors(r, role)} for a specimen that is {become[role]}" for role in choices)


def _roles(r: Repetition) -> tuple[str, str]:
    """What gives the way, if a factor can turn it, and what the load."""
    way = next((role for role in ("displacement", "strain") if role in r.channels), "")
    return way, "stress" if "stress" in r.channels else "force"


def _factors(r: Repetition, *turned: str) -> str:
    """The campaign's factors with those of ``turned`` roles the other way."""
    factors = {role: c.factor for role, c in r.channels.items() if c.factor is not None}
    factors |= {role: -factors.get(role, 1.0) for role in turned}
    return f"factors = {{ {', '.join(f'{role} = {value:g}' for role, value in factors.items())} }}"


def _looks_pressed(kind: str, x: np.ndarray, y: np.ndarray) -> bool:
    """Whether ``y`` (n,) over stretches above 1 is what neo-Hooke has where it is pressed by as much, and not
    where it is pulled."""
    x, y = x[: x.argmax() + 1], y[: x.argmax() + 1]
    if not 1.08 < x.max() < 1.9 or x.min() < 0.99 or x.size < 2 * BESIDE:
        return False
    pulled, pressed = (_misfit(basis, y) for basis in (NEO_HOOKE[kind](x), -NEO_HOOKE[kind](2 - x)))
    # What describes a curve misses it by so little of the largest force; another law is so much worse.
    return pressed < 0.02 and pulled > 4 * pressed


def _misfit(basis: np.ndarray, y: np.ndarray) -> float:
    """Root mean square of what is left of ``y`` without its part along ``basis``, over the largest."""
    rest = y - basis * (basis @ y) / (basis @ basis)
    return float(np.sqrt(np.mean(rest**2)) / np.abs(y).max())


# -- whether repetitions are repetitions --------------------------------------------------------------
def copies(experiments: Sequence[Experiment]) -> Iterator[tuple[Repetition, str, bool]]:
    """Repetitions whose readings stand in the campaign once more, in the same unit or another, what to know,
    and whether their noise is in both, which no two specimens have alike."""
    each = [(e, r) for e in experiments if e.curve for r in e.repetitions]
    for i, (other, b) in enumerate(each):
        before = [(e, a) for e, a in each[:i] if e.kind == other.kind]
        same = [(e, a) for e, a in before if _stands_in(a, b, e.rest) or _stands_in(b, a, e.rest)]
        for e, a in same[:1]:
            titles = " and ".join(f"'{c.title}'" for c in a.channels.values())
            said = (
                f"each specimen once: these readings are those of '{a.name}' in '{e.id}'. Of a channel in"
                f" several units name one as it stands, as {titles}, or by its number; leave a copied file"
                " out"
            )
            # Less roughness is the curve's own, and no noise.
            yield b, said, _noise(b) > 1e-3 * np.abs(b.y).max()


def _stands_in(a: Repetition, b: Repetition, rest: float) -> bool:
    """Whether all readings of ``a``, as recorded, are among those of ``b``, one after the other."""
    pairs = []
    for r in (a, b):
        factors = [r.channels[role].recorded if role in r.channels else 1.0 for role in _roles(r)]
        pairs.append(np.stack([(r.x - rest) * factors[0], r.y * factors[1]]))
    pairs = [pair / np.abs(pairs[1]).max(axis=1, keepdims=True) for pair in pairs]
    starts = np.flatnonzero(np.abs(pairs[1] - pairs[0][:, :1]).max(axis=0) < SAME)[:BESIDE]
    parts = [pairs[1][:, k : k + a.x.size] for k in starts if k + a.x.size <= b.x.size]
    return any(np.abs(part - pairs[0]).max() < SAME for part in parts)


def _noise(r: Repetition) -> float:
    return float(np.median(roughness(np.arange(r.y.size), r.y)))


# -- what a sensor cannot have felt -------------------------------------------------------------------
def doubts(experiment: Experiment) -> Iterator[str]:
    """Sentences on readings that may well be otherwise, each with its place and the key that settles it."""
    yield from dict.fromkeys(field.doubt for field in experiment.fields if field.doubt)
    for r in experiment.repetitions if experiment.curve else ():
        for at, sentence in _doubts(experiment.kind, r):
            fault = r.wrong("", "", "", at)
            place = f"line {fault.line}" if fault.line else f"reading {at + 1}"
            yield f"{Path(fault.file or r.name).name}, {place}: {sentence}"


def _doubts(kind: str, r: Repetition) -> Iterator[tuple[int, str]]:
    """Readings and what is doubtful there."""
    yield from _position(kind, r)
    yield from _preload(kind, r)
    if (c := r.contact) is not None and c.sd > 0 and "displacement" not in c.taken_off:
        place = f"{c.at:.3f} ± {c.sd:.2g} mm"
        yield 0, f"the force rises only from {place}: zero = 'auto' if contact is there, '0 mm' if it is not"
    way, load = _roles(r)
    if kind in NEO_HOOKE and way and r.channels[way].factor is None and _looks_pressed(kind, r.x, r.y):
        said = "this is the curve of a specimen that is pressed, and is read as that of one that is pulled: "
        yield 0, said + _pressed_or_pulled(r, way, load)
    if kind in ("sliding", "separation"):
        return
    x, y = (values[: _far(kind, r) + 1] for values in (r.x, r.y))
    ends = {
        "the load stands at its largest value, to all digits, as at a load cell's end": _range_ends(x, y),
        "there is no load any more": _load_lost(x, y),
        "the load shoots up, as where the blade meets the plate": _shoots_up(y) if kind == "cut" else None,
    }
    for what, at in ((what, at) for what, at in ends.items() if at is not None):
        end = _place(kind, r, x[at - 1 : at + 1].mean())
        yield at, f"from here on {what}, while travel goes on: until = {end} leaves that out"
    if not any(ends.values()):
        yield from _jumps(kind, r)
    level = np.abs(r.y) > MAX_ZERO_OFFSET * np.abs(r.y).max()
    lost = 1 + np.flatnonzero((r.y[1:] == 0) & level[:-1])
    if lost.size and level[lost[-1] :][: 2 * BESIDE].any():
        yield int(lost[0]), "the load is exactly 0 for some readings, then back: lost samples, to be left out"


def _place(kind: str, r: Repetition, x: float) -> str:
    """An abscissa as ``from`` and ``until`` take it."""
    if kind not in NEO_HOOKE:
        return f"'{x:.5g} mm'"
    channel = r.channels.get("displacement")
    return f"{x:.5g}" if channel is None else f"'{abs(x - 1) * channel.scale:.5g} mm'"


def _range_ends(x: np.ndarray, y: np.ndarray) -> int | None:
    """The reading from which the load stands at its end, while the way goes on; it rose up to there."""
    at = int(np.abs(y).argmax())
    last = at + int(np.argmin(np.append(y[at:] == y[at], False))) - 1
    ahead = np.diff(y[max(at - max(2 * BESIDE, y.size // 20), 0) : at + 1])
    rises = ahead.size > BESIDE and abs(ahead.sum()) > np.abs(ahead).sum() / 2 and np.mean(ahead == 0) < 0.2
    return at if rises and last - at >= AT_END and abs(x[last] - x[at]) > END_WAY * np.ptp(x) else None


def _load_lost(x: np.ndarray, y: np.ndarray) -> int | None:
    """The reading from which there is no load any more, while the way goes on."""
    top = np.abs(y).max()
    least = min(max(0.02 * top, 4 * y[-BESIDE:].std()), top)
    at = int(np.flatnonzero(np.abs(y) >= least)[-1]) + 1
    return at if y.size - at >= AT_END and abs(x[-1] - x[at]) > END_WAY * np.ptp(x) else None


def _shoots_up(y: np.ndarray) -> int | None:
    """The reading from which the load rises to the end by steps far above all those before."""
    steps = np.diff(y)
    usual = np.flatnonzero(steps <= AS_BEFORE * np.abs(steps[: -steps.size // 5]).max())
    at = int(usual[-1]) + 1 if usual.size else 0
    return at if steps.size > 2 * BESIDE and AT_END <= y.size - at < y.size else None


def _position(kind: str, r: Repetition) -> Iterator[tuple[int, str]]:
    """A first reading that is without load and far from rest."""
    x, u = r.x - (kind in NEO_HOOKE), r.channels.get("displacement")
    unloaded = abs(r.y[0]) < MAX_ZERO_OFFSET / 4 * np.abs(r.y).max()
    if u is not None and unloaded and abs(x[0]) > MAX_ZERO_OFFSET * np.abs(x).max():
        place = f"'{x[0] * u.recorded:.4g} mm'"
        yield 0, f"there is no load at {place}: zero = {place} counts a position, or a gap, from there"


def _preload(kind: str, r: Repetition) -> Iterator[tuple[int, str]]:
    """A first reading that is at rest and has load."""
    x, least, load = r.x - (kind in NEO_HOOKE), 0.03 * np.abs(r.y).max(), _roles(r)[1]
    begun = np.abs(x) < MAX_ZERO_OFFSET * np.abs(x).max()
    at_rest = abs(x[0]) < 0.1 * abs(x[1] - x[0]) and r.contact is None and begun.sum() > BESIDE
    if not at_rest or "displacement" not in r.channels or abs(r.y[0]) < max(least, 8 * _noise(r)):
        return
    bend, slope, first = np.polyfit(x[begun], r.y[begun], 2)
    contact = -2 * first / slope / (1 + np.sqrt(max(1 - 4 * bend * first / slope**2, 0.0)))
    zero, unit = contact * r.channels["displacement"].recorded, "N" if load == "force" else "MPa"
    said = (
        f"the {load} is not 0 where the displacement is: zero = '{zero:.4g} mm' if that was set to zero under"
        f" load, force_zero = '{first * r.channels[load].recorded:.4g} {unit}' if the load cell was off"
    )
    if first * r.y[0] > 0 and abs(first) > least:
        yield 0, said


def _jumps(kind: str, r: Repetition) -> Iterator[tuple[int, str]]:
    """Steps of the load, far above those around, after which it goes on as before: a sensor set to zero."""
    # Of many readings each step is taken over several, in which a sensor's jump may take its time.
    every, steps, top = -(-r.x.size // 300), dict[int, float](), np.abs(r.y).max()
    for width in (every, 2 * every, 3 * every):
        for at, step in _steps(r, width):
            if all(abs(at - other) > 2 * BESIDE * width for other in steps):
                steps[at] = step / top
    # Two jumps of one test are a sensor's; more are the specimen's.
    for at, part in steps.items() if len(steps) <= 2 else ():
        # A body that is cut gives way by itself, but not to no force at all.
        if part > 0.05 and (kind != "cut" or abs(r.y[at]) < 0.05 * top):
            until = _place(kind, r, r.x[max(at - 3 * every, 0) : at].mean())
            said = (
                f"the load jumps by {part:.3g} of its largest within a reading, and goes on as before: was it"
                f" set to zero amid the test, or does it turn over? until = {until} leaves out what follows"
            )
            yield at, said


def _steps(r: Repetition, width: int) -> Iterator[tuple[int, float]]:
    """Steps over ``width`` readings, the largest first: where each ends, and its size."""
    rise, way = r.y[width:] - r.y[:-width], np.abs(r.x[width:] - r.x[:-width])
    at = np.arange(BESIDE * width, rise.size - BESIDE * width)
    if at.size == 0:
        return
    back, ahead = (np.stack([rise[at + sign * k * width] for k in range(1, BESIDE + 1)]) for sign in (-1, 1))
    size, around = np.abs(rise[at]), np.abs(np.concatenate([back, ahead])).max(axis=0)
    alone = (size > 5 * around) & (way[at] < AS_BEFORE * np.median(way))
    alone &= _alike(back.sum(axis=0), ahead.sum(axis=0), AS_BEFORE)
    if r.time_s is not None:
        speed = way / (r.time_s[width:] - r.time_s[:-width])
        alone &= _alike(speed[at - width], speed[at + width], SAME_SPEED)
    for k in sorted(np.flatnonzero(alone), key=lambda k: -size[k]):
        yield int(at[k]) + width, float(size[k])


def _alike(a: np.ndarray, b: np.ndarray, factor: float) -> np.ndarray:
    """Where ``a`` and ``b`` have one sign and differ by no more than ``factor``."""
    return (a * b > 0) & (np.abs(a) < factor * np.abs(b)) & (np.abs(b) < factor * np.abs(a))


# -- whether they are of this material ----------------------------------------------------------------
def refuse_implausible(experiment: Experiment, case: Case) -> None:
    """Raise BadInput if the readings cannot be of the material of ``case``."""
    if experiment.kind == "cut":
        travel_fits(experiment)
    for r in experiment.repetitions if experiment.curve else ():
        if experiment.kind in NEO_HOOKE:
            _refuse_percent(experiment, r, case.model.shear_modulus(case.p))
        for key, what, value, wanted, most in _magnitudes(experiment, r, case):
            if wanted > 0 and value > 0 and not 1 / most < value / wanted < most:
                times = f"{value / wanted:.2g} times" if value > wanted else f"1/{wanted / value:.2g} of"
                expected = (
                    f"about that of the material, {what.format(f'{wanted:.3g}')}; {times} it looks like a"
                    " wrong unit of force, stress, length or area, or a wrong material"
                )
                raise r.wrong(key, what.format(f"{value:.3g}"), expected, int(np.argmax(np.abs(r.y))))


def _magnitudes(
    experiment: Experiment, r: Repetition, case: Case
) -> Iterator[tuple[str, str, float, float, float]]:
    """What readings are about, and what they are of the material: the key, the quantity in words, its value,
    that of the material, and how many times as large or small it may be."""
    modulus_MPa = case.model.shear_modulus(case.p)
    if experiment.kind in NEO_HOOKE:
        G = apparent_modulus(experiment, r)
        yield "stress", "a shear modulus of {} kPa", 1e3 * G, 1e3 * modulus_MPa, MAX_MODULUS_RATIO
    # One that was made without a file has nothing to be held against.
    elif experiment.kind == "cut" and "length" in experiment.specimen:
        far = int(np.argmax(r.x)) + 1
        x, y = (np.append(0.0, values[:far]) for values in (r.x, r.y))
        # Force on a blade over G · length · travel: real cuts lie between 0.05 and 5, about this.
        usual = 0.5 * modulus_MPa * experiment.specimen["length"] * x[-1] / 2
        yield "force", "{} N on average", float(np.trapezoid(y, x)) / x[-1], usual, MAX_MODULUS_RATIO
    elif experiment.kind == "sliding":
        pressure = experiment.pressure_MPa if r.pressure_MPa is None else float(np.median(r.pressure_MPa))
        at = Points(touched=np.ones(1), slid=np.zeros(1), slip_rate=np.zeros(1))
        laws = [law for law in case.model.all if isinstance(law, Blade)]
        strength = sum(float(law.strength(np.array([pressure]), case.p, {}, at)[0]) for law in laws)
        yield "traction", "{} kPa", 1e3 * float(np.median(np.abs(r.y))), 1e3 * strength, MAX_STRENGTH_RATIO
    elif experiment.kind == "separation":
        parts = [law.estimate(case.p, 0.0, 0.0) for law in case.model.laws("cut")]
        strength, opening = sum(e.strength for e in parts), sum(e.opening for e in parts)
        top = int(np.argmax(r.y))
        yield "traction", "{} kPa at the peak", 1e3 * r.y[top], 1e3 * strength, MAX_STRENGTH_RATIO
        yield "opening", "{} mm at the peak", r.x[top], opening * (strength > 0), MAX_STRENGTH_RATIO


def apparent_modulus(experiment: Experiment, r: Repetition) -> float:
    """Shear modulus in MPa of neo-Hooke through the readings of a homogeneous test below a stretch of 1.5."""
    small = np.abs(np.log(r.x)) < np.log(1.5)
    if small.sum() < 3:
        small = np.argsort(np.abs(r.x - 1))[:5]
    unit = NEO_HOOKE[experiment.kind](r.x[small])
    return float(unit @ r.y[small] / (unit @ unit)) if unit @ unit > 0 else float("nan")


def _refuse_percent(experiment: Experiment, r: Repetition, G: float) -> None:
    """A strain without a unit is in percent where the material is then the one that is said, within a factor
    of ten, and not as it stands; a stretch above 30 is none."""
    far, strain = int(np.argmax(r.x)), r.channels.get("strain")
    unit = "" if strain is None else strain.unit
    percent = " units = { strain = '%' } reads it in percent" * (unit in (None, "1"))
    if r.x[far] > 30:
        expected = "stretches below 30: is a displacement in another unit, or a strain in percent?" + percent
        raise r.wrong("stretch", f"{r.x[far]:.4g}", expected, far)
    if unit is None:
        as_read, as_percent = (
            abs(np.log(max(apparent_modulus(experiment, replace(r, x=1 + (r.x - 1) / by)) / G, 1e-9)))
            for by in (1, 100)
        )
        if as_percent < np.log(10) < as_read:
            expected = (
                f"its unit, which no title says: as it stands this is {np.exp(as_read):.2g} times too soft."
                f"{percent}, units = {{ strain = '1' }} as it is"
            )
            raise r.wrong("strain", f"{r.x[far] - 1:.4g}", expected, far)


def travel_fits(experiment: Experiment) -> None:
    """Raise BadInput if a cut goes through its specimen, or hardly into it."""
    height = experiment.specimen.get("height", np.inf)
    for r in experiment.repetitions:
        far, deep = int(np.argmax(r.x)), r.x.max() / height
        faults = (
            (deep > 1.5, far, f"at most the specimen's height of {height:g} mm; is it in another unit?"),
            (
                deep > 1,
                int(np.argmax(r.x > height)),
                f"at most {height:g} mm, the height, at which the blade meets the plate:"
                f" until = '{0.99 * height:.4g} mm' ends the readings before it, zero says where contact was",
            ),
            (
                deep < 2e-3 and np.isfinite(height),
                far,
                f"a travel into the specimen of {height:g} mm; is it in another unit?",
            ),
        )
        for holds, at, expected in faults:
            if holds:
                raise r.wrong("displacement", f"{r.x[at]:.4g} mm", expected, at)
