"""What every mechanism must satisfy, held over the registry: a new file is tested by being there.

No law is named here. Laws of the bulk and of the cut have files of their own.
"""

from __future__ import annotations

import math
import re
import sys
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from law_checks import (
    DECLARED,
    LAWS,
    NEW_UNITS,
    PRESSURE,
    N,
    close,
    cut,
    deformations,
    dimension,
    every_law,
    factors,
    in_new_units,
    jumps,
    loaded,
    numbers,
    of_slot,
    points,
    recorded,
    rewritten,
    rng,
    sliding,
    strength,
    stress,
    switched_off,
)

from cutbench.base.units import Parameter, unit_factor, ureg
from cutbench.case.model import DEFAULT, Model
from cutbench.mechanisms import SLOTS
from cutbench.mechanisms.base import STEP, Mechanism, cut_answers


# -- what a person sees --------------------------------------------------------------------------
@every_law
def test_a_mechanism_describes_itself(law):
    module = sys.modules[type(law).__module__]
    assert module.__name__ == f"cutbench.mechanisms.{law.slot}.{law.name}", "one mechanism a file of its name"
    assert law.slot in SLOTS
    assert re.fullmatch(r"[a-z][a-z0-9_]*", law.name)
    assert 0 < len(law.title.strip()) <= 24, "the title has room in a legend"
    assert len(module.__doc__.strip()) > 20, "the module's docstring gives formula and reference"
    assert type(law).__doc__.strip() and type(law).__doc__ != Mechanism.__doc__


@every_law
def test_parameters_are_complete(law):
    names = [q.name for q in law.parameters]
    assert len(set(names)) == len(names)
    for q in law.parameters:
        assert q.name.isidentifier()
        assert q.symbol.strip() and q.doc.strip()
        assert unit_factor(q.unit) > 0
        for value in (q.typical, q.off, q.default):
            if value is not None:
                q.check(value)
        assert q.typical != q.off, "the typical value must show the effect"
        shown = q.show(q.typical * q.factor)
        assert q.parse(shown) == pytest.approx(q.typical * q.factor, rel=1e-5)


@every_law
def test_what_a_law_reads_is_declared_elsewhere(law):
    assert set(law.reads) <= set(DECLARED)
    assert not set(law.reads) & {q.name for q in law.parameters}


@every_law
def test_a_law_stores_nothing(law):
    assert vars(law) == {}
    law.groups(numbers(law))
    law.start(3, numbers(law))
    assert vars(law) == {}


def test_one_parameter_name_means_one_quantity():
    seen: dict[str, Parameter] = {}
    for law in LAWS.values():
        for q in law.parameters:
            other = seen.setdefault(q.name, q)
            assert (
                ureg.Unit(q.unit if q.unit != "1" else "").dimensionality
                == ureg.Unit(other.unit if other.unit != "1" else "").dimensionality
            ), q.name


# -- units ---------------------------------------------------------------------------------------
@every_law
def test_groups_do_not_depend_on_the_units(law):
    p = numbers(law)
    here, there = law.groups(p), law.groups(rewritten(law, p))
    assert here.keys() == there.keys()
    for text, value in here.items():
        assert np.isfinite(value)
        assert there[text] == pytest.approx(value, rel=1e-12), text


@every_law
def test_a_parameter_that_switches_off_moves_a_group(law):
    on, off = law.groups(numbers(law)), law.groups(switched_off(law))
    if law.off:
        assert on != off


# -- blade ---------------------------------------------------------------------------------------
@of_slot("blade")
def test_blade_strength_is_never_negative(law):
    value = strength(law, PRESSURE)
    assert np.shape(value) == (N,)
    assert np.isfinite(value).all() and value.min() >= 0
    if law.role != "contact":
        assert value.max() > 0


@of_slot("blade")
def test_blade_strength_can_be_differentiated_by_a_complex_step(law):
    t_N, h = PRESSURE[1:].min() + PRESSURE, 1e-6
    exact = np.imag(strength(law, t_N + 1j * STEP)) / STEP + np.zeros(N)
    central = (strength(law, t_N + h) - strength(law, t_N - h)) / (2 * h)
    close(exact, central, 1e-6, atol=1e-9)


