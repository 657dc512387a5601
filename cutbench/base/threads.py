"""Threads of linear algebra: one a process. What sets them is read when numpy is loaded: keep this light."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

_FIRST = "OMP_NUM_THREADS"
#: Two cores are busier with two runs than with one run on two threads. Whatever BLAS is in use.
ONE_THREAD = dict.fromkeys(
    (_FIRST, "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)


def leave_cores_to_workers() -> None:
    """One thread for a process that watches and decides, unless somebody chose: the cores belong to runs."""
    os.environ.setdefault(_FIRST, "1")


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
