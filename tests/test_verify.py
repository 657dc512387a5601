"""The reference problems: they pass, and a law that is wrong by one percent does not."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from refusals import refusal
from typer.testing import CliRunner

from cutbench.case.model import DEFAULT, PAPER
from cutbench.mechanisms import registry
from verification import FIRST, Check, Reference, Verified, references, verify
from verification.__main__ import app
from verification.report import describe, markdown, write

#: Laws of the default and of the paper's model, and those of surfaces, with what carries their flux.
FLUX = {
    "neo_hookean": ("stress_factors", "tangent_factors"),
    "volumetric": ("stress_factors", "tangent_factors"),
    "smith_ferrante": ("traction",),
    "stiff_cohesion": ("traction",),
    "viscous": ("traction",),
    "viscous_degraded": ("traction",),
    "contact": ("pressure",),
    "coulomb": ("strength",),
    "adhesion": ("strength",),
    "surface_gradient": ("gradient",),
    "surface_tension": ("tension",),
    "bending_skin": ("bending",),
    "film": ("bending",),
}


def concerned(law: str) -> list[Reference]:
    """Quick problems whose numbers depend on the law, the fastest first."""
    return sorted((r for r in references().values() if r.quick and law in r.laws), key=lambda r: r.seconds)


def verified_by(folder: Path, *names: str):
    """``python -m verification --quick`` as a user runs it, of all or of some problems."""
    only = [word for name in names for word in ("--only", name)]
    done = CliRunner().invoke(app, ["--quick", *only, "--out", str(folder)])
    return done, json.loads((folder / "verify.json").read_text(encoding="utf-8")), folder


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The quickest of each law, and what takes a second or two."""
    names = {concerned(law)[0].name for law in FLUX}
    names |= {r.name for r in references().values() if r.quick and r.seconds <= 2}
    return verified_by(tmp_path_factory.mktemp("verify"), *sorted(names))


def passes(found, names: list[str]) -> None:
    done, record, _ = found
    assert done.exit_code == 0, done.output
    assert record["passed"] and record["complete"]
    assert [p["name"] for p in record["problems"]] == names
    checks = [check for problem in record["problems"] for check in problem["checks"]]
    assert len(checks) > 2 * len(names)
    assert all(check["passed"] and check["source"] for check in checks)


def test_the_quickest_pass(quick):
    done = {p["name"] for p in quick[1]["problems"]}
    assert len(done) >= 5
    passes(quick, [name for name in references() if name in done])


@pytest.mark.slow
def test_quick_passes_and_has_the_published_numbers(tmp_path):
    whole = verified_by(tmp_path)
    passes(whole, [r.name for r in references().values() if r.quick])
    found = {p["name"]: {c["reference"]: c for c in p["checks"]} for p in whole[1]["problems"]}
    assert {5.508, 6.981, 7.009} <= found["cook"].keys()
    assert {9.520, 17.966, 24.382, 16.244, 9.830, 13.961} <= found["inclusions"].keys()
    assert all(found.values())


def test_the_table_is_shown_and_written(quick):
    done, record, out = quick
    for problem in record["problems"]:
        assert problem["name"] in done.stdout
    text = (out / "verify.md").read_text(encoding="utf-8")
    assert text.count("| passed |") == sum(len(p["checks"]) for p in record["problems"])


def test_every_law_of_the_default_and_the_paper_is_covered():
    assert {*DEFAULT, *PAPER} <= set(FLUX)
    assert all(concerned(law) for law in FLUX)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n == "stiff_cohesion" else ()) for n in FLUX]
)
def test_one_percent_more_flux_is_noticed(name, monkeypatch):
    law = registry()[name]
    first = concerned(name)[0]
    for method in FLUX[name]:
        monkeypatch.setattr(law, method, _scaled(getattr(law, method)))
    done = list(verify([first]))
    assert done[0].failure is None
    assert not done[0].passed, f"{first.name} does not see {name} wrong by 1 %"


def _scaled(method):
    def flux(*args, **kwargs):
        value = method(*args, **kwargs)
        if not isinstance(value, tuple):
            return 1.01 * value
        # Stress factors and pressure come in tuples of numbers; a traction comes with its state.
        return tuple(part if isinstance(part, dict) else 1.01 * part for part in value)

    return flux


@pytest.mark.parametrize("name", FLUX)
def test_the_flux_unchanged_passes_the_same_problem(name, quick):
    _, record, _ = quick
    (problem,) = (p for p in record["problems"] if p["name"] == concerned(name)[0].name)
    assert problem["passed"]


# -- checks, runner, report ------------------------------------------------------------------------
def check(reference=2.0, obtained=2.01, tolerance=0.01, unit="N"):
    return Check("force", unit, reference, obtained, tolerance)


