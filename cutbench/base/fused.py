"""Functions of arrays of points as one compiled loop over points, where numba is installed.

``fused(f)`` answers as f does, up to rounding. First f is read as a formula (``cutbench.base.symbols``), of
which a loop is written and compiled, with derivatives for complex steps in f; the user's cache keeps it.
Numbers and arrays are inputs; all else that f is given (flags, names, laws) says which formula it is. What
cannot be read stays NumPy, as does what turns out to differ: calls number 1, 2, 4, 8, … are compared.
"""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np

from cutbench.base.compiled import COMPILED, VERSION, compiled
from cutbench.base.formula import Formula
from cutbench.base.graph import symbolic, under_way
from cutbench.base.symbols import leaf

#: Readings of one function that are kept, the last ones; and different formulas of one: with more there is
#: something that changes from call to call, and each would be compiled.
MAX_TRACES, MAX_FORMULAS = 64, 256
#: By which an answer may differ from NumPy's, over its largest number.
ROUNDING = 1e-8
_FLOAT, _COMPLEX = np.dtype(float), np.dtype(complex)
_MISS = object()


class Fused:
    """``plain`` as a compiled loop; the last axis of arrays runs over points. ``loops`` makes a function of
    its source."""

    def __init__(self, plain: Callable[..., Any], loops: Callable[[str], Callable[..., None]]):
        self.plain, self._loops = plain, loops
        self._known: list[_Reading] = []
        self._formulas: set[str] = set()

    def __call__(self, *given: Any) -> Any:
        if under_way():  # of what calls it
            return self.plain(*given)
        for k, reading in enumerate(self._known):
            if (found := reading.answer(given)) is not _MISS:
                if k:  # it is asked for again, most likely
                    self._known.insert(0, self._known.pop(k))
                return found
        if len(self._formulas) < MAX_FORMULAS:
            reading = _Reading(self.plain, given, self._loops)
            self._known.insert(0, reading)
            del self._known[MAX_TRACES:]
            self._formulas.add(reading.source)
            if (found := reading.answer(given)) is not _MISS:
                return found
        return self.plain(*given)

    def __reduce__(self):
        return fused, (self.plain,)

    @property
    def left_plain(self) -> list[str]:
        """Why what has been asked for is not compiled; empty if it is."""
        return [reading.why for reading in self._known if reading.why]


def fusing() -> bool:
    """Whether laws are compiled: where numba is, but with ``CUTBENCH_FUSED=0``."""
    return COMPILED and os.environ.get("CUTBENCH_FUSED") != "0"


def fused(plain: Callable[..., Any]) -> Callable[..., Any]:
    """``plain`` as one compiled loop over points, the last axis of all arrays; else itself."""
    return _fused(plain) if fusing() else plain


@lru_cache(maxsize=256)
def _fused(plain: Callable[..., Any]) -> Fused:
    return Fused(plain, _compiled_source)


