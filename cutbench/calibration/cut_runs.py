"""Cuts that a fit or a search computes, in the store of runs, and the emulator's database that they make.

A search that was stopped goes on from its store, and so does a fit; the runs of a sweep in the same store
count as well. What a rig does to the record is no part of a run.
"""

from __future__ import annotations

import hashlib
import json
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.files import replacing
from cutbench.base.progress import ALWAYS
from cutbench.calibration.settings import SETTINGS
from cutbench.case.case import Case
from cutbench.data.experiment import Experiment
from cutbench.data.field_comparison import at_travel, sample, sampled_slopes
from cutbench.emulator import RunDatabase
from cutbench.run.pool.pool import Job, TaskPool
from cutbench.run.result import Outcome, Result
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Added
from cutbench.run.store.runs import Store

COURSE = ("displacement_mm", "force_N", "time_s")
Derivatives = tuple[Mapping[str, np.ndarray], Sequence[Mapping[str, np.ndarray]]]


@dataclass(frozen=True)
class ComputedCut:
    """What a fit needs of a run.

    Attributes
    ----------
    course : ndarray, shape (3, n)
        Travel in mm, force in N and time in s.
    outcome : Outcome
        How it ended.
    onset_mm : float
        Where the cut begins; nan where it does not.
    slopes : mapping
        By name, derivatives (n,) of the force, internal units.
    by_added : sequence of mapping
        The same by the strengths of laws that the run lacks.
    fields, field_slopes : ndarray, shape (f,), (f, k)
        Displacements in mm at the places of measured fields, and their derivatives by ``slopes``' names.
    effort : int
        Linear systems that were factorised.
    """

    course: np.ndarray
    outcome: Outcome
    onset_mm: float
    slopes: Mapping[str, np.ndarray] = field(default_factory=dict)
    by_added: Sequence[Mapping[str, np.ndarray]] = ()
    fields: np.ndarray = field(default_factory=lambda: np.zeros(0))
    field_slopes: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    effort: int = 0

    @classmethod
    def of(cls, result: Result) -> ComputedCut:
        """Of a run, without fields."""
        return cls(
            np.stack([result.curve[name] for name in COURSE]),
            result.outcome,
            result.measures.get("onset_mm", math.nan),
            result.sensitivities,
            result.by_added,
            effort=result.counts.get("factorization_calls", 0),
        )


def without_rig(case: Case) -> Case:
    """``case`` without its rig: what the specimen and the blade do is the same."""
    rig = {q.name for law in case.model.laws("rig") for q in law.parameters}
    if not rig:
        return case
    values = {name: value for name, value in case.values.items() if name not in rig}
    return replace(case, mechanisms=case.model.unrigged.mechanisms, values=values)


def compute_cut(
    case: Case, names: Sequence[str], added: Sequence[Added], folder: Path | None, effort: float = math.inf
) -> ComputedCut:
    """The run of ``case`` with derivatives, out of the store in ``folder`` or computed, with this ``effort``
    at the most, and left there. Raises BadInput, ComputationFailed."""
    store = None if folder is None else Store(folder)
    keys = [*names, *(_key_of_added(each) for each in added)]
    if store is not None and (old := store.get(case.id)) is not None:
        if not keys:
            return ComputedCut.of(old)
        if (known := _derivatives(store.path(case.id), names, added)) is not None:
            return replace(ComputedCut.of(old), slopes=known[0], by_added=known[1])
    result = run_case(case, sensitivities=names, added=added, effort=effort)
    if store is not None and store.put(result, replace=bool(keys)) and keys:
        _store_derivatives(store.path(case.id), result, added)
    return ComputedCut.of(result)


def _key_of_added(added: Added) -> str:
    return "-".join([without_rig(added.case).id, *sorted(added.names)])


def _derivatives(home: Path, names: Sequence[str], added: Sequence[Added]) -> Derivatives | None:
    """Those that lie in an entry of the store, where they have all that is asked for."""
    for path in sorted(home.glob("derivatives-*.npz")):
        unreadable = suppress(OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)
        with unreadable, np.load(path, allow_pickle=False) as data:
            return {name: data[f"by {name}"] for name in names}, [
                {name: data[f"{_key_of_added(each)} by {name}"] for name in each.names} for each in added
            ]
    return None


def _store_derivatives(home: Path, result: Result, added: Sequence[Added]) -> None:
    arrays = {f"by {name}": values for name, values in result.sensitivities.items()}
    for each, by in zip(added, result.by_added, strict=True):
        arrays |= {f"{_key_of_added(each)} by {name}": values for name, values in by.items()}
    digest = hashlib.sha256(json.dumps(sorted(arrays)).encode()).hexdigest()[:8]
    with replacing(home / f"derivatives-{digest}.npz") as draft:
        np.savez_compressed(draft, **arrays)  # type: ignore[arg-type]