@of_slot("blade")
def test_blade_strength_has_the_dimension_of_a_stress(law):
    p, MPa = numbers(law), dimension("MPa")
    at = sliding(NEW_UNITS["[length]"], NEW_UNITS["[time]"])
    there = strength(law, in_new_units(PRESSURE, MPa), rewritten(law, p), at)
    close(there, in_new_units(strength(law, PRESSURE, p), MPa), 1e-12)


@of_slot("blade", lambda law: law.role == "contact")
@pytest.mark.parametrize("multiplier", [0.0, 0.02])
def test_contact_pressure_keeps_out_and_never_pulls(law, multiplier):
    p, stiffness, h = numbers(law), 3.0, 1e-8
    gap = np.linspace(-0.1, 0.1, 401) + 1e-5
    t_N, slope = law.pressure(gap, multiplier, stiffness, p)
    assert t_N.min() >= 0 and slope.max() <= 0
    assert np.all(np.diff(t_N) <= 0), "the deeper, the harder"
    assert t_N[-1] == 0 and t_N[0] == pytest.approx(multiplier - stiffness * gap[0])
    bracket = np.maximum(multiplier - stiffness * gap, 0)
    assert np.abs(t_N - bracket).max() <= 0.01 * stiffness * p.thickness / 2
    up, down = (law.pressure(gap + s * h, multiplier, stiffness, p)[0] for s in (1, -1))
    central = (up - down) / (2 * h)
    close(slope, central, 1e-5)
    close(law.pressure(gap + 1j * STEP, multiplier, stiffness, p)[0].imag / STEP, slope, 1e-13)


# -- skin ----------------------------------------------------------------------------------------
@of_slot("skin")
def test_a_skin_scales_and_never_turns_round(law):
    p = numbers(law)
    assert factors(law, p).min() > 0
    assert np.array_equal(factors(law, switched_off(law)), np.ones((2, N)))


@of_slot("skin")
def test_a_skin_does_not_depend_on_the_units(law):
    at, p = points(N), rewritten(law, numbers(law))
    at.X, at.depth = at.X * NEW_UNITS["[length]"], at.depth * NEW_UNITS["[length]"]
    there = np.stack([np.broadcast_to(f(p, at), N) for f in (law.stiffness, law.toughness)])
    close(there, factors(law, numbers(law)), 1e-12)


# -- rig -----------------------------------------------------------------------------------------
@of_slot("rig")
def test_a_rig_that_is_off_records_what_happened(law):
    x = np.linspace(0, 21, N)
    assert np.array_equal(recorded(law, switched_off(law)), [x, np.sin(x)])


@of_slot("rig")
def test_a_rig_does_not_depend_on_the_units(law):
    L, t, F = NEW_UNITS["[length]"], NEW_UNITS["[time]"], in_new_units(1.0, dimension("N"))
    here, there = recorded(law, numbers(law)), recorded(law, rewritten(law, numbers(law)), L, t, F)
    close(there[0], here[0] * L, 1e-12)
    close(there[1], here[1] * F, 1e-12)


# -- all slots -----------------------------------------------------------------------------------
def answer(law: Mechanism, p: SimpleNamespace) -> np.ndarray:
    """The law's flux at fixed, lively kinematics, for parameters ``p``."""
    if law.slot == "bulk":
        return stress(law, deformations(), p)
    if law.slot == "cut":
        old, states = loaded(law)
        return cut(law, jumps(), old, states, p=p)[0]
    if law.slot == "blade":
        flux = strength(law, PRESSURE, p)
        if law.role == "contact":
            flux = flux + law.pressure(np.linspace(-0.1, 0.1, N) + 1e-5, 0.0, 3.0, p)[0]
            flux = np.concatenate([flux, law.half_axes(p)])
        return flux
    if law.slot == "support":
        return np.array([law.compliance(p)])
    return factors(law, p) if law.slot == "skin" else recorded(law, p)


