"""Functions of NumPy read as formulas: called with symbols in place of numbers, they leave a graph.

A ``Symbol`` has a real part and the first-order part that complex steps have, so that a function that probes
another with ``x + 1j * STEP`` gives the derivative's own formula. Arrays of points are ``Symbols`` with two
points, which no formula may mix. What a graph cannot say (a branch on a value, an index, an unknown function)
raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from itertools import count
from typing import Any

import numpy as np

from cutbench.base.graph import TRUTHS, Node, Part, make, node, slopes

#: A complex number with a larger imaginary part is no complex step.
SMALLEST_STEP = 1e-15
#: Other names of the same functions.
_SAME = {
    "divide": "true_divide", "bitwise_and": "logical_and", "bitwise_or": "logical_or",
    "invert": "logical_not", "fmax": "maximum", "fmin": "minimum", "float_power": "power",
    "conjugate": "positive", "fabs": "absolute",
}  # fmt: skip
_variables = count()


def leaf(number: int, shape: tuple[int, ...] | None = None, points: tuple[int, ...] = ()) -> Any:
    """Input ``number``: a number, or an array of ``shape`` at each of the ``points``, its last axes."""
    if shape is None:
        return Symbol(node("leaf", (number, 0, 0), False))
    many = math.prod(points)
    each = (Symbol(node("leaf", (number, *divmod(k, many)), True)) for k in range(math.prod(shape) * many))
    return _filled(shape + points, each)


def _filled(shape: tuple[int, ...], items: Iterable) -> Symbols:
    array = np.empty(shape, object)
    for k, item in enumerate(items):
        array.flat[k] = item
    return array.view(Symbols)


def apply(name: str, *given: Any) -> Any:
    """An elementwise function of symbols and numbers."""
    name = _SAME.get(name, name)
    parts = [_parts(x) for x in given]
    re, im = [r for r, _ in parts], [i for _, i in parts]
    if name == "real":
        return Symbol(make("real", re[0]) if isinstance(re[0], Node) else re[0])
    if name == "imag":
        return Symbol(im[0])
    # A complex step alone leaves the value what it is, and what follows from it is not computed again.
    steps = name == "add" and isinstance(given[1], complex) and re[1] == 0
    value = re[0] if steps else make(name, *re)
    slope: Part = 0.0
    if name == "where":
        slope = make("where", re[0], im[1], im[2]) if any(i != 0 for i in im[1:]) else 0.0
    elif name in ("maximum", "minimum"):
        if any(i != 0 for i in im):
            first = make("greater_equal" if name == "maximum" else "less_equal", *re)
            slope = make("where", first, *im)
    elif any(i != 0 for i in im) and name not in TRUTHS:
        slope = slopes(name, value, re, im)
    if not isinstance(value, Node) and slope == 0:
        return value
    return Symbol(value, slope)


def _parts(x: Any) -> tuple[Part, Part]:
    if isinstance(x, Symbol):
        return x.re, x.im
    if isinstance(x, (bool, np.bool_)):
        return bool(x), 0.0
    if abs(imag := complex(x).imag) > SMALLEST_STEP:
        raise TypeError(f"{imag}j is no complex step")
    return float(complex(x).real), complex(x).imag


def _elementwise(name: str, *given: Any) -> Any:
    boxed = [_plain(x) for x in given]
    return _symbols(np.frompyfunc(partial(apply, name), len(given), 1)(*boxed))


def _plain(x: Any) -> Any:
    """Arrays of objects in place of symbols, in lists, too."""
    if isinstance(x, Symbols):
        return x.view(np.ndarray)
    if isinstance(x, Symbol):
        box = np.empty((), object)
        box[()] = x
        return box
    if isinstance(x, (list, tuple)):
        return type(x)(map(_plain, x)) if type(x) in (list, tuple) else x
    return x


def _symbols(x: Any) -> Any:
    if isinstance(x, np.ndarray) and x.dtype == object:
        return x.view(Symbols)
    return [_symbols(each) for each in x] if isinstance(x, list) else x


class _Reads:
    """What NumPy is told to do with symbols."""

    def __array_ufunc__(self, ufunc, method, *given, out=None, **options):
        if method == "__call__" and ufunc is not np.matmul and not options:
            found = _elementwise(ufunc.__name__, *given)
        else:
            found = _symbols(getattr(ufunc, method)(*map(_plain, given), **options))
        if out is None:
            return found
        out[0][...] = found
        return out[0]

    def __array_function__(self, function, types, given, options):
        if function in (np.real, np.imag) or (function is np.where and len(given) == 3):
            return _elementwise(function.__name__, *given)
        if function is np.clip and len(given) == 3 and not options:
            return _elementwise("minimum", _elementwise("maximum", *given[:2]), given[2])
        return _symbols(function(*map(_plain, given), **{k: _plain(v) for k, v in options.items()}))


class Symbol(_Reads, np.lib.mixins.NDArrayOperatorsMixin):
    """A number that is not known yet: ``re`` + i ``im``, to first order in ``im``."""

    __slots__ = ("im", "re")
    shape, ndim = (), 0

    def __init__(self, re: Part, im: Part = 0.0):
        self.re, self.im = re, im

    @property
    def real(self) -> Any:
        return apply("real", self)

    @property
    def imag(self) -> Any:
        return apply("imag", self)

    def __bool__(self):
        raise TypeError("a branch on a value")

    __hash__ = None  # type: ignore[assignment]


class Symbols(_Reads, np.ndarray):
    """An array of symbols and numbers, dtype object."""

    @property  # type: ignore[misc]
    def real(self):
        return _elementwise("real", self)

    @property  # type: ignore[misc]
    def imag(self):
        return _elementwise("imag", self)

    def astype(self, *given, **options):
        return self.copy()


def iterated(advance: Callable[[Any], tuple[Any, Any]], x: Any, times: int) -> Any:
    """x after ``x, done = advance(x)`` until all points are ``done``, ``times`` at most.

    For iterations of laws: it can be read as a formula, where a loop with a branch cannot. ``x`` is real.
    """
    if not isinstance(x, Symbols):
        for _ in range(times):
            x, done = advance(x)
            if done.all():
                break
        return x
    starts = [_parts(each) for each in x.flat]
    inside = [node("variable", (next(_variables),), True) for _ in starts]
    found = [np.ravel(each) for each in advance(_filled(x.shape, map(Symbol, inside)))]
    answers = []
    for (start, step), variable, following, done in zip(starts, inside, *found, strict=True):
        (value, slope), (ends, _) = _parts(following), _parts(done)
        if step != 0 or slope != 0:
            raise TypeError("a complex step through an iteration")
        answers.append(Symbol(node("iterated", (start, variable, value, ends, times), True)))
    return _filled(x.shape, answers)
