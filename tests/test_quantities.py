"""Units at the edges: what is read, what is refused, and that a value does not drift on the way."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refused

from cutbench.base.errors import BadInput
from cutbench.base.units import Parameter, parse_quantity, unit_factor

G = Parameter("G", "kPa", "G", "shear modulus", low=0, open_low=True)
NU = Parameter("nu", "1", "ν", "Poisson's ratio", low=0, high=0.5, open_high=True)


@pytest.mark.parametrize(
    "unit, factor",
    [
        ("1", 1), ("mm", 1), ("m", 1e3), ("um", 1e-3), ("s", 1), ("min", 60), ("N", 1), ("mN", 1e-3),
        ("MPa", 1), ("kPa", 1e-3), ("Pa", 1e-6), ("N/mm^2", 1), ("J/m^2", 1e-3), ("N/m", 1e-3), ("mJ", 1),
        ("J", 1e3), ("mm/s", 1), ("mm/min", 1 / 60), ("kg/m^3", 1e-12), ("MPa*s", 1),
    ],
)  # fmt: skip
def test_size_in_the_consistent_system(unit, factor):
    assert unit_factor(unit) == pytest.approx(factor, rel=1e-14)


def test_decimal_units_are_exact():
    assert (unit_factor("kPa"), unit_factor("J/m^2"), unit_factor("um")) == (1e-3, 1e-3, 1e-3)


@pytest.mark.parametrize(
    "text, unit, value",
    [
        ("7.5 kPa", "kPa", 7.5), ("7500 Pa", "kPa", 7.5), ("0.0075 MPa", "kPa", 7.5), ("7.5kPa", "kPa", 7.5),
        ("5.3 J/m²", "J/m^2", 5.3), ("5.3 N/m", "J/m^2", 5.3), ("5.3 kPa*mm", "J/m^2", 5.3),
        ("1.26 mm/min", "mm/s", 0.021), ("21 um/s", "mm/s", 0.021), ("1e-3 kg/m³", "kg/m^3", 1e-3),
        ("0.49", "1", 0.49), (0.49, "1", 0.49), (1, "1", 1.0), ("49 percent", "1", 0.49),
    ],
)  # fmt: skip
def test_what_a_person_writes_is_read(text, unit, value):
    assert parse_quantity(text, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    "raw, unit",
    [
        (7.5, "kPa"), ("7.5", "kPa"), (0, "mm"), ("7.5 mm", "kPa"), ("7.5 bananas", "kPa"),
        ("", "kPa"), ("soft", "kPa"), (None, "kPa"), (True, "1"), ([7.5], "kPa"), ({"value": 1}, "kPa"),
        ("7,5 kPa", "kPa"), ("7 5 kPa", "kPa"), ("7..5 kPa", "kPa"), ("7.5 kPa 3", "kPa"), ("7.5 kpa", "kPa"),
        ("kPa 7.5", "kPa"), ("7 to 8 kPa", "kPa"), ("7.5 ± 0.5 kPa", "kPa"), ("7.5 kPa kPa", "kPa"),
        ((1, "kPa"), "kPa"), ("0.49 mm", "1"), ("1 J/m^3", "J/m^2"), ("1 N*s", "N/m"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(raw, unit):
    with pytest.raises(BadInput) as caught:
        parse_quantity(raw, unit, key="parameters.G")
    error = caught.value
    assert error.exit_code == 2
    assert (error.key, error.value) == ("parameters.G", raw)
    message = str(error)
    assert "parameters.G" in message and error.expected in message
    assert (unit if unit != "1" else "without unit") in error.expected


@pytest.mark.parametrize("raw", ["0 kPa", "-1 kPa", "nan kPa", "inf kPa", "-inf kPa"])
def test_a_modulus_is_positive_and_finite(raw):
    with refused("G", hint="0 kPa < G"):
        G.parse(raw)


@pytest.mark.parametrize("raw, good", [(0, True), (0.4999, True), (0.5, False), (-0.01, False), (0.6, False)])
def test_bounds_are_closed_or_open_as_declared(raw, good):
    if good:
        assert NU.parse(raw) == raw
    else:
        with refused("nu", hint="0 <= nu < 0.5"):
            NU.parse(raw)


@pytest.mark.parametrize(
    "q, text",
    [
        (Parameter("x", "mm", "x", "x"), "x"),
        (Parameter("x", "mm", "x", "x", low=1), "1 mm <= x"),
        (Parameter("x", "mm", "x", "x", high=2, open_high=True), "x < 2 mm"),
        (Parameter("x", "1", "x", "x", low=1, high=2, open_low=True), "1 < x <= 2"),
    ],
)
def test_the_range_in_words(q, text):
    assert q.range_text() == text


def test_parse_gives_internal_units_and_show_gives_them_back():
    assert G.parse("7.5 kPa") == 7.5e-3
    assert G.show(7.5e-3) == "7.5 kPa"
    assert NU.show(0.49) == "0.49"


@given(value=st.floats(1e-6, 1e6))
def test_a_value_in_its_own_unit_is_read_to_the_last_bit(value):
    assert parse_quantity(f"{value!r} kPa", "kPa") == value


@given(value=st.floats(1e-6, 1e6))
def test_the_unit_that_was_written_does_not_matter(value):
    """To 15 digits, so that a case keeps its identity whatever unit it was written in."""
    text = f"{value:.9g}"
    number = float(text)
    assert parse_quantity(f"{text} MPa", "kPa") == pytest.approx(number * 1e3, rel=1e-15)
    assert math.isclose(parse_quantity(f"{text} Pa", "kPa"), number / 1e3, rel_tol=1e-15)
