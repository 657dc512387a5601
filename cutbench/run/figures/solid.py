"""Pictures of a cut in three dimensions: the cut plane, the front's shape, the deformed block.

The cut plane is drawn from the side: z along the blade, y the height, the blade coming from above.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import TriAnalyzer, Triangulation
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from cutbench.base.figure_style import (
    COLOURS,
    DOUBLE_MM,
    FIELD_MAP,
    GREY,
    LINE_COLOURS,
    LINES,
    SINGLE_MM,
    Look,
    force_from_zero,
    new_figure,
    save,
    style,
)
from cutbench.case.case import Case
from cutbench.run.figures.section import drawable, spread
from cutbench.run.result import Result, Snapshot

#: Colours end at this percentile of the nodes' stress; the few nodes at the tip would flatten the rest.
TOP_PERCENTILE = 99.5
#: The front is where half of the cohesion is lost.
FRONT_DAMAGE = 0.5
#: Points of a drawn-out block lie in fewer planes across the blade than this part of their number.
FEW_PLANES = 0.1
#: So many lines at the most are told apart in one picture of the front.
_FRONTS = 12


def save_solid(result: Result, folder: str | Path, plane: Result | None = None) -> dict[str, Path]:
    """Write cut_plane.png, front.png, block.png and, with a plane-strain run, plane_strain.png.

    Returns the paths by name. Without snapshots only the last can be drawn.
    """
    folder = Path(folder)
    figures = {}
    if result.snapshots:
        draw = {"cut_plane": plot_cut_plane, "front": plot_front, "block": plot_block}
        figures = {name: plot(result) for name, plot in draw.items()}
    if plane is not None:
        figures["plane_strain"] = plot_beside(result, plane)
    return {f"{name}_png": save(figure, folder / f"{name}.png")[0] for name, figure in figures.items()}


def plot_cut_plane(result: Result) -> Figure:
    """Von Mises stress, contact pressure (both kPa) and contact state on the cut plane, a column a snapshot.

    At most four columns, spread over the travel. Raises ValueError without a snapshot of a solid.
    """
    shown = spread(_solid(result))
    top_kPa = plane_top_kPa(shown)
    pressure_look = look_of(1e3 * max(s.faces["cut"]["contact_pressure_MPa"].max(initial=0.0) for s in shown))
    with style():
        figure = new_figure(DOUBLE_MM, 135)
        grid = figure.subplots(3, len(shown), squeeze=False, sharex=True, sharey=True)
        for column, s in enumerate(shown):
            cut = s.faces["cut"]
            z, y = cut["x"][:, 2], cut["x"][:, 1]
            pressed = cut["contact_state"] > 0
            first = draw_cut_plane(grid[0, column], s, result.case, top_kPa)
            kPa = 1e3 * cut["contact_pressure_MPa"][pressed]
            second = grid[1, column].scatter(
                z[pressed], y[pressed], 3, kPa, marker="s", lw=0, **pressure_look
            )
            _state(grid[2, column], z, y, cut)
            for axes in grid[1:, column]:
                _front_and_tip(axes, s, result.case, "black")
            grid[0, column].set_title(f"blade travel {s.displacement_mm:.2f} mm", loc="left", fontsize=8)
            grid[2, column].set_xlabel("along the blade (mm)")
        for row in grid:
            row[0].set_ylabel("height (mm)")
        figure.colorbar(first, ax=grid[0].tolist(), extend="max", label="von Mises (kPa)")
        figure.colorbar(second, ax=grid[1].tolist(), label="contact pressure (kPa)")
        # An empty bar keeps the third row as wide as the others.
        figure.colorbar(second, ax=grid[2].tolist()).ax.set_visible(False)
        names = grid[2, 0].get_legend_handles_labels()
        figure.legend(*names, loc="outside lower center", ncols=4, markerscale=3)
        title = f"{result.case.name}: cut plane (line: damage {FRONT_DAMAGE:g}; dotted: blade's tip)"
        figure.suptitle(title, x=0.02, ha="left")
    return figure


def plot_front(result: Result) -> Figure:
    """The front (damage one half) on the cut plane at each snapshot's blade travel, twelve at the most."""
    shown = spread(_solid(result), _FRONTS)
    with style():
        figure = new_figure(SINGLE_MM, 95)
        axes = figure.subplots()
        colours = LINE_COLOURS
        drawn = []
        for i, s in enumerate(shown):
            look: Look = {"color": colours[i % len(colours)], "linestyle": LINES[i % len(LINES)]}
            if front_line(axes, s, s.faces["cut"]["X"], lw=1.2, **look):
                drawn.append((*axes.plot([], [], lw=1.2, **look), f"{s.displacement_mm:.2f} mm"))
        X = shown[-1].points
        axes.set(xlabel="along the blade (mm)", ylabel="height in the uncut block (mm)")
        axes.set_xlim(X[:, 2].min(), X[:, 2].max())
        axes.set_ylim(top=X[:, 1].max())
        if drawn:
            names = zip(*drawn, strict=True)
            figure.legend(*names, loc="outside lower center", ncols=3, title="blade travel")
        else:
            axes.text(0.5, 0.5, "not cut", transform=axes.transAxes, ha="center")
        title = f"{result.case.name}: front of the cut"
        figure.suptitle(title, x=0.02, ha="left")
    return figure


