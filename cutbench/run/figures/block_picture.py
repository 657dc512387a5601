"""``solid.png``: the deformed block, cut open, with its blade and the front of the cut, and a closer look."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MaxNLocator

from cutbench.base.figure_style import FIELD_MAP, RC, SINGLE_MM, Look, new_figure, style
from cutbench.case.case import Case
from cutbench.run.figures.cut_open import FRONT_DAMAGE, CutOpen, cut_open
from cutbench.run.figures.section import drawable, scale_end, spread
from cutbench.run.figures.view import Surface, View, paint
from cutbench.run.result import Result, Snapshot

#: Of the damage on the cut plane. No stress has these colours; in grey that of a cut face lies between those
#: of little and of much stress.
DAMAGE_MAP = LinearSegmentedColormap.from_list("damage", ["#FFF3EC", "#F2A67E", "#C4500F"])
#: Where the damage is less the cut plane shows its stress.
SEEN_DAMAGE = 0.02
BLADE_GREY = 0.9
#: Colours of the stress end where this percentage of the surface has less.
TOP_PERCENTILE = 97.0
#: Margins round the block, for its axes: left, right, bottom, top, in parts of its height in the picture.
_MARGINS = (0.22, 0.08, 0.13, 0.02)
#: The picture's own margin and what its words and bars need of its height, mm; width over height of the
#: close look.
_EDGE_MM, _WORDS_MM, _CLOSE_ASPECT = 2.0, 34.0, 2.1
#: Half of the height of the close look is no more than this part of the block's width in the picture.
_CLOSEST = 0.15
#: Length of a tick, in parts of the picture's height.
_TICK = 0.018


def plot_solid(result: Result) -> Figure:
    """The block at the last snapshot, cut open, and a closer look at the tip where the blade is cut off.

    Raises ValueError without a snapshot of a solid.
    """
    s = solid(result)[-1]
    scene = BlockScene(result.case, [s])
    with style():
        tall, close = SINGLE_MM / scene.aspect, (SINGLE_MM - 2 * _EDGE_MM) / _CLOSE_ASPECT
        figure = new_figure(SINGLE_MM, tall + close + _WORDS_MM)
        figure.set_layout_engine("none")
        figure.set_dpi(RC["savefig.dpi"])  # pixels of the block are those of the file
        place = _Column(figure)
        edge, title = _EDGE_MM / SINGLE_MM, f"{result.case.name}: blade travel {s.displacement_mm:.2f} mm"
        figure.text(edge, place.down(4.5), title, fontweight="bold", fontsize=9)
        whole = place.axes(tall, 0.0)
        figure.text(edge, place.down(4.0), "the tip, where the blade is cut off")
        place.down(1.0)
        near = place.axes(close)
        scene.limits(whole)
        left, right, bottom, top = scene.close_look(s)
        near.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[], aspect="equal")
        for axes in (whole, near):
            scene.draw(axes, s)
        whole.add_patch(Rectangle((left, bottom), right - left, top - bottom, fill=False, lw=0.7))
        near.spines[:].set_visible(True)
        scale_bar(near)
        place.down(5.5)
        bars = [
            place.axes(2.6, start, width, down=False) for start, width in ((_EDGE_MM, 37.0), (46.0, 36.0))
        ]
        scene.bars(*bars)
        figure.legend(handles=scene.names([s]), loc="lower center", ncols=3)
    return figure


class _Column:
    """Places in a figure of one column, from the top down, in mm."""

    def __init__(self, figure: Figure):
        self.figure, self.height = figure, 25.4 * figure.get_figheight()
        self.at = self.height

    def down(self, mm: float) -> float:
        """So much further down; returns the height there in parts of the figure's."""
        self.at -= mm
        return self.at / self.height

    def axes(self, mm: float, start: float = _EDGE_MM, width: float | None = None, down: bool = True) -> Axes:
        """Axes that are so high, from ``start``; the next place is below them."""
        width = SINGLE_MM - 2 * start if width is None else width
        found = self.figure.add_axes(
            (start / SINGLE_MM, (self.at - mm) / self.height, width / SINGLE_MM, mm / self.height)
        )
        if down:
            self.at -= mm
        return found


