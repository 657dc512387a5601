"""Compiled loops over arrays where numba is installed, NumPy where it is not. Results agree to rounding."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np

try:
    if os.environ.get("CUTBENCH_COMPILED") == "0":
        raise ImportError("switched off by CUTBENCH_COMPILED=0")
    import numba
    from numba.core import event
except Exception:  # not installed, or broken: NumPy serves
    numba = None  # type: ignore[assignment]

Part = TypeVar("Part")

#: Whether loops are compiled here.
COMPILED = numba is not None
#: Of the compiler.
VERSION = "" if numba is None else numba.__version__


def compiled(plain: Callable[..., Any] | None = None) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator of a function of numbers and arrays, written in loops that numba compiles.

    ``plain`` does the same in NumPy, and is what runs without numba; where it is None the loops themselves
    do. Machine code is kept on disk beside the source, or in the user's cache where that cannot be written.
    """

    def chosen(loops: Callable[..., Any]) -> Callable[..., Any]:
        if numba is None:
            return plain or loops
        try:
            return numba.njit(cache=True, error_model="numpy", nogil=True)(loops)
        except RuntimeError:  # no place for a cache
            return numba.njit(error_model="numpy", nogil=True)(loops)

    return chosen


def announced(parts: Iterator[Part], say: Callable[[], None]) -> Iterator[Part]:
    """``parts``; where loops are compiled meanwhile, of which this machine keeps no code, ``say`` is called
    first, once."""
    if numba is None:
        yield from parts
        return

    class Waiting(event.Listener):
        said = False

        def on_start(self, event) -> None:
            if not self.said:
                self.said = True
                say()

        def on_end(self, event) -> None:
            pass

    with event.install_listener("numba:compile", Waiting()):
        yield from parts


def shared(formula: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a formula that compiled loops use with numbers and NumPy with arrays; see ``choose``."""
    return formula if numba is None else numba.extending.register_jitable(formula)


def choose(condition, first, second):
    """``first`` where the condition holds, else ``second``: of numbers in compiled loops, or of arrays."""
    return np.where(condition, first, second)


def _choose_number(condition, first, second):
    return lambda condition, first, second: first if condition else second


if numba is not None:
    numba.extending.overload(choose)(_choose_number)