def plot_block(result: Result) -> Figure:
    """The deformed part of the block with its von Mises stress (kPa) at the last snapshot."""
    s = _solid(result)[-1]
    faces = _skin(s.cells)
    values = 1e3 * s.point_data["von_mises"]
    top = float(np.percentile(values, TOP_PERCENTILE)) or 1.0
    # Matplotlib's depth axis is y: x, z, y makes the height point up.
    corners = s.current[:, [0, 2, 1]][faces]
    with style():
        figure = new_figure(DOUBLE_MM * 0.66, 90)
        axes = figure.add_subplot(projection="3d")
        look = {"edgecolors": "#00000055", "linewidths": 0.15, "norm": Normalize(0, top)}
        colours = Poly3DCollection(corners, cmap=FIELD_MAP, **look)
        colours.set_array(values[faces].mean(axis=1))
        axes.add_collection3d(colours)
        low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
        axes.set_box_aspect(high - low, zoom=0.78)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(MaxNLocator(4))
        # From the side of the cut plane and the free end, where the front can be seen.
        axes.view_init(elev=22, azim=-150)
        axes.set(xlabel="across (mm)", ylabel="along the blade (mm)", zlabel="height (mm)")
        figure.colorbar(colours, ax=axes, shrink=0.7, extend="max", label="von Mises (kPa)")
        title = f"{result.case.name}: blade travel {s.displacement_mm:.2f} mm"
        figure.suptitle(title, x=0.02, ha="left")
    return figure


def plot_beside(result: Result, plane: Result) -> Figure:
    """Force (N) over blade travel in three dimensions, of a blade all as its middle, and in plane strain."""
    with style():
        figure = new_figure(SINGLE_MM, 62)
        axes = figure.subplots()
        axes.plot(result.displacement_mm, result.force_N, color="black", ls="-", label="three dimensions")
        if (middle := result.curve.get("middle_force_N")) is not None:
            look: Look = {"color": COLOURS["vermilion"], "ls": LINES[2]}
            axes.plot(result.displacement_mm, middle, label="its middle, all along", **look)
        blue, dashed = COLOURS["blue"], LINES[1]
        axes.plot(plane.displacement_mm, plane.force_N, color=blue, ls=dashed, label="plane strain")
        force_from_zero(axes, "blade travel (mm)")
        axes.legend()
        figure.suptitle(result.case.name, x=0.02, ha="left")
    return figure


def _solid(result: Result) -> list[Snapshot]:
    return drawable(result.snapshots, "tetra", "a block is drawn from snapshots of a solid (tetra, tetra10)")


