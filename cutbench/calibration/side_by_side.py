"""Searches that ask for cuts at the same time, so that processes compute for all of them at once.

A search thinks, and waits for its cuts: three on two processes leave one idle for a quarter of the time. Here
each search thinks in turn until it asks for cuts, and what all of them ask for is computed together. What
comes of it does not depend on how many processes there are, or on which ends first.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextvars import ContextVar, copy_context
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from cutbench.base.errors import BadInput, ComputationFailed

Found = TypeVar("Found")


def side_by_side(
    searches: Sequence[Callable[[], Found]], compute: Callable[[Sequence[Any]], list[Any]]
) -> list[Found | ComputationFailed | BadInput]:
    """What each of ``searches`` finds, or why it finds nothing, in their order. ``compute`` has all that they
    ``ask`` for at one time, and gives as many answers.

    Raises KeyboardInterrupt, which every search gets for its answer first, and whatever else one raises.
    """
    under_way = [_Search(each) for each in searches]
    try:
        live = [each for each in under_way if each.goes_on()]
        while live:
            answers = iter(compute([task for each in live for task in each.tasks]))
            live = [each for each in live if each.goes_on([next(answers) for _ in each.tasks])]
    finally:
        for each in under_way:
            each.stop()
    return [each.found for each in under_way]


def ask(tasks: Sequence[Any]) -> list[Any] | None:
    """The answers to ``tasks``; None where no search side by side with others asks. Raises
    KeyboardInterrupt."""
    search = _SEARCH.get()
    return None if search is None else search.ask(tasks)


class _Search(Generic[Found]):
    """A thread of its own, of which one runs at a time."""

    def __init__(self, call: Callable[[], Found]):
        self.tasks: Sequence[Any] = ()
        self.found: Found | ComputationFailed | BadInput
        self._call, self._ended = call, False
        self._error: BaseException | None = None
        self._asked: SimpleQueue[Sequence[Any] | None] = SimpleQueue()
        self._answers: SimpleQueue[list[Any] | None] = SimpleQueue()
        context = copy_context()
        context.run(_SEARCH.set, self)
        self._thread = threading.Thread(target=context.run, args=(self._run,), daemon=True)
        self._waiting = True

    def goes_on(self, answers: list[Any] | None = None) -> bool:
        """With ``answers`` until it asks for ``tasks``: False where it has ended."""
        if self._thread.ident is None:
            self._thread.start()
        else:
            self._answers.put(answers)
        self._hear()
        if self._error is not None:
            raise self._error
        return not self._ended

    def stop(self) -> None:
        """End it, if it has not, by a KeyboardInterrupt for every answer."""
        while self._thread.ident is not None and not self._ended:
            if self._waiting:
                self._answers.put(None)
            self._hear()

    def ask(self, tasks: Sequence[Any]) -> list[Any]:
        self._asked.put(tasks)
        if (answers := self._answers.get()) is None:
            raise KeyboardInterrupt
        return answers

    def _hear(self) -> None:
        self._waiting = False
        tasks = self._asked.get()
        self._waiting, self._ended, self.tasks = tasks is not None, tasks is None, tasks or ()

    def _run(self) -> None:
        try:
            self.found = self._call()
        except (ComputationFailed, BadInput) as error:
            self.found = error
        except BaseException as error:
            self._error = error
        self._asked.put(None)


_SEARCH: ContextVar[_Search | None] = ContextVar("search", default=None)
