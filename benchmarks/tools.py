"""What benchmarks share: runs in processes of their own, commits, the machine, tables."""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path

import cutbench
from cutbench.base.threads import ONE_THREAD

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("cutbench", "numpy", "scipy", "scikit-fem", "numba", "py-mkl-pardiso")


def job(material: str, depth_mm: float | None = None, **changes: object) -> dict:
    """A run to be timed: ``changes`` as ``Case.set`` takes them."""
    depth = {} if depth_mm is None else {"depth": f"{depth_mm:g} mm"}
    return {"material": material, "changes": {**changes, **depth}}


def timed(jobs: Sequence[dict], tree: Path = ROOT) -> Iterator[dict]:
    """Records of ``jobs``, one after the other in one process with one thread and the package of ``tree``.

    RuntimeError with its last words where it crashes, or where another package is found.
    """
    command = [sys.executable, "-P", str(ROOT / "benchmarks" / "one_run.py")]
    environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(tree)}
    pipe = subprocess.PIPE
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8") as said,
        subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=said, text=True, cwd=tree, env=environment)
        as process,
    ):  # fmt: skip
        assert process.stdin is not None and process.stdout is not None
        try:
            with suppress(BrokenPipeError), process.stdin as to:
                json.dump(list(jobs), to)
            for line in process.stdout:
                yield json.loads(line)
            if process.wait() != 0:
                said.seek(0)
                words = said.read().strip().splitlines()
                raise RuntimeError(words[-1] if words else f"exit status {process.returncode}")
        finally:
            process.kill()


def fastest(records: Sequence[dict]) -> dict:
    """The one of several of the same run that took least, with the seconds of all."""
    best = min(records, key=lambda r: r["cpu_s"])
    return {**best, "all_cpu_s": [r["cpu_s"] for r in records]}


# -- commits ----------------------------------------------------------------------------------------
def git(*args: str) -> str | None:
    """What git says of this repository; None where it fails, or is not there."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        return None
    done = subprocess.run(["git", "-C", str(ROOT), *args], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None


def known(parser: argparse.ArgumentParser, option: str, revision: str) -> str:
    """The full name of a commit; else the end, with what would be right."""
    if git("rev-parse", "HEAD") is None:
        parser.error(
            f"{option} '{revision}' cannot be used: {ROOT} has no git history; expected a clone of the"
            " repository"
        )
    name = git("rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}")
    if name is None:
        shallow = " with its history (git fetch --unshallow)" * (
            git("rev-parse", "--is-shallow-repository") == "true"
        )
        parser.error(
            f"{option} '{revision}' cannot be used; expected a commit of the repository at {ROOT}{shallow}"
        )
    return name


@contextmanager
def files_of(revision: str) -> Iterator[Path]:
    """A commit's files in a folder of their own, gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="commit-") as name:
        folder = Path(name).resolve()
        subprocess.run(
            ["git", "-C", str(ROOT), "archive", "--output", str(folder / "all.tar"), revision], check=True
        )
        shutil.unpack_archive(folder / "all.tar", folder / "tree")
        yield folder / "tree"


def here() -> dict:
    """The commit that stands here, and whether the package differs from it; None where git does not tell."""
    changed = git("status", "--porcelain", "--", "cutbench", "benchmarks", "studies")
    return {"commit": git("rev-parse", "HEAD"), "changed": None if changed is None else bool(changed)}


# -- the machine ------------------------------------------------------------------------------------
def facts() -> dict:
    """Processor, cores, system, versions."""
    return {
        "cpu": cpu(), "cores": os.cpu_count(), "system": platform.platform(),
        "python": platform.python_version(), "versions": {name: version(name) for name in PACKAGES},
    }  # fmt: skip


def cpu() -> str:
    """The processor's name; its architecture where no name is to be had."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:  # the package itself may be run from its folder
        return cutbench.__version__ if package == "cutbench" else None


# -- what is shown ----------------------------------------------------------------------------------
def table(rows: Sequence[Sequence[str]], columns: Sequence[str], left: int = 2) -> str:
    """Columns of text, the first ``left`` to the left, numbers to the right."""
    lines = [list(columns), *map(list, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    sides = [str.ljust if i < left else str.rjust for i in range(len(columns))]
    shown = [
        "  ".join(side(cell, width) for side, cell, width in zip(sides, line, widths, strict=True))
        for line in lines
    ]
    return "\n".join([shown[0], "-" * len(shown[0]), *shown[1:]])


def check_json(parser: argparse.ArgumentParser, path: Path | None) -> None:
    """Before the runs, so that minutes of measuring do not end at a missing folder."""
    if path is not None and not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
        parser.error(f"--json = '{path}' cannot be used; expected a file in a folder that can be written to")
