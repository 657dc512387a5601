"""What kind of law it is, at a glance: its stress, traction, strength or profile at typical values."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import GREY, LINE_COLOURS, LINES, SINGLE_MM, Look, new_figure, style
from cutbench.case.model import Model, mechanism
from cutbench.homogeneous.history import LoadingHistory
from cutbench.homogeneous.predict import respond
from cutbench.mechanisms import Blade, Bulk, Cut, Points, Tool, Volumetric

#: Kinds of stretching, and how far each goes.
STRETCHED = {"uniaxial": (0.6, 2.0), "pure_shear": (1.0, 2.0), "equibiaxial": (1.0, 2.0)}
#: Volumes, over that at rest.
VOLUMES = (0.7, 1.4)
#: Openings in those at the peak, and the part of the largest traction below which nothing more is drawn.
WIDEST, GONE = 12.0, 0.01
#: Pressures go to this part of the typical shear modulus.
PRESSED = 4.0
#: Points of a line, and duration of a test with a law that has a state but no time, s.
DRAWN, DURATION_S = 121, 10.0
#: What a law is compared with, that it is switched off or left out.
WITHOUT: Look = {"color": GREY, "lw": 0.8, "zorder": 1}


def plot_law(name: str) -> Figure:
    """Draw a law at the typical values of its parameters.

    Parameters
    ----------
    name : str
        A known law of the slots ``bulk``, ``cut`` or ``blade``.

    Returns
    -------
    Figure
        Stress over stretch or volume, traction over opening, strength over pressure, or a blade's profile; in
        grey the same without the law's effect.

    Raises
    ------
    BadInput
        For a law that has none of these.
    """
    law = mechanism(name, key="mechanism")
    draw = next((draw for kind, draw in _DRAWN.items() if isinstance(law, kind)), None)
    if draw is None:
        expected = f"a law of the slots bulk, cut or blade with --plot; this is one of the slot '{law.slot}'"
        raise BadInput(key="mechanism", value=name, expected=expected)
    model = Model().with_(name)
    typical = {each: q.typical * q.factor for each, q in model.parameters().items()}
    off = {q.name: q.off_value for q in law.parameters if q.off is not None}
    with style():
        figure = new_figure(SINGLE_MM, 62)
        axes = figure.subplots()
        draw(axes, law, model, model.namespace(typical), model.namespace({**typical, **off}) if off else None)
        if axes.get_legend_handles_labels()[1]:
            axes.legend()
        figure.suptitle(f"{law.title} ({name})", x=0.02, ha="left")
    return figure


def _stress(axes: Axes, law, model: Model, p: SimpleNamespace, off: SimpleNamespace | None) -> None:
    times, way = [getattr(p, q.name) for q in law.parameters if q.unit == "s"], ""
    if back := bool(law.start(1, p)):
        time_s = np.linspace(0, times[0] if times else DURATION_S, DRAWN)
        way = f", there and back in {time_s[-1]:.3g} s"
    for k, (kind, (low, high)) in enumerate(STRETCHED.items()):
        x = high - (high - 1) * np.abs(np.linspace(-1, 1, DRAWN)) if back else np.linspace(low, high, DRAWN)
        history = LoadingHistory.along(x, time_s if back else None, rest=1.0)
        looks: list[tuple[SimpleNamespace, Look]] = [
            (p, {"color": LINE_COLOURS[k], "label": kind.replace("_", " ")})
        ]
        looks += [(off, WITHOUT | {"label": None if k else "without its effect"})] if off else []
        for values, look in looks:
            axes.plot(x, 1e3 * respond(kind, history, model, values).real, **(look | {"ls": LINES[k]}))
    axes.set(xlabel=f"stretch{way}", ylabel="nominal stress (kPa)")


def _pressure(axes: Axes, law, model: Model, p: SimpleNamespace, off: SimpleNamespace | None) -> None:
    J = np.linspace(*VOLUMES, DRAWN)
    axes.plot(J, 1e3 * law.dU_dJ(J, p))
    if off:
        axes.plot(J, 1e3 * law.dU_dJ(J, off), label="without its effect", **WITHOUT)
    axes.set(xlabel="volume over that at rest", ylabel="mean stress (kPa)")


def _traction(axes: Axes, law, model: Model, p: SimpleNamespace, off: SimpleNamespace | None) -> None:
    leads = law.role == "cohesive"
    others = [m.name for m in model.laws("cut") if m is not law and (leads or m.role != "cohesive")]
    alone = model.without(*others)
    widest = WIDEST * sum(each.estimate(p, 0.0, 0.0).opening for each in alone.laws("cut"))
    x = np.linspace(0, widest, 10 * DRAWN)
    history = LoadingHistory.along(x, x / p.speed)

    def traction(model: Model, values: SimpleNamespace, direction: str = "opening") -> np.ndarray:
        return 1e3 * respond("separation", history, model, values, direction=direction).real

    lines = {"normal": traction(alone, p), "tangential": traction(alone, p, "sliding")}
    if not leads:
        lines["without it"] = traction(alone.without(law.name), p)
    elif off:
        lines["without its effect"] = traction(alone, off)
    most = GONE * max(T.max() for T in lines.values())
    end = min(int(1.1 * max(np.flatnonzero(most < T)[-1] for T in lines.values())) + 1, x.size)
    for label, T in lines.items():
        axes.plot(x[:end], T[:end], label=label, **(WITHOUT if label.startswith("without") else {}))
    axes.set(
        xlabel=f"opening or slip (mm), at {p.speed:g} mm/s", ylabel="traction (kPa)", xlim=(0, x[end - 1])
    )
    axes.set_ylim(bottom=0)


def _strength(axes: Axes, law, model: Model, p: SimpleNamespace, off: SimpleNamespace | None) -> None:
    pressure = np.linspace(0, PRESSED * model.shear_modulus(p), DRAWN)

    def strength(q: SimpleNamespace, faster: float = 1.0, slid: float = 0.0) -> np.ndarray:
        moving = SimpleNamespace(**{**vars(q), "speed": faster * q.speed})
        ones = np.ones(DRAWN)
        at = Points(touched=ones, slid=slid * ones, slip_rate=moving.speed * ones, speed=moving.speed, dt=1.0)
        return 1e3 * np.real(law.strength(pressure, moving, law.start(DRAWN, q), at)) + 0 * pressure

    lines = {
        f"at {p.speed:g} mm/s": strength(p),
        "ten times as fast": strength(p, faster=10.0),
        f"after sliding by {p.height:g} mm": strength(p, slid=p.height),
    }
    first = next(iter(lines.values()))
    for label, line in lines.items():
        if line is first or not np.array_equal(line, first):
            axes.plot(1e3 * pressure, line, label=label)
    if off:
        axes.plot(1e3 * pressure, strength(off), label="without its effect", **WITHOUT)
    axes.set(xlabel="contact pressure (kPa)", ylabel="shear strength (kPa)", xlim=(0, 1e3 * pressure[-1]))
    axes.set_ylim(bottom=0)


def _profile(axes: Axes, law, model: Model, p: SimpleNamespace, off: SimpleNamespace | None) -> None:
    x, y = np.real(law.outline(p)).T
    if law.band:  # it goes on upwards
        top = y.max() + 0.3 * np.ptp(y)
        x, y = np.concatenate([x[:1], x, x[-1:]]), np.concatenate([[top], y, [top]])
    axes.fill(x, y, color="0.9", lw=0)
    axes.plot(x, y, "k-")
    axes.set(xlabel="across (mm)", ylabel="above the edge (mm)", aspect="equal")
    axes.set_xticks([x.min(), x.max()], [f"{end:.2g}" for end in (x.min(), x.max())])


_DRAWN = {Tool: _profile, Volumetric: _pressure, Bulk: _stress, Cut: _traction, Blade: _strength}
