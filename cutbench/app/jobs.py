"""Work in the background: one process a job, and all that it told, for who asks later."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from cutbench.base.errors import BadInput, CutbenchError

#: How a job stands; only the first goes on.
STATES = ("running", "done", "failed", "stopped")
#: So many at once: the machine is its user's, too.
MAX_RUNNING = 2
_SPAWN = multiprocessing.get_context("spawn")


@dataclass
class Job:
    """One computation: what it is, where it writes, how it stands, and what it told, in order."""

    id: str
    title: str
    folder: Path
    state: str = STATES[0]
    messages: list[dict] = field(default_factory=list)
    process: Any = None

    def summary(self) -> dict:
        """For a list of jobs."""
        return {"id": self.id, "title": self.title, "state": self.state, "folder": self.folder.name}


class Jobs:
    """The jobs of one server. Processes end with ``close``."""

    def __init__(self) -> None:
        self._jobs: dict[str, Job] = {}

    def __iter__(self):
        return iter(self._jobs.values())

    def get(self, id: str) -> Job | None:
        return self._jobs.get(id)

    def start(self, title: str, folder: Path, task: Callable, *given: object) -> Job:
        """Begin ``task(*given, folder, tell)``. Raises BadInput while ``MAX_RUNNING`` are under way."""
        if sum(job.state == STATES[0] for job in self) >= MAX_RUNNING:
            raise BadInput("jobs", title, f"at most {MAX_RUNNING} at once: wait for one, or stop it")
        job = Job(f"{len(self._jobs) + 1}", title, folder)
        folder.mkdir(parents=True, exist_ok=True)
        listen, speak = _SPAWN.Pipe(duplex=False)
        job.process = _SPAWN.Process(target=_work, args=(task, given, folder, speak), daemon=True)
        job.process.start()
        speak.close()
        self._jobs[job.id] = job
        threading.Thread(target=_listen, args=(job, listen), daemon=True).start()
        return job

    def stop(self, job: Job) -> None:
        """End a job: it keeps what it has told."""
        if job.state == STATES[0]:
            job.state = STATES[3]
            job.process.terminate()

    def close(self) -> None:
        for job in self:
            self.stop(job)


def _work(task: Callable, given: tuple, folder: Path, speak: Connection) -> None:
    """In the job's own process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the server's, which ends its jobs

    def tell(what: Mapping[str, object]) -> None:
        speak.send(dict(what))

    try:
        task(*given, folder, tell)
        tell({"state": "done"})
    except CutbenchError as error:
        tell({"error": str(error), "state": "failed"})
    except Exception as error:  # a fault of the program: said, not lost with the process
        tell({"error": f"{type(error).__name__}: {error}", "state": "failed"})


def _listen(job: Job, listen: Connection) -> None:
    ended = "failed"
    try:
        while True:
            what = listen.recv()
            ended = what.pop("state", ended)
            job.messages.append(what)
    except (EOFError, OSError):
        pass
    job.process.join()
    if job.state == STATES[0]:
        job.state = ended
