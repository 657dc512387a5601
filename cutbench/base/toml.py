"""What every TOML reader of cutbench needs: the table, the line of a key, the name that was meant."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from cutbench.base.errors import BadInput

#: Of more names than this the nearest are shown, so many.
MANY, NEAREST = 20, 5
#: How a path of Windows is written.
BACKSLASHES = "a path stands in single quotes, as in 'C:\\data\\gel.csv', or has / for each \\"


def path_hint(name: str) -> str:
    """What to add to a message on a path in which a backslash made a sign of its own."""
    return "" if name.isprintable() else f"; {BACKSLASHES}"


def read_toml(path: str | Path) -> tuple[dict, str]:
    """Read a TOML file into a dictionary, and keep its text for messages that name lines.

    Parameters
    ----------
    path : str or Path
        The file, saved as UTF-8.

    Returns
    -------
    dict
        The table in the file.
    str
        Its text.

    Raises
    ------
    BadInput
        If there is no such file, it cannot be read, or it is not TOML; with the line where that is known.
    """
    path = Path(path)
    name = str(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise BadInput("file", name, "a TOML file that exists" + path_hint(name)) from error
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        raise BadInput(
            "text", "bytes that are not UTF-8", "TOML, saved as UTF-8", file=name, line=line
        ) from error
    except OSError as error:
        raise BadInput("file", name, f"a TOML file that can be read ({error.strerror})") from error
    try:
        return tomllib.loads(text), text
    except tomllib.TOMLDecodeError as error:
        lines = text.splitlines() or [""]
        at = re.search(r"at line (\d+)", str(error))
        line = int(at[1]) if at else len(lines)
        shown = lines[min(line, len(lines)) - 1].strip()
        reason = re.sub(r"\s*\(at [^)]*\)", "", str(error)).rstrip(".")
        if "\\" in shown:
            reason += f"; {BACKSLASHES}"
        raise BadInput(
            "TOML", shown, f"readable TOML, such as 'G = \"7.5 kPa\"' ({reason})", file=name, line=line
        ) from error


#: What a TOML file is, by a section that no other has, and what takes it.
_SORTS = {
    "experiment": ("a campaign of tests, with [[experiment]]", "cutbench data, fit and discover"),
    "axis": ("a study, with [[axis]]", "cutbench sweep"),
    "change": ("a study of convergence, with [[change]]", "cutbench converge"),
    "case": ("a material or a case", "cutbench run2d and guide, and base and material in other files"),
}


def refuse_other(table: Mapping[str, object], path: str | Path, wanted: str) -> None:
    """Raise BadInput where the ``table`` in a file is not ``wanted``, a key of ``_SORTS``, but another."""
    sections = {key for key, part in table.items() if isinstance(part, dict)}
    of_a_case = bool(sections & {"material", "specimen", "blade", "protocol"})
    there = [sort for sort in _SORTS if sort in table or (sort == "case" and of_a_case)]
    if there and wanted not in there:
        (sought, _), (found, takes) = _SORTS[wanted], _SORTS[there[0]]
        raise BadInput("file", str(path), f"{sought}; this is {found}, for {takes}")


def in_short(raw: object) -> str:
    """What a person wrote, in a message about its key: of a section its keys; nothing is missing."""
    if raw is None:
        return "(missing)"
    if isinstance(raw, dict):
        return f"a section with {', '.join(map(str, raw))}"[:60]
    return (
        "a list of sections" if isinstance(raw, list) and raw and isinstance(raw[0], dict) else str(raw)[:60]
    )


def line_of(text: str, key: str, section: str | None = None) -> int | None:
    """Line number of ``key`` (below ``[section]`` if given), or of ``[key]``; None if it is not there."""
    name = rf"[\"']?{re.escape(key)}[\"']?"
    assigns = re.compile(rf"\s*{name}\s*(=|\.)")
    opens = re.compile(rf"\s*\[\[?\s*{name}\s*\]")
    here, elsewhere = None, None
    for number, line in enumerate(text.splitlines(), start=1):
        head = re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]", line)
        if head:
            here = head[1]
        if opens.match(line) or assigns.match(line):
            if section is None or here == section:
                return number
            elsewhere = elsewhere or number
    return elsewhere


def nearest(name: str, known: Iterable[str], likeness: float = 0.5) -> str | None:
    """The known name closest to ``name``, or None if none is as close as ``likeness``, of 1."""
    known = list(known)
    lower = {k.lower(): k for k in reversed(known)}
    close = difflib.get_close_matches(name.lower(), list(lower), n=1, cutoff=likeness)
    return lower[close[0]] if close else None


def one_of(name: str, known: Iterable[str]) -> str:
    """``"one of a, b, c; did you mean 'b'?"``: the text of what was expected; of many, the nearest."""
    known = list(known)
    guess = nearest(name, known)
    shown = known if len(known) <= MANY else difflib.get_close_matches(name, known, NEAREST, 0.0)
    more = f" and {len(known) - len(shown)} others" if len(shown) < len(known) else ""
    return f"one of {', '.join(shown)}{more}" + (f"; did you mean '{guess}'?" if guess else "")


def among(key: str, name: object, known: Iterable[object], *, value: object = None) -> None:
    """Raise BadInput unless ``name`` is one of the ``known``; ``value`` is shown where that is another."""
    names = list(known)
    if name not in names:
        raise BadInput(key, name if value is None else value, one_of(str(name), map(str, names)))


def written(key: str, raw: object, expected: str, *, value: object = None) -> str:
    """``raw`` if it is a text with something in it. Raises BadInput."""
    if not isinstance(raw, str) or not raw.strip():
        raise BadInput(key, raw if value is None else value, expected)
    return raw


@contextmanager
def located(
    file: str | Path,
    text: str,
    section: str | None = None,
    *,
    find: Callable[[str], int | None] | None = None,
) -> Iterator[None]:
    """Errors raised inside without a file get this one, and the line of their key where it is written.

    ``find`` gives the line of a key where ``line_of`` would not know which of several is meant.
    """
    try:
        yield
    except BadInput as error:
        if error.file is not None:
            raise
        raise BadInput(
            error.key,
            error.value,
            error.expected,
            file=str(file),
            line=find(error.key) if find else line_of(text, error.key, section),
        ) from error
