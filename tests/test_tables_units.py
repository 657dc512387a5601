"""Units as instruments spell them, titles that are wrong, clock times, words for what was not measured."""

from __future__ import annotations

import numpy as np
import pytest
import tables_made as made

from cutbench.base.errors import BadInput
from cutbench.base.unit_spelling import meant_unit, size_of
from cutbench.data.campaign import load_campaign

POND = 9.80665e-3
SPELT = {
    "MPa": {
        "KPa": 1e-3,
        "kpa": 1e-3,
        "KPA": 1e-3,
        "Kpa": 1e-3,
        "MPA": 1.0,
        "Mpa": 1.0,
        "PA": 1e-6,
        "GPA": 1e3,
        "N/mm2": 1.0,
        "N/mm^2": 1.0,
        "N/mm²": 1.0,
        "N/MM2": 1.0,
        "N mm-2": 1.0,
        "N.mm-2": 1.0,
        "N/m2": 1e-6,
        "kgf/cm2": 0.0980665,
        "kg/cm2": 0.0980665,
        "KGF/CM2": 0.0980665,
        "kp/cm2": 0.0980665,
        "PSI": 6.894757e-3,
        "lb/in2": 6.894757e-3,
        "mbar": 1e-4,
        "dyn/cm2": 1e-7,
    },
    "N": {
        "kp": 1e3 * POND,
        "KP": 1e3 * POND,
        "p": POND,
        "gf": POND,
        "g": POND,
        "gr": POND,
        "gms": POND,
        "Kg": 1e3 * POND,
        "kgf": 1e3 * POND,
        "KGF": 1e3 * POND,
        "lbf": 4.448222,
        "lbs": 4.448222,
        "LBF": 4.448222,
        "KN": 1e3,
        "kn": 1e3,
        "cN": 0.01,
        "daN": 10.0,
        "Newton": 1.0,
        "MN": 1e6,
        "mN": 1e-3,
    },
    "s": {
        "sec": 1.0,
        "Sec.": 1.0,
        "S": 1.0,
        "sek": 1.0,
        "min": 60.0,
        "Min.": 60.0,
        "hr": 3600.0,
        "MS": 1e-3,
        "msec": 1e-3,
    },
    "mm": {
        "MM": 1.0,
        "um": 1e-3,
        "µm": 1e-3,
        "μm": 1e-3,
        "micron": 1e-3,
        "in": 25.4,
        "IN": 25.4,
        "in.": 25.4,
        "mil": 0.0254,
    },
    "1": {"%": 0.01, "pct": 0.01, "mm/mm": 1.0, "-": 1.0, "µe": 1e-6},
}


@pytest.mark.parametrize("target", SPELT)
def test_units_as_instruments_spell_them(target):
    for unit, size in SPELT[target].items():
        assert size_of(unit, target) == pytest.approx(size, rel=1e-6), unit


@pytest.mark.parametrize(
    ("unit", "target"), [("mpa", "MPa"), ("mn", "N"), ("px", "mm"), ("pixel", "mm"), ("V", "N"), ("lbs", "1")]
)
def test_what_may_be_two_units_or_is_none_is_refused(unit, target):
    assert size_of(unit, target) is None


@pytest.mark.parametrize(
    ("unit", "target", "meant"), [("mpa", "MPa", "MPa"), ("kPs", "MPa", "kPa"), ("kgff", "N", "kgf")]
)
def test_the_unit_that_is_meant_is_named(unit, target, meant):
    assert f"did you mean '{meant}'" in meant_unit(unit, target)


def test_no_guess_differs_by_its_prefix():
    for unit in ("xPa", "qPa", "zN", "ym"):
        for target in ("MPa", "N", "mm"):
            assert "did you mean" not in meant_unit(unit, target)


@pytest.mark.parametrize(
    ("head", "factors"),
    [
        ("Strain (%),Stress (KPa)", (100, 1e3)),
        ("Strain (%),Stress (kpa)", (100, 1e3)),
        ("Strain (%),Stress (Mpa)", (100, 1)),
        ("Strain [-],Stress [N/mm2]", (1, 1)),
        ("Strain,Stress kPa", None),
        ("strain_%,Stress_kPa", (100, 1e3)),
        ('"Strain / %","Stress / kgf/cm2"', (100, 1 / 0.0980665)),
        ("Strain;Stress\n%;kPa", (100, 1e3)),
    ],
)
def test_a_curve_in_any_spelling_is_the_same_curve(tmp_path, head, factors):
    u = made.readings()[:, 1]
    separator = ";" if ";" in head else ","
    scale = factors or (1, 1e3)
    table = np.column_stack([u / made.LENGTH_MM * scale[0], made.force(u) / made.AREA_MM2 * scale[1]])
    more = "" if factors else 'units = { stress = "kPa" }\n'
    path = made.campaign(
        tmp_path, head + "\n" + made.rows(table, separator, 8), more, columns="{ strain = 1, stress = 2 }"
    )
    (r,) = load_campaign(path).experiments[0].repetitions
    np.testing.assert_allclose(r.x, 1 + u / made.LENGTH_MM, rtol=1e-6)
    np.testing.assert_allclose(r.y, made.force(u) / made.AREA_MM2, rtol=1e-5)


