"""The one style of all figures: column widths of journals, colours safe for the colour-blind.

Meaning never hangs on colour alone: series differ by line style too, areas by hatch.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.rcsetup import cycler
from matplotlib.text import Text

from cutbench.base.files import replacing

if TYPE_CHECKING:
    from matplotlib.typing import LineStyleType, RcKeyType

#: Keywords of a line or marker, as matplotlib takes them.
Look = dict[str, Any]

#: Widths of one and two journal columns, mm.
SINGLE_MM, DOUBLE_MM = 85.0, 180.0


@dataclass(frozen=True)
class Size:
    """What a picture is made for: its width and, where that is fixed, its height in mm, its type in pt, and
    what a PNG of it has in dots per inch."""

    width_mm: float
    text_pt: float
    height_mm: float | None = None
    dpi: float = 300.0


#: A journal column; a slide of 16:9, which beamer makes 160 mm wide, in 1920 by 1080 pixels.
SIZES = {"paper": Size(SINGLE_MM, 8.0, dpi=600.0), "slide": Size(160.0, 11.0, 90.0, dpi=304.8)}

#: Okabe & Ito's colours (https://jfly.uni-koeln.de/color/), black first.
COLOURS = {
    "black": "#000000",
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "green": "#009E73",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "purple": "#CC79A7",
    "yellow": "#F0E442",
}
GREY = "#7A7A7A"
#: Those that a thin line can have on white paper.
LINE_COLOURS = tuple(colour for name, colour in COLOURS.items() if name != "yellow")

#: Line styles in the order of the colours, so that series differ in grey print too.
LINES: tuple[LineStyleType, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1, 1.2)),
    (0, (6, 1.5, 1, 1.5)),
    (0, (3, 1, 1, 1, 1, 1)),
    (0, (8, 2)),
    (0, (2, 2)),
    "-",
)

#: Sequential map for stress: perceptually uniform, monotone in grey.
FIELD_MAP = "cividis"

RC: dict[RcKeyType, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Arial", "Helvetica", "Liberation Sans", "DejaVu Sans"],
    "mathtext.fontset": "dejavusans",
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.title_fontsize": 9,
    "legend.handlelength": 2.4,
    "axes.linewidth": 0.6,
    "axes.prop_cycle": cycler(color=LINE_COLOURS, linestyle=LINES[: len(LINE_COLOURS)]),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "hatch.linewidth": 0.4,
    "figure.titlesize": 9,
    "figure.titleweight": "bold",
    "figure.dpi": 150,
    "savefig.dpi": 300,
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    # Without a fixed salt two writings of the same figure differ.
    "svg.hashsalt": "cutbench",
}


#: What sets type.
_TYPE: tuple[RcKeyType, ...] = (
    "font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize",
    "legend.title_fontsize", "figure.titlesize",
)  # fmt: skip


@contextmanager
def style(size: Size | None = None) -> Iterator[None]:
    """Draw inside this: the style holds there, with the type of ``size``, and leaves a caller's own settings
    alone."""
    with matplotlib.rc_context(RC if size is None else RC | dict.fromkeys(_TYPE, size.text_pt)):
        yield


def one_type(figure: Figure, size: Size | None) -> None:
    """All text of ``figure`` in the type of ``size``."""
    if size is None:
        return
    for text in figure.findobj(Text):
        cast("Text", text).set_fontsize(size.text_pt)


def new_figure(width_mm: float = SINGLE_MM, height_mm: float = 60.0) -> Figure:
    """An empty figure with constrained layout, outside pyplot: nothing to close, no display needed."""
    layout = ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03, wspace=0.03, hspace=0.04)
    figure = Figure(figsize=(width_mm / 25.4, height_mm / 25.4), layout=layout)
    FigureCanvasAgg(figure)
    return figure


def sized(size: Size, height_mm: float) -> Figure:
    """An empty figure of ``size``, so high where that leaves it open."""
    return new_figure(size.width_mm, size.height_mm or height_mm)


def own_axes() -> Axes:
    """Axes of a new figure of pyplot's, which a notebook shows by itself."""
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def svg(figure: Figure, name: str) -> str:
    """The figure as an element for a page; ``name`` keeps the ids of several figures apart."""
    out = io.StringIO()
    with style(), matplotlib.rc_context({"svg.hashsalt": name}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    # Groups need no names, and those of several figures would be the same; what is referred to keeps its own.
    text = re.sub(r'<g id="[^"]*"', "<g", text[text.index("<svg") :])
    return re.sub(r'( id="|url\(#|href="#)', rf"\g<1>{name}-", text)


def svg_of(draw: Callable[[Axes], object]) -> str:
    """What ``draw`` puts into axes as SVG, to stand in a page."""
    with style():
        figure = new_figure(120, 72)
        draw(figure.subplots())
    return svg(figure, "axes")


def force_from_zero(axes: Axes, along: str) -> None:
    """Label ``axes`` as force over ``along``, both from zero."""
    axes.set(xlabel=along, ylabel="force (N)")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)


def legend_below(figure: Figure, axes: Iterable[Axes], columns: int) -> None:
    """One legend for all ``axes``, each label once."""
    entries: dict[str, Artist] = {}
    for each in axes:
        for handle, label in zip(*each.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns)


def legend_in_rows(figure: Figure, handles: Sequence[Artist], loc: Any, title: str = "") -> None:
    """One legend outside the axes under its ``title``, in as few rows as the figure is wide enough for."""
    for columns in range(len(handles), 0, -1):
        look: Look = {"ncols": columns, "columnspacing": 1.0, "handletextpad": 0.5, "handlelength": 1.5}
        legend = figure.legend(handles=handles, loc=loc, title=title, **look)
        if columns == 1 or legend.get_window_extent().width < figure.bbox.width:
            return
        legend.remove()


def save(
    figure: Figure, path: str | Path, *, also: Sequence[str] = (), size: Size | None = None
) -> list[Path]:
    """Write ``figure`` to ``path`` (format by its suffix; png at 300 dpi, or that of ``size``) and beside it
    as ``also`` says.

    ``save(fig, "phase.png", also=("svg", "pdf"))``. Each file appears whole or not at all. Returns the paths.
    """
    path = Path(path)
    first = path.suffix.lstrip(".") or "png"
    written = []
    dpi = RC["savefig.dpi"] if size is None else size.dpi
    for kind in dict.fromkeys((first, *(a.lstrip(".") for a in also))):
        # The date would make two pictures of the same run differ.
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
        target = path.with_suffix(f".{kind}")
        with replacing(target) as draft, style():
            figure.savefig(draft, format=kind, metadata=metadata, dpi=dpi)
        written.append(target)
    return written
