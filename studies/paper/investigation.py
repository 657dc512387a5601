"""All of it: choose b, hold the claims against runs, write what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cutbench.base.files import check_writable
from cutbench.base.progress import OnProgress, silent
from cutbench.base.toml import among
from cutbench.run.pool.worker import Run
from cutbench.run.store.runs import Store
from studies.paper import claims
from studies.paper.base import Claim
from studies.paper.judgement import Judged, Scan, calibrate, judge
from studies.paper.report import write
from studies.paper.runner import Runner


@dataclass(frozen=True)
class Investigation:
    """What was found, and where it is written."""

    judged: tuple[Judged, ...]
    scans: Mapping[str, Scan]
    runner: Runner
    paths: tuple[Path, ...]


def investigate(
    out: str | Path,
    *,
    only: Sequence[str] = (),
    workers: int | None = None,
    on_progress: OnProgress = silent,
    runs: Mapping[str, Run] | None = None,
    figures: bool = True,
) -> Investigation:
    """Hold the paper's claims (``only`` these) against runs, which go into ``out/runs`` and are made once.

    Writes claims.json, claims.md and pictures into ``out``. ``workers`` processes compute (default: one a
    core; 0: this one); ``on_progress`` counts the runs asked for so far. ``runs`` replaces how a
    kind of test is run.
    A KeyboardInterrupt passes through: runs that ended are kept, and the same call goes on from there.
    Raises BadInput for a claim that is not known, or a folder that cannot be written.
    """
    chosen = select(only)
    folder = check_writable(out)
    runner = Runner(Store(folder / "runs"), workers=workers, on_progress=on_progress, runs=runs)
    materials = dict.fromkeys(ask.material for claim in chosen for ask in claim.asks.values())
    scans = calibrate(runner, materials)
    judged = judge(runner, chosen, scans)
    paths = write(judged, scans, runner, folder)
    if figures:
        from studies.paper.figures import draw

        paths += draw(judged, scans, runner, folder)
    return Investigation(tuple(judged), scans, runner, tuple(paths))


def select(only: Sequence[str] = ()) -> list[Claim]:
    """The claims of these ids, all without any. Raises BadInput for an id that is not known."""
    known = claims()
    for id in only:
        among("--only", id, known)
    return [claim for id, claim in known.items() if not only or id in only]