class _Reading:
    """A function read for arguments of one kind."""

    def __init__(self, plain, given: tuple, loops: Callable[[str], Callable[..., None]]):
        self._plain, self.why, self.source, self.calls = plain, "", "", 0
        self._guards: list[str] = []
        self._objects: dict[str, Any] = {"array": np.array}
        self._places: list[str] = []
        self._leading: list[tuple[int, ...]] = []
        first = next((x for x in given if isinstance(x, np.ndarray) and x.ndim), None)
        self._points = None if first is None else first.shape[-1]
        numbers, arrays, build = [], [], "None"
        try:
            if (owner := getattr(plain, "__self__", None)) is not None:
                self._keeps(owner, self._object(owner))
            with symbolic():
                read = [self._read(x, f"a{k}") for k, x in enumerate(given)]
                formula = Formula(plain(*read), (2,), self._object)
            if not formula.arrays:
                raise TypeError("an answer that depends on no points")
            self.source = formula.source
            self._loop, self._rows = loops(self.source), formula.rows
            numbers, arrays, build = formula.numbers, formula.arrays, formula.build
        except Exception as error:  # whatever NumPy, a law or a compiler says to symbols
            self.why = f"{type(error).__name__}: {error}"
        self._lead = [(self._leading[k], math.prod(self._leading[k])) for k in arrays]
        listed = [", ".join(self._places[k] for k in some) for some in (numbers, arrays)]
        code = [
            f"def gather({', '.join(f'a{k}' for k in range(len(given)))}):",
            *(f"    if not ({guard}): return None" for guard in self._guards),
            f"    return array([{listed[0]}], ndmin=1), [{listed[1]}]",
            f"def build(o, shape): return {build}",
        ]
        exec("\n".join(code), self._objects)
        self._gather, self._build = self._objects["gather"], self._objects["build"]

    def _object(self, x: Any) -> str:
        """A name for an object in what is written."""
        self._objects[name := f"k{len(self._objects)}"] = x
        return name

    def _read(self, x: Any, place: str) -> Any:
        """An argument with symbols in it, in place of numbers and arrays of points."""
        if isinstance(x, (float, complex, np.inexact)) or (isinstance(x, np.ndarray) and x.ndim == 0):
            return self._leaf(place, None)
        if isinstance(x, np.ndarray):
            if x.dtype in (_FLOAT, _COMPLEX) and x.shape[-1] == self._points:
                return self._leaf(place, x.shape[:-1])
            return Unread()
        if isinstance(x, dict):
            self._guards.append(f"{place}.keys() == {self._object(dict.fromkeys(x).keys())}")
            return {k: self._read(v, f"{place}[{self._object(k)}]") for k, v in x.items()}
        if isinstance(x, SimpleNamespace):
            self._guards.append(f"type({place}) is {self._object(type(x))}")
            new = type(x)()
            vars(new).update(self._read(vars(x), f"{place}.__dict__"))
            return new
        if isinstance(x, (tuple, list)):
            self._guards.append(f"type({place}) is {self._object(type(x))} and len({place}) == {len(x)}")
            parts = [self._read(each, f"{place}[{i}]") for i, each in enumerate(x)]
            return type(x)(*parts) if hasattr(x, "_fields") else type(x)(parts)
        same = "==" if isinstance(x, (int, str)) and not isinstance(x, bool) else "is"
        # Arguments that are flags differ most often.
        self._guards.insert(0 if place.isalnum() else len(self._guards), f"{place} {same} {self._object(x)}")
        self._keeps(x, place)
        return x

    def _keeps(self, x: Any, place: str) -> None:
        """A law has nothing of its own; if it gets something, a method in place of its class's, it is read
        anew."""
        if not isinstance(x, type) and type(getattr(x, "__dict__", None)) is dict:
            self._guards.append(f"{place}.__dict__ == {self._object({**vars(x)})}")

    def _leaf(self, place: str, leading: tuple[int, ...] | None) -> Any:
        self._places.append(place)
        self._leading.append(leading or ())
        return leaf(len(self._places) - 1, leading, (2,))

    def answer(self, given: tuple) -> Any:
        """What the function answers; ``_MISS`` where it was not read for such arguments."""
        try:
            found = self._gather(*given)
        except (AttributeError, TypeError, ValueError, LookupError):
            return _MISS
        if found is None:
            return _MISS
        if self.why:
            return self._plain(*given)
        q, arrays = found
        shape = arrays[0].shape[-1:]
        kind, inputs = q.dtype, []
        for x in arrays:
            if x.dtype != kind:
                kind = _COMPLEX
        for x, (lead, rows) in zip(arrays, self._lead, strict=True):
            if x.shape != lead + shape:
                return _MISS
            if x.dtype != kind or not x.flags.carray:  # compiled loops are of one kind of arrays
                x = np.array(x, kind, order="C")
            inputs.append(x if x.ndim == 2 else x.reshape(rows, -1))
        if kind is not _FLOAT:
            q = q.astype(kind)
        out = np.empty((self._rows, inputs[0].shape[1]), kind)
        self._loop(q, *inputs, out)
        found = self._build(out, shape)
        self.calls += 1
        if self.calls & (self.calls - 1) == 0 and not _alike(found, self._plain(*given)):
            self.why = "differs from NumPy"
            return self._plain(*given)
        return found


class Unread:
    """In place of an array that does not run over points: no formula can have it."""


def _alike(found: Any, plain: Any) -> bool:
    if isinstance(plain, Mapping):
        return found.keys() == plain.keys() and all(_alike(found[k], plain[k]) for k in plain)
    if isinstance(plain, (tuple, list)):
        return len(found) == len(plain) and all(map(_alike, found, plain))
    if not isinstance(plain, (np.ndarray, float, complex)):
        return found is plain or found == plain
    if np.shape(found) != np.shape(plain):
        return False
    return all(_close(part(found), part(plain)) for part in (np.real, np.imag))


def _close(found: Any, plain: Any) -> bool:
    most = np.max(np.abs(plain), initial=0.0, where=np.isfinite(plain))
    with np.errstate(invalid="ignore"):
        near = (np.abs(found - plain) <= ROUNDING * most) | (found == plain)
    return bool(np.all(near | (np.isnan(plain) & np.isnan(found))))


def _compiled_source(source: str) -> Callable[..., None]:
    """``loop`` of a source, compiled, and kept for the next process where there is a place for it."""
    return compiled_functions(source)["loop"]


@lru_cache(maxsize=1024)
def compiled_functions(source: str) -> dict[str, Callable[..., Any]]:
    """All functions of a source by name, compiled; each may call those before it."""
    code = compile(source, _kept(source), "exec")
    scope: dict[str, Any] = {"np": np, "__name__": __name__}
    exec(code, scope)
    names = [name for name, made in scope.items() if isinstance(made, FunctionType)]
    for name in names:
        scope[name] = compiled()(scope[name])
    return {name: scope[name] for name in names}


def is_kept(source: str) -> bool:
    """Whether the user's cache has machine code of a source."""
    folder, name = _place(source)
    return any((folder / "__pycache__").glob(f"{Path(name).stem}.*.nbc"))


def mark(source: str) -> Path:
    """A file in the user's cache that says that a source's machine code has been found to be right."""
    folder, name = _place(source)
    return folder / f"{Path(name).stem}.{VERSION}.right"


def _place(source: str) -> tuple[Path, str]:
    """Folder and name of the file of a source in the user's cache."""
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(home) / "cutbench" / "loops", f"{hashlib.sha256(source.encode()).hexdigest()[:24]}.py"


def _kept(source: str) -> str:
    """The file of a source in the user's cache; machine code is kept beside it."""
    name = "source"
    try:
        folder, name = _place(source)
        if not (folder / name).exists():
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".new", delete=False) as file:
                file.write(source)
            os.replace(file.name, folder / name)
    except (OSError, RuntimeError):  # no home, or no room in it
        return f"<{name}>"
    return str(folder / name)
