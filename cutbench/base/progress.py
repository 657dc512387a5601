"""The one way in which a long computation says how far it is; what to make of it is the caller's matter."""

from __future__ import annotations

from typing import Protocol


class OnProgress(Protocol):
    """Called with what is ``done`` of a ``total`` (mm of travel, runs, problems; nan where it is not known
    beforehand) and a short ``text`` on how it stands: a force, a stage, what failed.

    It is called at the beginning, after each part and at the end, in the process that asked. A
    KeyboardInterrupt that it raises ends the computation as Ctrl-C does.
    """

    def __call__(self, done: float, total: float, text: str) -> None: ...


def silent(done: float, total: float, text: str) -> None:
    """Says nothing."""
