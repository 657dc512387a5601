"""The site of the documentation: every page is reached, short enough, and built without a warning."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
#: What programs write into a page: no person reads it from end to end.
WRITTEN = re.compile(r"<!-- (table|claims|benchmarks|results).*?<!-- (?:end of \1|\1: end) -->", re.S)
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


@pytest.mark.parametrize("page", [*PAGES, *DOCS.parent.glob("*.md")], ids=named)
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
