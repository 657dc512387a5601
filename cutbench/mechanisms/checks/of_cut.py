"""What every law of the cut must satisfy."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from cutbench.mechanisms.base import STEP
from cutbench.mechanisms.checks.base import ROUNDING, NotTested, check, close
from cutbench.mechanisms.checks.trial import DT, NEW_UNITS, N, Trial, in_new_units, rng


def _paths(t: Trial, count: int, substeps: int = 40) -> Iterator[list[np.ndarray]]:
    """Closed paths from zero through a few jumps (3, 1) and back, in small steps."""
    r = rng()
    for _ in range(count):
        k = r.integers(1, 6)
        turns = np.stack([r.uniform(-0.02, 3, k), r.uniform(-3, 3, k), r.uniform(-3, 3, k)]) * t.length
        turns = np.concatenate([np.zeros((3, 1)), turns, np.zeros((3, 1))], axis=1).T[:, :, None]
        pieces = [
            (1 - s) * a + s * b for a, b in pairwise(turns) for s in np.linspace(0, 1, substeps + 1)[1:]
        ]
        yield [turns[0], *pieces]


@check("cut")
def virgin_interface_carries_nothing(t: Trial) -> None:
    """A closed virgin interface has no traction."""
    zero = np.zeros((3, N))
    T, most = t.cut(zero, zero)[0], np.abs(t.cut(t.jumps(), zero)[0]).max()
    assert np.abs(T).max() <= ROUNDING * most, "it has a traction before it is opened"


@check("cut")
def traction_differentiates(t: Trial) -> None:
    """A complex step in the jump gives the derivative of the traction."""
    old, states = t.loaded()
    jump, h = t.jumps(), 1e-7
    for c in range(3):
        e = np.eye(3)[:, [c]]
        exact = t.cut(jump + 1j * STEP * e, old, states)[0].imag / STEP
        central = (t.cut(jump + h * e, old, states)[0] - t.cut(jump - h * e, old, states)[0]) / (2 * h)
        close(
            exact,
            central,
            1e-6,
            what=f"complex step and differences by the jump {c}",
        )
        assert np.abs(exact).max() > 0, f"the traction does not depend on the jump's component {c}"


@check("cut")
def traction_is_the_works_derivative(t: Trial) -> None:
    """Along any history dW/d⟦u⟧ = T, where the law knows its work."""
    (old, states), jump, p, name = t.loaded(), t.jumps(), t.numbers(), t.law.name
    T, new, at = t.cut(jump, old, states)
    if t.law.work(jump, p, new[name], at) is None:
        raise NotTested("it has no work()")
    for c in range(3):
        probe = jump + 1j * STEP * np.eye(3)[:, [c]]
        _, moved, at = t.cut(probe, old, states)
        slope = t.law.work(probe, p, moved[name], at).imag / STEP
        close(slope, T[c], 1e-12, what=f"the traction's component {c} and the work's derivative")


@check("cut")
def cycles_give_no_energy(t: Trial) -> None:
    """On closed paths of the jump a law takes up work, or none."""
    for steps in _paths(t, 12):
        states, T_old, work, passed = None, 0.0, 0.0, 0.0
        for old, jump in pairwise(steps):
            T, states, _ = t.cut(jump, old, states)
            piece = float(((T + T_old) / 2 * (jump - old)).sum())
            T_old, work, passed = T, work + piece, passed + abs(piece)
        assert work >= -0.02 * passed, "on a closed path of the jump it gives work"


def _opened(t: Trial) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Openings (n,) of a virgin interface until it is cut, with tractions and damages there."""
    wide = 100 * t.length
    openings, T, damage = np.concatenate([np.linspace(0, 0.2 * wide, 2001), [wide]]), [0.0], [0.0]
    state: Any = None
    for pair in pairwise(openings):
        old, jump = (np.array([[x], [0.0], [0.0]]) for x in pair)
        answer, state, _ = t.cut(jump, old, state)
        T.append(float(answer[0, 0]))
        damage.append(float(state[t.law.name]["damage"][0]))
    return openings, np.array(T), np.array(damage)


#: Damages, and what part of the strength may be left from there on: an exponential tail has 0.13 and 0.02.
COUNTS_AS_CUT = ((0.99, 0.15), (0.999, 0.03))
#: What carries less than this part of the strength has at least this damage.
NEXT_TO_NOTHING = (0.01, 0.95)


@check("cut", applies=lambda law: law.role == "cohesive")
def damage_says_what_is_cut(t: Trial) -> None:
    """What counts as cut by its damage carries next to nothing, and what carries that counts as cut."""
    _, T, damage = _opened(t)
    left = np.maximum.accumulate(T[::-1])[::-1] / T.max()  # from here on
    for least, most in COUNTS_AS_CUT:
        carried = left[damage >= least].max(initial=0.0)
        assert carried <= most, (
            f"with a damage of {least} it counts as cut, and carries {100 * carried:.0f} % of its strength,"
            f" where {100 * most:.0f} % are allowed: stiffness falls long before the traction does; let"
            " damage grow with the opening, and be 1 where the traction has gone"
        )
    little, least = NEXT_TO_NOTHING
    lowest = damage[left < little].min(initial=1.0)
    assert lowest >= least, (
        f"where it carries less than {100 * little:.0f} % of its strength its damage is {lowest:.2g}: it"
        f" counts as cut from {least} on"
    )


@check("cut", applies=lambda law: law.role == "cohesive")
def damage_is_handed_over(t: Trial) -> None:
    """The cohesive law's damage runs from 0 to 1, never falls, and costs the work of separation."""
    law, p, zero = t.law, t.numbers(), np.zeros((3, 1))
    for steps in _paths(t, 12, 5):
        states, damage, lost = None, 0.0, 0.0
        for old, jump in pairwise(steps):
            _, states, at = t.cut(jump, old, states)
            now = float(states[law.name]["damage"][0])
            assert damage <= now <= 1, "damage grows from 0 to 1 and never falls"
            damage, spent = now, law.work(zero, p, states[law.name], at)
            if spent is not None:  # what is left at zero jump is dissipated
                grows = spent[0] >= lost - 1e-14 * law.estimate(p, 0.0, 0.0).work
                assert grows, "what is dissipated falls again"
                lost = spent[0]
    openings, T, damages = _opened(t)
    assert abs(damages[-1] - 1) < 1e-9, "a wide open cut is cut"
    work, expected = np.trapezoid(T, openings), law.estimate(p, 0.0, 0.0).work
    assert abs(work - expected) < 1e-3 * expected, "opening costs the work of separation of its estimate"


@check("cut")
def traction_has_its_dimension(t: Trial) -> None:
    """Tractions change with the units as stresses do."""
    jump, p = t.jumps(), t.numbers()
    others = {m.name: t.rewritten(Trial(m, t.known).numbers()) for m in t.before()}
    zero, L = np.zeros_like(jump), NEW_UNITS["[length]"]
    there = t.cut(jump * L, zero, p=t.rewritten(p), dt=DT * NEW_UNITS["[time]"], others=others)[0]
    here = in_new_units(t.cut(jump, zero, p=p)[0], "MPa")
    close(there, here, 1e-12, what="tractions, and those from other units")
