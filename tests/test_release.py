"""What a release needs says the same in each place."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import cutbench

ROOT = Path(__file__).parents[1]


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_citation_is_of_this_version():
    cited = dict(re.findall(r"^([a-z-]+): *(.*)$", text_of("CITATION.cff"), re.M))
    assert cited["version"] == cutbench.__version__
    needed = {"title", "authors", "license", "abstract", "type", "message", "cff-version"}
    assert needed <= cited.keys() and cited["license"] == "BSD-3-Clause"


def test_the_recipe_needs_what_the_package_needs():
    """But for the factorization that conda does not have, and pyplot's windows."""
    project = tomllib.loads(text_of("pyproject.toml"))["project"]
    wanted = {each for each in project["dependencies"] if ";" not in each}
    (run,) = re.findall(r"^  run:\n((?:    - .*\n)+)", text_of("recipe/meta.yaml"), re.M)
    listed = {line.strip("- ").replace(" ", "") for line in run.splitlines()} - {"python>=3.11"}
    assert {each.replace("matplotlib-base", "matplotlib") for each in listed} == wanted
