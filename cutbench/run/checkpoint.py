"""A run's state in one file, from which it goes on after it was killed.

The file is an npz archive without pickled objects: arrays, and a JSON text that says where in a tree of
dictionaries and lists each of them stands. It appears whole or not at all.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cutbench.base.files import replacing

#: Layout of the file; one of another layout is not resumed from.
SCHEMA = 7
#: Name of the file in a run's folder.
NAME = "checkpoint.npz"


@dataclass
class Checkpoint:
    """A checkpoint keeps a run's state in the file ``path``, from which the run goes on after it was killed.

    ``key`` says which run it belongs to, by its id, which other code changes: a file of another run, or of
    other code, is ignored, and replaced. It is written every ``every_s`` seconds at the most."""

    path: Path
    key: str
    every_s: float = 60.0
    _latest: dict | None = field(default=None, repr=False)
    _written: float = field(default_factory=time.monotonic, repr=False)

    def load(self) -> dict | None:
        """The tree that was offered last for this run; None where there is none or it cannot be used."""
        try:
            with np.load(self.path, allow_pickle=False) as file:
                head = json.loads(str(file["head"]))
                if head != self._head():
                    return None
                return _unpacked(json.loads(str(file["tree"])), file)
        # A file that is not ours, or was damaged: the run begins anew.
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None

    def offer(self, state: dict) -> None:
        """Offer a tree to keep from now on, of dictionaries, lists, arrays and plain values that do not
        change any more; it is written when it is time to."""
        self._latest = state
        if time.monotonic() - self._written >= self.every_s:
            self.write()

    def write(self) -> None:
        """Write the state that was offered last; a disk that cannot take it does not end the run."""
        if self._latest is None:
            return
        arrays: dict[str, Any] = {}
        tree = _packed(self._latest, arrays)
        arrays |= {"head": np.array(json.dumps(self._head())), "tree": np.array(json.dumps(tree))}
        with contextlib.suppress(OSError), replacing(self.path) as draft, draft.open("wb") as file:
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
        self._written = time.monotonic()

    def remove(self) -> None:
        """Take the file away, since the run has ended."""
        self.path.unlink(missing_ok=True)

    def _head(self) -> dict:
        return {"schema": SCHEMA, "key": self.key}


def _packed(value, arrays: dict[str, np.ndarray]):
    """``value`` as JSON takes it; its arrays go into ``arrays``."""
    if isinstance(value, np.ndarray):
        name = f"a{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, dict):
        return {"dict": [[key, _packed(item, arrays)] for key, item in value.items()]}
    if isinstance(value, (list, tuple)):
        return [_packed(item, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _unpacked(value, arrays):
    if isinstance(value, dict):
        if "array" in value:
            return arrays[value["array"]]
        return {key: _unpacked(item, arrays) for key, item in value["dict"]}
    if isinstance(value, list):
        return [_unpacked(item, arrays) for item in value]
    return value
