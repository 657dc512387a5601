"""The source of a scalar loop that computes what a function has answered to symbols."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cutbench.base.graph import Node, congruent
from cutbench.base.symbols import Symbol

_OPERATORS = {
    "add": "+", "subtract": "-", "multiply": "*", "true_divide": "/", "power": "**", "logical_and": "and",
    "logical_or": "or",
}  # fmt: skip
#: Of numbers that may be complex their real parts are compared, as laws do.
_COMPARISONS = {
    "greater": ">", "greater_equal": ">=", "less": "<", "less_equal": "<=", "equal": "==", "not_equal": "!=",
}  # fmt: skip


def _text(part: Any) -> str:
    if isinstance(part, Node):
        return f"t{part.order}"
    if isinstance(part, bool) or math.isfinite(part):
        return f"({part!r})"
    return "np.nan" if math.isnan(part) else "np.inf" if part > 0 else "(-np.inf)"


def _real(part: Any) -> str:
    return _text(part) + (".real" if isinstance(part, Node) else "")


def _value(x: Any) -> Any:
    value, step = (x.re, x.im) if isinstance(x, Symbol) else (float(x), 0.0)
    if step != 0 or (isinstance(value, Node) and value.truth):
        raise TypeError("an answer that is no real number")
    return float(value) if isinstance(value, (bool, int)) else value


def _expression(node: Node) -> str:
    name, args = node.name, node.args
    texts = [_text(a) for a in args]
    if sign := _OPERATORS.get(name):
        return f" {sign} ".join(texts)
    if sign := _COMPARISONS.get(name):
        return f"{_real(args[0])} {sign} {_real(args[1])}"
    match name:
        case "where":
            return f"{texts[1]} if {texts[0]} else {texts[2]}"
        case "maximum" | "minimum":  # what is not a number stays none
            a, sign = _real(args[0]), ">=" if name == "maximum" else "<="
            return f"{texts[0]} if {a} {sign} {_real(args[1])} or {a} != {a} else {texts[1]}"
        case "real":
            return _real(args[0])
        case "negative":
            return f"-{texts[0]}"
        case "logical_not":
            return f"not {texts[0]}"
        case "signbit":
            return f"np.signbit({_real(args[0])})"
    return f"np.{name}({', '.join(texts)})"


class Formula:
    """Of an answer: ``source`` of ``loop(q, x0, x1, …, out)`` with numbers q and arrays (rows, n), of
    which inputs ``numbers`` and ``arrays`` say; ``rows`` of ``out``; and ``build``, an expression that
    makes the answer of ``o``, which is ``out``, and the points' ``shape``. ``keep`` names an object for it.
    The symbols are at ``points``, the last axes of arrays.
    """

    def __init__(self, answer: Any, points: tuple[int, ...], keep: Callable[[Any], str]):
        self._points, self._keep = points, keep
        self._outputs: list[Any] = []
        self.build = self._built(answer)
        self.rows = len(self._outputs)
        nodes = self._nodes()
        leaves = [node for node in nodes if node.name == "leaf"]
        self.numbers = list(dict.fromkeys(n.args[0] for n in leaves if not n.varies))
        self.arrays = list(dict.fromkeys(n.args[0] for n in leaves if n.varies))
        once: list[str] = []
        each: list[str] = []
        inside = self._inside(nodes)
        for node in nodes:
            if not inside[node]:
                (each if node.varies else once).extend(self._lines(node, nodes, inside))
        each += [f"out[{row}, i] = {_text(part)}" for row, part in enumerate(self._outputs)]
        head = f"def loop(q, {''.join(f'x{k}, ' for k in range(len(self.arrays)))}out):"
        body = [*once, "for i in range(out.shape[1]):", *("    " + line for line in each)]
        self.source = "\n".join([head, *("    " + line for line in body), ""])

    def _built(self, x: Any) -> str:
        """An expression for a part of the answer."""
        if isinstance(x, Symbol):
            if isinstance(value := _value(x), Node) and value.varies:
                raise TypeError("one number of many points")
            return f"o[{self._row(x)}, 0]"
        if isinstance(x, np.ndarray):
            split = x.ndim - len(self._points)
            if split < 0 or x.shape[split:] != self._points:
                if x.dtype == object:
                    raise TypeError("an array of symbols that does not run over points")
                return self._keep(x)
            first, lead = len(self._outputs), x.shape[:split]
            for row in x.reshape(-1, math.prod(self._points)):
                self._row(row[0])
                for point, each in enumerate(row):
                    if not congruent(self._outputs[-1], _value(each), point):
                        raise TypeError("an answer at one point that depends on others")
            return f"o[{first}:{len(self._outputs)}].reshape({lead} + shape)"
        if isinstance(x, dict):
            return f"{{{', '.join(f'{self._keep(k)}: {self._built(v)}' for k, v in x.items())}}}"
        if isinstance(x, (tuple, list)):
            parts = "".join(f"{self._built(each)}, " for each in x)
            kind = self._keep(type(x))
            return f"{kind}({parts})" if hasattr(x, "_fields") else f"{kind}(({parts}))"
        return self._keep(x)

    def _row(self, x: Any) -> int:
        self._outputs.append(_value(x))
        return len(self._outputs) - 1

    def _nodes(self) -> list[Node]:
        """All that is needed, what each needs before it."""
        found, left = set(), [part for part in self._outputs if isinstance(part, Node)]
        while left:
            if (node := left.pop()) not in found:
                found.add(node)
                left += [part for part in node.args if isinstance(part, Node)]
        return sorted(found, key=lambda node: node.order)

    def _inside(self, nodes: list[Node]) -> dict[Node, set[Node]]:
        """The iterations' variables that each depends on, outside of which it has no value."""
        inside: dict[Node, set[Node]] = {}
        for node in nodes:
            within = {node} if node.name == "variable" else set()
            for part in node.args:
                within |= inside[part] if isinstance(part, Node) else set()
            inside[node] = within - {node.args[1]} if node.name == "iterated" else within
        return inside

    def _lines(self, node: Node, nodes: list[Node], inside: dict[Node, set[Node]]) -> list[str]:
        name = _text(node)
        if node.name == "leaf":
            number, row, _ = node.args
            if node.varies:
                return [f"{name} = x{self.arrays.index(number)}[{row}, i]"]
            return [f"{name} = q[{self.numbers.index(number)}]"]
        if node.name == "variable":
            return []
        if node.name != "iterated":
            return [f"{name} = {_expression(node)}"]
        start, variable, value, done, times = node.args
        now = _text(variable)
        body = [line for n in nodes if variable in inside[n] for line in self._lines(n, nodes, inside)]
        body += [f"{name} = {_text(value)}", f"if {_text(done)}:", "    break", f"{now} = {name}"]
        return [f"{now} = {_text(start)}", f"for _ in range({times}):", *("    " + line for line in body)]
