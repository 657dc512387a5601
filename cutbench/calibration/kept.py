"""Cuts that a fit or a discovery has computed, in a folder: one that was stopped goes on from there.

What a rig does to the record is no part of a run: readings of other rigs are made of the same one.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.base.files import check_writable, replacing, write_text
from cutbench.case.case import Case
from cutbench.run.result import OnStep, Outcome, Result, Snapshot, unwatched
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Added

_COURSE = ("displacement_mm", "force_N", "time_s")
_TOO_LONG = "it takes more than {} steps"
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


@dataclass(frozen=True)
class Ran:
    """What a fit needs of a run: its ``course`` (3, n) of travel in mm, force in N and time in s, how it
    ended, derivatives (n,) of the force by name, and by the strengths of laws that it lacks."""

    course: np.ndarray
    outcome: Outcome
    onset_mm: float
    slopes: Mapping[str, np.ndarray]
    by_added: Sequence[Mapping[str, np.ndarray]]

    @classmethod
    def of(cls, result: Result) -> Ran:
        course = np.stack([result.curve[name] for name in _COURSE])
        onset = result.measures.get("onset_mm", float("nan"))
        return cls(course, result.outcome, onset, result.sensitivities, result.by_added)


def ran(
    case: Case,
    names: Sequence[str],
    added: Sequence[Added],
    folder: Path | None,
    longest: int | None = None,
) -> Ran:
    """The run of ``case`` with derivatives, out of ``folder`` or computed and left there.

    Raises BadInput, and ComputationFailed if it has more than ``longest`` steps."""
    on_step: OnStep = unwatched if longest is None else _Counted(longest)
    if folder is None:
        return Ran.of(run_case(case, sensitivities=names, added=added, on_step=on_step))
    id, keys = _bare(case).id, [_key(each) for each in added]
    if (old := _found(folder, id, names, keys)) is not None:
        return old
    long = folder / f"{id}.long"
    if longest is not None and _number(long) >= longest:
        raise ComputationFailed(_TOO_LONG.format(longest))
    try:
        new = Ran.of(run_case(case, sensitivities=names, added=added, on_step=on_step))
    except ComputationFailed:
        if isinstance(on_step, _Counted) and on_step.left < 0:
            check_writable(folder)
            write_text(str(longest), long)
        raise
    if new.outcome.kind != "interrupted":
        _write(folder, id, keys, new)
    return new


class _Counted:
    """Ends a run after so many steps. Raises ComputationFailed."""

    def __init__(self, longest: int):
        self.left = self.longest = longest

    def __call__(self, row: Mapping[str, float], snapshot: Snapshot | None) -> None:
        self.left -= 1
        if self.left < 0:
            raise ComputationFailed(_TOO_LONG.format(self.longest))


def _number(path: Path) -> int:
    """What a file says; 0 where there is none that says anything."""
    try:
        return int(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return 0


def _bare(case: Case) -> Case:
    """``case`` without its rig."""
    names = {q.name for law in case.model.laws("rig") for q in law.parameters}
    values = {name: value for name, value in case.values.items() if name not in names}
    return replace(case, mechanisms=case.model.unrigged.mechanisms, values=values)


def _key(added: Added) -> str:
    return "-".join([_bare(added.case).id, *sorted(added.names)])


def _found(folder: Path, id: str, names: Sequence[str], keys: Sequence[str]) -> Ran | None:
    """A run with at least these derivatives. One that cannot be read is none."""
    for path in sorted(folder.glob(f"{id}-*.npz")):
        try:
            with np.load(path, allow_pickle=False) as data:
                said = json.loads(str(data["said"]))
                if {*names} <= {*said["names"]} and {*keys} <= {*said["added"]}:
                    added = [_added(data, said["added"].index(key)) for key in keys]
                    slopes = {name: data[f"by_{name}"] for name in names}
                    return Ran(
                        data["course"], Outcome(**said["outcome"]), float(data["onset"]), slopes, added
                    )
        except _UNREADABLE:
            continue
    return None


def _added(data: Mapping[str, np.ndarray], number: int) -> dict[str, np.ndarray]:
    head = f"added{number}_"
    return {name.removeprefix(head): data[name] for name in data if name.startswith(head)}


def _arrays(new: Ran) -> Iterator[tuple[str, np.ndarray]]:
    yield "course", new.course
    yield "onset", np.array(new.onset_mm)
    for name, slope in new.slopes.items():
        yield f"by_{name}", slope
    for i, each in enumerate(new.by_added):
        for name, slope in each.items():
            yield f"added{i}_{name}", slope


def _write(folder: Path, id: str, keys: Sequence[str], new: Ran) -> None:
    said = json.dumps({"names": [*new.slopes], "added": [*keys], "outcome": asdict(new.outcome)})
    digest = hashlib.sha256(said.encode()).hexdigest()[:8]
    with replacing(check_writable(folder) / f"{id}-{digest}.npz") as draft:
        np.savez_compressed(draft, said=np.array(said), **dict[str, Any](_arrays(new)))
