"""What a user is told of bad input, by what it names and not by how it is worded."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cutbench.base.errors import BadInput, in_short

#: What is not asked for.
ANY = object()
#: The one message of a command: place, key, value, and what would be right.
MESSAGE = re.compile(
    r"(?:cutbench: )?(?:(?P<file>[^:]*?)(?:, line (?P<line>\d+))?: )?(?P<key>.*?) = (?P<value>.*?) "
    r"cannot be used; expected (?P<expected>.*)",
    re.S,
)


def check(found, key, value, line, file, hint) -> None:
    """A key is whole, its last part behind a dot, or all before "in"."""
    name = f".{found.key.removeprefix('--').partition(' in ')[0]}"
    assert key is None or name.endswith(f".{key.removeprefix('--')}"), (
        f"key {found.key!r}, not {key!r}: {found}"
    )
    shown = in_short(found.value)
    assert value is ANY or str(value) in (str(found.value), shown), f"value {shown!r}, not {value!r}: {found}"
    assert line is None or found.line == line, f"line {found.line}, not {line}: {found}"
    assert file is None or Path(found.file or "").name == Path(file).name, f"file {found.file}: {found}"
    assert found.expected.strip() and hint in found.expected, f"{hint!r} is not in: {found.expected}"


@contextmanager
def refused(
    key: str | None = None,
    *,
    value: object = ANY,
    line: int | None = None,
    file: str | Path | None = None,
    hint: str = "",
) -> Iterator[pytest.ExceptionInfo[BadInput]]:
    """The block raises BadInput that names this ``key``, ``value``, ``line`` and ``file``, as far as they are
    given. ``hint``: a name, a number or a unit in what would be right, which is always said."""
    with pytest.raises(BadInput) as caught:
        yield caught
    found = caught.value
    check(found, key, value, line, file, hint)
    assert all(str(part) in str(found) for part in (found.key, in_short(found.value), found.expected))


def refusal(
    done,
    key: str,
    *,
    value: object = ANY,
    line: int | None = None,
    file: str | Path | None = None,
    hint: str = "",
) -> str:
    """A command (a result of ``CliRunner``) that ended with exit code 2, without a traceback and with one
    message that names ``key`` and, where they are given, the rest; that message."""
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    said = done.output.strip()
    assert done.exit_code == 2 and "Traceback" not in said, said
    parts = MESSAGE.fullmatch(said)
    if parts is None:  # of the command line itself
        assert value is ANY and line is None and file is None and key in said and hint in said, said
        return said
    assert len(said.splitlines()) == 1, said
    shown = parts["value"]
    quoted = len(shown) > 1 and shown[0] == shown[-1] == "'"
    found = BadInput(
        parts["key"],
        shown[1:-1] if quoted else shown,
        parts["expected"],
        file=parts["file"],
        line=None if parts["line"] is None else int(parts["line"]),
    )
    check(found, key, value, line, file, hint)
    return said
