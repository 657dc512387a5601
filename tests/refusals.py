"""What a user is told of bad input, by what it names and not by how it is worded."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from cutbench.base.errors import BadInput

#: What is not asked for.
ANY = object()


@contextmanager
def refused(
    key: str | None = None,
    *,
    value: object = ANY,
    line: int | None = None,
    file: str | Path | None = None,
    hint: str = "",
) -> Iterator[pytest.ExceptionInfo[BadInput]]:
    """The block raises BadInput that names this ``key``, ``value``, ``line`` and ``file``, those that are given.

    A key is whole, or the last part of one with dots. ``hint``: a name, a number or a unit that stands in what
    would be right. What is expected is always said, and the message has all parts.
    """
    with pytest.raises(BadInput) as caught:
        yield caught
    found = caught.value
    if key is not None:
        assert f".{found.key}".endswith(f".{key}"), f"key {found.key!r}, not {key!r}: {found}"
    if value is not ANY:
        assert found.value == value or str(found.value) == str(value), f"value {found.value!r}: {found}"
    if line is not None:
        assert found.line == line, f"line {found.line}, not {line}: {found}"
    if file is not None:
        assert found.file is not None and Path(found.file).name == Path(file).name, f"{found}"
    assert found.expected.strip() and hint in found.expected, f"{hint!r} is not in: {found.expected}"
    assert all(str(part) in str(found) for part in (found.key, found.value, found.expected))


def refusal(done, key: str, *, hint: str = "") -> str:
    """A command (a result of ``CliRunner``) that ended with exit code 2 and one message that names ``key``; the
    message."""
    said = " ".join(done.output.split())
    assert done.exit_code == 2, done.output
    assert "Traceback" not in said and isinstance(done.exception, SystemExit | type(None)), said
    assert re.search(rf"(?<![\w]){re.escape(key)}(?![\w])", said), f"{key!r} is not in: {said}"
    assert hint in said, f"{hint!r} is not in: {said}"
    return said
