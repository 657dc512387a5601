"""What every TOML reader of cutbench needs: the table, the line of a key, the name that was meant."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cutbench.base.errors import BadInput

#: Of more names than this the nearest are shown, so many.
MANY, NEAREST = 24, 5
#: How a path of Windows is written.
BACKSLASHES = "a path stands in single quotes, as in 'C:\\data\\gel.csv', or has / for each \\"
#: What opens a section, and what a line begins with that is no continuation of the one before.
_HEAD = re.compile(r"\s*\[\[?\s*([^\]]+?)\s*\]")
_STATEMENT = re.compile(r"\s*([\w\"'.-]+\s*=|\[)")


def path_hint(name: str) -> str:
    """What to add to a message on a path in which a backslash made a sign of its own."""
    return "" if name.isprintable() else f"; {BACKSLASHES}"


@dataclass(frozen=True)
class TomlFile:
    """A file as it was read: its table, and its text, in which errors are placed."""

    path: Path
    table: dict[str, Any]
    text: str

    @contextmanager
    def at(
        self, section: str | Mapping[str, str] = "", number: int | None = None, name: str = ""
    ) -> Iterator[None]:
        """Errors raised inside without a file get this one, and the line of their key where it is written.

        That is in ``section``, or the one that it has for the key; of several of this name in the one with
        this ``number``, from 0. ``name`` stands before the key in the message.
        """
        try:
            yield
        except BadInput as error:
            if error.file is not None:
                raise
            place = section if isinstance(section, str) else section.get(error.key, "")
            line = line_of(self.text, error.key, place, number)
            key, file = name + error.key, str(self.path)
            raise BadInput(key, error.value, error.expected, file=file, line=line) from error

    def beside(self, source: str) -> Path | str:
        """The file ``source`` as seen from this one, or where there is none the name as it is."""
        near = self.path.parent / source
        return near if near.is_file() else source


def read_toml(path: str | Path, wanted: str = "") -> TomlFile:
    """Read a TOML file, and keep its text for messages that name lines. Raises BadInput."""
    path, name = Path(path), str(path)
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
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line = _broken_line(text, str(error))
        shown = [*text.splitlines(), ""][line - 1].strip()
        reason = re.sub(r"\s*\(at [^)]*\)", "", str(error)).rstrip(".")
        if "\\" in shown:
            reason += f"; {BACKSLASHES}"
        raise BadInput(
            "TOML", shown, f"readable TOML, such as 'G = \"7.5 kPa\"' ({reason})", file=name, line=line
        ) from error
    if wanted:
        _refuse_other(table, name, wanted)
    return TomlFile(path, table, text)


def _broken_line(text: str, message: str) -> int:
    """The line of an error of ``tomllib``; where a list or a string was left open that in which it begins."""
    lines = text.splitlines() or [""]
    at = re.search(r"at line (\d+)", message)
    line = min(int(at[1]), len(lines)) if at else len(lines)
    for n in range(line - 1, 0, -1):
        try:
            tomllib.loads("\n".join(lines[:n]))
        except tomllib.TOMLDecodeError:
            continue
        # Line n + 1 begins what cannot be read; a new statement below it was none of its lines.
        if _STATEMENT.match(lines[line - 1]):
            return next(k for k in range(n, line) if lines[k].split("#")[0].strip()) + 1
        break
    return line


#: What a TOML file is, by a section that no other has, and what takes it.
_SORTS = {
    "experiment": ("a campaign of tests, with [[experiment]]", "cutbench data, fit and discover"),
    "axis": ("a study, with [[axis]]", "cutbench sweep"),
    "change": ("a study of convergence, with [[change]]", "cutbench converge"),
    "case": ("a material or a case", "cutbench run2d and guide, and base and material in other files"),
}


def _refuse_other(table: Mapping[str, object], name: str, wanted: str) -> None:
    """Raise BadInput where the ``table`` in a file is not ``wanted``, a key of ``_SORTS``, but another."""
    sections = {key for key, part in table.items() if isinstance(part, dict)}
    of_a_case = bool(sections & {"material", "specimen", "blade", "protocol"})
    sorts = [sort for sort in _SORTS if sort in table or (sort == "case" and of_a_case)]
    if sorts and wanted not in sorts:
        (sought, _), (written, takes) = _SORTS[wanted], _SORTS[sorts[0]]
        raise BadInput("file", name, f"{sought}; this is {written}, for {takes}")


def line_of(text: str, key: str, section: str = "", number: int | None = None) -> int | None:
    """Line in which ``key`` is set or opened: in ``[section]`` if that has it, else wherever it is first.

    Dots in ``key`` lead into sections and tables. Of several sections of one name ``number``, from 0, says
    which is meant; a key that is not in it has the line of its head. None if it is nowhere.
    """
    lines = [line.split("#")[0] for line in text.splitlines()]
    heads = [(i, head[1]) for i, line in enumerate(lines) if (head := _HEAD.match(line))]
    own = [i for i, name in heads if name == section][number or 0 :]
    line = None
    if own:
        # Sections below it are its own, as [experiment.specimen] is of [[experiment]].
        after = (i for i, name in heads if i > own[0] and not name.startswith(f"{section}."))
        line = _place(lines, key, own[0] + 1, next(after, len(lines)))
    if line is None and number is None:
        line = _place(lines, key, 0, len(lines))
    if line is None and number is not None and own:
        line = own[0]
    return None if line is None else line + 1


def _place(lines: list[str], key: str, begin: int, end: int) -> int | None:
    """The place among ``lines`` of ``key``, or of as much of it as is between ``begin`` and ``end``."""
    place = None
    for word in key.split("."):
        name = rf"[\"']?{re.escape(word)}[\"']?\s*"
        # A head or a statement of its own, else within a line.
        ways = rf"\s*\[\[?\s*([^\]]+\.)?{name}\]|\s*{name}[=.]", rf".*[{{,.]\s*{name}[=.]"
        inner = next((i for way in ways for i in range(begin, end) if re.match(way, lines[i])), None)
        if inner is None:
            break
        place, begin, end = inner, inner, end if _HEAD.match(lines[inner]) else inner + 1
    return place


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


def written(key: str, raw: object, expected: str) -> str:
    """``raw`` if it is a text with something in it. Raises BadInput."""
    if not isinstance(raw, str) or not raw.strip():
        raise BadInput(key, raw, expected)
    return raw
