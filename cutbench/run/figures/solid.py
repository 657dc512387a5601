"""Pictures of a cut in three dimensions: the cut plane and the front's shape.

The cut plane is drawn from the side: z along the blade, y the height, the blade coming from above.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

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
from cutbench.base.files import write_text
from cutbench.run.figures.block_page import block_page
from cutbench.run.figures.block_picture import plot_solid, solid
from cutbench.run.figures.cut_open import FRONT_DAMAGE, columns_of, skin_of, whole_columns
from cutbench.run.figures.section import spread
from cutbench.run.result import Result, Snapshot

#: Colours end at this percentile of the nodes' stress; the few nodes at the tip would flatten the rest.
TOP_PERCENTILE = 99.5
#: What the blade touched before.
TOUCHED: Look = {"cmap": ListedColormap(["#BBBBBB"]), "rasterized": True}


def save_solid(result: Result, folder: str | Path, plane: Result | None = None) -> dict[str, Path]:
    """Write solid.png, solid.html, cut_plane.png, front.png of a block that is cut, and, with a plane-strain
    run, plane_strain.png.

    Returns the paths by name. Without snapshots only the last can be drawn.
    """
    folder = Path(folder)
    figures, paths = {}, {}
    if result.snapshots:
        draw = {"solid": plot_solid, "cut_plane": plot_cut_plane}
        if _cut_snapshots(result):
            draw["front"] = plot_front
        figures = {name: plot(result) for name, plot in draw.items()}
        paths["solid_html"] = write_text(block_page(result), Path(folder) / "solid.html")
    if plane is not None:
        figures["plane_strain"] = plot_beside(result, plane)
    return paths | {f"{name}_png": save(each, folder / f"{name}.png")[0] for name, each in figures.items()}


def plot_cut_plane(result: Result) -> Figure:
    """Von Mises stress and contact pressure (both kPa) on the cut plane as far down as the cut is felt, a
    column a snapshot; grey was touched before.

    At most four columns, spread over the travel. Raises ValueError without a snapshot of a solid.
    """
    shown = spread(solid(result))
    stress = [1e3 * s.point_data["von_mises"] for s in shown]
    planes = [cut_plane_of(s) for s in shown]
    on_plane = [values[np.unique(triangles)] for values, triangles in zip(stress, planes, strict=True)]
    stress_look = look_of(max(float(np.percentile(values, TOP_PERCENTILE)) for values in on_plane))
    pressure_look = look_of(1e3 * max(s.faces["cut"]["contact_pressure_MPa"].max(initial=0.0) for s in shown))
    top = max(s.current[np.unique(t), 1].max() for s, t in zip(shown, planes, strict=True))
    low = result.case.p.height - shown[-1].displacement_mm
    with style():
        figure = new_figure(DOUBLE_MM, 100)
        grid = figure.subplots(2, len(shown), squeeze=False, sharex=True, sharey=True)
        for column, (s, values, triangles) in enumerate(zip(shown, stress, planes, strict=True)):
            cut, columns = s.faces["cut"], columns_of(s)
            mesh = Triangulation(s.current[:, 2], s.current[:, 1], triangles)
            first = grid[0, column].tripcolor(mesh, values, shading="gouraud", **stress_look)
            points = Triangulation(*cut["X"][:, [2, 1]].T).triangles
            kPa, pressed = 1e3 * cut["contact_pressure_MPa"], cut["contact_state"] > 0
            for chosen, look in ((cut["touched"] > 0, TOUCHED), (pressed, pressure_look)):
                mask = ~chosen[points].any(axis=1)
                face = Triangulation(cut["x"][:, 2], cut["x"][:, 1], points, mask)
                second = grid[1, column].tripcolor(face, kPa, shading="gouraud", **look)
            for axes in grid[:, column]:
                if columns.depth_mm.any():
                    z, y = columns.front()[:, [2, 1]].T
                    axes.plot(z, y, color="white" if axes is grid[0, column] else "black", ls="-", lw=0.8)
                    low = min(low, y.min())
                axes.axhline(result.case.p.height - s.displacement_mm, color=GREY, lw=0.6, ls=":")
            grid[0, column].set_title(f"blade travel {s.displacement_mm:.2f} mm", loc="left", fontsize=8)
            grid[1, column].set_xlabel("along the blade (mm)")
        grid[0, 0].set_ylim(max(0.0, low - 0.2 * (top - low)), top + 0.03 * (top - low))
        for row in grid:
            row[0].set_ylabel("height (mm)")
        figure.colorbar(first, ax=grid[0].tolist(), extend="max", label="von Mises (kPa)")
        figure.colorbar(second, ax=grid[1].tolist(), label="contact pressure (kPa)")
        title = f"{result.case.name}: cut plane (line: damage {FRONT_DAMAGE:g}; dotted: blade's tip)"
        figure.suptitle(title, x=0.02, ha="left")
    return figure


def _cut_snapshots(result: Result) -> list[Snapshot]:
    """Those in which a part of the plane is cut."""
    return [s for s in solid(result) if columns_of(s).depth_mm.any()]


def plot_front(result: Result) -> Figure:
    """Depth of the cut (mm, in the uncut block) along the blade, at seven travels at the most. Raises
    ValueError where nothing is cut."""
    cut = [(s, whole_columns(s)) for s in spread(_cut_snapshots(result), len(LINE_COLOURS))]
    with style():
        figure = new_figure(SINGLE_MM, 78)
        axes = figure.subplots()
        for i, (s, columns) in enumerate(cut):
            look: Look = {"color": LINE_COLOURS[i], "ls": LINES[i]}
            axes.plot(
                columns.z,
                columns.depth_mm,
                lw=1.3,
                label=f"{s.displacement_mm:.2f} mm",
                clip_on=False,
                **look,
            )
        axes.set(xlabel="along the blade (mm)", ylabel="depth of the cut (mm)")
        axes.set_xlim(cut[0][1].z[0], cut[0][1].z[-1])
        axes.set_ylim(1.08 * max(columns.depth_mm.max() for _, columns in cut), 0)
        figure.legend(loc="outside lower center", ncols=3, title="blade travel")
        figure.suptitle(f"{result.case.name}: front of the cut", x=0.02, ha="left")
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


def look_of(top: float) -> Look:
    return {"cmap": FIELD_MAP, "norm": Normalize(0, top or 1.0), "rasterized": True}


def cut_plane_of(s: Snapshot) -> np.ndarray:
    """Triangles (n, 3) of the cut plane; of a split block those of the side x > 0."""
    faces = skin_of(s.cells)
    eps = 1e-9 * np.ptp(s.points[:, 0])
    on = np.all(np.abs(s.points[faces, 0]) < eps, axis=1)
    if s.points[:, 0].min() < -eps:
        # The nodes of one side come first; the other side's lie at the same places.
        used = np.unique(s.cells[s.points[s.cells[:, :4], 0].mean(axis=1) > 0])
        on &= np.isin(faces, used).all(axis=1)
    return faces[on]
