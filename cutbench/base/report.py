"""What a result says, as one record: rendered as text, as a page of its own, and in short for a notebook.

Nothing else puts cells into lines or into HTML; the command line gives the same tables to its terminal.
"""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def packaged_text(package: str, file: str) -> str:
    """A text that lies in a package, by its place in there."""
    return resources.files(package).joinpath(*file.split("/")).read_text(encoding="utf-8")


def filled(package: str, file: str, parts: Mapping[str, str]) -> str:
    """Such a text with ``__NAME__`` replaced by the part of that name; what parts say is not looked into."""
    return re.sub(r"__([A-Z]+)__", lambda mark: parts[mark[1]], packaged_text(package, file))


def aligned(rows: Iterable[Sequence[str]]) -> list[str]:
    """Rows of equal length as lines, with their cells one below the other."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{c:<{w}}" for c, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def number(value: float | None, form: str = "g") -> str:
    """A number in a cell; a dash where there is none."""
    return "-" if value is None or math.isnan(value) else format(value, form)


@dataclass(frozen=True)
class Table:
    """Cells in rows under heads. A row without cells is a line across; without any row ``none`` is said.

    Cells under heads that are ``right`` stand flush right, those under heads that are ``whole`` are not
    broken. Text has at ``most`` so many rows.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""
    right: Container[str] = ()
    whole: Container[str] = ()
    none: str = ""
    most: int | None = None

    def lines(self) -> list[str]:
        """As text."""
        if not self.rows:
            return [self.none] if self.none else []
        left_out = len(self.rows[self.most :]) if self.most else 0
        lines = aligned([self.heads, *filter(None, self.rows[: self.most])])
        return [*filter(None, [self.title]), *lines, *([f"and {left_out} more"] if left_out else [])]

    def html_rows(self) -> str:
        """What stands inside of a table in HTML; cells that start with a digit or a sign are numbers."""
        head = "".join(f'<th scope="col">{escape(text, quote=False)}</th>' for text in self.heads)
        body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in self.rows if row)
        return f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>"

    def html(self) -> str:
        """As HTML, with its title in words above."""
        if not self.rows:
            return _paragraph(self.none)
        return _paragraph(self.title) + _wide(f"<table>{self.html_rows()}</table>")


@dataclass(frozen=True)
class Picture:
    """What draws a figure when it is asked to, its name on the page, and what is to be said of it."""

    draw: Callable[[], Figure]
    name: str
    caption: str = ""

    def lines(self) -> list[str]:
        """Text has no pictures."""
        return []

    def html(self) -> str:
        """The drawing with its caption."""
        # What draws is loaded where there is a page to be drawn.
        svg = importlib.import_module("cutbench.base.figure_style").svg
        return _wide(svg(self.draw(), self.name)) + _paragraph(self.caption, "hint")


@dataclass(frozen=True)
class Chapter:
    """Sentences, tables and pictures under a title. A page says in a ``hint`` how to read them, and what is
    ``brief`` stands in a notebook, too."""

    title: str
    parts: Sequence[str | Table | Picture]
    hint: str = ""
    brief: bool = False

    def lines(self) -> list[str]:
        """As text; nothing where no part has any."""
        lines = [t for part in self.parts for t in ([part] if isinstance(part, str) else part.lines()) if t]
        return ["", self.title, *(f"  {text}" for text in lines)] if lines else []

    def html(self) -> str:
        """As HTML; nothing where no part has any."""
        body = "".join(_paragraph(part) if isinstance(part, str) else part.html() for part in self.parts)
        return f"<h2>{escape(self.title)}</h2>{_paragraph(self.hint, 'hint')}{body}" if body else ""

    def pairs(self) -> list[tuple[str, str]]:
        """Sentences under the title, rows under their first cells."""
        tables = [part for part in self.parts if isinstance(part, Table)]
        sentences = [(self.title.lower(), part) for part in self.parts if isinstance(part, str) and part]
        return sentences + [(first, "  ".join(filter(None, more))) for t in tables for first, *more in t.rows]


@dataclass(frozen=True)
class Report:
    """What a result says: facts under their names, sentences, of which the first is the answer ``in_short``,
    and chapters. ``kind`` chooses the colour of the answer on a page."""

    title: str
    facts: Sequence[tuple[str, str]]
    sentences: Sequence[str] = ()
    chapters: Sequence[Chapter] = ()
    in_short: str = ""
    kind: str = ""

    def text(self) -> str:
        """As lines of text, all of it."""
        head = [self.title, *map(": ".join, self.facts), *filter(None, self.sentences)]
        return "\n".join([*head, *(line for each in self.chapters for line in each.lines())])

    def summary_lines(self) -> list:
        """In short: the title, then pairs of words."""
        brief = [pair for chapter in self.chapters if chapter.brief for pair in chapter.pairs()]
        return [self.title, *self.facts, *(("said", text) for text in self.sentences if text), *brief]

    def page(self) -> str:
        """As a page in HTML that needs neither a network nor anything beside it."""
        facts = "; ".join(map(": ".join, self.facts))
        parts = {
            "TITLE": escape(self.title, quote=False),
            "KIND": self.kind,
            "HEAD": _paragraph(facts, "hint"),
            "ANSWER": _paragraph(self.in_short, "said") + "".join(map(_paragraph, self.sentences)),
            "BODY": "\n".join(chapter.html() for chapter in self.chapters),
        }
        return filled("cutbench.base", "report.html", parts)


def _paragraph(text: str, kind: str = "") -> str:
    look = f' class="{kind}"' if kind else ""
    return f"<p{look}>{escape(text, quote=False)}</p>" if text else ""


def _cell(text: str) -> str:
    look = ' class="number"' if re.match(r"[-+−±\d]", text) else ""
    return f"<td{look}>{escape(text, quote=False)}</td>"


def _wide(inner: str) -> str:
    """What scrolls sideways where the page is narrow, by keys, too."""
    return f'<div class="wide" tabindex="0">{inner}</div>'
