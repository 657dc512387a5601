"""The examples that come with an installed cutbench, and the sections of its files: documented and there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from refusals import refusal, refused
from typer.testing import CliRunner

import cutbench
from benchmarks.real import CAMPAIGNS
from cutbench.case.model import PROTOCOL, SPECIMEN, section_of
from cutbench.cli.main import app
from cutbench.data.campaign import load_campaign
from cutbench.maps.study import load_study
from cutbench.mechanisms import registry

ROOT = Path(__file__).resolve().parents[1]
IN_WHEEL = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["hatch"]["build"]["targets"][
    "wheel"
]["force-include"]


def test_examples_are_copied_and_can_be_read(tmp_path):
    folder = cutbench.copy_examples(tmp_path / "examples")
    for name in (*CAMPAIGNS, "synthetic/cutting"):
        assert load_campaign(folder / f"{name}.toml").train
    assert load_study(folder / "transition.toml").axes
    assert not (folder / "results").exists()
    with refused("--out", value=folder):
        cutbench.copy_examples(folder)


def test_the_command_says_what_it_copied(tmp_path):
    done = CliRunner().invoke(app, ["examples", "--out", str(tmp_path / "new")])
    assert done.exit_code == 0 and "treloar.toml" in done.output
    again = CliRunner().invoke(app, ["examples", "--out", str(tmp_path / "new")])
    refusal(again, "--out")


def test_every_study_and_campaign_is_in_the_wheel():
    shipped = {Path(source).as_posix() for source in IN_WHEEL}
    files = [
        path for path in (ROOT / "studies").iterdir() if path.name not in ("results", "paper", "gallery")
    ]
    assert {path.relative_to(ROOT).as_posix() for path in files} == shipped


def test_what_is_cited_is_this_version():
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    assert re.search(rf"^version: {re.escape(cutbench.__version__)}$", text, re.M)


@pytest.mark.slow
def test_a_wheel_runs_its_examples_where_there_is_no_source(tmp_path):
    pytest.importorskip("hatchling", reason="pip install hatchling")
    pip = [sys.executable, "-m", "pip", "-q"]
    built = [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(tmp_path), str(ROOT)]
    subprocess.run(built, check=True, cwd=tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", str(tmp_path / "site"), str(wheel)], check=True)
    env = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}

    def said(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "cutbench", *words],
            cwd=tmp_path, env=env, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "transition.toml" in said("examples", "--out", "examples")
    for study in (tmp_path / "examples").glob("[bt]*.toml"):
        assert re.search(r"\d+ runs", said("sweep", str(study), "--out", "map", "--dry-run"))
    for campaign in ("rubber/treloar", "silicone/meunier"):
        said("fit", f"examples/{campaign}.toml", "--out", "fit")
    assert "reached 0.2 mm" in said("run2d", "gelatin", "--depth", "0.2", "--h", "1.4", "--out", "run")


def test_what_the_documentation_opens_is_in_the_wheel():
    shipped = set()
    for source, target in IN_WHEEL.items():
        assert target.startswith("cutbench/data/examples/") and (ROOT / source).exists()
        shipped.add(Path(target).relative_to("cutbench/data/examples").parts[0])
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    used = set()
    for page in pages:
        for block in re.findall(r"^```python\n(.*?)^```$", page.read_text("utf-8"), re.M | re.S):
            assert "__file__" not in block, f"{page.name}: a path beside the package is not in a wheel"
            used |= set(re.findall(r"examples / \"([\w.]+)\"", block))
    assert used and used <= shipped


@pytest.mark.parametrize("section", ["blade", "specimen", "protocol"])
def test_the_keys_of_each_section_are_documented(section):
    page = (ROOT / "docs" / "reference" / "files.md").read_text("utf-8")
    parameters = [q for law in registry().values() for q in law.parameters] + [*SPECIMEN, *PROTOCOL]
    row = re.search(rf"^\| `\[{section}\]` \|.*$", page, re.M)[0]
    for name in {q.name for q in parameters if section_of(q.name) == section}:
        assert f"`{name}`" in row


AXIS = "\n[[axis]]\nname = 'G'\nfrom = '1 kPa'\nto = '9 kPa'\n"
TEST = "\n[[experiment]]\nid = 'a'\ndata = 'a.csv'\nunknown = 1\nkind = "


@pytest.mark.parametrize(
    "text",
    [
        "unknown = 1" + AXIS, AXIS + "unknown = 1",
        *(f"{AXIS}points = 3\n[{name}]\nunknown = 1" for name in ("regime", "plot", "uncertainty")),
        f"mode = 'boundary'{AXIS}[boundary]\nunknown = 1", f"mode = 'sobol'{AXIS}[sample]\nunknown = 1",
        "unknown = 1" + TEST + "'cut'",
        *(f"{TEST}'{kind}'" for kind in ("cut", "uniaxial", "sliding", "separation")),
    ],
)  # fmt: skip
def test_every_key_that_a_file_may_have_is_documented(text, tmp_path):
    """What is expected in place of an unknown key is the list of them all."""
    file = tmp_path / "file.toml"
    file.write_text(("" if TEST in text else "base = 'gelatin'\n") + text, "utf-8")
    with pytest.raises(cutbench.BadInput) as refused:
        (load_campaign if TEST in text else load_study)(file)
    assert refused.value.key.endswith("unknown"), refused.value
    page = (ROOT / "docs" / "reference" / "files.md").read_text("utf-8")
    names = refused.value.expected.removeprefix("one of ").partition(";")[0].split(", ")
    missing = [name for name in names if f"`{name}`" not in page and f"[{name}]" not in page]
    assert len(names) > 1 and not missing
