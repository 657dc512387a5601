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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cutbench.data.covariance import roughness
from cutbench.data.repetition import Repetition
from cutbench.mechanisms import registry

#: Standard deviations within which a contact that was found is believed.
COVERAGE_FACTOR = 4.0
#: Parts of the largest rise of the force up to which readings count, the widest first.
RISE_FRACTIONS = (0.2, 0.1, 0.05)
#: Fewest readings before contact, and of the rise.
BEFORE, AFTER = 5, 4
#: Residual in units of the noise up to which the rise counts as described.
MAX_RESIDUAL = 1.3
#: A rise below so many times the noise is none.
MIN_SIGNAL_TO_NOISE = 10.0
#: Places that are tried, in intervals that narrow around the likeliest by turns.
PLACES, TURNS = 40, 3
#: More readings than that are averaged in groups first.
MAX_READINGS = 1000
#: Travel without force above this part of the whole is spoken of.
MIN_FREE_TRAVEL = 0.03
#: A force before contact is spoken of above this part of the largest.
MIN_FORCE_OFFSET = 2e-3
#: With which the force begins to rise.
CONTACT_EXPONENTS = (1.0, 1.5, 2.0)


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
    by = -(-far // MAX_READINGS)  # means of so many; what is left over at the end is left out
    u, y = (v[: v.size // by * by].reshape(-1, by).mean(axis=1) for v in (all_u, all_y))
    far = u.size
    if far < BEFORE + AFTER:
        return f"{far} readings on the way out, fewer than {BEFORE + AFTER}"
    base = float(np.median(y[:BEFORE])) if air is None else air
    noise, top = float(np.median(roughness(np.arange(far), y))), float(y.max()) - base
    if top < MIN_SIGNAL_TO_NOISE * noise:
        return f"the force rises by no more than {MIN_SIGNAL_TO_NOISE:g} times its noise"
    found = [_change_point(u[:end], y[:end], air) for end in _rise_ends(y - base, top, noise)]
    best = next((i for i, (_, _, rms) in enumerate(found) if rms < MAX_RESIDUAL * noise), len(found) - 1)
    other = found[best + 1 if best + 1 < len(found) else max(best - 1, 0)][0]
    at, sd, _ = found[best]
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
    found = find_contact(u, y)
    if isinstance(found, str) or found.at - COVERAGE_FACTOR * found.sd < u[0]:
        return None
    return found if found.at > u[0] + MIN_FREE_TRAVEL * way else None


def _rise_ends(rise: np.ndarray, top: float, noise: float) -> Iterator[int]:
    """How many readings count, for each part of the curve that has enough of them above the noise."""
    last = 0
    for part in RISE_FRACTIONS:
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
    for _ in range(TURNS):
        places = np.linspace(low, high, PLACES + 2)[1:-1]
        squares = np.array([[_misfit(u, y, air, at, m) for m in CONTACT_EXPONENTS] for at in places])
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
    if tared or any(abs(c.force) > max(3 * c.force_sd, MIN_FORCE_OFFSET * c.largest) for _, c in airs):
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
    found: dict[str, tuple[float, float]] = {}
    for law in registry().values():
        if what := getattr(law, "approach", ""):
            rooms = [
                np.inf if r.contact is None else r.contact.remaining_uncertainty(what) for r in repetitions
            ]
            room = max(rooms, default=np.inf)
            if np.isfinite(room):
                found |= {q.name: (-room, room) for q in law.parameters}
    return found
