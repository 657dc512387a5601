"""Every block of README.md and docs/ does what it says.

Blocks of one page run in order in one folder. A block that begins with ``# file: NAME`` is written
there. A line ``$ cutbench …`` runs through the command line, and what stands under it must be in its
output. Set-up commands are marked and compared with what runs them, for they make environments.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from looped import over
from refusals import MESSAGE
from typer.testing import CliRunner

from cutbench.case.case import load_case
from cutbench.case.materials import names as material_names
from cutbench.cli.main import app
from verification import references
from verification.__main__ import app as verifies

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
#: What computes for more than some seconds says so in a comment.
SLOW = "<!-- slow -->"
TEXTS = [ROOT / "CONTRIBUTING.md", *PAGES]
SET_UP = re.compile(r"<!-- set-up: (\w+) -->\s*$")
KINDS = {"python", "console", "toml"}


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


class Block(NamedTuple):
    line: int
    kind: str
    text: str
    set_up: str | None


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = []
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.M | re.S):
        mark = SET_UP.search(text[: match.start()])
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(line, match[1], match[2], mark and mark[1]))
    return found


def set_up(kind: str) -> str:
    (found,) = [b.text.strip() for b in blocks(ROOT / "README.md") if b.set_up == kind]
    return found


def run(args: list[str], folder: Path) -> subprocess.CompletedProcess:
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    env = {
        **os.environ,
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",
        "CUTBENCH_COMPILED": "0",
        "PYTHONIOENCODING": "utf-8",
    }
    return subprocess.run(
        args, cwd=folder, env=env, capture_output=True, text=True, encoding="utf-8", check=False, timeout=300
    )


def entered(words: list[str], folder: Path) -> tuple[int, str]:
    """Exit status and output of a command; laws that it brings are not to stay in this process."""
    if any("mechanisms" in word or ".py" in word for word in words):
        done = run([sys.executable, "-m", *words], folder)
        return done.returncode, done.stdout + done.stderr
    with contextlib.chdir(folder):
        found = CliRunner().invoke(verifies if words[0] == "verification" else app, words[1:])
    return found.exit_code, found.output


def console(block: Block, folder: Path, where: str) -> None:
    """Run each command of a block and look for what is shown under it."""
    for part in re.split(r"^\$ ", block.text, flags=re.M)[1:]:
        command, _, shown = part.partition("\n")
        words = shlex.split(command)
        own = words[:3] == ["python", "-m", "verification"]
        assert own or words[0] == "cutbench", f"{where}: '{command}' is not run by this test"
        code, said = entered(words[2 * own :], folder)
        assert code == (2 if MESSAGE.search(shown) else 0), f"{where}: {command}\n{said}"
        for line in filter(None, map(str.strip, shown.splitlines())):
            assert line in said, f"{where}: {command}\n{said}"


def written_in(page: Path, line: int):
    """(folder, names) of files that a table behind the block at ``line`` lists; its mark is the folder."""
    text = (
        "\n".join(page.read_text(encoding="utf-8").splitlines()[line:])
        .partition("```")[2]
        .partition("```")[0]
    )
    for folder, table in re.findall(r"<!-- files: (\S+) -->\n((?:\|.*\n)+)", text):
        rows = table.splitlines()[2:]
        yield folder, [name for row in rows for name in re.findall(r"`([^`]+)`", row.split("|")[1])]


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=named(page), marks=pytest.mark.slow if SLOW in page.read_text("utf-8") else ())
        for page in PAGES
        if "\n```" in page.read_text("utf-8")
    ],
)
def test_blocks_run(page, tmp_path):
    script = []
    for block in blocks(page):
        where = f"{named(page)}, line {block.line}"
        assert block.kind in KINDS, f"{where}: a block of kind '{block.kind}' is not run by any test"
        if block.set_up:
            continue
        name = re.match(r"# file: (\S+)\n", block.text)
        if name:
            path = tmp_path / name[1]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text.partition("\n")[2], encoding="utf-8")
        elif block.kind == "console":
            console(block, tmp_path, where)
            for folder, names in written_in(page, block.line):
                assert names and all(list((tmp_path / folder).glob(name)) for name in names), where
        else:
            assert block.kind == "python", f"{where}: a TOML block needs a '# file: NAME' line"
            script.append(block.text)
    if script:
        (tmp_path / "page.py").write_text("\n".join(script), encoding="utf-8")
        done = run([sys.executable, "page.py"], tmp_path)
        assert done.returncode == 0, f"{page.name}\n{done.stderr}"
        for comment in re.findall(r"print\(.*?\)\s+# (done: .*)", "\n".join(script)):
            assert comment in done.stdout


@pytest.mark.slow
def test_the_law_of_the_tutorial_is_neo_hooke_where_it_does_not_stiffen(tmp_path):
    page = ROOT / "docs" / "tutorials" / "own-law.md"
    (law,) = [b.text for b in blocks(page) if b.text.startswith("# file: my_laws/demiray.py")]
    (tmp_path / "my_laws").mkdir()
    (tmp_path / "my_laws" / "demiray.py").write_text(law, encoding="utf-8")
    (tmp_path / "compare.py").write_text(
        "import cutbench\n"
        "cutbench.use_mechanisms('my_laws')\n"
        "small = dict(depth='0.5 mm', h='0.7 mm')\n"
        "for changes in ({}, dict(with_='demiray', k=1e-9), dict(with_='demiray', k=0.3)):\n"
        "    print(cutbench.run2d('gelatin', **changes, **small).force_N[-1])\n",
        encoding="utf-8",
    )
    done = run([sys.executable, "compare.py"], tmp_path)
    assert done.returncode == 0, done.stderr
    neo, far, near = map(float, done.stdout.split())
    assert far == pytest.approx(neo, rel=1e-6)
    assert near > 1.001 * neo


def test_ci_runs_the_test_command_of_the_readme():
    ci = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert ci.rstrip().splitlines()[-1] == set_up("tests")


def test_the_main_command_names_a_study_that_is_there():
    words = shlex.split(set_up("main"))
    study = ROOT / words[words.index("sweep") + 1]
    from cutbench.maps.study import load_study

    assert max(load_study(study).shape) > 1


@over("name", material_names())
def test_materials_are_as_the_page_says(name):
    text = (ROOT / "docs" / "reference" / "materials.md").read_text(encoding="utf-8")
    rows = re.findall(rf"^\| *{name} *\|(.*)\|$", text, re.M)
    cells = {cell.strip().replace("²", "^2") for row in rows for cell in row.split("|")}
    shown = load_case(name).shown()
    assert {shown[key] for key in ("G_c", "tau_W", "eta_reg")} <= cells


def test_every_reference_problem_has_its_line():
    text = (ROOT / "docs" / "validation" / "verify.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", text, re.M) == [*references()]


@over("page", TEXTS)
def test_paths_are_there(page):
    """Files and folders of the repository that a page names, and modules that are run with python -m."""
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"(?<![\w/.])((?:cutbench|tests|docs|benchmarks|studies)/[\w./*-]+|\.ci/\w+)", text)
    for path in named:
        assert list(ROOT.glob(path.rstrip("./"))), f"{page.name}: {path}"
    for module in re.findall(r"python -m ((?:cutbench|benchmarks)[\w.]*)", text):
        path = ROOT / module.replace(".", "/")
        assert path.is_dir() or path.with_suffix(".py").is_file(), f"{page.name}: {module}"


def test_links_lead_somewhere():
    for page in TEXTS:
        for target, anchor in re.findall(
            r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", page.read_text(encoding="utf-8")
        ):
            aim = page.parent / target if target else page
            assert aim.exists(), f"{page.name}: {target}"
            assert not anchor or anchor in anchors(aim), f"{page.name}: {target}#{anchor}"


def anchors(page: Path) -> set[str]:
    """What the headings of a page are called in links."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    heads = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