def plane_top_kPa(snapshots: Sequence[Snapshot]) -> float:
    """Where the colours of the stress on the cut plane end, kPa."""
    stress = (s.point_data["von_mises"][np.unique(cut_plane_of(s))] for s in snapshots)
    return 1e3 * max(float(np.percentile(values, TOP_PERCENTILE)) for values in stress)


def draw_cut_plane(axes: Axes, s: Snapshot, case: Case, top_kPa: float) -> TriMesh:
    """Von Mises stress on the cut plane, the front and the blade's tip; what a colour bar needs."""
    mesh = Triangulation(s.current[:, 2], s.current[:, 1], cut_plane_of(s))
    colours = axes.tripcolor(mesh, 1e3 * s.point_data["von_mises"], shading="gouraud", **look_of(top_kPa))
    _front_and_tip(axes, s, case, "white")
    return colours


def _front_and_tip(axes: Axes, s: Snapshot, case: Case, colour: str) -> None:
    front_line(axes, s, s.faces["cut"]["x"], color=colour, lw=0.8)
    axes.axhline(case.p.height - s.displacement_mm, color=GREY, lw=0.6, ls=":")
    axes.set_aspect("equal")


def look_of(top: float) -> Look:
    return {"cmap": FIELD_MAP, "norm": Normalize(0, top or 1.0), "rasterized": True}


def _state(axes, z: np.ndarray, y: np.ndarray, cut: dict[str, np.ndarray]) -> None:
    """Points never touched are left white; grey ones were touched before, coloured ones are pressed now."""
    pressed, touched = cut["contact_state"] > 0, cut["touched"] > 0
    kinds = (("touched", touched & ~pressed, "#BBBBBB"), ("pressed", pressed, COLOURS["vermilion"]))
    for name, chosen, colour in kinds:
        axes.scatter(z[chosen], y[chosen], s=2, marker="s", lw=0, color=colour, label=name, rasterized=True)


def front_line(axes, s: Snapshot, places: np.ndarray, **look) -> bool:
    """Draw where the damage is one half, at ``places`` (q, 3); False if nothing is cut yet, or all is."""
    cut = s.faces["cut"]
    damage = cut["damage"]
    if not damage.min() < FRONT_DAMAGE < damage.max():
        return False
    # Neighbours are found in the undeformed rectangle: the deformed one is not convex.
    flat = Triangulation(cut["X"][:, 2], cut["X"][:, 1])
    # Slivers along its border would join points that are far apart. A section drawn out is read in few
    # planes, and has none but slivers.
    few = np.unique(np.round(cut["X"][:, 2], 9)).size < FEW_PLANES * damage.size
    slivers = None if few else TriAnalyzer(flat).get_flat_tri_mask(0.05)
    mesh = Triangulation(places[:, 2], places[:, 1], flat.triangles, mask=slivers)
    style_of = {"colors": look["color"], "linewidths": look["lw"], "linestyles": [look.get("linestyle", "-")]}
    axes.tricontour(mesh, damage, levels=[FRONT_DAMAGE], **style_of)
    return True


def _skin(cells: np.ndarray) -> np.ndarray:
    """Corner triangles (n, 3) that belong to one tetrahedron only."""
    corners = cells[:, :4]
    faces = np.concatenate([corners[:, c] for c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[count == 1]]


def cut_plane_of(s: Snapshot) -> np.ndarray:
    """Triangles (n, 3) of the cut plane; of a split block those of the side x > 0."""
    faces = _skin(s.cells)
    eps = 1e-9 * np.ptp(s.points[:, 0])
    on = np.all(np.abs(s.points[faces, 0]) < eps, axis=1)
    if s.points[:, 0].min() < -eps:
        # The nodes of one side come first; the other side's lie at the same places.
        used = np.unique(s.cells[s.points[s.cells[:, :4], 0].mean(axis=1) > 0])
        on &= np.isin(faces, used).all(axis=1)
    return faces[on]
