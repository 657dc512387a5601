"""A list of a store's runs in one SQLite file, so that thousands are listed without opening each.

The folders of the runs are the truth, this only a copy of their heads: it is brought up to date when
it is read, and made again when it is missing, damaged, or of another layout. Several processes may
write at once; one that cannot leaves it to the next reader.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

NAME = "index.sqlite"
#: Layout of the table; another one is thrown away and made again.
_LAYOUT = 2
_WAIT_S = 30.0

Head = dict[str, Any]


class Index:
    """Heads of runs by id. A head is plain data (JSON); its ``name``, ``outcome`` and ``written`` are
    columns of their own, for whoever looks with another tool."""

    def __init__(self, root: Path):
        self.path = root / NAME

    def add(self, id: str, stamp: int, head: Mapping[str, object]) -> None:
        """Note a run; ``stamp`` tells this writing of it from others. Never fails: see ``refresh``."""
        with contextlib.suppress(sqlite3.Error, OSError), self._open() as db:
            _insert(db, [(id, stamp, head)])

    def remove(self, id: str) -> None:
        """Forget a run."""
        with contextlib.suppress(sqlite3.Error, OSError), self._open() as db:
            db.execute("DELETE FROM runs WHERE id = ?", (id,))

    def refresh(
        self, there: Mapping[str, int], read: Callable[[str], Mapping[str, object] | None]
    ) -> dict[str, Head]:
        """Heads of the runs that are ``there`` (id -> stamp), in their order.

        What is not listed, or with another stamp, is ``read`` (None: cannot be) and listed from now on.
        """
        known: dict[str, tuple[int, Head]] = {}
        try:
            with self._open() as db:
                known = {id: (stamp, json.loads(head)) for id, stamp, head in
                         db.execute("SELECT id, stamp, head FROM runs")}  # fmt: skip
        except (sqlite3.OperationalError, OSError):
            pass  # another process holds it, or it cannot be written here: the folders are read instead
        except (sqlite3.Error, ValueError):
            with contextlib.suppress(OSError):
                self.path.unlink()  # damaged, and only a copy: made again below
        found, new = {}, []
        for id, stamp in there.items():
            if id in known and known[id][0] == stamp:
                found[id] = known[id][1]
            elif (head := read(id)) is not None:
                found[id] = dict(head)
                new.append((id, stamp, head))
        gone = [(id,) for id in known if id not in there]
        if new or gone:
            with contextlib.suppress(sqlite3.Error, OSError), self._open() as db:
                _insert(db, new)
                db.executemany("DELETE FROM runs WHERE id = ?", gone)
        return found

    @contextlib.contextmanager
    def _open(self):
        db = sqlite3.connect(self.path, timeout=_WAIT_S)
        try:
            db.execute("PRAGMA synchronous = OFF")  # after a power cut it is made again
            with db:  # one transaction
                layout = db.execute("PRAGMA user_version").fetchone()[0]
                if layout != _LAYOUT:
                    db.execute("DROP TABLE IF EXISTS runs")
                    db.execute(f"PRAGMA user_version = {_LAYOUT}")
                db.execute(
                    "CREATE TABLE IF NOT EXISTS runs (id TEXT PRIMARY KEY, stamp INTEGER, name TEXT,"
                    " outcome TEXT, written REAL, head TEXT)"
                )
                yield db
        finally:
            db.close()


def _insert(db: sqlite3.Connection, rows: list[tuple[str, int, Mapping[str, object]]]) -> None:
    db.executemany(
        "INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?)",
        [
            (id, stamp, head.get("name"), head.get("outcome"), head.get("written"), json.dumps(head))
            for id, stamp, head in rows
        ],
    )
