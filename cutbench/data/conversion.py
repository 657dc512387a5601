"""From the columns of a file to repetitions in internal units: stretch, nominal stress, traction, time.

Of what a machine recorded counts what is asked for: from contact on, without the force before it, from one
place to another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter

from cutbench.base.errors import BadInput
from cutbench.base.units import parse_quantity
from cutbench.data.contact import BEFORE, MIN_FREE_TRAVEL, Contact, contact_at, find_contact, late_contact
from cutbench.data.experiment import HOMOGENEOUS, area_of
from cutbench.data.repetition import JITTER, SAME_SPEED, Channel, Repetition, first_return
from cutbench.data.table import Table

AUTO, RETURN = "auto", "return"
#: An ``until`` so many times as far as the readings go is none of them.
FAR_BEYOND = 1.5
#: What is found and taken off, by key.
TAKEN_OFF = {"zero": "displacement", "force_zero": "force"}


def titles_of(table: Table, label: str | None) -> dict[str, str]:
    """What the repetitions in one file are called, by their labels in it."""
    if table.labels is None:
        return {"1": "1" if label is None else label}
    return {name: name if label is None else f"{label}/{name}" for name in dict.fromkeys(table.labels)}


def repetitions_of(
    table: Table, kind: str, label: str | None, written: Mapping, sizes: Mapping[str, Mapping[str, float]],
    speed: float | None, factors: Mapping[str, float], zeros: Mapping[str, Mapping[str, object]],
) -> list[Repetition]:  # fmt: skip
    """The repetitions in one file, in internal units; ``sizes`` and ``zeros`` are of each by its name."""
    names = np.array(table.labels if table.labels is not None else ["1"] * table.lines.size)
    found = []
    for name, title in titles_of(table, label).items():
        mine = {role: values[names == name] for role, values in table.columns.items()}
        lines, files = table.lines[names == name], np.array(table.files, dtype=object)[names == name]
        if table.clock:
            mine["time"] = mine["time"] - mine["time"][0]
        check_steps(mine, files, lines)
        specimen = sizes[title]
        if "speed" in mine:
            speeds = np.abs(mine.pop("speed"))
            if speeds.max() > SAME_SPEED * speeds.min():
                value, line = f"{speeds.max():g} mm/s", int(lines[speeds.argmax()])
                expected = "one speed in each repetition; a column of time says more"
                raise BadInput(file=files[0], line=line, key="speed", value=value, expected=expected)
            speed = speeds.mean() / (specimen.get("length", 1.0) if kind in HOMOGENEOUS else 1.0)
        own = {**written, **{key: values[title] for key, values in zeros.items()}}
        here, contact = _zeros_taken_off(mine, own, factors, title)
        x, y = _abscissa(here, kind, specimen, speed), _ordinate(here, kind, specimen)
        if written.get("strain") == "true":
            x = np.exp(x - 1)
        if written.get("stress") == "cauchy":
            y = y / np.where(x > 0, x, np.nan)
        pressure = here.get("pressure")
        if "normal_force" in here:
            pressure = here["normal_force"] / area_of(kind, specimen)
        first = contact.first if contact is not None and "zero" in written else 0
        length = specimen["length"] if kind in HOMOGENEOUS and "displacement" in here else None
        keep = _selected_readings(written, kind, x, first, length)
        x, y, lines, files = x[keep], y[keep], lines[keep], files[keep]
        time, pressure = (None if a is None else a[keep] for a in (here.get("time"), pressure))
        if time is None and speed is not None and not (kind == "cut" and first_return(x) is not None):
            way = np.cumsum(np.append(abs(x[0] - (kind in HOMOGENEOUS)), np.abs(np.diff(x))))
            # Equal abscissas, as coarse sensors give them, need times that differ.
            time = (way + 1e-9 * way[-1] * np.arange(x.size)) / speed
        file = files[0] if len(set(files)) == 1 else tuple(files)
        channels = _channels(table, kind, specimen, factors)
        found.append(Repetition(x, y, time, title, pressure, file, lines, contact, channels))
    return found


def _channels(
    table: Table, kind: str, specimen: Mapping[str, float], factors: Mapping[str, float]
) -> dict[str, Channel]:
    """The columns as they were recorded, and what one of stretch and of stress is in them."""
    length = specimen.get("length", 1.0) if kind in HOMOGENEOUS else 1.0
    scales = {"displacement": length, "force": (area_of(kind, specimen) or 1.0) if kind != "cut" else 1.0}
    return {
        role: replace(channel, factor=factors.get(role), scale=scales.get(role, 1.0))
        for role, channel in table.channels.items()
    }


def _abscissa(here: Mapping, kind: str, specimen: Mapping[str, float], speed: float | None) -> np.ndarray:
    if "stretch" in here:
        return here["stretch"]
    if "strain" in here:
        return 1 + here["strain"]
    if "displacement" in here:
        u = here["displacement"]
        return 1 + u / specimen["length"] if kind in HOMOGENEOUS else u
    if speed is None:
        expected = "the sliding speed, or a column of displacement"
        raise BadInput(key="speed", value="(missing)", expected=expected)
    return speed * (here["time"] - here["time"][0])


def _ordinate(here: Mapping, kind: str, specimen: Mapping[str, float]) -> np.ndarray:
    if "stress" in here:
        return here["stress"]
    return here["force"] if kind == "cut" else here["force"] / area_of(kind, specimen)


# -- contact ----------------------------------------------------------------------------------------
def _zeros_taken_off(
    read: Mapping[str, np.ndarray], written: Mapping, factors: Mapping[str, float], title: str
) -> tuple[dict[str, np.ndarray], Contact | None]:
    """The columns times their factors, displacement from contact and force from its zero, if that is asked
    for; and the contact, in recorded values."""
    zeros, contact = dict.fromkeys(read, 0.0), None
    load = "force" if "force" in read else "stress"
    if "zero" in written or written.get("force_zero") == AUTO:
        if "displacement" not in read:
            key = "zero" if "zero" in written else "force_zero"
            raise BadInput(key=key, value=str(written[key])[:60], expected="a column of displacement")
        contact = _contact(read, written, factors, load, title)
        zeros["displacement"] = contact.at if "zero" in written else 0.0
    elif "displacement" in read and load in read and not {"from", "force_zero"} & written.keys():
        _, out, rise, sense, pull = _loading_path(read, factors, load)
        late = late_contact(out, rise) if np.isfinite([out, rise]).all() else None
        contact = None if late is None else _in_recorded_units(late, sense, pull, load)
    if "force_zero" in written:
        zeros[load] = _force_zero(written["force_zero"], load, contact)
    if contact is not None:
        off = tuple(what for key, what in TAKEN_OFF.items() if written.get(key) == AUTO)
        given = 0.0 if "force" in off else zeros[load]
        contact = replace(contact, taken_off=off, force=contact.force - given)
    here = {role: factors.get(role, 1.0) * (values - zeros[role]) for role, values in read.items()}
    return here, contact


def _loading_path(
    read: Mapping[str, np.ndarray], factors: Mapping[str, float], load: str
) -> tuple[int, np.ndarray, np.ndarray, float, float]:
    """The reading with which the way out begins, displacement and force from there on, both growing on the
    way out, and what turns each into recorded ones.

    A machine that first drives back, and a first reading from before the test, do not count.
    """
    signs = [float(np.sign(factors.get(role, 1.0))) for role in ("displacement", load)]
    if read[load].size < BEFORE:
        return 0, signs[0] * read["displacement"], signs[1] * read[load], signs[0], signs[1]
    way = _direction(signs[0] * read["displacement"], read[load])
    sense, pull = (way * sign for sign in signs)
    u = sense * read["displacement"]
    rise = u - np.minimum.accumulate(u) > MIN_FREE_TRAVEL * np.ptp(u[1:])
    ahead = u[: int(np.argmax(rise)) + 1] if rise.any() else u
    lowest = int(np.argmin(ahead))
    above = np.flatnonzero(ahead[:lowest] > ahead[lowest] + JITTER * np.ptp(u[1:]))
    first = int(above[-1]) + 1 if above.size else 0
    return first, u[first:], pull * read[load][first:], sense, pull


def _contact(
    read: Mapping[str, np.ndarray], written: Mapping, factors: Mapping[str, float], load: str, title: str
) -> Contact:
    first, u, y, sense, pull = _loading_path(read, factors, load)
    zero = written.get("zero", AUTO)
    if zero != AUTO:
        at = parse_quantity(zero, "mm", key="zero")
        if not (u[0] - np.ptp(u) <= sense * at < u.max()):
            ends = sorted((float(sense * u[0]), float(sense * u.max())))
            expected = f"a displacement that was recorded, from {ends[0]:g} to {ends[1]:g} mm"
            raise BadInput(key="zero", value=str(zero), expected=expected)
        found: Contact | str = contact_at(u, y, sense * at)
    else:
        tare = written.get("force_zero", AUTO)
        found = find_contact(u, y, None if tare == AUTO else pull * _force_zero(tare, load, None))
    if isinstance(found, str):
        key, such = ("zero", "2.1 mm") if "zero" in written else ("force_zero", "0.01 N")
        expected = (
            f"{BEFORE} readings or more before contact, and a clear rise after it, in repetition '{title}';"
            f" {found}. Write where it is, such as {key} = '{such}', leave it out where the machine counts"
            " from contact, or give force_zero where it began at a trigger force"
        )
        raise BadInput(key=key, value=AUTO, expected=expected)
    return replace(_in_recorded_units(found, sense, pull, load), first=first)


def _in_recorded_units(found: Contact, sense: float, pull: float, load: str) -> Contact:
    unit = "N" if load == "force" else "MPa"
    return replace(found, at=sense * found.at, force=pull * found.force, unit=unit)


def _direction(x: np.ndarray, y: np.ndarray | None = None) -> float:
    """1 or -1: towards which end the test goes, wherever its first reading is: that of the largest change of
    ``y``, as a machine may first drive back, or the farther one."""
    start = float(np.median(x[:3]))
    most = x[np.argmax(np.abs(x - start))]
    if y is not None:
        loaded = x[1 + np.argmax(np.abs(y[1:] - np.median(y[:3])))]
        most = loaded if abs(loaded - start) > JITTER * np.ptp(x) else most
    return -1.0 if most < start else 1.0


def _force_zero(raw: object, load: str, contact: Contact | None) -> float:
    if raw == AUTO and contact is not None:
        if np.isnan(contact.force):
            expected = "two readings or more before contact, or the force there, such as '0.01 N'"
            raise BadInput(key="force_zero", value=AUTO, expected=expected)
        return contact.force
    if load == "stress":
        return parse_quantity(raw, "MPa", key="force_zero")
    try:
        return parse_quantity(raw, "N", key="force_zero")
    except BadInput:
        try:
            return 9.80665 * parse_quantity(raw, "kg", key="force_zero")  # the weight of a mass
        except BadInput:
            pass
        raise


# -- from here to there -----------------------------------------------------------------------------
def _selected_readings(
    written: Mapping, kind: str, x: np.ndarray, first: int, length: float | None
) -> np.ndarray:
    """The readings (k,) that count: from contact on, on the way out that begins with reading ``first``, where
    that is known, from ``from`` up to the first beyond ``until``, which is ``return`` for the farthest.
    Raises BadInput if none are left, or ``until`` is far from all."""
    way = _direction(x[first:])
    rest, unit = (1.0, "") if kind in HOMOGENEOUS else (0.0, " mm")
    out = way * (x - rest)
    far = f"they go to {x[np.argmax(out)]:.4g}{unit}"
    if length is not None:
        far += f", a displacement of {length * out.max():.4g} mm"
    far += " from contact" * ("zero" in written)

    def place(key: str) -> float:
        """How far from rest; in a test whose file has displacements these, too."""
        with suppress(BadInput):
            if length is not None:
                return abs(parse_quantity(written[key], "mm", key=key)) / length
        return way * (parse_quantity(written[key], unit.strip() or "1", key=key) - rest)

    keep = np.arange(x.size)
    if "until" in written:
        last = first + int(np.argmax(out[first:])) + 1
        if written["until"] != RETURN:
            if (end := place("until")) > FAR_BEYOND * out.max():
                expected = f"a place that the readings reach; {far}"
                raise BadInput(key="until", value=str(written["until"]), expected=expected)
            beyond = out > end
            last = int(np.argmax(beyond)) if beyond.any() else x.size
        keep = keep[:last]
    if "from" in written:
        reached = out[keep] >= place("from")
        keep = keep[int(np.argmax(reached)) :] if reached.any() else keep[:0]
    if "zero" in written:
        keep = keep[(out[keep] >= 0) & (keep >= first)]
    for key in ("from", "until", "zero"):
        if key in written and keep.size == 0:
            expected = f"a place that leaves readings; {far}"
            raise BadInput(key=key, value=str(written[key]), expected=expected)
    return keep


# -- readings that no machine makes -------------------------------------------------------------------
#: A step of so many times those before it, and those around it, is looked at.
OUTLIER_STEPS = 15.0
#: Readings that may lie off before the rest is back.
OFF = 3
#: Of readings that go one way, the steps sum up to this part of their sizes' sum.
MONOTONE_FRACTION = 0.7
#: Steps by which a reading may miss where it should be.
RETURN_STEPS = 3.0
#: By which a decimal point is lost, or a sign between thousands is taken for one.
POWERS_OF_TEN = np.array([10.0, 100.0, 1e3, 1e4, 1e-1, 1e-2, 1e-3])


def check_steps(read: Mapping[str, np.ndarray], files: Sequence[str], lines: np.ndarray) -> None:
    """Raise BadInput for the first recorded travel or time of ``read`` (n,) that lies far from where those
    before it go, as where a decimal point was lost, with its place in ``files`` and ``lines`` (n,).

    A jump is a step many times as large as those before it, which go one way: what rests, as before the step
    of a relaxation, has no pace to be measured against. It is refused where it ends a power of ten from where
    the readings were going, at a pace so many times theirs, or where the next are back; another step that
    stays may be the test's own.
    """
    for role in ("displacement", "stretch", "strain", "time"):
        if role not in read or read[role].size < 2 * BEFORE:
            continue
        for at, times, goes in _jumps(read[role], read.get("time") if role != "time" else None):
            # A time that runs back is another fault, and a last one may be late.
            if role != "time" or (read[role][at] > goes and at < read[role].size - 1):
                expected = (
                    f"about {goes:.6g}, where the readings before it go: this is {times:.2g} of their steps."
                    " Was a decimal point lost, or is a sign between thousands taken for one?"
                )
                value = f"{read[role][at]:.6g}"
                raise BadInput(file=files[at], line=int(lines[at]), key=role, value=value, expected=expected)


def _jumps(x: np.ndarray, time: np.ndarray | None) -> Iterator[tuple[int, float, float]]:
    """Readings that jump, by how many steps, and where they should be, seen from those before or behind."""
    steps = np.abs(np.diff(x))
    if time is not None and np.all(np.diff(time) > 0):
        # Where readings are farther apart in time, they are in travel too.
        steps = np.minimum(steps, steps * np.median(np.diff(time)) / np.diff(time))
    usual = median_filter(steps, 2 * BEFORE + 1, mode="mirror")
    wide = (steps > OUTLIER_STEPS * usual) & (usual > 0)
    for way in (1, -1):
        z, size = x[::way], steps[::way]
        for j in map(int, np.flatnonzero(wide[::way])):
            before = np.diff(z[max(j - BEFORE, 0) : j + 1])
            step = float(before.mean()) if before.size > 1 else 0.0
            if (
                abs(before.sum()) < MONOTONE_FRACTION * np.abs(before).sum()
                or size[j] <= OUTLIER_STEPS * abs(step)
                or step == 0
            ):
                continue
            goes, near, later = z[j] + step, RETURN_STEPS * abs(step), z[j + 2 : j + 2 + OFF]
            back = np.abs(later - z[j]) < near * np.arange(2, 2 + later.size)
            pace = (
                abs(z[j + 2] - z[j + 1]) / abs(step) / POWERS_OF_TEN
                if later.size
                else np.ones(POWERS_OF_TEN.size)
            )
            shifted = (
                (np.abs(z[j + 1] / POWERS_OF_TEN - goes) < near)
                & (pace < RETURN_STEPS)
                & (pace > 1 / RETURN_STEPS)
            )
            shifted &= (abs(goes) > RETURN_STEPS * near) & (way > 0)
            if shifted.any() or back.any():
                yield j + 1 if way > 0 else x.size - 2 - j, size[j] / abs(step), goes
