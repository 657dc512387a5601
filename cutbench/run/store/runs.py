"""Finished runs on disk, under their ids: what is there is never computed again.

The computation is part of an id (``cutbench.case.computation``): a run of other code is not found, and stays
listed with the version that wrote it. ``ROOT/<id[:2]>/<id>/`` holds ``run.json`` (inputs, outcome, measures,
cost, computation, versions) and ``curve.npz``. An entry appears whole or not at all (it is written beside and
renamed), so several processes may share a store, and one that is killed leaves nothing that looks finished.
"""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import shutil
import tempfile
import time
import uuid
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.files import number, plain
from cutbench.base.versions import written_by
from cutbench.case.case import Case
from cutbench.case.computation import own_sources
from cutbench.run.result import Outcome, Result

#: Layout of run.json; raised when a reader of the old one would misread the new one.
SCHEMA = 1

#: What there is to say of a run without its curve: plain data.
Head = dict[str, Any]

#: A half-written entry older than this belongs to a process that died.
_STALE_S = 3600.0

_UNREADABLE = (
    OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile, BadInput,
)  # fmt: skip


class Store:
    """A store keeps runs in the folder ``root`` by their ids.

    Only runs that ended by themselves are kept: an interrupted one has no result. Raises BadInput if the
    folder cannot be written."""

    def __init__(self, root: str | os.PathLike[str]):
        self.root = Path(root)
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.root):
                pass
        except OSError as error:
            expected = f"a folder that can be written ({error.strerror})"
            raise BadInput(key="store", value=str(self.root), expected=expected) from error
        self._sweep_up()

    def path(self, id: str) -> Path:
        """The folder of a run, there or not."""
        return self.root / id[:2] / id

    def __contains__(self, id: str) -> bool:
        """Whether a whole, readable entry is there."""
        return self.get(id) is not None

    def get(self, id: str) -> Result | None:
        """A run without its snapshots; None where there is none, or only one that cannot be read."""
        try:
            return self.read(id)
        except _UNREADABLE:
            return None

    def read(self, id: str) -> Result:
        """Read a run that must be there, without its snapshots; where it may be missing, ``get`` returns
        None.

        Raises BadInput where its case is none of this cutbench, with the version that wrote it; OSError,
        ValueError or KeyError where it is not there or damaged."""
        home = self.path(id)
        return result_of(self._record(home), home / "run.json", _read_curve(home / "curve.npz"))

    def put(self, result: Result, *, replace: bool = False) -> bool:
        """Keep a run, unless it was interrupted; whether it was written.

        A damaged entry is replaced, a whole one with ``replace`` alone."""
        if result.outcome.kind == "interrupted":
            return False
        id = result.id
        home = self.path(id)
        home.parent.mkdir(parents=True, exist_ok=True)
        fresh = self._folder(".new-")
        try:
            with (fresh / "run.json").open("w", encoding="utf-8") as file:
                json.dump(record_of(result), file, indent=1)
            keep_laws(result, fresh)
            with (fresh / "curve.npz").open("wb") as file:
                np.savez(file, **dict[str, Any](result.curve))
            for path in filter(Path.is_file, fresh.rglob("*")):
                with path.open("rb") as file:
                    os.fsync(file.fileno())
            while True:
                try:
                    os.rename(fresh, home)
                    break
                except OSError:
                    if not home.exists():
                        raise
                if not replace and id in self:
                    return False
                self._discard(home)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
        return True

    def remove(self, id: str) -> None:
        """Forget a run, so that it is computed again."""
        if self.path(id).exists():
            self._discard(self.path(id))

    def heads(self) -> dict[str, Head]:
        """What there is to say of each run without its curve, by id: name, outcome, message, reached_mm,
        dim, mechanisms, values (with unit), numerics, measures, seconds, counts, computation, versions,
        written (seconds since 1970).

        Damaged entries are left out: see ``unreadable``."""
        found = {}
        for folder in self._folders():
            with contextlib.suppress(*_UNREADABLE):
                found[folder.name] = self._head(folder)
        return found

    def unreadable(self) -> dict[str, str]:
        """The entries that cannot be used: the reason by id."""
        found = {}
        for folder in self._folders():
            try:
                self._head(folder)
            except BadInput as error:
                found[folder.name] = str(error)
            except (OSError, ValueError) as error:
                reason = f"damaged ({type(error).__name__}): remove its folder, or let a sweep write it again"
                found[folder.name] = reason
            except _UNREADABLE:
                found[folder.name] = "its inputs cannot be read"
        return found

    def mark(self) -> str:
        """The name of a file in the store that is in no other: who finds it sees this very folder."""
        for path in sorted(self.root.glob(".mark-*")):
            return path.name
        path = self.root / f".mark-{uuid.uuid4().hex}"
        path.touch()
        return path.name

    def __iter__(self) -> Iterator[Result]:
        """All readable runs, in the order of their ids."""
        for folder in self._folders():
            if (result := self.get(folder.name)) is not None:
                yield result

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _folders(self) -> list[Path]:
        """Those of all entries, readable or not, in the order of their ids."""
        return sorted(self.root.glob("??/*"))

    def _head(self, home: Path) -> Head:
        record = self._record(home)
        case, outcome = record["case"], record["outcome"]
        return {
            **{key: case[key] for key in ("name", "dim", "mechanisms", "numerics")},
            **{key: outcome[key] for key in ("message", "reached_mm")},
            **{key: record[key] for key in ("measures", "counts", "versions")},
            "outcome": outcome["kind"],
            "values": {key: [v["value"], v["unit"]] for key, v in case["values"].items()},
            "seconds": record["timings_s"].get("total"),
            "computation": record.get("computation", ""),
            "written": (home / "run.json").stat().st_mtime,
        }

    def _record(self, home: Path) -> dict[str, Any]:
        record = json.loads((home / "run.json").read_text(encoding="utf-8"))
        if (found := record.get("schema")) != SCHEMA:
            raise BadInput("schema", found, f"{SCHEMA}; {writer(record)} wrote this run and can read it")
        if record["id"] != home.name:
            raise ValueError(f"{home} holds the run {record['id']}")
        return record

    def _discard(self, home: Path) -> None:
        """Take a folder away in one move, whatever it holds; another process may have been faster."""
        grave = self._folder(".old-")
        try:
            os.rename(home, grave / home.name)
        except FileNotFoundError:
            pass
        finally:
            shutil.rmtree(grave, ignore_errors=True)

    def _folder(self, prefix: str) -> Path:
        # Not mkdtemp: an entry keeps this folder's mode, and a shared store must stay readable.
        folder = self.root / f"{prefix}{uuid.uuid4().hex}"
        folder.mkdir()
        return folder

    def _sweep_up(self) -> None:
        for pattern in (".new-*", ".old-*"):
            for folder in self.root.glob(pattern):
                try:
                    stale = time.time() - folder.stat().st_mtime > _STALE_S
                except OSError:
                    continue
                if stale:
                    shutil.rmtree(folder, ignore_errors=True)


