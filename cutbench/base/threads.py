"""Threads: one of linear algebra a process, whose loops may share their work out among several. What sets the
former is read when numpy is loaded: keep this light.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from functools import partial
from queue import SimpleQueue
from threading import Thread, local

_FIRST = "OMP_NUM_THREADS"
#: Two cores are busier with two runs than with one run on two threads. Whatever BLAS is in use.
ONE_THREAD = dict.fromkeys(
    (_FIRST, "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
#: Numbers to go over from which on another thread saves more than the 50 µs that it takes to call it.
GRAIN = 50_000


class _Mine(local):
    """How many threads share the work of this one, with itself, and where the others get it from."""

    threads, todo = 1, SimpleQueue()  # type: ignore[var-annotated]


_mine = _Mine()


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """How many share the work of this one, with itself."""
    return _mine.threads


@contextmanager
def sharing(count: int) -> Iterator[None]:
    """Inside, so many threads share the work: results are the same up to rounding."""
    before, todo = (_mine.threads, _mine.todo), SimpleQueue()  # type: ignore[var-annotated]
    for _ in range(count - 1):
        Thread(target=_help, args=(todo,), daemon=True).start()
    _mine.threads, _mine.todo = count, todo
    try:
        yield
    finally:
        for _ in range(count - 1):
            todo.put(None)
        _mine.threads, _mine.todo = before


def _help(todo: SimpleQueue) -> None:
    """Do what there is; a pool of futures takes four times as long to call."""
    for call, done in iter(todo.get, None):
        done.put(_error(call))


def _error(call: Callable[[], object]) -> BaseException | None:
    try:
        call()
    except BaseException as error:
        return error
    return None


def at_once(*calls: Callable[[], None]) -> None:
    """All ``calls``, each by a thread of its own as far as there are some."""
    own, others, done = calls[:1], calls[1:], SimpleQueue()  # type: ignore[var-annotated]
    if _mine.threads == 1:
        own, others = calls, ()
    for call in others:
        # What NumPy says of numbers that are not finite is a matter of context.
        _mine.todo.put((partial(copy_context().run, call), done))
    for error in filter(None, [*map(_error, own), *(done.get() for _ in others)]):
        raise error


def shared_out(work: Callable[[int, int], None], count: int, numbers: int) -> None:
    """``work(begin, end)`` on parts of ``range(count)``, all at once, where it goes over so many
    ``numbers``."""
    hands = max(1, min(threads(), count, numbers // GRAIN))
    at_once(*(partial(work, count * k // hands, count * (k + 1) // hands) for k in range(hands)))


def leave_cores_to_workers() -> None:
    """One thread of linear algebra, unless somebody chose: the cores belong to runs, or to who shares one's
    work."""
    if _FIRST not in os.environ:
        os.environ.update({name: os.environ.get(name, "1") for name in ONE_THREAD if name != _FIRST})


def threads_of_a_run() -> int:
    """What a run may take that runs alone: as many as ``OMP_NUM_THREADS`` says, else one a core."""
    given = os.environ.get(_FIRST, "")
    return int(given) if given.isdecimal() and int(given) else cores()


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Children start with these variables set, before they import numpy."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
