"""``python -m benchmarks.page [--check]``: the documentation's table of what runs cost, from its JSON.

``measured.json`` is what ``python -m benchmarks --all --write`` found; the table stands in
docs/explanation/speed.md between two marks. With ``--check`` nothing is written, and the exit status is 1
if the two do not agree.
"""

from __future__ import annotations

import json
import sys
import textwrap
from collections.abc import Sequence
from typing import Any

from benchmarks import transition
from benchmarks.tools import ROOT
from cutbench.base.files import markdown_table, write_json, write_text

DATA, PAGE = ROOT / "benchmarks" / "measured.json", ROOT / "docs" / "explanation" / "speed.md"
BEGIN, END = "<!-- benchmarks: made by python -m benchmarks --all --write -->\n", "<!-- end of benchmarks -->"


def short(commit: str | None) -> str:
    return (commit or "no commit")[:7]


def machine(facts: dict) -> str:
    """A machine in a line."""
    versions = [f"{name} {version}" for name, version in facts["versions"].items() if version]
    system = f"{facts['cpu']}, {facts['cores']} cores; {facts['system']}"
    return f"{system}; Python {facts['python']}, {', '.join(versions)}"


def filled(text: str) -> str:
    """Prose in lines of the page's length."""
    return textwrap.fill(text, 120, break_on_hyphens=False, break_long_words=False)


def told(data: dict[str, Any]) -> str:
    """What stands between the marks."""
    cells = []
    for r in data["runs"]:
        now = r["here"]
        cells.append([
            r["run"], f"{now['unknowns']:,}", now["steps"],
            f"{now['factorization_calls']:,} + {now['window_factorization_calls']:,}",
            f"{now['cpu_s']:.1f}", f"{100 * now['limit']:.0f} %",
        ])  # fmt: skip
    head = (
        f"run to {data['depth_mm']:g} mm", "unknowns", "steps", "factorizations, whole + front", "CPU s",
        "in factorization and solution",
    )  # fmt: skip
    beside = data["peer"]
    iterations, ms = beside["taken_as_given"]["iterations"], beside["measured"]["ms_per_iteration"]
    problems = [
        f"{r['cpu_s']:.1f} s here with the {r['problem']}, {r['times']:.1f} times as long there"
        for r in beside["problems"]
    ]
    made = (
        f"Commit `{short(data['commit'])}`, one thread a run, compiled code loaded before"
        f" ({machine(data['machine'])}):"
    )
    held = (
        f"The published model of gelatin to {beside['depth_mm']:g} mm beside"
        f" DOLFINx {beside['measured']['dolfinx']}: an iteration of a problem of its size takes {ms:.1f} ms"
        f" there (measured, by turns), and an independent implementation needed {iterations:,} of them (taken"
        f" as given), {beside['peer_s']:.0f} s in all. A run takes {'; '.join(problems)}."
    )
    parts = (
        filled(made), "\n".join(markdown_table(head, cells)), filled(held),
        filled(transition.told(data["transition"])),
    )  # fmt: skip
    return "\n\n".join(parts) + "\n"


def renewed(text: str, data: dict[str, Any]) -> str:
    """A page with what stands between its marks made anew."""
    before, _, rest = text.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"expected '{BEGIN.strip()}' and '{END}' in the page")
    return before + BEGIN + told(data) + END + after


def write(data: dict[str, Any]) -> tuple[str, ...]:
    """Keep ``data``, and make the page from it; the names of both."""
    write_json(data, DATA)
    write_text(renewed(PAGE.read_text(encoding="utf-8"), data), PAGE)
    return tuple(path.relative_to(ROOT).as_posix() for path in (DATA, PAGE))


def main(argv: Sequence[str] | None = None) -> int:
    check = "--check" in (sys.argv[1:] if argv is None else argv)
    data, text = json.loads(DATA.read_text(encoding="utf-8")), PAGE.read_text(encoding="utf-8")
    stale = renewed(text, data) != text
    if stale and not check:
        write_text(renewed(text, data), PAGE)
    print(f"{'not as measured' if check else 'written'}: {PAGE.name if stale else 'no page'}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