def test_error_is_relative_or_absolute_where_the_reference_is_zero():
    assert check().error == pytest.approx(0.005)
    assert check(reference=-2.0, obtained=-2.01).error == pytest.approx(-0.005)
    assert check(reference=0.0, obtained=-0.3).error == -0.3


@pytest.mark.parametrize(
    ("given", "passed"),
    [
        ({}, True),
        ({"obtained": 2.03}, False),
        ({"obtained": 1.97}, False),
        ({"obtained": math.nan}, False),
        ({"obtained": math.inf}, False),
        ({"reference": 0.0, "obtained": 0.009}, True),
        ({"reference": 0.0, "obtained": -0.011}, False),
    ],
)
def test_verdict(given, passed):
    assert check(**given).passed is passed


def reference(compute, name="made_up") -> Reference:
    return Reference(name, "A title.", "a source", compute)


def failing():
    yield check()
    raise FloatingPointError("no way")


def verified(compute) -> Verified:
    return next(iter(verify([reference(compute)])))


def test_what_a_problem_raises_is_its_verdict():
    got = verified(failing)
    assert got.failure.startswith("FloatingPointError: ")
    assert len(got.checks) == 1 and not got.passed


def test_a_problem_without_checks_does_not_pass():
    assert not verified(lambda: iter(())).passed


def test_interruption_is_not_swallowed():
    def interrupted():
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        verified(interrupted)


def test_record_of_a_failure_is_valid_json(tmp_path):
    bad = verified(lambda: iter([check(obtained=math.nan), check(reference=0.0)]))
    write([bad], tmp_path, complete=True)
    record = json.loads((tmp_path / "verify.json").read_text(encoding="utf-8"))
    assert record["passed"] is False
    first, second = record["problems"][0]["checks"]
    assert first["obtained"] is None and first["error_is"] == "relative"
    assert second["error_is"] == "absolute"
    assert record["versions"]["numpy"]
    assert "FAILED" in (tmp_path / "verify.md").read_text(encoding="utf-8")


def test_incomplete_is_not_passed():
    good = verified(lambda: iter([check()]))
    assert describe([good], complete=True)["passed"]
    assert not describe([good], complete=False)["passed"]
    (row,) = (line for line in markdown([good]).splitlines() if line.startswith("| force |"))
    assert [cell.strip() for cell in row.split("|")[2:-1]] == ["2 N", "2.01 N", "+0.5 %", "1 %", "passed"]


def test_problems_are_found_by_being_there():
    folder = Path(__import__("verification", fromlist=["x"]).__file__).parent
    found = references()
    assert tuple(found)[: len(FIRST)] == FIRST
    for name, one in found.items():
        assert (folder / f"{name}.py").is_file()
        assert one.title.endswith(".") and not one.source.endswith(".")
        assert set(one.laws) <= registry().keys()
    # Estimates for the progress bar: what they add up to is what the options promise.
    assert sum(one.seconds for one in found.values() if one.quick) < 60
    assert sum(one.seconds for one in found.values()) < 600


# -- the command -------------------------------------------------------------------------------------
def invoke(*args: str):
    return CliRunner().invoke(app, [*args])


def test_list_computes_nothing():
    done = invoke("--list")
    assert done.exit_code == 0
    assert all(name in done.stdout for name in references())


def test_a_problem_that_is_unknown_or_slow_is_refused():
    done = invoke("--only", "cok")
    refusal(done, "--only", value="cok", hint="cook")
    done = invoke("--quick", "--only", "steady")
    refusal(done, "--only", value="steady")


def test_a_folder_that_cannot_be_written_to_is_refused_first(tmp_path):
    (tmp_path / "file").write_text("")
    done = invoke("--only", "objectivity", "--out", str(tmp_path / "file"))
    assert done.exit_code == 2
    assert "--out" in done.stderr


@pytest.fixture
def only(monkeypatch):
    """Calling it with problems makes those all that there are."""
    return lambda found: monkeypatch.setattr("verification.references", lambda: found)


def test_a_failed_check_is_exit_status_1(only, tmp_path):
    only({"made_up": reference(lambda: iter([check(), check(obtained=3.0)]))})
    done = invoke("--out", str(tmp_path))
    assert done.exit_code == 1
    assert "FAILED" in done.stdout and "1 of 2" in done.stdout
    assert json.loads((tmp_path / "verify.json").read_text(encoding="utf-8"))["passed"] is False


def test_what_was_computed_before_an_interruption_is_kept(only, tmp_path):
    def interrupted():
        raise KeyboardInterrupt
        yield

    both = {"a": reference(lambda: iter([check()]), "a"), "b": reference(interrupted, "b")}
    only(both)
    done = invoke("--out", str(tmp_path))
    assert done.exit_code == 130
    record = json.loads((tmp_path / "verify.json").read_text(encoding="utf-8"))
    assert [p["name"] for p in record["problems"]] == ["a"]
    assert record["complete"] is False and record["passed"] is False
