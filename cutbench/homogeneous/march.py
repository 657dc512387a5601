"""The way along a history as compiled loops: all steps, Newton's method in each, all answers at once.

What laws answer at one step is read as a formula (``cutbench.base.symbols``), of which a loop over points is
written; another loop goes along the history with it. Machine code is kept in the user's cache. Models are
compiled after they were asked for a few times: one that is asked once is done sooner without.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import numpy as np

from cutbench.base.formula import Formula
from cutbench.base.fused import compiled_functions, fusing, is_kept, mark
from cutbench.base.graph import symbolic
from cutbench.base.symbols import leaf
from cutbench.mechanisms.base import STEP

#: Marches of one model without compiling; of code that is kept, none.
MARCHES_BEFORE_COMPILING = 8

#: By which an answer may differ from NumPy's, over its largest number.
ROUNDING = 1e-6
#: Of all steps: stretches (T, count), durations (T,) in s, whether a reading is reached (T,).
Steps = tuple[np.ndarray, np.ndarray, np.ndarray]
#: Rows of the inputs: stretch, ln of the free stretch, duration, state, parameters.
_STATE = 3

#: To first order in the imaginary part: the compiler's own overflows far from 0.
_TANH = """
def tanh(z):
    value = np.tanh(z.real)
    return value + 1j * z.imag * (1 - value * value)
"""
#: ``X`` (R, N): inputs, ``W``: their real parts. Returns the step that failed, -1 for none.
_MARCH = """
def march(X, W, stretch, dt, reached, lateral, resists, states, close, step, P):
    rows, points = X.shape
    q = np.zeros(1, np.complex128)
    O = np.zeros((2 + states, points), np.complex128)
    b, slope = np.zeros(points), np.zeros(points)
    before = np.ones(points)
    row = 0
    for t in range(dt.size):
        for n in range(points):
            X[0, n] = stretch[t, n]
            W[0, n] = stretch[t, n].real
            X[2, n] = W[2, n] = dt[t]
            b[n] += lateral * np.log(stretch[t, n].real / before[n])
            before[n] = stretch[t, n].real
        if resists:
            settled = False
            for _ in range(100):
                for n in range(points):
                    W[1, n] = b[n] + 1j * step
                {step_W}
                settled = True
                for n in range(points):
                    slope[n] = O[1, n].imag / step
                    change = -O[1, n].real / slope[n]
                    b[n] += min(max(change, -0.2), 0.2)
                    if not np.isfinite(b[n]):
                        return t
                    if not abs(change) < close:
                        settled = False
                if settled:
                    break
            if not settled:
                return t
            for n in range(points):
                X[1, n] = b[n]
            {step_X}
            for n in range(points):
                X[1, n] = b[n] - 1j * (O[1, n].imag / slope[n])
            {step_X}
        else:
            for n in range(points):
                X[1, n] = lateral * np.log(stretch[t, n])
            {step_X}
            for n in range(points):
                O[0, n] -= O[1, n] * np.exp(X[1, n]) / stretch[t, n]
        for n in range(points):
            for k in range(states):
                X[3 + k, n] = O[2 + k, n]
                W[3 + k, n] = O[2 + k, n].real
        if reached[t]:
            for n in range(points):
                P[row, n] = O[0, n]
            row += 1
    return -1
