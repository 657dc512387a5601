"""What kind of law it is, at a glance: its stress, traction, strength or profile at typical values."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import GREY, SINGLE_MM, Look, legend_below, new_figure, style
from cutbench.case.model import Model, mechanism
from cutbench.homogeneous.history import LoadingHistory
from cutbench.homogeneous.predict import respond
from cutbench.mechanisms import Blade, Bulk, Cut, Points, Tool, Volumetric

#: What stands at both axes, and lines by what they are called.
Drawn = tuple[tuple[str, str], dict[str, tuple[np.ndarray, np.ndarray]]]
#: Points of a line, and duration of a test with a law that has a state but no time, s.
DRAWN, DURATION_S = 201, 10.0
#: Kinds of stretching, and how far each goes.
STRETCHED = {"uniaxial": (0.6, 2.0), "pure_shear": (1.0, 2.0), "equibiaxial": (1.0, 2.0)}
#: Openings in those at the peak, and the part of the largest traction below which nothing more is drawn.
WIDEST, GONE = 12.0, 0.01
#: The line of a law that is switched off.
OFF = "without its effect"


def plot_law(name: str) -> Figure:
    """Draw a law at the typical values of its parameters. Raises BadInput."""
    law = mechanism(name, key="mechanism")
    draw = next((draw for kind, draw in _DRAWN.items() if isinstance(law, kind)), None)
    if draw is None:
        expected = f"a law of the slots bulk, cut or blade with --plot; this is one of the slot '{law.slot}'"
        raise BadInput(key="mechanism", value=name, expected=expected)
    model = Model().with_(name)
    values = {each: q.typical * q.factor for each, q in model.parameters().items()}
    (along, up), lines = draw(law, model, model.namespace(values))
    if off := {q.name: q.off_value for q in law.parameters if q.off is not None}:
        lines[OFF] = next(iter(draw(law, model, model.namespace(values | off))[1].values()))
    with style():
        figure = new_figure(SINGLE_MM, 70)
        axes = figure.subplots()
        for label, (x, y) in lines.items():
            off_look: Look = {"color": GREY, "lw": 0.8, "zorder": 1} if label == OFF else {}
            axes.plot(x, y, label=label, **off_look)
        axes.set(xlabel=along, ylabel=up)
        if isinstance(law, Tool):
            axes.set_aspect("equal", adjustable="datalim")
        legend_below(figure, [axes], 2)
        figure.suptitle(f"{law.title} ({name})", x=0.02, ha="left")
    return figure


def _stress(law, model: Model, p: SimpleNamespace) -> Drawn:
    lines, time_s, way = {}, None, ""
    if law.start(1, p):  # there and back, then
        end = next((getattr(p, q.name) for q in law.parameters if q.unit == "s"), DURATION_S)
        time_s, way = np.linspace(0, end, DRAWN), f", there and back in {end:.3g} s"
    for kind, (low, high) in STRETCHED.items():
        there = np.linspace(low, high, DRAWN)
        x = there if time_s is None else high - (high - 1) * np.abs(np.linspace(-1, 1, DRAWN))
        history = LoadingHistory.along(x, time_s, rest=1.0)
        lines[kind.replace("_", " ")] = x, 1e3 * respond(kind, history, model, p).real
    return (f"stretch{way}", "nominal stress (kPa)"), lines


def _pressure(law, model: Model, p: SimpleNamespace) -> Drawn:
    J = np.linspace(0.7, 1.4, DRAWN)
    return ("volume over that at rest", "mean stress (kPa)"), {law.title: (J, 1e3 * law.dU_dJ(J, p))}


def _traction(law, model: Model, p: SimpleNamespace) -> Drawn:
    """A cohesive law alone; others with that of the model, which they follow."""
    kept = {law.role, None if law.role == "cohesive" else "cohesive"}
    alone = model.without(*(m.name for m in model.laws("cut") if m.role not in kept))
    x = np.linspace(0, WIDEST * sum(m.estimate(p, 0.0, 0.0).opening for m in alone.laws("cut")), 5 * DRAWN)
    history = LoadingHistory.along(x, x / p.speed)
    T = {
        name: 1e3 * respond("separation", history, alone, p, direction=direction).real
        for name, direction in (("normal", "opening"), ("tangential", "sliding"))
    }
    most = max(each.max() for each in T.values())
    end = min(int(1.1 * max(np.flatnonzero(each > GONE * most)[-1] for each in T.values())) + 1, x.size)
    axes = f"opening or slip (mm), at {p.speed:g} mm/s", "traction (kPa)"
    return axes, {name: (x[:end], each[:end]) for name, each in T.items()}


def _strength(law, model: Model, p: SimpleNamespace) -> Drawn:
    lines, pressure, ones = {}, np.linspace(0, 4 * model.shear_modulus(p), DRAWN), np.ones(DRAWN)
    for label, speed in ((f"at {p.speed:g} mm/s", p.speed), ("ten times as fast", 10 * p.speed)):
        q = SimpleNamespace(**{**vars(p), "speed": speed})
        at = Points(touched=ones, slid=p.height * ones, slip_rate=speed * ones, speed=speed, dt=1.0)
        lines[label] = 1e3 * pressure, 1e3 * law.strength(pressure, q, law.start(DRAWN, q), at) * ones
    return (f"contact pressure (kPa), after sliding by {p.height:g} mm", "shear strength (kPa)"), lines


def _profile(law, model: Model, p: SimpleNamespace) -> Drawn:
    x, y = np.real(law.outline(p)).T
    if law.band:  # it goes on upwards
        x, y = np.concatenate([x[:1], x, x[-1:]]), np.concatenate([[1.3 * y.max()], y, [1.3 * y.max()]])
    return ("across (mm)", "above the edge (mm)"), {law.title: (x, y)}


_DRAWN = {Tool: _profile, Volumetric: _pressure, Bulk: _stress, Cut: _traction, Blade: _strength}