def test_a_title_that_is_wrong_is_overruled_and_that_is_noted(tmp_path):
    text = "Time (s),Ch:Strain (lbs),Ch:Stress (kPa)\n"
    u = made.readings()[:, 1]
    text += made.rows(np.column_stack([u, u / made.LENGTH_MM, 1e3 * made.force(u) / made.AREA_MM2]), digits=7)
    columns = '{ time = "Time", strain = "Ch:Strain", stress = "Ch:Stress" }'
    assert "Ch:Strain" in made.refused(["data", str(made.campaign(tmp_path, text, columns=columns))])
    path = made.campaign(tmp_path, text, 'units = { strain = "1" }\n', columns=columns)
    (pull,) = load_campaign(path).experiments
    np.testing.assert_allclose(pull.repetitions[0].x, 1 + u / made.LENGTH_MM)
    assert any("lbs" in note and "strain" in note for note in pull.notes)


def test_of_two_columns_of_one_name_the_one_of_the_right_kind_is_read(tmp_path):
    u = made.readings()[:, 1]
    table = np.column_stack([u, 100 * u / made.LENGTH_MM, 1e3 * made.force(u) / made.AREA_MM2])
    path = made.campaign(
        tmp_path, "Strain (mm),Strain (%),Stress (kPa)\n" + made.rows(table, digits=6),
        columns='{ strain = "Strain", stress = "Stress" }',
    )  # fmt: skip
    np.testing.assert_allclose(load_campaign(path).experiments[0].reach, 1.5)


CLOCKS = {
    "hours": lambda t: f"12:03:{4 + t:04.1f}" if t < 56 else f"12:04:{t - 56:04.1f}",
    "minutes": lambda t: f"{int(t // 60):02d}:{t % 60:04.1f}",
    "midnight": lambda t: f"23:59:{50 + t:04.1f}" if t < 10 else f"00:00:{t - 10:04.1f}",
    "iso": lambda t: f"2024-05-02T23:59:{50 + t:04.1f}" if t < 10 else f"2024-05-03T00:00:{t - 10:04.1f}",
    "day first": lambda t: f"02.05.2024 12:03:{t:04.1f}",
    "afternoon": lambda t: f"11:59:{50 + t:04.1f} AM" if t < 10 else f"12:00:{t - 10:04.1f} PM",
}


@pytest.mark.parametrize("name", CLOCKS)
def test_clock_times(tmp_path, name):
    values = made.readings()
    text = "".join(f"{CLOCKS[name](t)},{u:.4f},{F:.5f}\n" for t, u, F in values)
    (r,) = (
        load_campaign(made.campaign(tmp_path, "Time,Extension (mm),Load (N)\n" + text))
        .experiments[0]
        .repetitions
    )
    np.testing.assert_allclose(r.time_s, values[:, 0] - values[0, 0], atol=1e-6)


def test_clock_times_of_two_parts_say_which(tmp_path):
    values = made.readings(reach=19.5)
    text = "Time (mm:ss);Extension;Load\n;mm;N\n" + "".join(
        f"{int(2 * t) // 60}:{int(2 * t) % 60:02d};{u:.4f};{F:.5f}\n".replace(".", ",")
        for t, u, F in np.column_stack([np.arange(40) / 2, values[:, 1:]])
    )
    assert "units.time" in made.refused(["data", str(made.campaign(tmp_path, text))])
    (r,) = (
        load_campaign(made.campaign(tmp_path, text, 'units = { time = "min" }\n')).experiments[0].repetitions
    )
    np.testing.assert_allclose(r.time_s, np.arange(40), atol=1e-9)
    (r,) = load_campaign(made.campaign(tmp_path, text, 'units = { time = "h" }\n')).experiments[0].repetitions
    np.testing.assert_allclose(r.time_s, 60.0 * np.arange(40), atol=1e-9)


def test_a_column_that_is_not_read_may_hold_anything(tmp_path):
    table = "".join(f"{t:.3f}, {F:.4f}, N/A, , {u:.3f}, 1\n" for t, u, F in made.readings())
    head = "\n\nTime (sec), Load (N), Stress (KPa), Strain (mm), Extension (mm), Cycle\n"
    (r,) = load_campaign(made.campaign(tmp_path, head + table)).experiments[0].repetitions
    assert r.x.size == 40


@pytest.mark.parametrize("word", ["-nan(ind)", "-1.#IND", "#N/A", "NaN", "N/A", ""])
def test_what_was_not_measured_is_refused_in_a_curve_with_its_line(tmp_path, word):
    lines = made.rows(made.readings()).splitlines()
    lines[9] = f"{lines[9].rpartition(',')[0]},{word}"
    with pytest.raises(BadInput) as wrong:
        load_campaign(made.campaign(tmp_path, "\n".join([made.HEAD, *lines])))
    assert wrong.value.line == 11 and wrong.value.file.endswith("data.csv")
