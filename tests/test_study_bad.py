"""Studies with an error in them are refused with file, line, key and value."""

from __future__ import annotations

from pathlib import Path

import pytest
from refusals import refused
from study_texts import BOUNDARY, GOOD, SAMPLED

from cutbench.base.errors import BadInput
from cutbench.case.model import DEFAULT
from cutbench.maps.study import load_study


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


#: What is changed in GOOD -> the key named, the value shown, a piece of the hint, the line.
BAD = [
    ("title = ", "tittle = ", "tittle", "A small study", "title", 1),
    ('"A small study"', "3", "title", "3", "a title", 1),
    ('base = "gelatin"\n', "", "base", "(missing)", "gelatin", None),
    ('"gelatin"', '"gelatine"', "base", "gelatine", "gelatin", 2),
    ('"gelatin"', "5", "base", "5", "", 2),
    ('name = "cohesion"', 'name = "contact"', "axis 1: name", "contact", "", 11),
    ('"0.01 mm/s", ', '"two", ', "axis 2: values", "two", "mm/s", 19),
    ('"1.2 mm/min"', '"0.01 mm/s"', "axis 2: values", "0.01 mm/s", "ascending", 19),
    ('"10 kPa"', '"10 kg"', "G", "10 kg", "kPa", 5),
    ('"10 kPa"', "10", "G", "10", "unit", 5),
    ('"10 kPa"', '"-1 kPa"', "G", "-1 kPa", "0 kPa < G", 5),
    ('G = "10 kPa"', 'speed = "1 mm/s"', "speed", "1 mm/s", "[protocol]", 5),
    ('G = "10 kPa"', 'GG = "10 kPa"', "GG", "10 kPa", "'G'", 5),
    ('G = "10 kPa"', 'G_c = "1 J/m^2"', "axis 1: name", "cohesion", "G_c", 11),
    ('h = "0.5 mm"', 'h = "0.5 s"', "h", "0.5 s", "mm", 8),
    ("points = 3", "points = 0", "axis 1: points", "0", "2 to", 14),
    ("points = 3", "points = 2.5", "axis 1: points", "2.5", "whole number", 14),
    ("points = 3", "points = true", "axis 1: points", "True", "whole number", 14),
    ("points = 3", "points = 99999", "axis 2: points", "199998", "at most", 17),
    ("points = 3\n", "", "axis 1: points", "(missing)", "points", 10),
    ("from = 1.0", "from = 100.0", "axis 1: from", "100.0", "less than", 12),
    ("from = 1.0", "from = 0.0", "axis 1: from", "0.0", "more than 0", 12),
    ("from = 1.0", 'from = "1 kPa"', "axis 1: from", "1 kPa", "without unit", 12),
    ("from = 1.0", "from = nan", "axis 1: from", "nan", "0 <= cohesion", 12),
    ("from = 1.0", "form = 1.0", "axis 1: form", "1.0", "'from'", 12),
    ('scale = "log"', 'scale = "logarithmic"', "axis 1: scale", "logarithmic", "log", 15),
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
    ("drop = 0.2", 'onset_length = "0 mm"', "onset_length", "0 mm", "0 mm < onset_length", 22),
    ("drop = 0.2", "surge = -1", "surge", "-1", "0 < surge", 22),
    ('mark = ["meat"]', 'mark = ["meet"]', "mark", "meet", "'meat'", 25),
    ('mark = ["meat"]', 'mark = ["my/meat.toml"]', "mark", "my/meat.toml", "TOML file", 25),
    ('mark = ["meat"]', 'mark = ["meat", "meat"]', "mark", "meat", "different names", 25),
    ('mark = ["meat"]', 'mark = "meat"', "mark", "meat", "a list", 25),
    ('mark = ["meat"]', 'x = "viscosity"', "x", "viscosity", "cohesion", 25),
    ('mark = ["meat"]', 'x = "speed"\ny = "speed"', "y", "speed", "", 26),
    ("[regime]", "[[regime]]", "regime", "drop", "[regime]", 21),
    ("drop = 0.2", "drop = ", "TOML", "drop =", "readable TOML", 22),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "value", "hint", "line"), BAD)
def test_what_is_wrong_is_named(write, old, new, key, value, hint, line):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with refused(key, line=line, file=line and path, hint=hint) as caught:
        load_study(path)
    assert value in str(caught.value.value) and caught.value.line == line


@pytest.mark.parametrize(
    ("case", "file", "key", "hint"),
    [
        ("[parameters]\nG = 3\n", "gel.toml", "G", "unit"),  # wrong in its own file
        ("G = 3\n", "gel.toml", "G", "[parameters]"),
        (f"mechanisms = {[m for m in DEFAULT if 'viscous' not in m]}", "study.toml", "mark", "viscosity"),
        ('[blade]\nthickness = "0.1 mm"\ntip = "0.15 mm"\n', "study.toml", "mark", "h = "),
    ],
)
def test_a_marked_case_file_with_an_error_is_refused(write, tmp_path, case, file, key, hint):
    (tmp_path / "gel.toml").write_text('base = "gelatin"\n' + case)
    with refused(key, file=file, hint=hint):
        load_study(write(GOOD.replace('"meat"', '"gel.toml"').replace('"cohesion"', '"viscosity"')))


@pytest.mark.parametrize(
    ("axes", "hint"),
    [(["cohesion", "cohesion"], "once"), (["cohesion", "G_c"], "G_c"), (["viscosity", "eta_reg"], "eta_reg")],
)
def test_two_axes_that_set_the_same_are_refused(write, axes, hint):
    values = {"G_c": '["1 J/m^2"]', "eta_reg": '["1 s"]'}
    text = 'base = "gelatin"\n' + "".join(
        f'[[axis]]\nname = "{name}"\nvalues = {values.get(name, "[1.0]")}\n' for name in axes
    )
    with refused(line=6, hint=hint):
        load_study(write(text))


def test_a_study_without_axes_or_file_is_refused(write, tmp_path):
    with refused("axis", value="(missing)"):
        load_study(write('base = "gelatin"\n'))
    with refused("axis", line=2):
        load_study(write('base = "gelatin"\n[axis]\nname = "cohesion"\nvalues = [1.0]\n'))
    with refused("file", value=tmp_path / "none.toml"):
        load_study(tmp_path / "none.toml")


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
        (BOUNDARY, "[boundary]\nruns", "[sample]\npoints", "sample", "mode = 'sobol'", 17),
        (SAMPLED, "points = 16", "points = 0", "points", "1 to", 14),
        (SAMPLED, "points = 16\n", "", "points", "points = 100", 13),
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
    with refused(key, line=line, hint=hint):
        load_study(write(text.replace(old, new, 1)))


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
CONVERGE = ("convergence", "choices", "folds")
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
