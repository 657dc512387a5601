"""The same problem in another size, with all lengths and the toughness times s, has the same answer over
powers of s: to rounding, which powers of two leave alone, and nearly so in sizes that round."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cutbench
from cutbench.base.units import dimensions_of
from cutbench.case.case import load_case
from cutbench.run.cutting import run2d, run3d
from cutbench.run.snap_back import rate_independent_case, trace_path
from cutbench.run.tension import run_tension, strip_case

SMALL = {
    "width": "8 mm", "length": "8 mm", "height": "6 mm", "depth": "1.1 mm", "h": 0.86, "corner": 0.25,
    "detail": 1.0, "element": "P1", "penalty": 700, "stick": 280, "until": "depth",
}  # fmt: skip
#: Each begins to be cut, but for the wire, which enters a slit.
CASES = {
    "ellipse": {"cohesion": 0.5, "tip": "3.5 mm", "mu": 0.2},
    "bevel": {"with": "bevel", "edge_radius": "0.1 mm", "cohesion": 0.3, "mu": 0.2, "slice_push": 0.5},
    "wire": {"with": "wire", "precut": "1 mm", "mu": 0.3, "depth": "0.5 mm"},
}


def in_size(case, s):
    """``case`` with all lengths times ``s`` at the same stresses and times."""
    known = case.model.parameters()

    def factor(q):
        force, length, _ = dimensions_of(q.unit)
        return s ** (2 * force + length)

    values = {name: value * factor(known[name]) for name, value in case.values.items()}
    return replace(case, values=values, motion=tuple((t, s * y) for t, y in case.motion))


def section(name):
    return load_case("gelatin", {**SMALL, **CASES[name]})


def block():
    small = {"layers": 2, "length": "3 mm", "height": "4 mm", "depth": "0.5 mm", "cohesion": 0.2, "h": 0.95}
    return load_case("gelatin", {**SMALL, **small, "tip": "3.5 mm"}, dim=3)


@cache
def curve_of(name, s):
    """Columns by name in units of size 1, and how many steps were refused."""
    if name == "strip":
        case = in_size(strip_case(load_case("gelatin", dim=3), {"h": 3.0, "depth": "4 mm"}, notch_mm=2.4), s)
        result = run_tension(case, 2.4 * s)
    elif name == "path":
        plain = rate_independent_case(section("ellipse").set(mu=0)).set(depth="0.5 mm")
        return _over(trace_path(in_size(plain, s))[0], s), 0
    elif name == "block":
        result = run3d(in_size(block(), s), snapshots_mm=())
    else:
        result = run2d(in_size(section(name), s), snapshots_mm=())
    return _over(result.curve, s), result.counts["rejected_steps"]


def _over(curve, s):
    powers = {"_mJ": 3, "_MPa": 0, "_s": 0, "_mm": 1, "_N": 2}
    return {
        name: column / s ** next((power for unit, power in powers.items() if name.endswith(unit)), 0)
        for name, column in curve.items()
    }


@pytest.mark.parametrize(
    ("name", "s"),
    [*((name, s) for name in CASES for s in (1 / 64, 8, 1024)), ("path", 8), ("strip", 1024), ("block", 8)],
)
def test_the_same_to_rounding_in_powers_of_two(name, s):
    (one, refused), (other, also) = curve_of(name, 1), curve_of(name, s)
    assert refused == also
    for column, values in one.items():
        size = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        np.testing.assert_allclose(other[column], values, rtol=1e-9, atol=1e-9 * size, err_msg=column)


@pytest.mark.parametrize("s", [0.1, 10])
@pytest.mark.parametrize("name", CASES)
def test_nearly_the_same_in_sizes_that_round(name, s):
    one, other = curve_of(name, 1)[0], curve_of(name, s)[0]
    assert one["force_N"].size == other["force_N"].size
    for column in ("displacement_mm", "force_N", "cut_length_mm"):
        np.testing.assert_allclose(other[column], one[column], atol=1e-4 * np.abs(one[column]).max())


@pytest.mark.parametrize("name", ["ellipse", "bevel", "block"])
def test_these_cases_are_cut(name):
    length = curve_of(name, 1)[0]["cut_length_mm"]
    assert length[-1] > length[0] + 0.05


def test_numerics_with_their_unit_stay_when_the_blade_changes():
    case = load_case("gelatin", {"h": "0.1 mm", "penalty": "5e4 1/mm"})
    large = case.set(thickness="1.4 mm")
    for each in (case, large):
        assert (each.sizes.h_mm, each.sizes.penalty_per_mm) == (0.1, 5e4)
    assert large.sizes.step_mm == pytest.approx(2 * case.sizes.step_mm)
    assert case.from_dict(case.to_dict()).id == case.id


def _lengths_in_mm(file):
    """Names of what a file sets to numbers that are in mm, by the name or by the comment above."""
    text = file.read_text(encoding="utf-8")
    lines = text.splitlines()
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        numbers = [n.value for n in ast.walk(node.value) if isinstance(n, ast.Constant)]
        given = isinstance(node.value, (ast.Constant, ast.Tuple, ast.BinOp, ast.UnaryOp))
        if not given or not any(n for n in numbers if isinstance(n, (int, float)) and n is not True):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
        above = node.lineno - 2
        while above >= 0 and lines[above].lstrip().startswith("#:"):
            above -= 1
        said = " ".join(lines[above + 1 : node.lineno - 1])
        if any(name.lower().endswith("_mm") for name in names) or re.search(r"\bmm\b", said):
            yield from names


def test_no_length_is_in_mm_below_the_command_line():
    """But for what pictures are wide, what the paper has chosen for its own blade, and the tests that typical
    values, which have units, are of."""
    package = Path(cutbench.__file__).parent
    rooms = [p for p in package.iterdir() if p.is_dir() and p.name not in ("app", "cli")]
    files = [f for room in rooms for f in room.rglob("*.py") if "figure" not in str(f.relative_to(package))]
    found = {name for f in files for name in _lengths_in_mm(f) if not name.startswith("PAPER_")}
    assert len(files) > 200 and not found - {"top_mm", "TYPICAL_TESTS"}, found
