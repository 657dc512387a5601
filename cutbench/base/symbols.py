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
from typing import Any

import numpy as np

#: A complex number with a larger imaginary part is no complex step.
SMALLEST_STEP = 1e-15
TRUTHS = {
    "greater", "greater_equal", "less", "less_equal", "equal", "not_equal", "signbit",
    "logical_and", "logical_or", "logical_not",
}  # fmt: skip
#: Other names of the same functions.
_SAME = {
    "divide": "true_divide", "bitwise_and": "logical_and", "bitwise_or": "logical_or",
    "invert": "logical_not", "fmax": "maximum", "fmin": "minimum", "float_power": "power",
    "conjugate": "positive", "fabs": "absolute",
}  # fmt: skip


class Node:
    """An operation on nodes and numbers; ``varies`` from point to point or not."""

    __slots__ = ("args", "name", "order", "varies")

    def __init__(self, name: str, args: tuple, varies: bool, order: int):
        self.name, self.args, self.varies, self.order = name, args, varies, order

    @property
    def truth(self) -> bool:
        """Whether it is true or false, not a number."""
        return self.name in TRUTHS or (self.name == "where" and _truth(self.args[1]))


Part = Any  # Node, float or bool


def _truth(part: Part) -> bool:
    return part.truth if isinstance(part, Node) else isinstance(part, (bool, np.bool_))


class Graph:
    """The nodes of one reading, each once."""

    def __init__(self) -> None:
        self._known: dict[tuple, Node] = {}

    def node(self, name: str, args: tuple, varies: bool) -> Node:
        # 0.0 and -0.0, 1.0 and True are equal, but not the same.
        key = (name, *((id(a),) if isinstance(a, Node) else repr(a) for a in args))
        return self._known.setdefault(key, Node(name, args, varies, len(self._known)))

    def __len__(self) -> int:
        return len(self._known)


_graph = Graph()


def begin() -> None:
    """A new reading."""
    global _graph
    _graph = Graph()


def leaf(number: int, shape: tuple[int, ...] | None = None, points: tuple[int, ...] = ()) -> Any:
    """Input ``number``: a number, or an array of ``shape`` at each of the ``points``, its last axes."""
    if shape is None:
        return Symbol(_graph.node("leaf", (number, 0, 0), False))
    count = math.prod(points)
    each = (
        Symbol(_graph.node("leaf", (number, *divmod(k, count)), True))
        for k in range(math.prod(shape) * count)
    )
    return _filled(shape + points, each)


def _filled(shape: tuple[int, ...], items: Iterable) -> Symbols:
    array = np.empty(shape, object)
    for k, item in enumerate(items):
        array.flat[k] = item
    return array.view(Symbols)


def _number(part: Part) -> Part:
    if not _truth(part):
        return part
    return _make("where", part, 1.0, 0.0) if isinstance(part, Node) else float(part)


def _make(name: str, *args: Part) -> Part:
    """The real value of an operation on real values."""
    if name.startswith("logical"):
        if not all(map(_truth, args)):
            raise TypeError("a logical operation on numbers")
    elif name != "where" or not (_truth(args[1]) and _truth(args[2])):
        args = (args[0], *map(_number, args[1:])) if name == "where" else tuple(map(_number, args))
    if not any(isinstance(a, Node) for a in args):
        with np.errstate(all="ignore"):
            value: Any = np.where(*args) if name == "where" else getattr(np, name)(*args)
        return bool(value) if name in TRUTHS or value.dtype == bool else float(value)
    match name, args:
        case ("positive", (a,)):
            return a
        case ("multiply", (1.0, a)) | ("multiply" | "true_divide", (a, 1.0)):
            return a
        case ("multiply", (-1.0, a)):
            return _make("negative", a)
        case ("where", (bool() as c, a, b)):
            return a if c else b
        case ("where", (_, a, b)) if a is b:
            return a
        case ("logical_and", (bool() as c, a) | (a, bool() as c)):
            return a if c else False
        case ("logical_or", (bool() as c, a) | (a, bool() as c)):
            return True if c else a
        case ("square", (a,)):
            return _make("multiply", a, a)
        case ("power", (a, float() as n)) if n in (1.0, 2.0, 3.0, 4.0):
            square = a if n == 1 else _make("multiply", a, a)
            return square if n <= 2 else _make("multiply", square, a if n == 3 else square)
        case ("power", (a, 0.5)):
            return _make("sqrt", a)
    return _graph.node(name, args, any(isinstance(a, Node) and a.varies for a in args))


def _add(a: Part, b: Part) -> Part:
    return b if a == 0 else a if b == 0 else _make("add", a, b)


