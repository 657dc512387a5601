"""Where a test begins: the contact after an approach, found as the change point of the force.

Before contact the force is a constant F₀; after it, it rises as c₁ hᵐ + c₂ hᵐ⁺¹ with h = u − u₀ and m = 1 (a
strip, a flat punch), 3/2 (a ball) or 2 (a cone, a tip that sinks in). For each u₀ and m the others follow by
least squares, with c₁ ≥ 0 and a force that still rises at the end; of the sum S of squares of the n
readings S^(−(n − 4)/2) is the likelihood of u₀, whose mean and standard deviation follow over all m. The
readings that count go from the first to where the force has risen by a fifth of its largest rise, or by a
tenth or a twentieth where the rise up to there is not described to within the noise. What the next part would
change of u₀, and a twelfth of the squared spacing of readings, are added to its variance. Where F₀ is known,
u₀ may lie before the first reading, as in a test that was recorded from a trigger force on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput, require
from cutbench.base.units import parse_quantity
from cutbench.data.covariance import roughness
from cutbench.data.experiment_section import parse_either
from cutbench.data.repetition import JITTER, Repetition
from cutbench.data.table import Table
from cutbench.mechanisms import registry

AUTO = "auto"
#: What is found and taken off, by key.
TAKEN_OFF = {"zero": "displacement", "force_zero": "force"}
#: Standard deviations within which a contact that was found is believed.
COVERAGE_FACTOR = 4.0
#: Fewest readings before contact, and of the rise.
BEFORE, AFTER = 5, 4
#: A rise below so many times the noise is none.
MIN_SIGNAL_TO_NOISE = 10.0
#: Travel without force above this part of the whole is spoken of.
MIN_FREE_TRAVEL = 0.03


@dataclass(frozen=True)
class Contact:
    """Contact at ``at`` mm of the recorded displacement, known to ``sd``, after so many ``readings``; before
    it the force is ``force``, known to ``force_sd``, later ``largest`` at the most, in ``unit``.
    ``taken_off``: which of ``displacement`` and ``force`` was found and taken off; a force that was given is
    taken off ``force``, too. ``first``: so many readings come before the way out begins, as of a machine that
    first drives back."""

    at: float
    sd: float
    force: float
    force_sd: float
    readings: int
    largest: float
    unit: str = "N"
    taken_off: tuple[str, ...] = ()
    first: int = 0

    def remaining_uncertainty(self, what: str) -> float:
        """How far the ``displacement`` (mm) or ``force`` (N) that was found here and taken off may be wrong,
        with room for what the rule itself may be off; infinite where it was not."""
        sd = self.sd if what == "displacement" else self.force_sd if self.unit == "N" else np.inf
        return COVERAGE_FACTOR * sd if what in self.taken_off and sd > 0 else np.inf


def contact_at(u: np.ndarray, y: np.ndarray, at: float, sd: float = 0.0) -> Contact:
    """The contact at a known place; the force before it is nan where fewer than two readings lie there."""
    ahead = int(np.argmax(u >= at)) if u.max() >= at else 0
    surely = int(np.argmax(u >= at - 2 * sd))
    air = y[: max(surely, min(ahead, BEFORE))]
    if air.size < 2:
        return Contact(at, sd, np.nan, np.nan, ahead, float(y.max()))
    error = float(air.std(ddof=1) / np.sqrt(air.size))
    return Contact(at, sd, float(air.mean()), error, ahead, float(y.max()))


def find_contact(u: np.ndarray, y: np.ndarray, air: float | None = None) -> Contact | str:
    """The contact of a test on its way out, ``u`` and ``y`` (n,) oriented so that both grow; else why there
    is none. Where the force before contact is known, ``air``, contact may lie before the first reading."""
    far = int(np.argmax(u)) + 1
    all_u, all_y = u[:far], y[:far]
    by = -(-far // 1000)  # of many readings means of so many; what is left over at the end is left out
    u, y = (v[: v.size // by * by].reshape(-1, by).mean(axis=1) for v in (all_u, all_y))
    far = u.size
    if far < BEFORE + AFTER:
        return f"{far} readings on the way out, fewer than {BEFORE + AFTER}"
    base = float(np.median(y[:BEFORE])) if air is None else air
    noise, top = float(np.median(roughness(np.arange(far), y))), float(y.max()) - base
    if top < MIN_SIGNAL_TO_NOISE * noise:
        return f"the force rises by no more than {MIN_SIGNAL_TO_NOISE:g} times its noise"
    parts = [_change_point(u[:end], y[:end], air) for end in _rise_ends(y - base, top, noise)]
    # Up to a residual of so many times the noise the rise counts as described.
    best = next((i for i, (_, _, rms) in enumerate(parts) if rms < 1.3 * noise), len(parts) - 1)
    other = parts[best + 1 if best + 1 < len(parts) else max(best - 1, 0)][0]
    at, sd, _ = parts[best]
    spacing = float(np.median(np.abs(np.diff(u))))
    known = contact_at(all_u, all_y, at, float(np.sqrt(sd**2 + (at - other) ** 2 + spacing**2 / 12)))
    if known.readings < BEFORE and air is None:
        return f"the force rises from reading {known.readings + 1} on"
    return known


def late_contact(u: np.ndarray, y: np.ndarray) -> Contact | None:
    """The contact of a test that begins with travel in which its force does not rise, ``u`` and ``y`` as
    above; None for others. Most are told at a glance."""
    way = float(np.ptp(u))
    still = int(np.argmax(u - u[0] > MIN_FREE_TRAVEL * way))
    rise = y - np.median(y[:BEFORE])
    if still < BEFORE or np.abs(rise[:still]).max() > MIN_FREE_TRAVEL * rise.max():
        return None
    contact = find_contact(u, y)
    if isinstance(contact, str) or contact.at - COVERAGE_FACTOR * contact.sd < u[0]:
        return None
    return contact if contact.at > u[0] + MIN_FREE_TRAVEL * way else None


def _rise_ends(rise: np.ndarray, top: float, noise: float) -> Iterator[int]:
    """How many readings count, for each part of the curve that has enough of them above the noise: up to a
    part of the largest rise, the widest first."""
    last = 0
    for part in (0.2, 0.1, 0.05):
        above = rise > part * top
        lasting = above & np.append(above[1:], True)
        end = int(np.argmax(lasting)) + 1
        rising = int((rise[:end] > 3 * noise).sum())
        if last == 0 or (rising >= AFTER and part * top > MIN_SIGNAL_TO_NOISE * noise and end < last):
            end = min(max(end, end + AFTER - rising), rise.size)
            last = end
            yield end


def _change_point(u: np.ndarray, y: np.ndarray, air: float | None) -> tuple[float, float, float]:
    """Mean and standard deviation of the change point, and the least residual's root mean square."""
    first, last = u[0] if air is None else 2 * u[0] - u[-1], u[-1]
    low, high = first, last
    # Forty places are tried in intervals that narrow around the likeliest, with each way a force may rise.
    for _ in range(3):
        places = np.linspace(low, high, 42)[1:-1]
        squares = np.array([[_misfit(u, y, air, at, m) for m in (1.0, 1.5, 2.0)] for at in places])
        chance = (squares / squares.min()) ** (-(u.size - 4) / 2)
        weight = chance.sum(axis=1) / chance.sum()
        at = float(weight @ places)
        sd = float(np.sqrt(weight @ (places - at) ** 2))
        reach = max(5 * sd, 2 * (places[1] - places[0]))
        low, high = max(first, at - reach), min(last, at + reach)
    return at, sd, float(np.sqrt(squares.min() / max(u.size - 4, 1)))