def solid(result: Result) -> list[Snapshot]:
    """The snapshots of a block. Raises ValueError where there is none, or one of something else."""
    return drawable(result.snapshots, "tetra", "a block is drawn from snapshots of a solid (tetra, tetra10)")


def surfaces_of(block: CutOpen, top_kPa: float) -> list[Surface]:
    """Skin, cut plane and blade, from back to front, with their colours; those of the stress end at
    ``top_kPa``."""
    stress = colormaps[FIELD_MAP](block.stress_kPa / top_kPa)[:, :3]
    damage = np.nan_to_num(block.damage)
    plane = np.where((damage > SEEN_DAMAGE)[:, None], DAMAGE_MAP(damage)[:, :3], stress)
    none = np.empty((0, 2), dtype=int)
    surfaces = [
        Surface(block.points, block.skin, stress, block.edges),
        Surface(block.points, block.cut, plane, none),
    ]
    if block.blade.size:
        grey = np.full((len(block.blade_points), 3), BLADE_GREY)
        surfaces.append(Surface(block.blade_points, block.blade, grey, block.blade_edges))
    return surfaces


class BlockScene:
    """How snapshots of a block are drawn, on one scale, in one frame."""

    stem = "solid"

    def __init__(self, case: Case, snapshots: Sequence[Snapshot]):
        self.case, self.view = case, View()
        shown = [cut_open(s, case) for s in spread(snapshots)]
        ends = [
            scale_end(b.points, np.concatenate([b.cut, b.skin]), b.stress_kPa, TOP_PERCENTILE) for b in shown
        ]
        self.top_kPa = max(ends) or 1.0
        places = [self.view.flat(points) for b in shown for points in (b.points, b.blade_points)]
        flat = np.concatenate(places)
        self._low, self._high = flat.min(axis=0), flat.max(axis=0)
        box = shown[-1].reference
        self._corners = box.min(axis=0), box.max(axis=0)

    @property
    def aspect(self) -> float:
        """Width over height of the frame."""
        (left, right, bottom, top) = self._frame
        return (right - left) / (top - bottom)

    @property
    def _frame(self) -> tuple[float, float, float, float]:
        size = self._high[1] - self._low[1]
        left, right, bottom, top = (part * size for part in _MARGINS)
        return self._low[0] - left, self._high[0] + right, self._low[1] - bottom, self._high[1] + top

    def limits(self, axes: Axes) -> None:
        """The frame that holds all snapshots, and the block's own axes round it."""
        left, right, bottom, top = self._frame
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        axes.set_axis_off()
        (x0, y0, z0), (x1, y1, z1) = self._corners
        self._axis(axes, (x0, y0, z0), (x0, y0, z1), "along the blade (mm)", (0, -1))
        self._axis(axes, (x0, y0, z1), (x1, y0, z1), "across (mm)", (0.5, -1))
        # Beside what bulges.
        beside = self._low[0] - self.view.flat(np.array([[x0, y0, z0]]))[0, 0]
        self._axis(axes, (x0, y0, z0), (x0, y1, z0), "height (mm)", (-1, 0), beside)

    def _axis(self, axes: Axes, start, end, name: str, outwards, aside: float = 0.0) -> None:
        """Ticks along an edge of the undeformed block, with numbers and a name on the outer side."""
        start, end, out = np.array(start), np.array(end), np.array(outwards, dtype=float)
        along = int(np.argmax(np.abs(end - start)))
        tick = _TICK * np.ptp(axes.get_ylim()) * out / np.linalg.norm(out)
        shift = 0.6 * tick + np.array([aside, 0.0])
        line = self.view.flat(np.array([start, end])) + shift
        look: Look = {"color": "black", "ls": "-", "lw": 0.6}
        axes.plot(*line.T, **look)
        low, high = sorted((start[along], end[along]))
        for value in MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(low, high):
            crowded = along == 0 and value <= low  # the corner has the number of the axis along the blade
            if low - 1e-9 <= value <= high + 1e-9 and not crowded:
                at = np.where(np.arange(3) == along, value, start)
                foot = self.view.flat(at[None])[0] + shift
                axes.plot(*np.array([foot, foot + tick]).T, **look)
                self._write(axes, foot + 2.6 * tick, f"{value:g}".replace("-", "−"))
        turn = float(np.degrees(np.arctan2(*(line[1] - line[0])[::-1])))
        self._write(axes, line.mean(axis=0) + 5.6 * tick, name, turn)

    @staticmethod
    def _write(axes: Axes, at: np.ndarray, text: str, turn: float = 0.0) -> None:
        x, y = at
        axes.text(
            x, y, text, fontsize=7, ha="center", va="center", rotation=turn, rotation_mode="anchor"
        )  # fmt: skip

    def close_look(self, s: Snapshot) -> tuple[float, float, float, float]:
        """Limits round the tip in the middle of the block: left, right, bottom, top."""
        p, tool = self.case.p, self.case.model.tool
        reach = max(4 * p.thickness, 1.6 * tool.height(p) if tool else 0.0)
        reach = min(reach, _CLOSEST * (self._high[0] - self._low[0]))
        x, y = self.view.flat(np.array([[0.0, p.height - s.displacement_mm + 0.2 * reach, 0.0]]))[0]
        wide = _CLOSE_ASPECT * 0.75 * reach
        return x - wide, x + wide, y - 0.75 * reach, y + 0.75 * reach

    def draw(self, axes: Axes, s: Snapshot) -> None:
        """Paint ``s`` and its front into ``axes``."""
        block = cut_open(s, self.case)
        paint(axes, self.view, surfaces_of(block, self.top_kPa))
        if block.front.size:
            cased = [Stroke(linewidth=2.0, foreground="white"), Normal()]
            axes.plot(*self.view.flat(block.front).T, color="black", ls="-", lw=0.9, path_effects=cased,
                      gid="front")  # fmt: skip

    def bars(self, stress: Axes, damage: Axes) -> None:
        """Colour bars of the stress and of the damage in these axes."""
        figure = stress.get_figure(root=True)
        assert figure is not None
        bar = figure.colorbar
        look: Look = {"orientation": "horizontal"}
        colours = ScalarMappable(Normalize(0, self.top_kPa), FIELD_MAP)
        bar(colours, cax=stress, extend="max", label="von Mises stress (kPa)", **look)
        bar(ScalarMappable(Normalize(0, 1), DAMAGE_MAP), cax=damage, label="damage on the cut plane",
            ticks=[0, 0.5, 1], **look)  # fmt: skip

    def names(self, shown: Sequence[Snapshot]) -> list[Artist]:
        """What a legend says of what is there."""
        there: list[Artist] = [Patch(facecolor=str(BLADE_GREY), edgecolor="black", lw=0.5, label="blade")]
        if any(cut_open(s, self.case).front.size for s in shown):
            there += [
                Line2D([], [], color="black", ls="-", lw=1.2, label=f"front (damage {FRONT_DAMAGE:g})"),
                Patch(facecolor=DAMAGE_MAP(1.0), edgecolor="black", lw=0.5, label="cut face"),
            ]
        return there


def scale_bar(axes: Axes) -> None:
    """A bar below ``axes`` that is as long as it says, in the picture's plane."""
    low, high = axes.get_xlim()
    length = MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(0, high - low)[1]
    y = axes.get_ylim()[0] - 0.06 * np.ptp(axes.get_ylim())
    axes.plot([high - length, high], [y, y], color="black", ls="-", lw=1.5, clip_on=False)
    axes.text(high - 1.06 * length, y, f"{length:g} mm", ha="right", va="center", fontsize=7)
