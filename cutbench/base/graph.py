"""Operations on numbers that are not known yet: nodes, each once, and how one depends on another."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import local
from typing import Any

import numpy as np

#: Operations that are true or false.
TRUTHS = {
    "greater", "greater_equal", "less", "less_equal", "equal", "not_equal", "signbit",
    "logical_and", "logical_or", "logical_not",
}  # fmt: skip


class Node:
    """An operation on nodes and numbers; ``varies`` from point to point or not."""

    __slots__ = ("args", "name", "order", "varies")

    def __init__(self, name: str, args: tuple, varies: bool, order: int):
        self.name, self.args, self.varies, self.order = name, args, varies, order

    @property
    def truth(self) -> bool:
        """Whether it is true or false, not a number."""
        return self.name in TRUTHS or (self.name == "where" and is_truth(self.args[1]))


Part = Any  # Node, float or bool


def is_truth(part: Part) -> bool:
    return part.truth if isinstance(part, Node) else isinstance(part, (bool, np.bool_))


class Graph:
    """The nodes of one reading, each once. ``finite``: no number of it is infinite or none at all."""

    def __init__(self, finite: bool = False) -> None:
        self.finite = finite
        self._known: dict[tuple, Node] = {}

    def node(self, name: str, args: tuple, varies: bool) -> Node:
        # 0.0 and -0.0, 1.0 and True are equal, but not the same.
        key = (name, *((id(a),) if isinstance(a, Node) else repr(a) for a in args))
        return self._known.setdefault(key, Node(name, args, varies, len(self._known)))


class _Now(local):
    graph: Graph | None = None


_now = _Now()


@contextmanager
def symbolic(*, finite: bool = False) -> Iterator[None]:
    """In which functions may be called with symbols. ``finite``: nothing is left of a product with 0."""
    _now.graph = Graph(finite)
    try:
        yield
    finally:
        _now.graph = None


def under_way() -> bool:
    """Whether a function is being read, in this thread."""
    return _now.graph is not None


def node(name: str, args: tuple, varies: bool) -> Node:
    """That of the reading under way."""
    if _now.graph is None:
        raise TypeError("symbols out of place")
    return _now.graph.node(name, args, varies)


def number(part: Part) -> Part:
    """1 for true, 0 for false."""
    if not is_truth(part):
        return part
    return make("where", part, 1.0, 0.0) if isinstance(part, Node) else float(part)


def make(name: str, *args: Part) -> Part:
    """The real value of an operation on real values."""
    if name.startswith("logical"):
        if not all(map(is_truth, args)):
            raise TypeError("a logical operation on numbers")
    elif name != "where" or not (is_truth(args[1]) and is_truth(args[2])):
        args = (args[0], *map(number, args[1:])) if name == "where" else tuple(map(number, args))
    if not any(isinstance(a, Node) for a in args):
        with np.errstate(all="ignore"):
            value: Any = np.where(*args) if name == "where" else getattr(np, name)(*args)
        return bool(value) if name in TRUTHS or value.dtype == bool else float(value)
    if _now.graph is not None and _now.graph.finite:
        match name, args:
            case ("multiply", (0.0, _) | (_, 0.0)) | ("true_divide", (0.0, _)):
                return 0.0
            case ("add", (0.0, a) | (a, 0.0)) | ("subtract", (a, 0.0)):
                return a
            case ("subtract", (0.0, a)):
                return make("negative", a)
    match name, args:
        case ("positive", (a,)):
            return a
        case ("multiply", (1.0, a)) | ("multiply" | "true_divide", (a, 1.0)):
            return a
        case ("multiply", (-1.0, a)):
            return make("negative", a)
        case ("where", (bool() as c, a, b)):
            return a if c else b
        case ("where", (_, a, b)) if a is b:
            return a
        case ("logical_and", (bool() as c, a) | (a, bool() as c)):
            return a if c else False
        case ("logical_or", (bool() as c, a) | (a, bool() as c)):
            return True if c else a
        case ("square", (a,)):
            return make("multiply", a, a)
        case ("power", (a, float() as n)) if n in (1.0, 2.0, 3.0, 4.0):
            square = a if n == 1 else make("multiply", a, a)
            return square if n <= 2 else make("multiply", square, a if n == 3 else square)
        case ("power", (a, 0.5)):
            return make("sqrt", a)
    return node(name, args, any(isinstance(a, Node) and a.varies for a in args))


def add(a: Part, b: Part) -> Part:
    return b if a == 0 else a if b == 0 else make("add", a, b)


def times(a: Part, b: Part) -> Part:
    return 0.0 if (a == 0 or b == 0) else make("multiply", a, b)


def over(a: Part, b: Part) -> Part:
    return make("true_divide", a, b)


#: Of value and arguments, the derivatives by the arguments.
_SLOPES: dict[str, Callable[..., tuple[Part, ...]]] = {
    "add": lambda v, a, b: (1.0, 1.0),
    "subtract": lambda v, a, b: (1.0, -1.0),
    "multiply": lambda v, a, b: (b, a),
    "true_divide": lambda v, a, b: (over(1.0, b), make("negative", over(v, b))),
    "power": lambda v, a, n: (
        times(n, make("power", a, make("subtract", n, 1.0))),
        make("multiply", v, make("log", a)),
    ),
    "negative": lambda v, a: (-1.0,),
    "positive": lambda v, a: (1.0,),
    "square": lambda v, a: (times(2.0, a),),
    "reciprocal": lambda v, a: (make("negative", make("multiply", v, v)),),
    "sqrt": lambda v, a: (over(0.5, v),),
    "exp": lambda v, a: (v,),
    "expm1": lambda v, a: (make("exp", a),),
    "log": lambda v, a: (over(1.0, a),),
    "log1p": lambda v, a: (over(1.0, make("add", 1.0, a)),),
    "tanh": lambda v, a: (make("subtract", 1.0, make("multiply", v, v)),),
    "sin": lambda v, a: (make("cos", a),),
    "cos": lambda v, a: (make("negative", make("sin", a)),),
    "sinh": lambda v, a: (make("cosh", a),),
    "cosh": lambda v, a: (make("sinh", a),),
    "arctan": lambda v, a: (over(1.0, make("add", 1.0, make("multiply", a, a))),),
}


def slopes(name: str, value: Part, args: Sequence[Part], moving: Sequence[Part]) -> Part:
    """What ``value`` of a function changes by where its arguments change by ``moving``."""
    changes: Part = 0.0
    for by, change in zip(_SLOPES[name](value, *args), moving, strict=True):
        changes = add(changes, times(by, change))
    return changes


def congruent(first: Part, other: Part, point: int) -> bool:
    """Whether ``other`` is at ``point`` what ``first`` is at point 0, and neither knows other points."""
    known: dict[Node, Node] = {}
    left = [(first, other)]
    while left:
        a, b = left.pop()
        if not (isinstance(a, Node) and isinstance(b, Node)):
            if isinstance(a, Node) or isinstance(b, Node) or repr(a) != repr(b):
                return False
        elif a in known or a.name != b.name:
            if known.get(a) is not b:
                return False
        else:
            known[a] = b
            if a.name == "leaf":
                if a.args[:2] != b.args[:2] or (a.args[2], b.args[2]) != (0, point if b.varies else 0):
                    return False
            elif a.name != "variable":
                left += zip(a.args, b.args, strict=True)
    return True