def _times(a: Part, b: Part) -> Part:
    return 0.0 if (a == 0 or b == 0) else _make("multiply", a, b)


def _over(a: Part, b: Part) -> Part:
    return _make("true_divide", a, b)


#: Of value and arguments, the derivatives by the arguments.
_SLOPES: dict[str, Callable[..., tuple[Part, ...]]] = {
    "add": lambda v, a, b: (1.0, 1.0),
    "subtract": lambda v, a, b: (1.0, -1.0),
    "multiply": lambda v, a, b: (b, a),
    "true_divide": lambda v, a, b: (_over(1.0, b), _make("negative", _over(v, b))),
    "negative": lambda v, a: (-1.0,),
    "positive": lambda v, a: (1.0,),
    "square": lambda v, a: (_times(2.0, a),),
    "reciprocal": lambda v, a: (_make("negative", _make("multiply", v, v)),),
    "sqrt": lambda v, a: (_over(0.5, v),),
    "exp": lambda v, a: (v,),
    "expm1": lambda v, a: (_make("exp", a),),
    "log": lambda v, a: (_over(1.0, a),),
    "log1p": lambda v, a: (_over(1.0, _make("add", 1.0, a)),),
    "tanh": lambda v, a: (_make("subtract", 1.0, _make("multiply", v, v)),),
    "sin": lambda v, a: (_make("cos", a),),
    "cos": lambda v, a: (_make("negative", _make("sin", a)),),
    "sinh": lambda v, a: (_make("cosh", a),),
    "cosh": lambda v, a: (_make("sinh", a),),
    "arctan": lambda v, a: (_over(1.0, _make("add", 1.0, _make("multiply", a, a))),),
}


def _power_slopes(v: Part, a: Part, n: Part) -> tuple[Part, Part]:
    return _times(n, _make("power", a, _make("subtract", n, 1.0))), _make("multiply", v, _make("log", a))


def apply(name: str, *given: Any) -> Any:
    """An elementwise function of symbols and numbers."""
    name = _SAME.get(name, name)
    parts = [_parts(x) for x in given]
    re, im = [r for r, _ in parts], [i for _, i in parts]
    if name == "real":
        return Symbol(_make("real", re[0]) if isinstance(re[0], Node) else re[0])
    if name == "imag":
        return Symbol(im[0])
    # A complex step alone leaves the value what it is, and what follows from it is not computed again.
    steps = name == "add" and isinstance(given[1], complex) and re[1] == 0
    value = re[0] if steps else _make(name, *re)
    slope: Part = 0.0
    if name == "where":
        slope = _make("where", re[0], im[1], im[2]) if any(i != 0 for i in im[1:]) else 0.0
    elif name in ("maximum", "minimum"):
        if any(i != 0 for i in im):
            first = _make("greater_equal" if name == "maximum" else "less_equal", *re)
            slope = _make("where", first, *im)
    elif any(i != 0 for i in im) and name not in TRUTHS:
        if name == "power":
            slopes = [(_power_slopes(value, *re)[k], i) for k, i in enumerate(im) if i != 0]
        else:
            slopes = list(zip(_SLOPES[name](value, *re), im, strict=True))
        for by, i in slopes:
            slope = _add(slope, _times(by, i))
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
    inside = [_graph.node("variable", (len(_graph),), True) for _ in starts]
    found = [np.ravel(each) for each in advance(_filled(x.shape, map(Symbol, inside)))]
    answers = []
    for (start, step), variable, following, done in zip(starts, inside, *found, strict=True):
        (value, slope), (ends, _) = _parts(following), _parts(done)
        if step != 0 or slope != 0:
            raise TypeError("a complex step through an iteration")
        answers.append(Symbol(_graph.node("iterated", (start, variable, value, ends, times), True)))
    return _filled(x.shape, answers)


def congruent(first: Part, other: Part, point: int) -> bool:
    """Whether ``other`` is at ``point`` what ``first`` is at point 0, and neither knows other points."""
    known: dict[Node, Node] = {}
    seen: set[tuple[Node, Node]] = set()
    left = [(first, other)]
    while left:
        a, b = left.pop()
        if not (isinstance(a, Node) and isinstance(b, Node)):
            if isinstance(a, Node) or isinstance(b, Node) or repr(a) != repr(b):
                return False
        elif known.setdefault(a, b) is not b or a.name != b.name:
            return False
        elif a.name == "leaf":
            if a.args[:2] != b.args[:2] or (a.args[2], b.args[2]) != (0, point if b.varies else 0):
                return False
        elif a.name != "variable" and (a, b) not in seen:
            seen.add((a, b))
            left += zip(a.args, b.args, strict=True)
    return True
