"""Cuts that are computed for a fit or a search, and the database of the emulator that they make."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import ALWAYS
from cutbench.calibration.kept import Ran, ran
from cutbench.case.case import Case
from cutbench.emulator import RunDatabase
from cutbench.run.pool.job import Job
from cutbench.run.pool.pool import TaskPool
from cutbench.run.sensitivity import Added

Compute = Callable[..., Ran]


class CutRuns:
    """Computes cuts on a pool's processes and remembers them.

    Parameters
    ----------
    pool : TaskPool
        Where they are computed.
    folder : Path, optional
        What was computed before lies there, and what is computed now is left there.
    check : callable
        Called now and then; may raise KeyboardInterrupt.
    compute : callable
        Computes a cut as ``cutbench.calibration.kept.ran`` does.

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
        compute: Compute = ran,
    ):
        self.database, self.count, self.failed = RunDatabase(), 0, dict[str, str]()
        self._pool, self._folder, self._check, self._compute = pool, folder, check, compute
        self._known: dict[str, tuple[tuple[str, ...], tuple[Added, ...], Ran]] = {}

    def __call__(
        self, cases: Sequence[Case], names: Sequence[str] = (), added: Sequence[Added] = ()
    ) -> list[Ran | None]:
        """Compute cuts.

        Parameters
        ----------
        cases : sequence of Case
            Each to the depth of its test, without a rig's laws.
        names : sequence of str
            Parameters that forces are differentiated by.
        added : sequence of Added
            Laws whose strengths they are differentiated by, at off.

        Returns
        -------
        list
            In the order of the cases; None for one that falls short, whose reason is in ``failed``.
        """
        jobs, wanted = [], {}
        for case in cases:
            known = self._known.get(case.id)
            if known is None or not ({*names} <= {*known[0]} and len(added) <= len(known[1])):
                wanted.setdefault(case.id, case)
        asked = tuple(names), tuple(added)
        jobs = [Job(id, _computed, (case, *asked, self._folder, self._compute)) for id, case in wanted.items()
                if id not in self.failed]  # fmt: skip
        self.count += len(jobs)
        done = {each.key: each for each in self._pool.run(iter(jobs), self._check)}
        # In their own order, whichever ended first: what is said from them is then the same every time.
        for job in jobs:
            try:
                found = done[job.key].result()
            except (ComputationFailed, BadInput) as error:
                self.failed[str(job.key)] = str(error)
                continue
            if found.outcome.kind == "interrupted":
                raise KeyboardInterrupt
            if not found.outcome.done:
                self.failed[str(job.key)] = str(found.outcome)
                continue
            if str(job.key) not in self._known:
                self.database.add(wanted[str(job.key)], found.course, found.onset_mm)
            self._known[str(job.key)] = *asked, found
        return [self._known[c.id][2] if c.id in self._known else None for c in cases]


def _computed(
    case: Case, names: Sequence[str], added: Sequence[Added], folder: Path | None, compute: Compute
) -> Ran:
    return compute(case, names, added, folder)
