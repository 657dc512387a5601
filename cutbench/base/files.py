"""Files that appear whole or not at all, and what JSON can hold."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import tempfile
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout

from cutbench.base.errors import BadInput

#: The file by which a process holds a folder of results; the system lets go of it where one is killed.
LOCK = ".lock"


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """A temporary path beside ``target`` that takes its place when the block ends well.

    A reader, or a kill half way, never meets half a file. The suffix is kept: writers go by it. An OSError,
    such as that of a full disk, names ``target``.
    """
    draft = target.with_name(f".{target.stem}-{os.getpid()}-{threading.get_ident()}{target.suffix}")
    try:
        yield draft
        os.replace(draft, target)
    except OSError as error:
        error.filename = str(target)
        raise
    finally:
        draft.unlink(missing_ok=True)


def file_digest(path: Path) -> str:
    """64 hex digits of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def folder_lock(out_dir: str | Path, wait_s: float = 0.0, key: str = "--out") -> Iterator[Path]:
    """Hold ``out_dir``, made if need be, so that no other process writes its results there meanwhile.

    Raises BadInput (``key``) if it cannot be written to, or another process holds it for longer than
    ``wait_s``. On a file system without locks nothing is held.
    """
    out = check_writable(out_dir)
    lock = FileLock(out.resolve() / LOCK, thread_local=False, is_singleton=True)
    try:
        lock.acquire(timeout=wait_s)
    except Timeout as error:
        expected = "another folder, or to wait: another cutbench is at work in this one"
        raise BadInput(key, str(out_dir), expected) from error
    except (OSError, NotImplementedError):
        pass
    try:
        yield out
    finally:
        if lock.lock_counter == 1:
            with suppress(OSError):
                (out / LOCK).unlink()
        lock.release()


def check_writable(out_dir: str | Path) -> Path:
    """Make ``out_dir`` if need be and try to write in it; raises BadInput (``--out``) if that fails."""
    out = Path(out_dir)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=out, prefix=".try-"):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadInput("--out", str(out_dir), f"a folder that can be written to ({reason})") from error
    return out


def write_text(text: str, path: str | Path) -> Path:
    """Write ``text``, ended by one newline; its path."""
    path = Path(path)
    with replacing(path) as draft:
        draft.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
    return path


def write_json(record: object, path: str | Path) -> Path:
    """Write ``record`` as JSON, with null for what is not finite; its path."""
    return write_text(json.dumps(plain(record), indent=2, ensure_ascii=False, allow_nan=False), path)


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as CSV, a line a row, every digit kept; what is None or not finite is empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: object) -> object:
    if not isinstance(value, float):
        return value
    # float() first: the repr of numpy's own scalars names their type.
    return repr(float(value)) if math.isfinite(value) else None


def markdown_table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> list[str]:
    """The lines of a table in Markdown."""

    def line(cells: Sequence[object]) -> str:
        return (
            "|" + "|".join(f" {c} " if c else " " for c in (str(c).replace("|", "\\|") for c in cells)) + "|"
        )

    return [line(head), "|---" * len(head) + "|", *map(line, rows)]


def picked(one: object, *names: str) -> dict[str, object]:
    """These attributes of ``one`` by name."""
    return {name: getattr(one, name) for name in names}


def plain(value):
    """``value`` for JSON: numpy's numbers as Python's, and null for nan and infinity, which JSON lacks."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (np.generic,)):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def number(value: float | None) -> float:
    """The reverse of ``plain`` for a number."""
    return math.nan if value is None else float(value)