def _misfit(u: np.ndarray, y: np.ndarray, air: float | None, at: float, m: float) -> float:
    """The least sum of squares about F₀ + c₁ hᵐ + c₂ hᵐ⁺¹, of a known F₀ or the best."""
    h = np.maximum(u - at, 0.0)
    constant = [np.ones_like(u)] if air is None else []
    rise = y if air is None else y - air
    for powers in ((m, m + 1), (m,)):
        A = np.stack([*(h**k for k in powers), *constant], axis=1)
        c, *_ = np.linalg.lstsq(A, rise, rcond=None)
        if c[0] >= 0 and sum(k * a * h[-1] ** (k - m) for k, a in zip(powers, c, strict=False)) >= 0:
            break
    return float(((rise - A @ c) ** 2).sum())


# -- zeros that are taken off -------------------------------------------------------------------------
def zeros_taken_off(
    table: Table, written: Mapping, factors: Mapping[str, float], title: str
) -> tuple[Table, Contact | None]:
    """The columns times their factors, displacement from contact and force from its zero, if that is asked
    for; and the contact, in recorded values."""
    read = table.columns
    zeros, contact = dict.fromkeys(read, 0.0), None
    load = "force" if "force" in read else "stress"
    asked = [key for key in TAKEN_OFF if (key == "zero" and key in written) or written.get(key) == AUTO]
    if asked:
        require("displacement" in read, asked[0], written[asked[0]], "a column of displacement")
    if asked or ({"displacement", load} <= read.keys() and not {"from", "force_zero"} & written.keys()):
        contact = _contact(read, written, factors, load, title, bool(asked))
    if "force_zero" in written:
        zeros[load] = _force_zero(written["force_zero"], load, contact)
    if contact is not None:
        zeros["displacement"] = contact.at if "zero" in written else 0.0
        off = tuple(what for key, what in TAKEN_OFF.items() if written.get(key) == AUTO)
        told = 0.0 if "force" in off else zeros[load]
        contact = replace(contact, taken_off=off, force=contact.force - told)
    moved = {role: factors.get(role, 1.0) * (values - zeros[role]) for role, values in read.items()}
    return table.having(**moved), contact


