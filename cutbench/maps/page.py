"""``map.html``: a map as one page that needs no network; a point shows its curve and its force split.

Plotly draws it; its part for plane axes lies in ``web/plotly`` and is written into the page. All words and
numbers of a run are put together here, so that the script has to choose and to draw only.
"""

from __future__ import annotations

import heapq
import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import to_hex
from scipy.integrate import cumulative_trapezoid
from scipy.special import ndtr

from cutbench.base.errors import BadInput
from cutbench.base.greek import plain_formula, plain_symbol, subscripted
from cutbench.base.report import Table, filled, packaged_text
from cutbench.base.units import Parameter
from cutbench.case.case import Case
from cutbench.case.physics import Physics
from cutbench.maps.axes import Axis
from cutbench.maps.closed_form_estimates import margin_on_grid
from cutbench.maps.dataset import (
    ESTIMATE,
    LABELS,
    NOT_COMPUTED,
    NUMBERS,
    OUTCOME_FLAGS,
    MapRun,
    axes_of,
    axis_of,
    computed_by,
    physics_by_place,
    places_of,
    runs_of,
)
from cutbench.maps.guidance import MapReader
from cutbench.maps.phase import shown_strips
from cutbench.maps.plot_coordinates import DROP_COLOURS, SMALLEST_IN_LOG, between, drop_text
from cutbench.run.figures.curve import ledger_shares, look_of, smooth_force, title_of
from cutbench.run.measures import NOTED, UNCUT, forward
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

#: Where the parts of the page lie.
_PLACE = "cutbench.maps"
#: Of more runs than these the curves have half the points.
_MAX_RUNS_IN_DETAIL = 300
#: A curve is thinned until what is drawn is so near to it, relative to its largest force; to so many points
#: at the most.
CURVE_TOLERANCE, MAX_CURVE_POINTS = 0.005, 120
#: Numbers of a curve are whole multiples of its largest force divided by this.
STEPS = 2000
#: Shares that are small throughout, together; and what the energy balance leaves of the mean force.
OTHERS, REST = "others", "rest"
#: Levels of an estimate along an axis that is walked by a slider; points along those that are shown.
LEVELS, FINE = 17, 41
#: Points of the classical estimates along an axis that is shown.
_ESTIMATED_POINTS = 13
#: Points of an estimate at the most: the page grows by each of them.
_MAX_POINTS = 60_000
#: Numbers of a layer are thousandths.
PER = 1000
#: Numbers of a run whose names alone do not tell them apart.
_TITLES = {
    "drop_rel": "force drop",
    "peak_mm": "peak at",
    "max_N": "largest force",
    "steady_N": "steady force",
    "crossed_mm": "crossed from",
    "crossed_mm2": "crossed area",
    "snap_rel": "work in jumps",
}
_CLOSURE = "what the energy balance does not account for, relative to the work of the blade"
#: Kinds of points where they are not the labels of runs.
_KINDS = {NOT_COMPUTED: "not computed", UNCUT: "not cut"}
#: A quantity of a run and the parameter that it sets; None where its model has none.
Pair = tuple[float, float] | None
TO_COME, NO_RUN = "to come", "no run of its own"