def compute_fields(case: Case, names: Sequence[str], e: Experiment) -> ComputedCut:
    """The run of ``case`` with the displacement fields of a test, and their derivatives by ``names``.

    Pictures are not stored. One step before each field is kept too: between the two, displacements are
    interpolated. Raises BadInput, ComputationFailed.
    """
    wanted = sorted({max(f.travel_mm - back, 0.0) for f in e.fields for back in (case.sizes.step_mm, 0.0)})
    result = run_case(case, sensitivities=names, snapshots_mm=wanted)
    u, by = [], []
    for measured in e.fields:
        u.append(np.full(measured.u.size, np.nan))
        by.append(np.zeros((measured.u.size, len(names))))
        if (picture := at_travel(result.snapshots, measured.travel_mm)) is not None:
            u[-1][:] = sample(picture, measured).u.ravel()
            by[-1][:] = sampled_slopes(picture, measured, names).reshape(measured.u.size, -1)
    return replace(ComputedCut.of(result), fields=np.concatenate(u), field_slopes=np.concatenate(by))


Compute = Callable[[Case, Sequence[str], Sequence[Added], Path | None, float], ComputedCut]


class CutRuns:
    """Computes cuts on a pool's processes, and remembers them.

    Parameters
    ----------
    pool : TaskPool
        Where they are computed.
    folder : Path, optional
        The store of runs: what is there is not computed again.
    check : callable
        Called now and then; may raise KeyboardInterrupt.
    compute : callable
        Computes a cut as ``compute_cut`` does.

    Attributes
    ----------
    database : RunDatabase
        All that were computed to their depth.
    count : int
        How many cuts were asked for that were not known.
    failed : dict
        By id of the case, why it was not computed to its depth.
    """

    def __init__(
        self,
        pool: TaskPool,
        folder: Path | None = None,
        check: Callable[[], None] = ALWAYS,
        compute: Compute = compute_cut,
    ):
        self.database, self.count, self.failed = RunDatabase(), 0, dict[str, str]()
        self._pool, self._folder, self.check, self._compute = pool, folder, check, compute
        self._known: dict[str, tuple[tuple[str, ...], ComputedCut]] = {}
        self.on_run: Callable[[], None] = lambda: None
        if folder is not None and folder.is_dir():
            for result in Store(folder):
                # Another version's run is of another computation, and has another id.
                if result.outcome.done and result.case.id == result.id:
                    self._take(result.case, ComputedCut.of(result))

    def known(self, case: Case) -> ComputedCut | None:
        """The run of ``case``; None where it was not computed."""
        return self._known[case.id][1] if case.id in self._known else None

    def __call__(
        self, cases: Sequence[Case], names: Sequence[str] = (), added: Sequence[Added] = ()
    ) -> list[ComputedCut | None]:
        """Compute cuts. Raises KeyboardInterrupt."""
        keys, wanted = tuple(_key_of_added(each) for each in added), dict[str, Case]()
        for case in cases:
            known = self._known.get(case.id)
            if known is None or not ({*names} <= {*known[1].slopes} and keys == known[0][: len(keys)]):
                wanted.setdefault(case.id, case)
        self._run(
            wanted, [Job(id, self._compute, (case, tuple(names), tuple(added), self._folder, self._effort()))
                     for id, case in wanted.items() if id not in self.failed], keys,
        )  # fmt: skip
        return [self.known(case) for case in cases]

    def with_fields(self, case: Case, names: Sequence[str], e: Experiment) -> ComputedCut | None:
        """The run of a test whose displacement fields were measured, with these."""
        known = self.known(case)
        if known is None or not known.fields.size or not {*names} <= {*known.slopes}:
            self._run({case.id: case}, [Job(case.id, compute_fields, (case, tuple(names), e))], ())
        return self.known(case)

    def _effort(self) -> float:
        """What a run may take: one that takes many times as much as others holds up more than it tells."""
        efforts = [run.effort for *_, run in self._known.values() if run.effort]
        return SETTINGS.hopeless * float(np.median(efforts)) if len(efforts) >= SETTINGS.first else math.inf

    def _run(self, wanted: Mapping[str, Case], jobs: Sequence[Job], keys: tuple[str, ...]) -> None:
        done = {}
        for each in self._pool.run(iter(jobs), self.check):
            done[each.key], self.count = each, self.count + 1
            self.on_run()
        # In their own order, whichever ended first: what is said from them is then the same every time.
        for job in jobs:
            try:
                found = done[job.key].result()
                if found.outcome.kind == "interrupted":
                    raise KeyboardInterrupt
                if not found.outcome.done:
                    raise ComputationFailed(str(found.outcome))
            except (ComputationFailed, BadInput) as error:
                self.failed[str(job.key)] = str(error)
            else:
                self._take(wanted[str(job.key)], found, keys)

    def _take(self, case: Case, found: ComputedCut, keys: tuple[str, ...] = ()) -> None:
        if case.id not in self._known:
            self.database.add(case, found.course, found.onset_mm)
        self._known[case.id] = keys, found