def keep_laws(result: Result, folder: Path) -> None:
    """Copies of the files of a user's own laws in the run's ``folder``, where another computer finds them."""
    for _, files in own_sources(result.case.model).values():
        for place, path in files.items():
            copy = folder / place
            copy.parent.mkdir(exist_ok=True)
            if not copy.exists():  # it has its content in its name
                shutil.copyfile(path, copy)


def record_of(result: Result) -> dict[str, Any]:
    """What run.json has of a run: inputs with units, outcome, measures, cost, computation and versions."""
    return {
        "schema": SCHEMA,
        "id": result.id,
        "computation": result.computation,
        "laws": {
            name: {"digest": digest, "files": list(files)}
            for name, (digest, files) in own_sources(result.case.model).items()
        },
        "name": result.case.name,
        "case": result.case.to_dict(),
        "outcome": plain(asdict(result.outcome)),
        "measures": plain(result.measures),
        "counts": plain(result.counts),
        "timings_s": plain(result.timings),
        "versions": result.versions,
    }


def result_of(record: Mapping[str, Any], file: Path, curve: dict[str, np.ndarray]) -> Result:
    """The run that a ``record`` in ``file`` describes. Raises BadInput, which names the version that wrote
    it, where its case is none of this cutbench."""
    try:
        case = Case.from_dict(record["case"])
    except BadInput as error:
        expected = f"{error.expected}; {writer(record)} wrote this run and can read it"
        if own := record.get("laws", {}).get(str(error.value)):
            # A user's code is executed where the user asks for it, and nowhere else.
            places = dict.fromkeys(str(file.parent / place) for place in map(os.path.dirname, own["files"]))
            asked = " ".join(f"--mechanisms {shlex.quote(place)}" for place in places)
            expected = f"a law that is known; its source is kept with the run and read with {asked}"
        raise BadInput(file=str(file), key=error.key, value=error.value, expected=expected) from error
    return Result(
        case=case,
        curve=curve,
        outcome=Outcome(**{**record["outcome"], "reached_mm": number(record["outcome"]["reached_mm"])}),
        timings={key: number(value) for key, value in record["timings_s"].items()},
        counts=record["counts"],
        measures={key: number(value) for key, value in record["measures"].items()},
        id=record["id"],
        computation=record.get("computation", ""),
        versions=record["versions"],
    )


def writer(record: Mapping[str, Any]) -> str:
    """What wrote a record or a head, in words."""
    return written_by((record.get("versions") or {}).get("cutbench"), record.get("computation"))


def _read_curve(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as file:
        curve = {name: file[name] for name in file.files}
    if len({column.shape for column in curve.values()}) != 1:
        raise ValueError(f"{path}: the columns have different lengths")
    return curve