def _loading_path(
    read: Mapping[str, np.ndarray], factors: Mapping[str, float], load: str
) -> tuple[int, np.ndarray, np.ndarray, float, float]:
    """The reading with which the way out begins, displacement and force from there on, both growing on the
    way out, and what turns each into recorded ones.

    A machine that first drives back, and a first reading from before the test, do not count.
    """
    sense, pull = (float(np.sign(factors.get(role, 1.0))) for role in ("displacement", load))
    first, u, y = 0, read["displacement"], read[load]
    if y.size >= BEFORE:
        way = direction(sense * u, y)
        sense, pull = way * sense, way * pull
        reach = np.ptp(u[1:])
        rise = sense * u - np.minimum.accumulate(sense * u) > MIN_FREE_TRAVEL * reach
        ahead = sense * u[: int(np.argmax(rise)) + 1 if rise.any() else u.size]
        lowest = int(np.argmin(ahead))
        above = np.flatnonzero(ahead[:lowest] > ahead[lowest] + JITTER * reach)
        first = int(above[-1]) + 1 if above.size else 0
    return first, sense * u[first:], pull * y[first:], sense, pull


def _contact(
    read: Mapping[str, np.ndarray], written: Mapping, factors: Mapping[str, float], load: str, title: str,
    asked: bool,
) -> Contact | None:  # fmt: skip
    """The contact in recorded values; where nobody ``asked`` for it that of a test that begins before it."""
    first, u, y, sense, pull = _loading_path(read, factors, load)
    zero, tare = written.get("zero", AUTO), written.get("force_zero", AUTO)
    contact: Contact | str | None
    if not asked:
        contact = late_contact(u, y) if np.isfinite([u, y]).all() else None
    elif zero != AUTO:
        at = parse_quantity(zero, "mm", key="zero")
        ends = sorted((float(sense * u[0]), float(sense * u.max())))
        expected = f"a displacement that was recorded, from {ends[0]:g} to {ends[1]:g} mm"
        require(u[0] - np.ptp(u) <= sense * at < u.max(), "zero", zero, expected)
        contact = contact_at(u, y, sense * at)
    else:
        contact = find_contact(u, y, None if tare == AUTO else pull * _force_zero(tare, load, None))
    if isinstance(contact, str):
        key, such = ("zero", "2.1 mm") if "zero" in written else ("force_zero", "0.01 N")
        expected = (
            f"{BEFORE} readings or more before contact, and a clear rise after it, in repetition '{title}';"
            f" {contact}. Write where it is, such as {key} = '{such}', leave it out where the machine counts"
            " from contact, or give force_zero where it began at a trigger force"
        )
        raise BadInput(key=key, value=AUTO, expected=expected)
    if contact is None:
        return None
    at, force, unit = sense * contact.at, pull * contact.force, "N" if load == "force" else "MPa"
    return replace(contact, at=at, force=force, unit=unit, first=first * asked)


def direction(x: np.ndarray, y: np.ndarray | None = None) -> float:
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
        expected = "two readings or more before contact, or the force there, such as '0.01 N'"
        require(not np.isnan(contact.force), "force_zero", AUTO, expected)
        return contact.force
    if load == "stress":
        return parse_quantity(raw, "MPa", key="force_zero")
    force, unit = parse_either(raw, "kg", "N", key="force_zero")
    return 9.80665 * force if unit == "kg" else force  # the weight of a mass


# -- what to know of it -------------------------------------------------------------------------------
def contact_notes(repetitions: Sequence[Repetition]) -> tuple[str, ...]:
    """What to know of the contacts of a test: where each lies, what the force is before it, and whether these
    were taken off."""
    known = [(r, r.contact) for r in repetitions if r.contact is not None]
    moved, tared = (any(what in c.taken_off for _, c in known) for what in ("displacement", "force"))
    notes = []
    if places := [(r.name, f"{c.at:.3f} ± {c.sd:.2g} mm") for r, c in known if moved and c.sd > 0]:
        notes.append(f"contact found at a recorded displacement of {_listed(places)}")
    if early := [(r.name, str(c.first)) for r, c in known if moved and c.first]:
        notes.append(
            f"readings before the lowest, with which the way out begins, are left out: {_listed(early)}"
        )
    airs = [(r, c) for r, c in known if np.isfinite(c.force)]
    if tared or any(abs(c.force) > max(3 * c.force_sd, 2e-3 * c.largest) for _, c in airs):
        forces = _listed([(r.name, f"{c.force:.3g} ± {c.force_sd:.2g} {c.unit}") for r, c in airs])
        used = "taken off" if tared else "which is not taken off: force_zero = 'auto' does"
        notes.append(f"the force before contact is {forces}, {used}")
    return tuple(notes)


def _listed(values: Sequence[tuple[str, str]]) -> str:
    if len(values) == 1:
        return values[0][1]
    return ", ".join(f"{text} ({name})" for name, text in values)


def bounds_by(repetitions: Sequence[Repetition]) -> dict[str, tuple[float, float]]:
    """Bounds of the parameters by which laws of the testing machine say what the approach has told, where it
    was found and taken off in all ``repetitions``."""
    contacts = [r.contact for r in repetitions]
    bounds: dict[str, tuple[float, float]] = {}
    for law in registry().values():
        what = getattr(law, "approach", "")
        rooms = [np.inf if c is None else c.remaining_uncertainty(what) for c in contacts if what]
        room = max(rooms, default=np.inf)
        bounds |= {q.name: (-room, room) for q in law.parameters if np.isfinite(room)}
    return bounds
