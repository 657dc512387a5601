"""What every law must satisfy, whatever its slot."""

from __future__ import annotations

import re
import sys
from types import SimpleNamespace

import numpy as np

from cutbench.base.units import unit_factor
from cutbench.mechanisms.base import STEP, Mechanism
from cutbench.mechanisms.checks.base import ROUNDING, NotTested, check, close
from cutbench.mechanisms.checks.trial import Trial, dimension, in_new_units


@check()
def describes_itself(t: Trial) -> None:
    """Name, title and docstrings are there."""
    law, module = t.law, sys.modules[type(t.law).__module__]
    assert re.fullmatch(r"[a-z][a-z0-9_]*", law.name), "the name has small letters, digits and underscores"
    assert module.__name__.endswith(law.name), "one mechanism a file of its name"
    assert 0 < len(law.title.strip()) <= 24, "the title has room in a legend"
    assert len((module.__doc__ or "").strip()) > 20, "the module's docstring gives formula and reference"
    assert type(law).__doc__ and type(law).__doc__ != Mechanism.__doc__, "the class has a docstring"


@check()
def declares_its_parameters(t: Trial) -> None:
    """Each parameter has a unit, a symbol, a text, and values within its bounds."""
    names = [q.name for q in t.law.parameters]
    assert len(set(names)) == len(names), "each parameter once"
    assert set(t.law.reads) <= set(t.declared), "what it reads is declared somewhere"
    assert not set(t.law.reads) & set(names), "it reads what others declare"
    for q in t.law.parameters:
        told = q.name.isidentifier() and q.symbol.strip() and q.doc.strip() and unit_factor(q.unit) > 0
        assert told, f"{q.name}: a name without spaces, a symbol, a text and a known unit are there"
        for value in (q.typical, q.off, q.default):
            assert value is None or q.check(value) == value, f"{q.name}: {value:g} is within its bounds"
        assert q.typical != q.off, f"{q.name}: the typical value shows the effect"
        shown = q.typical * q.factor
        read = q.parse(q.show(shown))
        assert abs(read - shown) <= 1e-5 * abs(shown), f"{q.name}: {q.show(shown)} is read as itself"
        for other in t.known.values():
            for same in (o for o in other.parameters if o.name == q.name):
                assert dimension(same.unit) == dimension(q.unit), (
                    f"{q.name} is another quantity in {other.name}"
                )


@check()
def stores_nothing(t: Trial) -> None:
    """Its instance stays empty: a state is in what it returns."""
    t.law.groups(t.numbers())
    t.law.start(3, t.numbers())
    t.answer(t.numbers())
    assert vars(t.law) == {}, f"it keeps {', '.join(vars(t.law))} in itself"


@check()
def groups_have_no_unit(t: Trial) -> None:
    """Groups are the same in other units, and a switch moves one."""
    p = t.numbers()
    here, there = t.law.groups(p), t.law.groups(t.rewritten(p))
    assert here.keys() == there.keys(), "the same groups are there in other units"
    for text, value in here.items():
        assert np.isfinite(value) and abs(there[text] - value) <= 1e-12 * abs(value), (
            f"the group {text} is finite and the same in other units: {value:g} and {there[text]:g}"
        )
    off = {q.name: q.off_value for q in t.law.parameters if q.off is not None}
    if not here and not off:
        raise NotTested("it has no groups()")
    assert not off or t.law.groups(t.numbers(**off)) != here, "no group tells on from off"


@check(applies=lambda law: law.settable)
def groups_are_solved(t: Trial) -> None:
    """A group that can be set is solved for its parameter, in any units."""
    p = t.numbers()
    for group in t.law.settable:
        x, known = group.value(p), getattr(p, group.parameter)
        found = group.solve(p, x)
        assert abs(found - known) <= 1e-12 * abs(known), (
            f"{group.name}: {group.parameter} is {known:g}, solved from the group {found:g}"
        )
        assert set(group.needs) <= set(t.declared), f"{group.name}: it needs what no law declares"
        there = group.value(t.rewritten(p))
        assert abs(there - in_new_units(x, group.unit)) <= 1e-12 * abs(there), (
            f"{group.name}: it changes with the units as {group.unit} does"
        )


@check()
def parameters_differentiate(t: Trial) -> None:
    """A complex step in each parameter gives the derivative of its answer."""
    for name, value in vars(t.numbers()).items():
        size = value or 1.0
        h = 1e-6 * size
        exact = np.imag(t.answer(t.numbers(**{name: value + 1j * STEP}))) / STEP
        up, down = (t.answer(t.numbers(**{name: value + s * h})) for s in (1, -1))
        what = f"derivatives by {name}, by a complex step and by differences (is there an abs or a norm?)"
        close(exact * size, (up - down) / (2 * h) * size, 1e-6, 1e-8 * np.abs(up).max(), what=what)


@check(applies=lambda law: law.off)
def off_is_absent(t: Trial) -> None:
    """At its off values it changes nothing, and at the typical ones it does."""
    laws, without = t.context(), t.context(without=True)
    needs = [q for law in (*laws, *without) for q in (*law.parameters, *(t.declared[n] for n in law.reads))]
    p = SimpleNamespace(**{q.name: q.typical * q.factor for q in needs})
    off = t.together(laws, SimpleNamespace(**(vars(p) | t.switches())))
    assert np.isfinite(off).all(), "where it is off its answer is not finite"
    assert not np.array_equal(t.together(laws, p), off), "it shows nothing"
    for other in without:
        lost = ", ".join(q.name for q in other.parameters if q.name not in t.own)
        if lost and t.law.role and other.role == t.law.role:
            raise NotTested(f"it does not declare {lost} of {other.name}: no values make it that law")
    close(off, t.together(without, p), ROUNDING, what="what is there where it is off, and without it")


@check(applies=lambda law: law.off)
def shows_at_once(t: Trial) -> None:
    """The derivative at off is finite and does not vanish: absent mechanisms are scored by it."""
    off = t.switches()
    for name, value in off.items():
        slope = np.imag(t.answer(t.numbers(**(off | {name: value + 1j * STEP})))) / STEP
        assert np.isfinite(slope).all() and np.abs(slope).max() > 0, (
            f"the derivative by {name} at its off value is finite and not 0"
        )