def page(data: xr.Dataset, store: Store | None) -> str:
    """The whole page as HTML, its data, its style and its scripts in it; curves come from ``store``, and are
    missing without one."""
    drawn = contents(data, store)
    # "</script>" in a title must not end the script.
    content = json.dumps(drawn, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")
    parts = {
        "TITLE": escape(data.attrs["title"]),
        "BY": escape(f"{data.attrs[ESTIMATE] or 'Computed'}; by {computed_by(data)}."),
        "STYLE": packaged_text(_PLACE, "web/page.css"),
        "CONTROLS": _controls(drawn),
        "MARKS": _marks(drawn["points"]),
        "TABLE": _table(data).html_rows(),
        "DATA": content,
        "PLOTLY": packaged_text(_PLACE, "web/plotly/plotly-cartesian.min.js"),
        "SCRIPT": packaged_text(_PLACE, "web/page.js"),
    }
    return filled(_PLACE, "web/page.html", parts)


def contents(data: xr.Dataset, store: Store | None) -> dict:
    """What the script draws, as plain data: axes, layers, strips, points with their curves and words."""
    names, runs = axes_of(data), runs_of(data)
    results = [store.get(run.id) if store is not None and run.id else None for run in runs]
    most = MAX_CURVE_POINTS if len(runs) <= _MAX_RUNS_IN_DETAIL else MAX_CURVE_POINTS // 2
    curves = [curve_of(result, most) if result else None for result in results]
    shown = [data.attrs[f"plot_{which}"] for which in ("x", "y")]
    entries = list(dict.fromkeys(name for curve in curves if curve for name in curve["split"]))
    layers, axes = layers_of(data), {name: axis_of(data, name) for name in names}
    physics = _physics_of(data, runs, results)
    quantities = _quantities(physics)
    points = [
        _point(run, axes, curve)
        | {"rows": _rows(run, axes, result, [(q, q.values(own)) for q in quantities])}
        for run, result, curve, own in zip(runs, results, curves, physics, strict=True)
    ]
    ladder = layers["chance"]["values"] if "margin" in data and "chance" in layers else None
    drops = [_number(run, "drop_rel") or 0.0 for run in runs]
    drops += [z / PER for z in layers.get("drop", {}).get("z", ()) if z is not None]
    threshold = float(data.attrs["drop_threshold"])
    looks = json.loads(packaged_text(_PLACE, "web/looks.json"))
    looks["shades"]["drop"]["colorbar"]["title"]["text"] = drop_text(data)
    return {
        "axes": [
            _axis(axes[name], ladder[k] if ladder else places_of(data)[name]) for k, name in enumerate(names)
        ],
        "x": names.index(shown[0]),
        "y": names.index(shown[1]) if shown[1] else -1,
        "threshold": threshold,
        "line": _line_title(data),
        "top": min(1.0, max(math.ceil(10 * max(drops, default=0.0) - 1e-9) / 10, 2 * threshold)),
        "gridded": list(data["label"].dims) == names,
        "sought": "margin" in data,
        "points": points,
        "layers": layers,
        "strips": shown_strips(data),
        "entries": _entries(entries),
        "colours": [[k / 16, to_hex(DROP_COLOURS(k / 16))] for k in range(17)],
        "looks": looks,
    }


def _kind(run: MapRun) -> str:
    """Its regime in words, or why there is none."""
    if not run.outcome or run.outcome == OUTCOME_FLAGS[0]:
        return TO_COME if run.outcome else NO_RUN
    return _KINDS.get(run.label, run.label)


def _number(run: MapRun, name: str) -> float | None:
    """One of its numbers; None where there is none."""
    return _short(run.columns.get(name, math.nan))


def _point(run: MapRun, axes: Mapping[str, Axis], curve: dict | None) -> dict:
    """What the page says of one run, but for its numbers."""
    drop, name = _number(run, "drop_rel"), f"{run.mark}: " if run.mark else ""
    where = ", ".join(f"{_label(axis)} {_on_axis(axis, run.at[name])}" for name, axis in axes.items())
    hover, head = (
        "" if drop is None else f"{words} {_percent(drop)}"
        for words in (", force drop", ": the force falls by")
    )
    return {
        "id": run.id or f"mark-{run.mark}", "mark": run.mark, "kind": _kind(run),
        "at": [_short(value) for value in run.at.values()], "drop": drop,
        "text": f"{escape(name)}{_kind(run)}{hover}<br>{where}", "head": f"{name}{_kind(run)}{head}",
        "notes": _notes(run, curve), "curve": curve, "spots": _spots(run, curve),
    }  # fmt: skip


def _notes(run: MapRun, curve: dict | None) -> str:
    reached, crossed, drag = (_number(run, n) for n in ("reached_mm", "crossed_mm", "drag_steps"))
    message, error = str(run.columns.get("message", "")), curve["error"] if curve else 0.0
    without = "its curve is not here: the page was written without the folder of the runs"
    notes = {
        f"not as on the map: {subscripted(plain_formula(run.differs))}": run.differs,
        run.outcome + ("" if reached is None else f" at {_text(reached, 'mm')}"):
            run.outcome not in ("", "done", OUTCOME_FLAGS[0]),
        escape(message): message,
        f"its surface passes through itself from {_text(crossed, 'mm')} on": crossed is not None,
        f"{drag or 0:.0f} points of the curve needed raised damping": drag,
        without: run.id and run.outcome != OUTCOME_FLAGS[0] and curve is None,
        f"lines stay within {_percent(error)} of the largest force or share": error,
    }  # fmt: skip
    return "; ".join(text for text, holds in notes.items() if holds)


def _rows(
    run: MapRun, axes: Mapping[str, Axis], result: Result | None, quantities: Sequence[tuple[_Quantity, Pair]]
) -> str:
    """The run's numbers as rows of a table."""
    drawn, known, rows = set(), {q.name: (q, pair) for q, pair in quantities}, [_part("Where it is")]
    for name, axis in axes.items():
        q, pair = known.get(name, (None, None))
        drawn.add(plain_symbol(axis.symbol) if q is None else q.parameter.symbol)
        cells = [_on_axis(axis, run.at[name]), *(q.said(pair) if q else [])]
        symbol = "" if axis.mechanism else plain_symbol(axis.symbol)
        rows.append(_row(_label(axis), symbol, cells, axis.long_name))
    for q, pair in quantities:
        if pair and q.parameter.symbol not in drawn:
            title = q.parameter.doc if q.symbol == q.parameter.symbol else q.name.replace("_", " ")
            rows.append(_row(title, q.symbol, [_text(pair[0], q.unit), *q.said(pair)], q.parameter.doc))
    if not run.outcome:
        return "".join(rows)
    closure = math.nan if result is None else float(result.measures.get("closure", math.nan))
    numbers = {name: _number(run, name) for name in NUMBERS}
    entries = [
        *((_title(name), _text(value, NUMBERS[name][0]), NUMBERS[name][1])
          for name, value in numbers.items() if value or (value == 0 and name not in NOTED)),
        ("closure", _percent(closure) if math.isfinite(closure) else "", _CLOSURE),
        ("reached", _text(_number(run, "reached_mm"), "mm").strip("–"), "blade travel reached"),
        ("run", run.id, "its folder in the store"),
    ]  # fmt: skip
    rows.append(_part("What was found"))
    rows += [_row(title, "", [text], meaning) for title, text, meaning in entries if text]
    return "".join(rows)


def _spots(run: MapRun, curve: dict | None) -> list[tuple[float, float, str]]:
    """Onset and peak on the curve: travel (mm), force (N), name."""
    if curve is None:
        return []
    d, force, down = np.array(curve["d"]), curve["scale"] * np.array(curve["force"]), len(curve["mean"])
    return [
        (at, float(f"{np.interp(at, d[:down], force[:down]):.4g}"), name)
        for at, name in ((_number(run, f"{name}_mm"), name) for name in ("onset", "peak"))
        if at is not None and at <= d[-1]
    ]


@dataclass(frozen=True)
class _Quantity:
    """A group that a person can set, and the ``parameter`` that it sets; or a parameter of groups, itself."""

    name: str
    symbol: str
    unit: str
    parameter: Parameter

    def values(self, physics: Physics | Case | None) -> Pair:
        """The group and the parameter, in their units; None where a model has none."""
        if physics is None:
            return None
        group = physics.model.settable_groups().get(self.name)
        name = group.parameter if group else self.name
        if name not in physics.values:
            return None
        own = physics.values[name] / physics.model.parameters()[name].factor
        return (group.value(physics.p) if group else own), own

    def said(self, pair: Pair) -> list[str]:
        """The parameter in an equation; nothing where a model has none, or it is the quantity itself."""
        symbol, unit = self.parameter.symbol, self.parameter.unit
        return [f"{subscripted(symbol)} = {_text(pair[1], unit)}"] if pair and symbol != self.symbol else []


def _physics_of(
    data: xr.Dataset, runs: Sequence[MapRun], results: Sequence[Result | None]
) -> list[Physics | Case | None]:
    """Laws and values of each run; None where a place stands for none that this cutbench knows."""
    try:
        by_place = physics_by_place(data)
    except BadInput:
        return [None] * len(runs)
    physics: list[Physics | Case | None] = []
    for run, result in zip(runs, results, strict=True):
        try:
            physics.append(result.case if result else by_place(run.at) if not run.mark else None)
        except BadInput:
            physics.append(None)
    return physics


def _quantities(physics: Iterable[Physics | Case | None]) -> list[_Quantity]:
    """The groups of the runs' laws, and what they are made of and none sets, which makes values of them."""
    models = {p.model for p in physics if p is not None}
    known = {n: q for model in models for n, q in model.parameters().items()}
    groups = {n: g for model in models for n, g in model.settable_groups().items()}
    scales = {n for g in groups.values() for n in g.needs} - {g.parameter for g in groups.values()}
    settable = [_Quantity(n, plain_symbol(g.symbol), g.unit, known[g.parameter]) for n, g in groups.items()]
    return settable + [_Quantity(n, q.symbol, q.unit, q) for n, q in known.items() if n in scales]


# -- words and tables -------------------------------------------------------------------------------------
def _text(value: float | None, unit: str = "") -> str:
    if value is None:
        return "–"
    shown = f"{value:.3g}".replace("-", "−")
    return shown if unit in ("", "1") else f"{shown}\u00a0{unit.replace('^2', '²').replace('mm2', 'mm²')}"


def _percent(part: float) -> str:
    return f"{100 * part:.2g}\u00a0%".replace("1e+02", "100")


def _label(axis: Axis) -> str:
    return plain_symbol(axis.symbol) if axis.mechanism else axis.name.replace("_", " ")


def _on_axis(axis: Axis, value: float) -> str:
    return ("with" if value else "without") if axis.mechanism else _text(value, axis.unit)


def _title(name: str) -> str:
    return _TITLES.get(name, re.sub(r"_(rel|mm2?|N|mJ|N_per_mm)$", "", name).replace("_", " "))


def _part(title: str) -> str:
    return f'<tr class="part"><th colspan="3" scope="rowgroup">{title}</th></tr>'


def _row(title: str, symbol: str, cells: Sequence[str], meaning: str) -> str:
    tail = "".join(f"<td>{cell}</td>" for cell in cells)
    name = f"{escape(title)} {subscripted(symbol)}".strip()
    return f'<tr title="{escape(meaning)}"><th scope="row">{name}</th>{tail}</tr>'


def _line_title(data: xr.Dataset) -> str:
    surge = float(data.attrs["surge_threshold"])
    more = f", surge of {surge:g}" if math.isfinite(surge) else ""
    return f"drop of {_percent(data.attrs['drop_threshold'])}{more}"


def _entries(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Title, colour and pattern of each entry of the ledgers, as in pictures."""
    looks = {name: look_of("" if name in (OTHERS, REST) else name) for name in names}
    return {
        name: {"title": title, "colour": looks[name][0], "shape": looks[name][1]}
        for name, title in titles_of(names).items()
    }


def _axis(axis: Axis, values: Any) -> dict:
    """An axis as the script needs it: ``levels`` where a slider can stand, with their ``texts``, and how
    plotly draws it."""
    levels = np.unique([_short(v) for v in np.ravel(values) if np.isfinite(v)]).tolist()
    unit = "" if axis.unit == "1" else f" [{axis.unit.replace('^2', '²')}]"
    title = (
        axis.long_name
        if axis.mechanism
        else f"{axis.long_name} {subscripted(plain_symbol(axis.symbol))}{unit}"
    )
    ticks = list(axis.values) if axis.mechanism else _ticks(axis)
    texts = [_on_axis(axis, v) if axis.mechanism else f"{v:g}" for v in ticks]
    layout = {"title": {"text": title}, "type": axis.scale, "showgrid": False, "zeroline": False}
    layout |= {"ticks": "outside", "automargin": True}
    return {
        "name": axis.name, "label": _label(axis), "levels": levels,
        "texts": [_on_axis(axis, v) for v in levels],
        "layout": layout | ({"tickvals": ticks, "ticktext": texts} if ticks else {}),
    }  # fmt: skip


def _ticks(axis: Axis) -> list[float]:
    """Plain numbers on a logarithmic axis; none where plotly finds its own."""
    if axis.scale != "log":
        return []
    low, high = axis.values[0], axis.values[-1]
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    within = (1, 2, 5) if len(decades) < 4 else (1,)
    round_numbers = [float(f"{m * 10.0**k:.6g}") for k in decades for m in within]
    return [tick for tick in round_numbers if low / 1.3 <= tick <= high * 1.3]


def _controls(drawn: dict) -> str:
    """Which axes are across and up, the shading, and a slider for each other axis."""

    def select(id: str, text: str, options: Mapping[Any, str]) -> str:
        inner = "".join(f'<option value="{value}">{escape(name)}</option>' for value, name in options.items())
        return f'<label>{text} <select id="{id}">{inner}</select></label>'

    axes, plane = drawn["axes"], drawn["y"] >= 0
    labels = {k: axis["label"] for k, axis in enumerate(axes)}
    shades = {"drop": "force drop", "chance": "chance of abrupt", "none": "nothing"}
    shades = {name: text for name, text in shades.items() if name in drawn["layers"] or name == "none"}
    return "".join([
        *([select("x", "across", labels), select("y", "up", labels)] if plane else []),
        *([select("shade", "shading", shades)] if plane and drawn["layers"] else []),
        *(
            f'<label class="level" data-axis="{k}">{escape(axis["label"])} <output></output>'
            f'<input type="range" min="0" max="{len(axis["levels"]) - 1}" id="level-{axis["name"]}"></label>'
            for k, axis in enumerate(axes)
        ),
    ])  # fmt: skip


def _marks(points: Sequence[dict]) -> str:
    """The materials, each as a button that shows its own run."""
    lines = [
        f'<li><button type="button" data-id="{escape(p["id"])}">{escape(p["mark"])}</button> '
        f"{p['text'].split(': ', 1)[1].replace('<br>', '; ')}</li>"
        for p in points
        if p["mark"]
    ]
    return f'<section id="marks"><h2>Materials</h2><ul>{"".join(lines)}</ul></section>' if lines else ""


def _table(data: xr.Dataset) -> Table:
    """All runs, a row each."""
    axes = [axis_of(data, name) for name in axes_of(data)]
    numbers = [name for name in NUMBERS if name in data]
    heads = ["material", *(_label(axis) + _in(axis.unit) for axis in axes), "regime"]
    heads += [*(_title(name) + _in(NUMBERS[name][0]) for name in numbers), "reached [mm]", "end", "run"]
    rows = [
        [run.mark, *(_on_axis(axis, run.at[axis.name]) for axis in axes), _kind(run),
         *(_text(_number(run, name)) for name in (*numbers, "reached_mm")), run.outcome, run.id]
        for run in runs_of(data) if run.outcome
    ]  # fmt: skip
    return Table(heads, rows)


def _in(unit: str) -> str:
    return "" if unit in ("", "1") else f" [{unit}]"


def _short(value: float) -> float | None:
    """Four digits; None, JSON's null, for what is not a number."""
    value = float(value)
    return float(f"{value:.4g}") if math.isfinite(value) else None


# -- layers -----------------------------------------------------------------------------------------------
def layers_of(data: xr.Dataset) -> dict[str, dict]:
    """Layers by name, each with the ``values`` of all axes and whole thousandths in their order, nulls where
    nothing is known. Of runs that lie on no grid there are none.

    ``drop``: the relative force drop ``z``, of a sought boundary's map between its runs. ``chance``, by the
    Gaussian process through all runs: the chance ``p`` of abrupt cutting, and ``over``, the logarithm of
    measure over threshold. ``line``, of a grid: ``over`` between the runs. On the boundary it is 0.
    ``classical``: 0 on the boundary of the classical estimates, where these have one.
    """
    if list(data["label"].dims) != axes_of(data):
        return {}
    if "margin" in data:
        part = data[["margin", "margin_sd"]].isel(_pick(data))
        return {
            "drop": _layer(part, z=between(data, "drop_rel").isel(_pick(data))),
            "chance": _layer(part, over=_over(part["margin"]), p=xr.apply_ufunc(_chance, *part.values())),
        } | _classical(data)
    layers = {"drop": _layer(data, z=data["drop_rel"]), "line": _layer(data, over=_line(data))}
    if (chance := _estimated_chance(data)) is not None:
        layers["chance"] = chance
    return layers | _classical(data)


def _line(data: xr.Dataset) -> xr.DataArray:
    """The logarithm of measure over threshold: it keeps a steep drop from pushing the line aside."""
    with np.errstate(divide="ignore", invalid="ignore"):
        over = data["drop_rel"] / data.attrs["drop_threshold"]
        if math.isfinite(data.attrs["surge_threshold"]):
            over = np.minimum(over, data["surge"] / data.attrs["surge_threshold"])
        over = xr.where(data["label"] == LABELS.index(UNCUT), np.nan, over)
        return np.log(np.maximum(over, SMALLEST_IN_LOG))


def _pick(data: xr.Dataset) -> dict[str, np.ndarray]:
    """What is kept of a lattice of runs that were sought."""
    shown = [name for name in (data.attrs["plot_x"], data.attrs["plot_y"]) if name]
    pick = {
        name: np.unique(np.rint(np.linspace(0, data.sizes[name] - 1, LEVELS)).astype(int))
        for name in axes_of(data)
        if name not in shown and data.sizes[name] > LEVELS
    }
    if pick:
        pick |= {name: np.arange(0, data.sizes[name], 2) for name in shown if data.sizes[name] > 2 * LEVELS}
    return pick


def _layer(data: xr.Dataset, **arrays: xr.DataArray) -> dict:
    names = axes_of(data)
    values = [[float(f"{v:.5g}") for v in data[name].values] for name in names]
    return {"values": values} | {key: _whole(a.transpose(*names).values) for key, a in arrays.items()}


def _whole(values: np.ndarray) -> list[int | None]:
    return [round(PER * v) if math.isfinite(v) else None for v in map(float, values.ravel())]


def _over(margin: Any) -> Any:
    """The logarithm of measure over threshold that margins stand for."""
    return np.arctanh(np.clip(margin, -0.995, 0.995))


def _chance(margin: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """How likely margins with these standard deviations are above 0."""
    return ndtr(margin / np.maximum(sd, SMALLEST_IN_LOG))


def _estimated_chance(data: xr.Dataset) -> dict | None:
    """Margin and chance between the points of a grid; None where too few runs say."""
    names = axes_of(data)
    axes = {name: axis_of(data, name) for name in names}
    shown = [n for n in (data.attrs["plot_x"], data.attrs["plot_y"]) if n]
    for fine in (FINE, FINE // 2, FINE // 4, 0):
        values = [refined(axes[n], fine if n in shown else 0) for n in names]
        if math.prod(map(len, values)) <= _MAX_POINTS or not fine:
            break
    both = np.full((2, *map(len, values)), math.nan)
    switches = [k for k, n in enumerate(names) if axes[n].mechanism]
    for chosen in itertools.product(*(range(len(values[k])) for k in switches)):
        level = dict(zip(switches, chosen, strict=True))
        free = [k for k in range(len(names)) if k not in level]
        places = itertools.product(*(values[k] for k in free))
        at = [{names[k]: value for k, value in zip(free, place, strict=True)} for place in places]
        where = (slice(None), *(level.get(k, slice(None)) for k in range(len(names))))
        with suppress(BadInput):
            reader = MapReader(data, {names[k]: values[k][i] for k, i in level.items()})
            both[where] = np.reshape(reader.margin(at), both[where].shape)
    if not np.isfinite(both[0]).any():
        return None
    short = [[float(f"{v:.5g}") for v in some] for some in values]
    return {"values": short, "over": _whole(_over(both[0])), "p": _whole(_chance(*both))}


def _classical(data: xr.Dataset) -> dict[str, dict]:
    shown, values = (data.attrs["plot_x"], data.attrs["plot_y"]), {}
    for name in axes_of(data):
        v, axis = data[name].values, axis_of(data, name)
        if name in shown and v.size > 1 and not axis.mechanism:
            v = (np.geomspace if axis.scale == "log" else np.linspace)(v[0], v[-1], _ESTIMATED_POINTS)
        elif v.size > LEVELS:
            v = v[np.rint(np.linspace(0, v.size - 1, LEVELS)).astype(int)]
        values[name] = [float(f"{u:.5g}") for u in v]
    small = math.prod(map(len, values.values())) <= _MAX_POINTS
    z = margin_on_grid(data, values) if small else None
    return {} if z is None else {"classical": {"values": [*values.values()], "z": _whole(z)}}


def refined(axis: Axis, count: int) -> list[float]:
    """The values of an axis with others between them on its scale, about ``count`` in all."""
    v = np.asarray(axis.values, dtype=float)
    if axis.mechanism or v.size < 2 or v.size >= count:
        return v.tolist()
    parts = max(1, round((count - 1) / (v.size - 1)))
    at = np.arange((v.size - 1) * parts + 1) / parts
    if axis.scale == "log":
        return np.exp(np.interp(at, np.arange(v.size), np.log(v))).tolist()
    return np.interp(at, np.arange(v.size), v).tolist()


# -- curves -----------------------------------------------------------------------------------------------
def curve_of(result: Result, points: int = MAX_CURVE_POINTS) -> dict | None:
    """Travel ``d`` (mm), ``force`` over it and, until the blade first rests, ``mean`` and its ``split``.

    Forces are whole numbers, times ``scale`` N. A mechanism's share is the slope of its work over ``window``
    mm of travel, half a blade's thickness, and ``mean`` that of the blade's own: with ``REST`` the shares add
    up to it exactly, at every point. ``error`` is how far thinning has moved a line, relative to the largest
    force or share.
    None of a run without travel.
    """
    d, force = result.displacement_mm, result.force_N
    if d.size < 2:
        return None
    down, window = forward(d), result.case.values.get("thickness", 0.7) / 2
    travel = d[:down]
    shares, small = ledger_shares(result, window, travel) if down > 1 else ({}, {})
    shares |= {OTHERS: np.sum([*small.values()], axis=0)} if small else {}
    mean = smooth_force(travel, cumulative_trapezoid(force[:down], travel, initial=0), window, travel)
    lines = np.zeros((d.size, 2 + len(shares)))
    lines[:, 0] = force
    for k, share in enumerate([mean, *shares.values()], start=1):
        lines[:down, k], lines[down:, k] = share, share[-1]
    # Of a curve that is zero throughout nothing is lost by any scale.
    largest = float(np.max(np.abs(lines))) or 1.0
    keep, error = thinned(d, lines / largest, CURVE_TOLERANCE, points)
    keep = np.union1d(keep, [down - 1])
    scale = float(f"{largest / STEPS:.4g}")
    whole = np.rint(lines[keep] / scale).astype(int)
    first = keep < down
    split = {name: whole[first, k] for k, name in enumerate(shares, start=2)}
    if shares:
        split[REST] = whole[first, 1] - sum(split.values())
    return {
        "scale": scale,
        "window": window,
        "error": float(f"{error:.2g}"),
        "d": [float(f"{v:.5g}") for v in d[keep]],
        "force": whole[:, 0].tolist(),
        "mean": whole[first, 1].tolist(),
        "split": {name: share.tolist() for name, share in split.items() if np.any(share)},
    }


def titles_of(names: Sequence[str]) -> dict[str, str]:
    """How a page calls the entries of a ledger."""
    known = {OTHERS: "others, each small", REST: "left by the energy balance"}
    return {name: known.get(name) or title_of(name) for name in names}


def thinned(x: np.ndarray, lines: np.ndarray, near: float, points: int) -> tuple[np.ndarray, float]:
    """Which points of polygons over ``x`` (n,) stay ``near`` to ``lines`` (n, k), and how near they are.

    The farthest first (Douglas & Peucker 1973), ``points`` at the most.
    """
    lines = lines.reshape(x.size, -1)
    kept, spans = [0, x.size - 1], [_farthest(x, lines, 0, x.size - 1)]
    while len(kept) < points and -spans[0][0] > near:
        _, first, middle, last = heapq.heappop(spans)
        kept.append(middle)
        for ends in ((first, middle), (middle, last)):
            heapq.heappush(spans, _farthest(x, lines, *ends))
    return np.unique(kept), -spans[0][0]


def _farthest(x: np.ndarray, lines: np.ndarray, first: int, last: int) -> tuple[float, int, int, int]:
    """Minus the distance of the farthest point between two, and where it is."""
    if last - first < 2:
        return 0.0, first, first, last
    run = x[last] - x[first]
    part = (x[first + 1 : last] - x[first]) / run if run > 0 else np.zeros(last - first - 1)
    straight = lines[first] + part[:, None] * (lines[last] - lines[first])
    away = np.abs(lines[first + 1 : last] - straight).max(axis=1)
    k = int(np.argmax(away))
    return -float(away[k]), first, first + 1 + k, last
