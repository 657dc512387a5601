"""Work in the background: one process a job, and all that it told, for who asks later."""

from __future__ import annotations

import multiprocessing
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from cutbench.base.errors import BadInput, CutbenchError
from cutbench.base.progress import Clock, count

RUNNING, DONE, FAILED, STOPPED = "running", "done", "failed", "stopped"
#: So many at once: the machine is its user's, too.
MAX_RUNNING = 2
#: Seconds in which a job that is to stop may write what it has, once the server ends.
PATIENCE_S = 5.0
_SPAWN = multiprocessing.get_context("spawn")


@dataclass
class Job:
    """One computation: what it is, where it writes, how it stands, and what it told.

    ``part`` of it is done (nan where that is not known), ``text`` says at what it is and how long it takes
    yet, ``stages`` are all such texts without their numbers; ``points`` are of its force curve (mm, N),
    ``said`` is its answer and ``fault`` why there is none.
    """

    id: str
    kind: str
    title: str
    folder: Path
    state: str = RUNNING
    part: float = float("nan")
    text: str = ""
    stages: list[str] = field(default_factory=list)
    points: list[tuple[float, float]] = field(default_factory=list)
    said: str = ""
    fault: str = ""
    process: Any = None
    pipe: Connection | None = None
    stopping: bool = False

    @property
    def files(self) -> list[str]:
        """Names of the files in its folder."""
        return sorted(path.name for path in self.folder.iterdir() if path.is_file() and path.name[0] != ".")

    def take(self, told: dict[str, Any]) -> None:
        """Keep what the process told."""
        if "point" in told:
            self.points.append(told["point"])
        for name in ("part", "text", "said", "fault"):
            setattr(self, name, told.get(name, getattr(self, name)))
        if (stage := told.get("stage")) and stage not in self.stages:
            self.stages.append(stage)


class Teller:
    """How a task tells what it has, in its own process; ``unit`` is what its progress is counted in."""

    unit = ""

    def __init__(self, pipe: Connection):
        self._pipe, self._clock = pipe, Clock()

    def __call__(self, **told: object) -> None:
        self._pipe.send(told)

    def progress(self, done: float, total: float, text: str) -> None:
        """As ``OnProgress``: ends the computation, as Ctrl-C does, where it is to stop."""
        if self._pipe.poll():  # nothing is sent there but that it is to stop
            raise KeyboardInterrupt
        part = min(1.0, done / total) if total > 0 and np.isfinite(done / total) else float("nan")
        left = self._clock.left(done, total, text)
        parts = [count(done, total, self.unit), text, left and f"{left} left"]
        self(part=part, text=", ".join(filter(None, parts)), stage=text.split(",")[0])


Task = Callable[..., None]


class Jobs:
    """The jobs of one server. Processes end with ``close``."""

    def __init__(self) -> None:
        self._jobs: dict[str, Job] = {}

    def __iter__(self):
        return iter(self._jobs.values())

    def check_free(self) -> None:
        """Raise BadInput while ``MAX_RUNNING`` jobs are under way."""
        if sum(job.state == RUNNING for job in self) >= MAX_RUNNING:
            raise BadInput("jobs", MAX_RUNNING, "fewer at once: wait for one, or stop it")

    def start(self, kind: str, title: str, folder: Path, task: Task, *given: object) -> Job:
        """Begin ``task(*given, folder, tell)`` in a process. Raises BadInput while too many are under way."""
        self.check_free()
        folder.mkdir(parents=True, exist_ok=True)
        here, there = _SPAWN.Pipe()
        # No daemon: that could not have the processes of a sweep.
        process = _SPAWN.Process(target=_work, args=(task, given, folder, there))
        job = Job(f"{len(self._jobs) + 1}", kind, title, folder, process=process, pipe=here)
        process.start()
        there.close()
        self._jobs[job.id] = job
        threading.Thread(target=_listen, args=(job, here), daemon=True).start()
        return job

    def stop(self, job: Job) -> None:
        """Ask a job to end: it keeps what it has. One that was asked before is ended at once."""
        if job.state != RUNNING:
            return
        if job.stopping:
            job.process.terminate()
        elif job.pipe is not None:
            job.stopping, job.text = True, "stopping after what is under way; again: at once"
            with suppress(OSError):  # it ends at this moment
                job.pipe.send(STOPPED)

    def close(self) -> None:
        """End all jobs."""
        due = time.monotonic() + PATIENCE_S
        for job in self:
            self.stop(job)
        for job in self:
            job.process.join(max(0.0, due - time.monotonic()))
            job.process.terminate()


def _work(task: Task, given: tuple, folder: Path, pipe: Connection) -> None:
    """In the job's own process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends its jobs
    tell = Teller(pipe)
    try:
        task(*given, folder, tell)
        tell(state=DONE)
    except KeyboardInterrupt:
        tell(state=STOPPED)
    except CutbenchError as error:
        tell(fault=str(error), state=FAILED)
    except Exception as error:  # a fault of the program: said, not lost with the process
        tell(fault=f"{type(error).__name__}: {error}", state=FAILED)


def _listen(job: Job, pipe: Connection) -> None:
    ended = FAILED
    try:
        while True:
            told = pipe.recv()
            ended = told.get("state", ended)
            job.take(told)
    except (EOFError, OSError):
        pass
    job.process.join()
    job.state = STOPPED if job.stopping else ended
