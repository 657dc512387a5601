"""``python docs/tables.py [--check]``: the tables of these pages that are made from the code.

Each stands between the marks ``<!-- table: NAME -->`` and ``<!-- end of table -->``. With ``--check`` nothing
is written, and the exit status is 1 if a page is not as the code would have it.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path

from cutbench.case.model import DEFAULT
from cutbench.case.numerics import ALIASES, Numerics, defaults
from cutbench.case.tuning import Tuning
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import Mechanism

HERE = Path(__file__).resolve().parent


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def attribute_texts(cls: type) -> dict[str, str]:
    """What the section Attributes of a class's docstring says of each."""
    _, _, section = (inspect.getdoc(cls) or "").partition("Attributes\n----------\n")
    entries = re.findall(r"^(\w+) :.*\n((?:    .*\n?)+)", section, re.MULTILINE)
    return {name: " ".join(text.split()).replace("``", "`") for name, text in entries}


def digits(value: float) -> str:
    return re.sub(r"e([-+])0*", lambda found: "e" + found[1].strip("+"), f"{value:g}")


def shown(value: object, unit: str) -> str:
    if value is None:
        return "none"
    return f"`{digits(value)}{unit}`" if isinstance(value, (int, float)) else f"`{value}`"


def numerics() -> str:
    short, texts, rows = {long: name for name, long in ALIASES.items()}, attribute_texts(Numerics), []
    for f in (f for f in fields(Numerics) if f.name != "tuning"):
        unit, about, allowed = " mm" if f.name.endswith("_mm") else "", f.metadata, "a path"
        plane, solid = (shown(getattr(defaults(dim), f.name), unit) for dim in (2, 3))
        if "choices" in about:
            allowed = ", ".join(about["choices"])
        elif about:
            zero = "0, or " if about["chosen"] else ""
            allowed = f"{zero}{digits(about['low'])} to {digits(about['high'])}{unit}"
        default = plane if solid == plane else f"{plane}; in blocks {solid}"
        rows.append([f"`{short.get(f.name, f.name)}`", default, allowed, texts[f.name].rstrip(".")])
    return table(("name", "default", "allowed", "what it does"), rows)


def tuning() -> str:
    """The parts, with what their numbers decide."""
    lines = []
    for part in fields(Tuning):
        about = type(getattr(Tuning(), part.name)).__doc__ or ""
        lines.append(f"- `{part.name}`: {about.partition('. ')[0].rstrip('.').replace('``', '`')}")
    return "\n".join(lines)


def replaced(law: Mechanism) -> Mechanism | None:
    """The law whose role ``law`` takes, one whose parameters it keeps if there is; none where it is added."""
    names = {q.name for q in law.parameters}
    same = [o for o in registry().values() if o.role == law.role is not None and o.name != law.name]
    inside = [o for o in same if {q.name for q in o.parameters} <= names and o.name in DEFAULT]
    kept = [o for o in same if set(o.parameters) < set(law.parameters)]
    default = [o for o in same if o.name in DEFAULT and law.name not in DEFAULT]
    return next(iter(inside + kept + default), None)


def mechanisms() -> str:
    parts: dict[str, list[str]] = {}
    for law in (law for law in registry().values() if law.role != "contact"):
        about, _, _ = (sys.modules[type(law).__module__].__doc__ or "").partition("\n\n")
        about = re.sub(r" \(paper[^)]*\)", "", " ".join(about.split())).replace("``", "`").rstrip(".,")
        name = f"**`{law.name}`**" if law.name in DEFAULT else f"`{law.name}`"
        other = replaced(law)
        own = [q for q in law.parameters if other is None or q not in other.parameters]
        named = ", ".join(f"`{q.name}`" if q.off is None else f"**`{q.name}`**" for q in own)
        place, named = f" for `{other.name}`" if other else "", f" ({named})" if named else ""
        parts.setdefault(law.slot, []).append(f"- {name}{place}: {about}{named}")
    return "\n\n".join("\n".join([f"### {slot}", "", *lines]) for slot, lines in parts.items())


TABLES: dict[str, Callable[[], str]] = {"numerics": numerics, "tuning": tuning, "mechanisms": mechanisms}


def renewed(text: str) -> str:
    """A page with its tables made anew."""
    return re.sub(
        r"(<!-- table: (\w+) -->\n).*?(?=<!-- end of table -->)",
        lambda found: f"{found[1]}{TABLES[found[2]]()}\n",
        text,
        flags=re.S,
    )


def main(argv: Sequence[str] | None = None) -> int:
    check, stale = "--check" in (sys.argv[1:] if argv is None else argv), []
    for page in sorted(HERE.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (new := renewed(text)) != text:
            stale.append(page.name)
            if not check:
                page.write_text(new, encoding="utf-8")
    print(f"{'not as the code has it' if check else 'written'}: {', '.join(stale) or 'no page'}")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
