"""Studies: what is read, the order of points, and what is refused with file, line, key and value."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from cutbench.base.errors import BadInput
from cutbench.case.model import groups
from cutbench.maps.study import coarse_to_fine, load_study

TRANSITION = Path(__file__).parents[1] / "studies" / "transition.toml"

GOOD = """title = "A small study"
base = "gelatin"

[parameters]
G = "10 kPa"

[numerics]
h = "0.5 mm"

[[axis]]
name = "cohesion"
from = 1.0
to = 100.0
points = 3
scale = "log"

[[axis]]
name = "speed"
values = ["0.01 mm/s", "1.2 mm/min"]

[regime]
drop = 0.2

[plot]
mark = ["meat"]
"""


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_the_default_study_holds_the_materials_and_both_regimes_have_room():
    study = load_study(TRANSITION)
    assert math.prod(study.shape) >= 100
    assert len({case.id for case in study.cases()}) == math.prod(study.shape)
    assert [mark.name for mark in study.marks()] == ["gelatin", "elastomer", "meat"]
    expected = {
        "gelatin": (10.1, 0.714, 0.0106),
        "elastomer": (1.79, 0.714, 0.187),
        "meat": (11.4, 2.86, 0.0),
    }
    for mark in study.marks():
        for axis, value in zip(study.axes, expected[mark.name], strict=True):
            assert mark.at[axis.name] == pytest.approx(value, rel=0.01, abs=1e-12)
            assert axis.values[0] <= value * 1.005 and value <= axis.values[-1] * 1.005


def test_each_point_has_the_groups_of_its_place():
    study = load_study(TRANSITION)
    for index, case in list(study.points())[::7]:
        for axis, i in zip(study.axes, index, strict=True):
            assert groups()[axis.name].value(case.p) == pytest.approx(axis.values[i], rel=1e-9, abs=1e-15)


def test_values_units_and_sections_arrive_in_the_cases(write):
    study = load_study(write(GOOD))
    assert study.shape == (3, 2)
    assert study.axes[0].values == (1.0, 10.0, 100.0)
    assert study.axes[1].values == pytest.approx((0.01, 0.02)) and study.axes[1].unit == "mm/s"
    assert {case.p.G for case in study.grid} == {0.01}
    assert {case.numerics.h_mm for case in study.grid} == {0.5}
    assert study.regime.drop == 0.2 and study.regime.surge_min is None
    assert (study.plot.x, study.plot.y, study.plot.panel) == ("cohesion", "speed", "")
    assert study.marks()[0].at["speed"] == pytest.approx(0.021)


def test_a_group_of_a_section_holds_along_the_axes(write):
    text = (
        'base = "gelatin"\n[parameters]\ncohesion = 5.0\n[[axis]]\nname = "G"\nvalues = ["5 kPa", "50 kPa"]\n'
    )
    cases = load_study(write(text)).grid
    assert [case.groups()["(G_c/delta_c)/G"] for case in cases] == pytest.approx([5.0, 5.0])
    assert cases[1].p.G_c == pytest.approx(10 * cases[0].p.G_c)


def test_a_case_file_beside_the_study_is_a_base(write, tmp_path):
    (tmp_path / "mine.toml").write_text('base = "meat"\n[parameters]\nG = "33 kPa"\n')
    study = load_study(
        write(GOOD.replace('base = "gelatin"', 'base = "mine.toml"').replace("G = ", "nu = 0.48 #"))
    )
    assert pytest.approx(0.033) == study.base.p.G


@pytest.mark.parametrize("shape", [(8, 5, 3), (7,), (1, 4), (2, 2)])
def test_the_order_takes_each_point_once_and_every_time_alike(shape):
    order = coarse_to_fine(shape)
    assert sorted(order) == list(range(math.prod(shape)))
    assert order == coarse_to_fine(shape)


def test_any_beginning_of_the_order_is_spread_over_the_map():
    shape = (8, 5, 3)
    index = np.stack(np.unravel_index(coarse_to_fine(shape), shape), axis=1) / (np.array(shape) - 1)
    everything = np.stack(np.unravel_index(np.arange(120), shape), axis=1) / (np.array(shape) - 1)

    def farthest_gap(points):
        return np.sqrt(((everything[:, None] - points[None]) ** 2).sum(-1)).min(axis=1).max()

    assert farthest_gap(index[:12]) < 0.7 < farthest_gap(everything[:12])
    assert farthest_gap(index[:40]) < 0.4 < farthest_gap(everything[:40])


#: What is changed in GOOD -> the key named, the value shown, a piece of the hint, the line.
BAD = [
    ("title = ", "tittle = ", "tittle", "A small study", "title", 1),
    ('"A small study"', "3", "title", "3", "a title", 1),
    ('base = "gelatin"\n', "", "base", "(missing)", "gelatin", None),
    ('"gelatin"', '"gelatine"', "base", "gelatine", "gelatin", 2),
    ('"10 kPa"', '"10 kg"', "G", "10 kg", "kPa", 5),
    ('"10 kPa"', "10", "G", "10", "unit", 5),
    ('"10 kPa"', '"-1 kPa"', "G", "-1 kPa", "0 kPa < G", 5),
    ('G = "10 kPa"', 'speed = "1 mm/s"', "speed", "1 mm/s", "[protocol]", 5),
    ('G = "10 kPa"', 'GG = "10 kPa"', "GG", "10 kPa", "'G'", 5),
    ('G = "10 kPa"', 'G_c = "1 J/m^2"', "axis 1: name", "cohesion", "G_c to be set once", 11),
    ('h = "0.5 mm"', 'h = "0.5 s"', "h", "0.5 s", "mm", 8),
    ("points = 3", "points = 0", "axis 1: points", "0", "2 or more", 14),
    ("points = 3", "points = 2.5", "axis 1: points", "2.5", "whole number", 14),
    ("points = 3", "points = true", "axis 1: points", "True", "whole number", 14),
    ("points = 3", "points = 99999", "axis 2: points", "199998", "at most", 17),
    ("points = 3\n", "", "axis 1: points", "(missing)", "from, to and points", 10),
    ("from = 1.0", "from = 100.0", "axis 1: from", "100.0", "less than", 12),
    ("from = 1.0", "from = 0.0", "axis 1: from", "0.0", "more than 0", 12),
    ("from = 1.0", 'from = "1 kPa"', "axis 1: from", "1 kPa", "without unit", 12),
    ("from = 1.0", "from = nan", "axis 1: from", "nan", "0 <= cohesion", 12),
    ("from = 1.0", "form = 1.0", "axis 1: form", "1.0", "'from'", 12),
    ('scale = "log"', 'scale = "logarithmic"', "axis 1: scale", "logarithmic", "'log'", 15),
    ('"0.01 mm/s", ', '"1 mm", ', "axis 2: values", "1 mm", "mm/s", 19),
    ('"0.01 mm/s", ', "0.01, ", "axis 2: values", "0.01", "unit", 19),
    ('["0.01 mm/s", "1.2 mm/min"]', "[]", "axis 2: values", "[]", "at least one", 19),
    ('["0.01 mm/s", "1.2 mm/min"]', '"0.01 mm/s"', "axis 2: values", "0.01 mm/s", "a list", 19),
    ('"0.01 mm/s", ', '"-1 mm/s", ', "axis 2: values", "-1 mm/s", "0 mm/s < speed", 19),
    ("0.01 mm/s", "3 mm/s", "axis 2: values", "3 mm/s", "ascending", 19),
    ('name = "speed"', 'name = "speeed"', "axis 2: name", "speeed", "'speed'", 18),
    ('name = "speed"\n', "", "axis 2: name", "(missing)", "one of", 17),
    ('name = "speed"', 'name = "speed"\npoints = 3', "axis 2: points", "3", "either values", 19),
    ("drop = 0.2", "drop = 1.2", "drop", "1.2", "0 < drop < 1", 22),
    ("drop = 0.2", 'drop = "much"', "drop", "much", "number", 22),
    ("drop = 0.2", "fall = 0.2", "fall", "0.2", "drop", 22),
    ("drop = 0.2", 'onset_length = "0 mm"', "onset_length", "0 mm", "above 0", 22),
    ("drop = 0.2", "surge = -1", "surge", "-1", "0 < surge", 22),
    ('mark = ["meat"]', 'mark = ["meet"]', "mark", "meet", "'meat'", 25),
    ('mark = ["meat"]', 'mark = "meat"', "mark", "meat", "a list", 25),
    ('mark = ["meat"]', 'x = "viscosity"', "x", "viscosity", "cohesion", 25),
    ('mark = ["meat"]', 'x = "speed"\ny = "speed"', "y", "speed", "not show already", 26),
    ("[regime]", "[[regime]]", "regime", "drop", "[regime]", 21),
    ("drop = 0.2", "drop = ", "TOML", "drop =", "readable TOML", 22),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "value", "hint", "line"), BAD)
def test_what_is_wrong_is_named(write, old, new, key, value, hint, line):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(BadInput) as caught:
        load_study(path)
    error = caught.value
    assert error.key == key
    assert value in str(error.value) and hint in error.expected
    assert error.line == line
    if line is not None:
        assert error.file == str(path)


@pytest.mark.parametrize(
    ("axes", "hint"),
    [
        (["cohesion", "cohesion"], "each axis once"),
        (["cohesion", "G_c"], "sets G_c already"),
        (["viscosity", "eta_reg"], "sets eta_reg already"),
    ],
)
def test_two_axes_that_set_the_same_are_refused(write, axes, hint):
    values = {"G_c": '["1 J/m^2"]', "eta_reg": '["1 s"]'}
    text = 'base = "gelatin"\n' + "".join(
        f'[[axis]]\nname = "{name}"\nvalues = {values.get(name, "[1.0]")}\n' for name in axes
    )
    with pytest.raises(BadInput, match=hint) as caught:
        load_study(write(text))
    assert caught.value.line == 6


def test_a_study_without_axes_or_file_is_refused(write, tmp_path):
    with pytest.raises(BadInput, match="at least one"):
        load_study(write('base = "gelatin"\n'))
    with pytest.raises(BadInput, match="exists"):
        load_study(tmp_path / "none.toml")


SAMPLED = """mode = "lhs"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 100.0
scale = "log"
[[axis]]
name = "speed"
values = ["0.01 mm/s", "0.02 mm/s"]
[[axis]]
mechanism = "adhesion"
[sample]
points = 16
seed = 3
"""


def test_a_latin_hypercube_has_one_point_in_each_slice_and_all_levels_equally_often(write):
    study = load_study(write(SAMPLED))
    assert study.shape == (16,) and len(study.grid) == len(study.samples) == 16
    cohesion, speed, adhesion = np.array(study.samples).T
    assert sorted((np.log10(cohesion) / 2 * 16).astype(int)) == list(range(16))
    assert sorted(speed) == [0.01] * 8 + [0.02] * 8 and sorted(adhesion) == [0.0] * 8 + [1.0] * 8
    for (index, case), values in zip(study.points(), study.samples, strict=True):
        assert groups()["cohesion"].value(case.p) == pytest.approx(values[0], rel=1e-9)
        assert case.p.speed == pytest.approx(values[1]) and ("adhesion" in case.mechanisms) == bool(values[2])
        assert study.case_at(values).id == case.id and len(index) == 1
    again, other = load_study(write(SAMPLED)), load_study(write(SAMPLED.replace("seed = 3", "seed = 4")))
    assert again.samples == study.samples != other.samples


def test_one_at_a_time_departs_from_the_base_and_moves_one_axis(write):
    text = SAMPLED.replace('mode = "lhs"', 'mode = "one-at-a-time"').split("[sample]")[0]
    study = load_study(write(text.replace("to = 100.0", "to = 100.0\npoints = 3")))
    base = study.samples[0]
    assert base == pytest.approx((10.0952, 0.021, 1.0))
    moved = [sum(a != b for a, b in zip(values, base, strict=True)) for values in study.samples]
    assert moved == [0, 1, 1, 1, 1, 1, 1]
    assert study.cases()[0].id == study.base.id or study.cases()[0].p.G_c == pytest.approx(
        study.base.p.G_c, rel=1e-5
    )
    assert [case.p.speed for case in study.grid][4:6] == [0.01, 0.02]
    assert "adhesion" not in study.grid[6].mechanisms


def test_any_mechanism_can_be_switched_and_what_is_said_of_it_goes_with_it(write):
    study = load_study(
        write(
            'base = "gelatin"\n[parameters]\ntau_W = "2 kPa"\nmu = 0.3\n'
            '[[axis]]\nmechanism = "adhesion"\n[[axis]]\nmechanism = "viscous"\nvalues = [true, false]\n'
            '[[axis]]\nname = "G"\nvalues = ["5 kPa"]\n'
        )
    )
    assert study.shape == (2, 2, 1) and [axis.name for axis in study.axes[:2]] == [
        "with_adhesion",
        "with_viscous",
    ]
    off, on = study.grid[0], study.grid[2]
    assert "adhesion" not in off.mechanisms and "tau_W" not in off.values
    assert on.values["tau_W"] == 0.002 and off.values["mu"] == 0.3
    assert "viscous" not in off.mechanisms and "viscous_degraded" in off.mechanisms
    with_viscous = study.grid[1]
    assert "viscous" in with_viscous.mechanisms and "viscous_degraded" not in with_viscous.mechanisms


BOUNDARY = """mode = "boundary"
base = "gelatin"
[[axis]]
name = "cohesion"
from = 1.0
to = 16.0
scale = "log"
tolerance = "1/16"
[[axis]]
name = "speed"
from = "0.01 mm/s"
to = "0.1 mm/s"
tolerance = 0.125
[[axis]]
name = "adhesion"
values = [0.0, 0.1]
[boundary]
runs = 60
"""


def test_a_search_has_a_lattice_of_half_its_tolerances_and_levels(write):
    study = load_study(write(BOUNDARY))
    assert study.shape == (33, 17, 2) and not study.grid and not list(study.points())
    assert (study.search.start, study.search.batch, study.search.runs) == (5, 8, 60)
    assert study.axes[0].values[16] == pytest.approx(4.0) and study.axes[1].values[8] == pytest.approx(0.055)
    case = study.case_at([4.0, 0.055, 0.1])
    assert groups()["cohesion"].value(case.p) == pytest.approx(4.0) and case.p.speed == 0.055
    rest = load_study(write(BOUNDARY.split("[boundary]")[0]))
    assert rest.search.runs == max(16 * 8 // 8, 25 + 4 * 8)


@pytest.mark.parametrize(
    ("text", "old", "new", "key", "hint", "line"),
    [
        (BOUNDARY, '"boundary"', '"boundry"', "mode", "'boundary'", 1),
        (BOUNDARY, "runs = 60", "runs = 10", "runs", "25 to", 18),
        (BOUNDARY, "runs = 60", "batch = 0", "batch", "1 to", 18),
        (BOUNDARY, "runs = 60", "start = 2.5", "start", "3 to", 18),
        (BOUNDARY, "0.125", "0", "axis 2: tolerance", "above 0", 13),
        (BOUNDARY, '"1/16"', '"1/0"', "axis 1: tolerance", "'1/32'", 8),
        (BOUNDARY, '"1/16"', '"1/3000"', "axis 2: tolerance", "larger tolerances", 13),
        (BOUNDARY, 'tolerance = "1/16"', "points = 5", "axis 1: points", "tolerance", 8),
        (BOUNDARY, "[boundary]\nruns", "[sample]\npoints", "sample", "mode = 'lhs'", 17),
        (SAMPLED, "points = 16", "points = 0", "points", "1 to", 14),
        (SAMPLED, "points = 16\n", "", "sample", "points = 100", 13),
        (SAMPLED, "seed = 3", "seed = -3", "seed", "0 to", 15),
        (SAMPLED, 'mechanism = "adhesion"', 'mechanism = "adhesio"', "axis 3: mechanism", "'adhesion'", 12),
        (
            SAMPLED,
            'mechanism = "adhesion"',
            'mechanism = "adhesion"\nvalues = [0, 2]',
            "axis 3: values",
            "[false",
            13,
        ),
        (
            SAMPLED,
            'mechanism = "adhesion"',
            'mechanism = "adhesion"\nfrom = 1',
            "axis 3: from",
            "only values",
            13,
        ),
        (SAMPLED, "to = 100.0", 'to = 100.0\ntolerance = "1/8"', "axis 1: tolerance", "mode = 'boundary'", 7),
    ],
)
def test_what_is_wrong_in_a_mode_is_named(write, text, old, new, key, hint, line):
    assert old in text
    with pytest.raises(BadInput) as caught:
        load_study(write(text.replace(old, new, 1)))
    assert caught.value.key == key and hint in caught.value.expected and caught.value.line == line


def damages(line):
    """A line made wrong in the ways a hand slips: a key misspelt, a value of the wrong kind, a sign lost."""
    name, sign, value = (part.strip() for part in line.partition("="))
    if not sign:
        yield line.replace("]", "", 1)
        yield line.replace(name.strip("[]"), name.strip("[]") + "s")
        return
    yield f"{name[:-1]}z = {value}"
    yield f"{name} {value}"
    yield f"{name} = "
    yield f"{name} = {{}}"
    yield f"{name} = true" if "true" not in value else f"{name} = 7.5"
    if value.startswith('"'):
        yield f"{name} = {value[:-1]}"
        if name != "title":
            yield f'{name} = "{value[1:-1]} nonsense"'
    if value.startswith("["):
        yield f"{name} = {value[:-1]}"
        yield f'{name} = [{{}}, "nonsense"]'


#: Files of `cutbench sweep`; the others are read by `cutbench converge` (test_convergence.py).
CONVERGE = ("convergence", "choices")
STUDIES = sorted(p for p in Path(__file__).parents[1].glob("studies/*.toml") if p.stem not in CONVERGE)


@pytest.mark.parametrize(
    "source", [GOOD, SAMPLED, BOUNDARY, *STUDIES], ids=lambda s: getattr(s, "name", "text")
)
def test_a_study_with_an_error_in_any_line_is_refused_with_that_line_named(write, source):
    text = source if isinstance(source, str) else source.read_text(encoding="utf-8")
    lines = text.splitlines()
    tried = 0
    for number, line in enumerate(lines, start=1):
        statement = line.split("#")[0].rstrip()
        if not statement:
            continue
        for damaged in damages(statement):
            path = write("\n".join([*lines[: number - 1], damaged, *lines[number:]]))
            with pytest.raises(BadInput) as caught:
                load_study(path)
            assert caught.value.line == number, f"{damaged!r}: {caught.value}"
            tried += 1
    assert tried > 40
