"""Whether readings can be what they are said to be: a column, a specimen, a load cell, of this material.

What cannot be is refused. What may well be otherwise is a doubt: a sentence with file, line and the key that
settles it, to be read before any mechanism is believed. Each test is far enough from what real specimens do
that none of them meets it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

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
#: A modulus this many times that of the material, or as little of it, is not believed.
MAX_MODULUS_RATIO = 100.0
#: Force on a blade over G · length · travel: real cuts lie between 0.05 and 5.
CUT_FORCE_RANGE = (0.005, 50.0)
#: A shear or cohesive strength against the material's.
MAX_STRENGTH_RATIO = 300.0
#: Titles of columns that count up as a specimen is pressed, and of measures that follow its deformation.
_PRESSED = re.compile(r"compress|comprim|stauch|druck", re.IGNORECASE)
_TRUE = re.compile(r"\b(true|log|logarithmic|hencky|cauchy|wahre)", re.IGNORECASE)
#: A strain in percent without a word of it is this much softer than the material; as it should be within it.
PERCENT_RATIO = 10.0
#: Readings that agree to this part of the largest are the same ones, but for rounding.
SAME = 2e-4
#: Roughness above this part of the largest is noise, and not the curve's own.
NOISY = 1e-3
#: A first reading without load that is farther from rest than this part of the way has another zero.
MAX_ZERO_OFFSET = 0.2
#: A force at rest above this part of the largest, and so many times the noise, is none of rest.
PRELOAD, PRELOAD_NOISE = 0.03, 8.0
#: Readings of one value, to all digits, that make an end of a range, and the part of the way that they take.
AT_END, END_WAY = 5, 0.02
#: A force below this part of the largest is none.
NO_FORCE = 0.02
#: A step of the force is so many times its neighbours, above this part of the largest force.
JUMP, MIN_JUMP = 5.0, 0.05
#: Readings on either side that say how it went before and goes on, and at most how much faster or slower.
BESIDE, AS_BEFORE = 5, 3.0
#: Jumps of one test that are a sensor's; more are the specimen's.
MAX_JUMPS = 2
#: Of more readings than this each step is taken over several, in which a sensor's jump may take its time.
MAX_READINGS = 300
#: Misfit, as a part of the largest force, of a law that describes a curve, and how much worse another does.
DESCRIBED, WORSE = 0.02, 4.0
#: Travel within this part of the way is none.
AT_REST = 0.005


# -- what a column is ---------------------------------------------------------------------------------
def refuse_misread(kind: str, repetitions: Iterable[Repetition], written: Mapping[str, object]) -> None:
    """Raise BadInput where a column cannot be what it is read as; ``written`` is what the campaign says."""
    for r in repetitions if kind in NEO_HOOKE else ():
        _refuse_true_measure(r, written)
        _refuse_other_measure(r)
        _refuse_pressed(r)


def _refuse_true_measure(r: Repetition, written: Mapping[str, object]) -> None:
    for role, name, other in (("stress", "cauchy", "nominal"), ("strain", "true", "engineering")):
        if role in r.channels and role not in written and _TRUE.search(r.channels[role].title):
            expected = f"{role} = '{name}' beside it, as its title says, or {role} = '{other}' if it is that"
            raise r.wrong(f"columns.{role}", r.channels[role].title, expected)


def _refuse_other_measure(r: Repetition) -> None:
    """A strain is 0 and a stretch 1 where there is no load."""
    first = max(BESIDE, r.x.size // 10)
    slope, load = np.polyfit(r.x[:first] - r.x[0], r.y[:first], 1) if np.ptp(r.x[:first]) > 0 else (0.0, 0.0)
    unloaded = r.x[0] - load / slope if slope else r.x[0]
    for role, other, at in (("strain", "stretch", 2.0), ("stretch", "strain", 0.0)):
        if role in r.channels and max(abs(r.x[0] - at), abs(unloaded - at)) < MAX_ZERO_OFFSET:
            title = r.channels[role].title
            expected = f"columns = {{ {other} = '{title}' }}: without load it is {at / 2:g}"
            raise r.wrong(f"columns.{role}", title, expected, 0)


def _refuse_pressed(r: Repetition) -> None:
    way, load = _roles(r)
    named = next(
        (c.title for role, c in r.channels.items() if role != "time" and _PRESSED.search(c.title)), None
    )
    far = int(np.argmax(np.abs(r.x - 1)))
    if named and way and r.channels[way].factor is None and r.x[far] > 1 and r.y[far] > 0:
        expected = (
            f"{_factors(r, way, load)} for a specimen that is pressed, {way} = 1 in it for one that is pulled"
        )
        raise r.wrong(f"columns.{way}", named, expected, far)


def way_fault(kind: str, r: Repetition) -> tuple[str, str, str, int] | None:
    """What is wrong with a test whose way out, from rest to the farthest reading, gives work."""
    rest = 1.0 if kind in NEO_HOOKE else 0.0
    far = int(np.argmax(np.abs(r.x - rest)))
    work = np.trapezoid(np.append(0.0, r.y[: far + 1]), np.append(rest, r.x[: far + 1]))
    if work >= 0:
        return None
    i = int(np.argmin(r.y * np.sign(r.x - rest)))
    key, unit = ("force", "N") if kind == "cut" else ("stress" if kind in NEO_HOOKE else "traction", "MPa")
    if (place := _position(kind, r)) is not None:
        return "displacement", place.strip("'"), f"0 mm without load: zero = {place} counts from there", 0
    if (jump := next(_jumps(kind, r), None)) is not None:
        return key, f"{r.y[jump[0]]:.6g} {unit}", f"a {key} without a fault: {jump[1]}", jump[0]
    expected = (
        f"a {key} that takes work on the way out, here it gives {-work:.3g}; if a sensor counts the other"
        f" way, write {_turned(kind, r, r.x[far] > rest)}"
    )
    return key, f"{r.y[i]:.6g} {unit}", expected, i


def _turned(kind: str, r: Repetition, up: bool) -> str:
    """The factors of the sensor that counts the other way: one of which nobody spoke, the likelier first."""
    way, load = _roles(r)
    open_ones = [role for role in (way, load) if role in r.channels and r.channels[role].factor is None]
    choices = open_ones or [role for role in (way, load) if role]
    if kind not in NEO_HOOKE:
        return _factors(r, way if way in choices and not up else load if load in choices else choices[0])
    result = {way: "pressed" if up else "pulled", load: "pulled" if up else "pressed"}
    named = any(_PRESSED.search(c.title) for c in r.channels.values())
    likely = "pressed" if not up or named or _looks_pressed(kind, r.x, np.abs(r.y)) else "pulled"
    choices.sort(key=lambda role: result[role] != likely)
    return " or ".join(f"{_factors(r, role)} for a specimen that is {result[role]}" for role in choices)


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
    if not 1.08 < x.max() < 1.9 or x.min() < 0.99:
        return False
    pulled, pressed = (_misfit(basis, y) for basis in (NEO_HOOKE[kind](x), -NEO_HOOKE[kind](2 - x)))
    return pressed < DESCRIBED and pulled > WORSE * pressed


def _misfit(basis: np.ndarray, y: np.ndarray) -> float:
    """Root mean square of what is left of ``y`` without its part along ``basis``, over the largest."""
    rest = y - basis * (basis @ y) / (basis @ basis)
    return float(np.sqrt(np.mean(rest**2)) / np.abs(y).max())


# -- whether repetitions are repetitions --------------------------------------------------------------
def copies(experiments: Sequence[Experiment]) -> Iterator[tuple[Repetition, str, bool]]:
    """Repetitions whose readings stand in the campaign once more, in the same unit or another, what to know,
    and whether their noise is in both, which no two specimens have alike."""
    each = [(e, r) for e in experiments if e.curve for r in e.repetitions]
    for (e, a), (other, b) in combinations(each, 2):
        if e.kind == other.kind and (_stands_in(a, b, e.rest) or _stands_in(b, a, e.rest)):
            titles = " and ".join(f"'{c.title}'" for c in a.channels.values())
            said = (
                f"each specimen once: these readings are those of '{a.name}' in '{e.id}'. Of a channel in"
                f" several units name one as it stands, as {titles}, or by its number; leave a copied file"
                " out"
            )
            yield b, said, float(np.median(roughness(np.arange(b.y.size), b.y))) > NOISY * np.abs(b.y).max()


def _stands_in(a: Repetition, b: Repetition, rest: float) -> bool:
    """Whether all readings of ``a`` are among those of ``b``, one after the other."""
    near = [SAME * np.abs(values).max() for values in (b.x - rest, b.y)]
    starts = (np.abs(b.x - a.x[0]) < near[0]) & (np.abs(b.y - a.y[0]) < near[1])
    parts = [slice(k, k + a.x.size) for k in np.flatnonzero(starts)[:BESIDE] if k + a.x.size <= b.x.size]
    return any(
        np.abs(a.x - b.x[part]).max() < near[0] and np.abs(a.y - b.y[part]).max() < near[1] for part in parts
    )


# -- what a sensor cannot have felt -------------------------------------------------------------------
def doubts(experiment: Experiment) -> Iterator[str]:
    """Sentences on readings that may well be otherwise, each with its place and the key that settles it."""
    yield from dict.fromkeys(field.doubt for field in experiment.fields if field.doubt)
    for r in experiment.repetitions if experiment.curve else ():
        for at, sentence in _doubts(experiment.kind, r):
            fault = r.wrong("", "", "", at)
            place = (
                f"{Path(fault.file).name}, line {fault.line}"
                if fault.file
                else f"'{r.name}', reading {at + 1}"
            )
            yield f"{place}: {sentence}"


def _doubts(kind: str, r: Repetition) -> Iterator[tuple[int, str]]:
    """Readings and what is doubtful there."""
    rest = 1.0 if kind in NEO_HOOKE else 0.0
    out = int(np.argmax(np.abs(r.x - rest))) + 1
    yield from _other_zero(kind, r, rest)
    way, _ = _roles(r)
    if (
        kind in NEO_HOOKE
        and not (way and r.channels[way].factor is not None)
        and _looks_pressed(kind, r.x, r.y)
    ):
        cure = f"{_factors(r, way)}, or 1 if it is pulled" if way else "stretches below 1"
        yield 0, f"the curve is that of a specimen that is pressed, and it is read as pulled: {cure}"
    if kind in ("sliding", "separation"):
        return
    ends = [(check(r.x[:out], r.y[:out]), what) for check, what in _ENDS.items()]
    for at, what in ends:
        if at is not None:
            end = _place(kind, r, r.x[at - 1 : at + 1].mean())
            yield at, f"from here on {what}, while travel goes on: until = {end} leaves that out"
    if not any(at for at, _ in ends):
        yield from _jumps(kind, r)
    level = np.abs(r.y) > MAX_ZERO_OFFSET * np.abs(r.y).max()
    lost = 1 + np.flatnonzero((r.y[1:-1] == 0) & level[:-2] & (level[2:] | (r.y[2:] == 0)))
    if lost.size and level[lost[-1] :].any() and lost.size < r.y.size / 20:
        yield (
            int(lost[0]),
            "the load is exactly 0 for some readings, then back: lost samples, to be left out",
        )


def _place(kind: str, r: Repetition, x: float) -> str:
    """An abscissa as ``from`` and ``until`` take it."""
    if kind not in NEO_HOOKE:
        return f"'{x:.4g} mm'"
    return (
        f"'{abs(x - 1) * r.channels['displacement'].scale:.4g} mm'"
        if "displacement" in r.channels
        else f"{x:.4g}"
    )


def _range_ends(x: np.ndarray, y: np.ndarray) -> int | None:
    """The reading from which the load stands at its end, while the way goes on; it rose up to there."""
    at = int(np.abs(y).argmax())
    held = np.flatnonzero(y[at:] != y[at])
    last = at + (int(held[0]) if held.size else y.size - at) - 1
    ahead = np.diff(y[max(at - max(2 * BESIDE, y.size // 20), 0) : at + 1])
    rises = ahead.size > BESIDE and abs(ahead.sum()) > np.abs(ahead).sum() / 2 and np.mean(ahead == 0) < 0.2
    return at if rises and last - at >= AT_END and abs(x[last] - x[at]) > END_WAY * np.ptp(x) else None


def _load_lost(x: np.ndarray, y: np.ndarray) -> int | None:
    """The reading from which there is no load any more, while the way goes on."""
    least = max(NO_FORCE * np.abs(y).max(), 4 * y[-BESIDE:].std())
    at = int(np.flatnonzero(np.abs(y) >= min(least, np.abs(y).max()))[-1]) + 1
    return at if y.size - at >= AT_END and abs(x[-1] - x[at]) > END_WAY * np.ptp(x) else None


_ENDS = {
    _range_ends: "the load stands at its largest value, to all digits, as at a load cell's end",
    _load_lost: "there is no load any more",
}


def _other_zero(kind: str, r: Repetition, rest: float) -> Iterator[tuple[int, str]]:
    """A first reading without load that is not at rest, or one at rest that has load."""
    x, y, load = r.x - rest, r.y, _roles(r)[1]
    if not {"displacement", load} <= r.channels.keys():
        return
    part, way, top = abs(y[0]) / np.abs(y).max(), np.abs(x).max(), np.abs(y).max()
    u, F = (c.scale / (c.factor or 1.0) for c in (r.channels["displacement"], r.channels[load]))
    if (place := _position(kind, r)) is not None:
        yield 0, f"there is no load at {place}: zero = {place} counts a position, or a gap, from there"
    begun, noise = np.abs(x) < MAX_ZERO_OFFSET * way, float(np.median(roughness(np.arange(y.size), y)))
    at_rest = abs(x[0]) < AT_REST * way and r.contact is None
    if at_rest and begun.sum() > BESIDE and part > max(PRELOAD, PRELOAD_NOISE * noise / top):
        bend, slope, first = np.polyfit(x[begun], y[begun], 2)
        turn = np.sqrt(max(1 - 4 * bend * first / slope**2, 0.0))
        zero, unit = f"'{-2 * u * first / slope / (1 + turn):.4g} mm'", "N" if load == "force" else "MPa"
        said = (
            f"the {load} is not 0 where the displacement is: zero = {zero} if that was set to zero under"
            f" load, force_zero = '{F * first:.4g} {unit}' if the load cell was off"
        )
        yield 0, said


def _position(kind: str, r: Repetition) -> str | None:
    """The recorded displacement of a first reading that is without load and far from rest."""
    x, channel = r.x - (kind in NEO_HOOKE), r.channels.get("displacement")
    if channel is None or abs(x[0]) < MAX_ZERO_OFFSET * np.abs(x).max():
        return None
    place = f"'{x[0] * channel.scale / (channel.factor or 1.0):.4g} mm'"
    return place if abs(r.y[0]) < MAX_ZERO_OFFSET / 4 * np.abs(r.y).max() else None


def _jumps(kind: str, r: Repetition) -> Iterator[tuple[int, str]]:
    """Steps of the load, far above those around, after which it goes on as before: a sensor set to zero."""
    every, steps = -(-r.x.size // MAX_READINGS), list[tuple[int, float]]()
    for width in (every, 2 * every, 3 * every):
        for at, step in _steps(r, width):
            if all(abs(at - other) > 2 * BESIDE * width for other, _ in steps):
                steps.append((at, step))
    for at, step in steps if len(steps) <= MAX_JUMPS else ():
        # A body that is cut gives way by itself, but not to no force at all.
        if kind != "cut" or abs(r.y[at]) < MIN_JUMP * np.abs(r.y).max():
            until = _place(kind, r, r.x[max(at - 3 * every, 0) : at].mean())
            said = (
                f"the load jumps by {step:.3g} of its largest within a reading, and goes on as before: was it"
                f" set to zero amid the test, or does it turn over? until = {until} leaves out what follows"
            )
            yield at, said


def _steps(r: Repetition, width: int) -> Iterator[tuple[int, float]]:
    """Jumps over ``width`` readings, the largest first: where each ends, and its part of the largest load."""
    reach, top = BESIDE * width, np.abs(r.y).max()
    if r.y.size < 2 * reach + width + 1:
        return
    rise, way = r.y[width:] - r.y[:-width], np.abs(r.x[width:] - r.x[:-width])
    at = np.arange(reach, rise.size - reach)
    back, ahead = (np.stack([rise[at + sign * k * width] for k in range(1, BESIDE + 1)]) for sign in (-1, 1))
    around = np.abs(np.concatenate([back, ahead])).max(axis=0)
    went, goes = back.sum(axis=0), ahead.sum(axis=0)
    as_before = (
        (went * goes > 0)
        & (np.abs(went) < AS_BEFORE * np.abs(goes))
        & (np.abs(goes) < AS_BEFORE * np.abs(went))
    )
    as_before &= way[at] < AS_BEFORE * np.median(way)
    if r.time_s is not None:
        sides = ((at - reach, at), (at + width, at + width + reach))
        before, after = (np.abs(r.x[j] - r.x[i]) / (r.time_s[j] - r.time_s[i]) for i, j in sides)
        as_before &= np.maximum(before, after) < SAME_SPEED * np.minimum(before, after)
    size = np.abs(rise[at])
    wide = np.flatnonzero(as_before & (size > JUMP * around) & (size > MIN_JUMP * top))
    for k in wide[np.argsort(-size[wide], kind="stable")]:
        yield int(at[k]) + width, float(size[k] / top)


# -- whether they are of this material ----------------------------------------------------------------
def refuse_implausible(experiment: Experiment, case: Case) -> None:
    """Raise BadInput if the readings cannot be of the material of ``case``."""
    modulus_MPa = case.model.shear_modulus(case.p)
    if experiment.kind == "cut":
        travel_fits(experiment)
    for r in experiment.repetitions if experiment.curve else ():
        if experiment.kind in NEO_HOOKE:
            _stretch(r)
            _modulus(experiment, r, modulus_MPa)
        elif experiment.kind == "cut":
            _cut(experiment, r, modulus_MPa)
        elif experiment.kind == "sliding":
            _sliding(experiment, r, case)
        else:
            _separation(r, case)


def apparent_modulus(experiment: Experiment, r: Repetition) -> float:
    """Shear modulus in MPa of neo-Hooke through the readings of a homogeneous test below a stretch of 1.5."""
    small = np.abs(np.log(r.x)) < np.log(1.5)
    if small.sum() < 3:
        small = np.argsort(np.abs(r.x - 1))[:5]
    unit = NEO_HOOKE[experiment.kind](r.x[small])
    return float(unit @ r.y[small] / (unit @ unit)) if unit @ unit > 0 else float("nan")


def _ratio_text(ratio: float) -> str:
    return f"{ratio:.2g} times" if ratio >= 1 else f"1/{1 / ratio:.2g} of"


def _stretch(r: Repetition) -> None:
    i = int(np.argmax(r.x))
    if r.x[i] > 30:
        expected = "stretches below 30: is a displacement in another unit, or a strain in percent?"
        if "strain" in r.channels and r.channels["strain"].unit in (None, "1"):
            expected += " units = { strain = '%' } reads it in percent"
        raise r.wrong("stretch", f"{r.x[i]:.4g}", expected, i)


def _modulus(experiment: Experiment, r: Repetition, G: float) -> None:
    apparent, strain = apparent_modulus(experiment, r), r.channels.get("strain")
    if strain is not None and strain.unit is None and 0 < PERCENT_RATIO * apparent < G < 1e3 * apparent:
        far = int(np.argmax(np.abs(r.x - 1)))
        small = apparent_modulus(experiment, replace(r, x=1 + (r.x - 1) / 100))
        if max(small / G, G / small) < min(PERCENT_RATIO, G / apparent):
            expected = (
                f"its unit, which no title says: as it stands G is {_ratio_text(apparent / G)} the"
                " material's. units = { strain = '%' } reads it in percent, units = { strain = '1' } as it is"
            )
            raise r.wrong("strain", f"{r.x[far] - 1:.4g}", expected, far)
    if apparent > 0 and not 1 / MAX_MODULUS_RATIO < apparent / G < MAX_MODULUS_RATIO:
        expected = (
            f"about that of the material, {1e3 * G:.3g} kPa; {_ratio_text(apparent / G)} it looks like a"
            " wrong unit of force, stress, length or area, or a wrong material"
        )
        raise r.wrong("stress", f"a shear modulus of {1e3 * apparent:.3g} kPa", expected, _largest(r))


def _largest(r: Repetition) -> int:
    return int(np.argmax(np.abs(r.y)))


def travel_fits(experiment: Experiment) -> None:
    """Raise BadInput if a cut goes far through its specimen, or hardly into it."""
    height = experiment.specimen.get("height", np.inf)
    for r in experiment.repetitions:
        i = int(np.argmax(r.x))
        if r.x[i] > 1.5 * height:
            expected = f"at most 1.5 times the specimen's height of {height:g} mm; is it in another unit?"
            raise r.wrong("displacement", f"{r.x[i]:.4g} mm", expected, i)
        if r.x[i] > height:
            i = int(np.argmax(r.x > height))
            expected = (
                f"at most {height:g} mm, the height, at which the blade meets the plate:"
                f" until = '{0.99 * height:.4g} mm' ends the readings before it, zero says where contact was"
            )
            raise r.wrong("displacement", f"{r.x[i]:.4g} mm", expected, i)
        if r.x[i] < 2e-3 * height and np.isfinite(height):
            expected = f"a travel into the specimen of {height:g} mm; is it in another unit?"
            raise r.wrong("displacement", f"{r.x[i]:.4g} mm at the most", expected, i)


def _cut(experiment: Experiment, r: Repetition, G: float) -> None:
    far = int(np.argmax(r.x)) + 1
    x = np.append(0.0, r.x[:far])
    work = float(np.trapezoid(np.append(0.0, r.y[:far]), x))
    if "length" not in experiment.specimen:  # made without a file: nothing to hold it against
        return
    natural = G * experiment.specimen["length"] * x[-1] ** 2 / 2
    ratio = work / natural
    if not CUT_FORCE_RANGE[0] < ratio < CUT_FORCE_RANGE[1]:
        expected = (
            f"a force of the order of G · length · travel, {natural / x[-1]:.3g} N (the material has G ="
            f" {1e3 * G:.3g} kPa); {_ratio_text(ratio)} it looks like a wrong unit or a wrong material"
        )
        raise r.wrong("force", f"{work / x[-1]:.3g} N on average", expected, _largest(r))


def _sliding(experiment: Experiment, r: Repetition, case: Case) -> None:
    pressure = experiment.pressure_MPa if r.pressure_MPa is None else float(np.median(r.pressure_MPa))
    at = Points(touched=np.ones(1), slid=np.zeros(1), slip_rate=np.zeros(1))
    laws = [law for law in case.model.all if isinstance(law, Blade)]
    strength = sum(float(law.strength(np.array([pressure]), case.p, {}, at)[0]) for law in laws)
    found = float(np.median(np.abs(r.y)))
    if strength > 0 and found > 0 and not 1 / MAX_STRENGTH_RATIO < found / strength < MAX_STRENGTH_RATIO:
        expected = (
            f"about the strength of the material's interface, {1e3 * strength:.3g} kPa;"
            f" {_ratio_text(found / strength)} it looks like a wrong unit of force or area"
        )
        raise r.wrong("traction", f"{1e3 * found:.3g} kPa (median)", expected, _largest(r))


def _separation(r: Repetition, case: Case) -> None:
    parts = [law.estimate(case.p, 0.0, 0.0) for law in case.model.laws("cut")]
    strength, opening = sum(e.strength for e in parts), sum(e.opening for e in parts)
    if not strength:
        return
    i = int(np.argmax(r.y))
    for key, found, wanted, unit in (
        ("traction", 1e3 * r.y[i], 1e3 * strength, "kPa"),
        ("opening", r.x[i], opening, "mm"),
    ):
        if found > 0 and not 1 / MAX_STRENGTH_RATIO < found / wanted < MAX_STRENGTH_RATIO:
            expected = (
                f"about that of the material, {wanted:.3g} {unit}; {_ratio_text(found / wanted)} it looks"
                " like"
            )
            raise r.wrong(key, f"{found:.3g} {unit} at the peak", expected + " a wrong unit", i)
