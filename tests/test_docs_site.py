"""The site of the documentation: every page is reached, short enough, and built without a warning."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
from looped import over

from cutbench.case.numerics import Numerics
from cutbench.mechanisms import registry

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
#: What programs write into a page: no person reads it from end to end.
WRITTEN = re.compile(r"<!-- (?:made: )?(\S[^>]*?) -->\n.*?<!-- end of (?:benchmarks|\1) -->", re.S)
NUMERICS = "reference/numerics.md"
WORDS = 1500


def named(page: Path) -> str:
    return page.relative_to(DOCS.parent).as_posix()


def test_every_page_is_reached_from_the_front():
    reached, asked = set(), [DOCS / "index.md"]
    while asked:
        page = asked.pop()
        reached.add(page)
        for listed in re.findall(r"^:::\{toctree\}\n(.*?)^:::$", page.read_text("utf-8"), re.M | re.S):
            names = [line for line in listed.splitlines() if line and not line.startswith(":")]
            asked += [page.parent / f"{name}.md" for name in names]
    assert reached == set(PAGES)


@pytest.fixture(scope="module")
def filled():
    """What the site has of a page, by its path in docs."""
    script = (
        "import json, pathlib, made; here = pathlib.Path('docs');"
        "pages = {p.relative_to(here).as_posix(): p.read_text('utf-8') for p in here.rglob('*.md')};"
        "old = [name for name, text in pages.items() if made.written(text) != text];"
        "assert not old, f'python docs/made.py writes {old} anew';"
        "print(json.dumps({name: made.filled(text) for name, text in pages.items()}))"
    )
    path = os.pathsep.join([str(DOCS), str(DOCS.parent)])
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=DOCS.parent,
        env={**os.environ, "PYTHONPATH": path}, encoding="utf-8",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_code_fills_every_table(filled):
    assert not [page for page, text in filled.items() if "<!-- made:" in text]
    for law in registry().values():
        assert f"`{law.name}`" in filled[f"reference/{'tools' if law.role == 'contact' else 'mechanisms'}.md"]
    for field in fields(Numerics):
        assert field.name == "tuning" or f"\n| `{field.name}` | " in filled[NUMERICS]


@over("page", [*PAGES, *DOCS.parent.glob("*.md")])
def test_a_page_is_read_in_a_few_minutes(page):
    text = WRITTEN.sub("", page.read_text("utf-8"))
    assert len(text.split()) <= WORDS, f"{named(page)}: part it, or let a program write its tables"


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path):
    for needed in ("sphinx", "myst_parser", "pydata_sphinx_theme"):
        pytest.importorskip(needed, reason="pip install 'cutbench[docs]'")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", str(DOCS), str(tmp_path / "site")],
        capture_output=True, text=True, check=False, cwd=DOCS.parent, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    shown = (tmp_path / "site" / "reference" / "command-line.html").read_text("utf-8")
    assert "--until" in shown and "made:" not in shown
    assert "run2d" in (tmp_path / "site" / "reference" / "api.html").read_text("utf-8")