def together(model: Model, slot: str, p: SimpleNamespace) -> np.ndarray:
    """What all laws of a slot answer together."""
    laws = model.laws(slot)
    if slot == "skin":
        return math.prod([factors(law, p) for law in laws], start=np.ones((2, N)))
    if slot == "rig":
        x = np.linspace(0, 21, N)
        return np.stack(model.record(x, np.sin(x), x / 0.021, p))
    if slot == "support":
        return np.array([sum(law.compliance(p) for law in laws)])
    if slot == "cut":
        # The state of a slot is one dictionary: laws name theirs differently.
        states = {k: v for law in laws for k, v in law.start(N, p).items()}
        total = np.zeros((3, N))
        for old, jump in pairwise([np.zeros((3, N)), rng().permutation(jumps(), axis=1), jumps()]):
            total, new = np.zeros((3, N)), {}
            for answer in cut_answers(laws, jump, p, states, points(N, jump_old=old)):
                total, new = total + answer.traction, new | answer.new
            states = new
        return total
    if slot == "bulk":
        at, past = points(N, laws=laws), rng().permutation(deformations(), axis=2)
        states = {k: v for law in laws for k, v in law.stress(past, p, law.start(N, p), at)[1].items()}
        F = deformations()
        parts = [(law.stress(F, p, states, at)[0], law.tangent(F, p, states, at, 3)) for law in laws]
        return np.concatenate([sum(part[i] for part in parts).reshape(-1, N) for i in range(2)])
    flux = sum(law.strength(PRESSURE, p, {}, sliding()) for law in laws)
    contact = next(law for law in laws if law.role == "contact")
    pressure = contact.pressure(np.linspace(-0.1, 0.1, N) + 1e-5, 0.0, 3.0, p)[0]
    return np.concatenate([flux, pressure, contact.half_axes(p)])


@every_law
def test_parameters_can_be_differentiated_by_a_complex_step(law):
    """Sensitivities come from the law itself, whatever its parameter."""
    p = numbers(law)
    for name, value in vars(p).items():
        size = value or 1.0
        h = 1e-6 * size
        exact = np.imag(answer(law, numbers(law, **{name: value + 1j * STEP}))) / STEP
        up, down = (answer(law, numbers(law, **{name: value + s * h})) for s in (1, -1))
        close(exact * size, (up - down) / (2 * h) * size, 1e-6, atol=1e-8 * np.abs(up).max())


def off_values(law: Mechanism) -> dict[str, float]:
    return {q.name: q.off * q.factor for q in law.parameters if q.off is not None}


def switches(law: Mechanism) -> dict[str, float]:
    """Off values (internal units) of what the law adds to the law of its role that it generalises, if any."""
    known = Model(DEFAULT).parameters()
    return {k: v for k, v in off_values(law).items() if k not in known} or off_values(law)


def typical(model: Model) -> dict[str, float]:
    return {name: q.typical * q.factor for name, q in model.parameters().items()}


@every_law
def test_a_law_that_is_off_changes_nothing_to_the_bit(law):
    """A model with the law at its off values answers as the one without it."""
    if not law.off:
        assert all(q.off is None for q in law.parameters)
        return
    model, new = Model(DEFAULT).with_(law.name), switches(law)
    # A law with parameters of its own leaves what it replaces; one without is compared with nothing.
    own_switch = not set(new) & set(Model(DEFAULT).parameters())
    base = Model(DEFAULT) if own_switch else model.without(law.name)
    values = typical(model)
    off = together(model, law.slot, SimpleNamespace(**(values | new)))
    absent = together(base, law.slot, SimpleNamespace(**values))
    assert np.isfinite(off).all()
    assert np.array_equal(off, absent)
    assert not np.array_equal(together(model, law.slot, SimpleNamespace(**values)), off), "it shows nothing"


@every_law
def test_a_law_shows_at_once_when_it_is_no_longer_off(law):
    """The derivative at off is finite and does not vanish: absent mechanisms can be scored by it."""
    off = switches(law)
    for name, value in off.items():
        p = numbers(law, **off)
        setattr(p, name, value + 1j * STEP)
        slope = np.imag(answer(law, p)) / STEP
        assert np.isfinite(slope).all()
        assert np.abs(slope).max() > 0
