"""From the columns of a file to repetitions in internal units: stretch, nominal stress, traction, time.

Of what a machine recorded counts what is asked for: from contact on, without the force before it, from one
place to another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.units import parse_quantity
from cutbench.data.contact import BEFORE, Contact, contact_at, find_contact, late_contact
from cutbench.data.experiment import HOMOGENEOUS, area_of
from cutbench.data.repetition import Repetition, first_return
from cutbench.data.table import Table

AUTO, RETURN = "auto", "return"
#: What is found and taken off, by key.
TAKEN_OFF = {"zero": "displacement", "force_zero": "force"}


def repetitions_of(
    table: Table, kind: str, label: str | None, written: Mapping, specimen: Mapping[str, float],
    speed: float | None, factors: Mapping[str, float],
) -> list[Repetition]:  # fmt: skip
    """The repetitions in one file, in internal units."""
    names = np.array(table.labels if table.labels is not None else ["1"] * table.lines.size)
    found = []
    for name in dict.fromkeys(names):
        title = str(name) if label is None else label if table.labels is None else f"{label}/{name}"
        file, lines = str(table.path), table.lines[names == name]
        mine = {role: values[names == name] for role, values in table.columns.items()}
        here, contact = _begun(mine, _own(written, title), factors, title)
        x, y = _abscissa(here, kind, specimen, speed), _ordinate(here, kind, specimen)
        if kind in HOMOGENEOUS and written.get("stress", "nominal") == "cauchy":
            y = y / np.where(x > 0, x, np.nan)
        pressure = here.get("pressure")
        if "normal_force" in here:
            pressure = here["normal_force"] / area_of(kind, specimen)
        keep = _kept(written, kind, x)
        x, y, lines = x[keep], y[keep], lines[keep]
        time, pressure = (None if a is None else a[keep] for a in (here.get("time"), pressure))
        if time is None and speed is not None and not (kind == "cut" and first_return(x) is not None):
            way = np.cumsum(np.append(abs(x[0] - (kind in HOMOGENEOUS)), np.abs(np.diff(x))))
            # Equal abscissas, as coarse sensors give them, need times that differ.
            time = (way + 1e-9 * way[-1] * np.arange(x.size)) / speed
        found.append(Repetition(x, y, time, title, pressure, file, lines, contact))
    return found


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


def _own(written: Mapping, title: str) -> dict:
    """What is written of one repetition: of zeros by name its own."""
    found = dict(written)
    for key in TAKEN_OFF:
        if isinstance(raw := written.get(key), Mapping):
            if title not in raw:
                expected = f"a value for each repetition; none is given for '{title}'"
                raise BadInput(key=key, value=", ".join(raw), expected=expected)
            found[key] = raw[title]
    return found


# -- contact ----------------------------------------------------------------------------------------
def _begun(
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
        contact = _noticed(read, factors, load)
    if "force_zero" in written:
        zeros[load] = _force_zero(written["force_zero"], load, contact)
    if contact is not None:
        off = tuple(what for key, what in TAKEN_OFF.items() if written.get(key) == AUTO)
        given = 0.0 if "force" in off else zeros[load]
        contact = replace(contact, taken_off=off, force=contact.force - given)
    return {role: factors.get(role, 1.0) * (values - zeros[role]) for role, values in read.items()}, contact


def _outward(
    read: Mapping[str, np.ndarray], factors: Mapping[str, float], load: str
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Displacement and force, both growing on the way out, and what turns each into recorded ones."""
    signs = [float(np.sign(factors.get(role, 1.0))) for role in ("displacement", load)]
    way = _way(signs[0] * read["displacement"])
    sense, pull = (way * sign for sign in signs)
    return sense * read["displacement"], pull * read[load], sense, pull


def _contact(
    read: Mapping[str, np.ndarray], written: Mapping, factors: Mapping[str, float], load: str, title: str
) -> Contact:
    u, y, sense, pull = _outward(read, factors, load)
    zero = written.get("zero", AUTO)
    if zero != AUTO:
        at = parse_quantity(zero, "mm", key="zero")
        if not (u[0] - np.ptp(u) <= sense * at < u.max()):
            ends = sorted((float(read["displacement"][0]), float(sense * u.max())))
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
    return _recorded(found, sense, pull, load)


def _recorded(found: Contact, sense: float, pull: float, load: str) -> Contact:
    unit = "N" if load == "force" else "MPa"
    return replace(found, at=sense * found.at, force=pull * found.force, unit=unit)


def _noticed(read: Mapping[str, np.ndarray], factors: Mapping[str, float], load: str) -> Contact | None:
    """Travel before contact that nobody spoke of."""
    u, y, sense, pull = _outward(read, factors, load)
    found = late_contact(u, y) if np.isfinite(u).all() and np.isfinite(y).all() else None
    return None if found is None else _recorded(found, sense, pull, load)


def _way(x: np.ndarray) -> float:
    """1 or -1: towards which end the test goes."""
    return -1.0 if x[np.argmax(np.abs(x - x[0]))] < x[0] else 1.0


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
def _kept(written: Mapping, kind: str, x: np.ndarray) -> np.ndarray:
    """The readings (k,) that count: from contact on where that is known, from ``from`` up to the first beyond
    ``until``, which is ``return`` for the farthest. Raises BadInput if none are left."""
    rest = 1.0 if kind in HOMOGENEOUS else 0.0
    way = _way(x)
    out, unit = way * (x - rest), "1" if kind in HOMOGENEOUS else "mm"
    keep = np.arange(x.size)
    if "until" in written:
        last = int(np.argmax(out)) + 1
        if written["until"] != RETURN:
            beyond = out > way * (parse_quantity(written["until"], unit, key="until") - rest)
            last = int(np.argmax(beyond)) if beyond.any() else x.size
        keep = keep[:last]
    if "from" in written:
        reached = out[keep] >= way * (parse_quantity(written["from"], unit, key="from") - rest)
        keep = keep[int(np.argmax(reached)) :] if reached.any() else keep[:0]
    if "zero" in written:
        keep = keep[out[keep] >= 0]
    for key in ("from", "until", "zero"):
        if key in written and keep.size == 0:
            far = f"{x[np.argmax(out)]:.4g}{'' if unit == '1' else ' mm'}"
            expected = f"a place that leaves readings; they go to {far}" + (
                " from contact" if "zero" in written else ""
            )
            raise BadInput(key=key, value=str(written[key]), expected=expected)
    return keep
