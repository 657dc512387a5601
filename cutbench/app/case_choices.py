"""What the page lets a person choose, and the case that this makes."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cutbench.base.errors import BadInput
from cutbench.base.units import Parameter
from cutbench.case.case import Case, known_materials, load_case
from cutbench.case.model import section_of
from cutbench.case.motion import UNTIL
from cutbench.case.numerics import PRESETS
from cutbench.mechanisms import Tool, registry

#: A slider reaches so many times below and above the material's value.
_SPAN = 20.0
#: What a request may hold.
_KEYS = ("material", "tool", "values", "numerics", "until")


def materials() -> list[dict]:
    """Each known material with its sliders, by tool: ``{"name": …, "tools": {…: [slider, …]}}``."""
    found = []
    for name, case in known_materials().items():
        sliders = {}
        for tool in tools():
            try:
                of_tool = _with(case, tool)
            except BadInput:  # one that needs a file of its own
                continue
            sliders[tool] = [_slider(q, of_tool) for q in of_tool.model.parameters().values()]
        found.append({"name": name, "tools": sliders})
    return found


def tools() -> dict[str, str]:
    """The blades that a model can have, with their titles; the usual one first."""
    laws = [law for law in registry().values() if isinstance(law, Tool)]
    return {law.name: law.title for law in sorted(laws, key=lambda law: (not law.standard, law.name))}


def case_from_request(request: Mapping[str, object]) -> Case:
    """The case of what the page sends: ``{"material": "gelatin", "tool": "wedge", "values": {"G": "8 kPa"},
    "numerics": "fast", "until": "transition"}``. Raises BadInput naming the key."""
    for key in request:
        if key not in _KEYS:
            raise BadInput(key, request[key], f"one of {', '.join(_KEYS)}")
    name, values = request.get("material", "gelatin"), request.get("values", {})
    if name not in known_materials():
        raise BadInput("material", name, f"one of {', '.join(known_materials())}")
    if not isinstance(values, Mapping):
        raise BadInput("values", values, "an object of texts by name")
    given = {key: _number(text) for key, text in values.items()}
    numerics, until = request.get("numerics", PRESETS[0]), request.get("until", UNTIL[0])
    case = _with(load_case(str(name)), str(request.get("tool", next(iter(tools())))))
    return case.set(**given, numerics=numerics, until=until)


def case_preview(case: Case) -> dict:
    """What the page says of a case before it is run."""
    return {
        "id": case.id,
        "groups": [{"name": name, "value": float(f"{value:.4g}")} for name, value in case.groups().items()],
        "doubts": list(case.doubts),
        "depth_mm": case.p.depth,
    }


def _with(case: Case, tool: str) -> Case:
    if tool not in tools():
        raise BadInput("tool", tool, f"one of {', '.join(tools())}")
    return case if tool in case.mechanisms else case.set(with_=tool)


def _number(text: object) -> object:
    """A number that stands alone as one: a parameter without a unit."""
    try:
        return float(str(text))
    except ValueError:
        return text


def _slider(q: Parameter, case: Case) -> dict:
    """Name, unit and words of a parameter, its value, and from where to where a slider goes."""
    value = case.values[q.name] / q.factor
    span = abs(value) or abs(q.typical)
    low, high = (value / _SPAN, value * _SPAN) if value > 0 else (min(0.0, value), _SPAN / 4 * span)
    low = max(low, -math.inf if q.low is None else q.low)
    high = min(high, math.inf if q.high is None else q.high)
    return {
        "name": q.name,
        "unit": "" if q.unit == "1" else q.unit,
        "symbol": q.symbol,
        "doc": q.doc,
        "section": section_of(q.name),
        "value": float(f"{value:.6g}"),
        "low": float(f"{low:.3g}"),
        "high": float(f"{high:.3g}"),
        "log": low > 0,
    }