"""


class March:
    """The compiled march of one model in one mode; ``of`` is None where it is done without."""

    def __init__(self, source: str, names: list[str], states: Mapping[str, tuple[int, ...]]):
        self._march: Callable[..., int] | None = _compiled(source)
        self._names, self._states, self._mark = names, states, mark(source)
        self.checked = self._mark.exists()

    @classmethod
    def of(cls, stress: Callable[..., Any], laws: tuple, mode: Any, p: SimpleNamespace,
           state: Mapping[str, np.ndarray], count: int) -> March | None:  # fmt: skip
        """``stress(mode, laws, stretch, b, p, state, dt)`` answers P₁₁, P₃₃ and the new state."""
        if not fusing():
            return None
        shapes = {name: value.shape[:-1] for name, value in state.items()}
        names = sorted(name for name, value in vars(p).items() if _is_number(value, count))
        key = (laws, mode, tuple(names), tuple(sorted(shapes.items())))
        if key not in _known:
            _asked[key] += 1
            source = _sources.get(key)
            if source is None:
                source = _sources[key] = _source(stress, laws, mode, p, names, state)
            if source and not (_asked[key] > MARCHES_BEFORE_COMPILING or is_kept(source)):
                return None
            _known[key] = cls(source, names, shapes) if source else None
        return _known[key]

    def along(self, steps: Steps, p, state, lateral: float, resists: bool, close: float):
        """P₁₁ (n, count) and the step that failed, -1 for none. None where it cannot be compiled."""
        if self._march is None:
            return None
        stretch, dt, reached = steps
        points = stretch.shape[1]
        rows = [np.zeros((_STATE, points), complex)]
        for name, shape in self._states.items():
            rows.append(np.asarray(state[name], complex).reshape(math.prod(shape), points))
        rows += [np.broadcast_to(np.asarray(getattr(p, n), complex), (1, points)) for n in self._names]
        X = np.ascontiguousarray(np.vstack(rows))
        P = np.zeros((int(reached.sum()), points), complex)
        states = sum(math.prod(shape) for shape in self._states.values())
        try:
            failed = self._march(
                X, X.real.astype(complex), np.asarray(stretch, complex), dt, reached, lateral, resists,
                states, close, STEP, P,
            )  # fmt: skip
        except Exception:  # whatever a compiler says to a law
            self._march = None
            return None
        return P, failed

    def holds(self, found: np.ndarray, plain: np.ndarray) -> np.ndarray:
        """``found`` where it is what NumPy has, ``plain``; else that, and it is done without from now on."""
        self.checked = True
        if all(_close(part(found), part(plain)) for part in (np.real, np.imag)):
            with suppress(OSError):  # no place for it: it is checked again
                self._mark.touch()
            return found
        self._march = None
        return plain


def _close(found: np.ndarray, plain: np.ndarray) -> bool:
    return bool(np.all(np.abs(found - plain) <= ROUNDING * np.abs(plain).max(initial=0.0)))


_known: dict[tuple, March | None] = {}
_asked: Counter[tuple] = Counter()
_sources: dict[tuple, str] = {}


def _is_number(value: Any, count: int) -> bool:
    if isinstance(value, np.ndarray):
        return value.shape in ((), (count,)) and value.dtype.kind in "fc"
    return isinstance(value, (float, complex, np.inexact))


def _compiled(source: str) -> Callable[..., int]:
    made = compiled_functions(source)
    return next(made[name] for name in made if name.startswith("march"))


def _source(stress, laws, mode, p: SimpleNamespace, names: list[str], start: Mapping) -> str:
    """Of the march; empty where laws cannot be read."""
    shapes = {name: value.shape[:-1] for name, value in start.items()}
    # What begins at 0 is taken to stay there; what the formula does not leave there is looked at again.
    still = {name: np.all(value == 0, axis=-1) for name, value in start.items()}
    try:
        while True:
            with symbolic(finite=True):
                stretch, b, dt = (leaf(k, (), (2,)) for k in range(_STATE))
                state = {
                    name: np.where(still[name][..., None], 0.0, leaf(_STATE + k, shape, (2,)))
                    for k, (name, shape) in enumerate(shapes.items())
                }
                first = _STATE + len(shapes)
                values = {name: leaf(first + k, (), (2,)) for k, name in enumerate(names)}
                given = SimpleNamespace(**{**vars(p), **values})
                P, free, new = stress(mode, laws, stretch, b, given, state, dt)
                moved = {name: still[name] & ~_zero(new[name]) for name in shapes}
                if not any(map(np.any, moved.values())):
                    formula = Formula((P, free, *(new[name] for name in shapes)), (2,), lambda x: "None")
                    break
            still = {name: still[name] & ~moved[name] for name in shapes}
        if formula.numbers or formula.rows != 2 + sum(map(math.prod, shapes.values())):
            return ""
    except Exception:  # whatever a law says to symbols
        return ""
    rows, first = [], 0
    for size in [1] * _STATE + [math.prod(shape) for shape in shapes.values()] + [1] * len(names):
        rows.append((first, first := first + size))
    calls = {
        f"step_{of}": f"loop(q, {''.join(f'{of}[{rows[k][0]}:{rows[k][1]}], ' for k in formula.arrays)}O)"
        for of in "XW"
    }
    source = _TANH + formula.source.replace("np.tanh(", "tanh(") + _MARCH.format(**calls)
    # Machine code from several caches is linked by names: each source has its own.
    own = hashlib.sha256(source.encode()).hexdigest()[:16]
    return re.sub(r"(?<![\w.])(tanh|loop|march)\(", rf"\1_{own}(", source)


def _zero(x: Any) -> np.ndarray:
    """Which entries (…) of symbols and numbers (…, 2) are 0 for certain."""
    entries = np.asarray(x).view(np.ndarray)
    flat = [isinstance(each, (int, float)) and each == 0 for each in entries.ravel()]
    return np.all(np.reshape(flat, entries.shape), axis=-1)
