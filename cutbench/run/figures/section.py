"""The deformed plane-strain section with the blade in it, and a closer look at the tip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, TriMesh
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.tri import Triangulation

from cutbench.base.figure_style import DOUBLE_MM, FIELD_MAP, Look, new_figure, style
from cutbench.case.case import Case
from cutbench.run.blade_geometry import blade_outline
from cutbench.run.result import Result, Snapshot

#: Colours end where this percentage of the material has less stress: that at the tip would flatten the rest.
TOP_PERCENTILE = 99.9


def plot_section(result: Result) -> Figure:
    """Von Mises stress (kPa) on the deformed section, mirrored to the full block, with a zoom at the tip.

    One snapshot stands beside its zoom; several, four at the most, stand in a row with their zooms below, on
    one colour scale. Raises ValueError without a plane snapshot.
    """
    wanted = "a section is drawn from plane snapshots (triangle, triangle6)"
    shown = spread(drawable(result.snapshots, "triangle", wanted))
    halves = [Half(s) for s in shown]
    top_kPa = max(h.top_kPa for h in halves) or 1.0
    case, p = result.case, result.case.p
    with style():
        n = len(halves)
        figure = new_figure(DOUBLE_MM, 82 if n == 1 else 48 + 190 / n)
        if n == 1:
            grid = figure.subplots(1, 2, width_ratios=(1.75, 1), squeeze=False).T
        else:
            grid = figure.subplots(2, n, squeeze=False, height_ratios=(1, 0.85))
        for column, half in enumerate(halves):
            whole, near = grid[0, column], grid[1, column]
            colours = draw_half(whole, half, case, top_kPa, line=0.12)
            draw_half(near, half, case, top_kPa, line=0.2)
            frame(whole, shown, p.height)
            _zoom(whole, near, half, case, lines=n == 1)
            whole.set_title(f"blade travel {half.travel_mm:.2f} mm", loc="left", fontsize=8.5)
            if column == 0:
                whole.set_ylabel("height (mm)")
                near.set_ylabel("height (mm)")
        look: Look = {"extend": "max", "pad": 0.015, "location": "right", "aspect": 28, "shrink": 0.85}
        bar = figure.colorbar(colours, ax=grid.ravel().tolist(), label="von Mises stress (kPa)", **look)
        bar.outline.set_linewidth(0.5)
        figure.suptitle(result.case.name, x=0.02, ha="left")
        # Axes of equal scales have room for their labels only once they were laid out twice.
        figure.draw_without_rendering()
    return figure


def drawable(snapshots: Sequence[Snapshot], cells: str, wanted: str) -> list[Snapshot]:
    """``snapshots`` of elements of the kind ``cells``. Raises ValueError where there is none, or another."""
    if not snapshots:
        raise ValueError("no snapshot to draw: the run was made without snapshots_mm")
    if not all(s.cell_type.startswith(cells) for s in snapshots):
        raise ValueError(wanted)
    return list(snapshots)


def spread(snapshots: Sequence[Snapshot], most: int = 4) -> list[Snapshot]:
    """So many at the most, spread evenly: more than four in a row are too small to see anything."""
    last = len(snapshots) - 1
    return [snapshots[i] for i in np.linspace(0, last, min(most, last + 1)).round().astype(int)]


class Half:
    """A snapshot as drawn: current positions, triangles of three nodes, edges of the elements."""

    def __init__(self, snapshot: Snapshot):
        self.travel_mm = snapshot.displacement_mm
        self.x = snapshot.current[:, :2]
        self.stress_kPa = 1e3 * np.asarray(snapshot.point_data["von_mises"])
        self.triangles = split(snapshot.cells)
        width = np.ptp(snapshot.points[:, 0])
        self.full = bool(snapshot.points[:, 0].min() < -1e-9 * width)
        edges, boundary = _edges(snapshot.cells)
        self.inner = self.x[edges]
        # Where the cut plane has not opened there is no surface to show.
        on_plane = np.all(np.abs(snapshot.points[boundary, 0]) < 1e-9 * width, axis=1)
        closed = np.all(np.abs(self.x[boundary, 0]) < 1e-4 * width, axis=1)
        self.outline = self.x[boundary[~(on_plane & closed)]]

    @property
    def top_kPa(self) -> float:
        return scale_end(self.x, self.triangles, self.stress_kPa)

    @property
    def sides(self) -> tuple[float, ...]:
        """Factors on x: the half block and its mirror image, or the full block as it is."""
        return (1.0,) if self.full else (1.0, -1.0)


def scale_end(
    x: np.ndarray, triangles: np.ndarray, values: np.ndarray, percentile: float = TOP_PERCENTILE
) -> float:
    """Where the colours of ``values`` (n,) at the nodes ``x`` (n, 2 or 3) end: by area, not by nodes, of
    which most are at the tip."""
    a, b, c = (x[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    squared = (u**2).sum(axis=1) * (v**2).sum(axis=1) - (u * v).sum(axis=1) ** 2
    shares = np.repeat(np.sqrt(np.maximum(squared, 0.0))[:, None] / 3, 3, axis=1)
    area = np.bincount(triangles.ravel(), shares.ravel(), minlength=values.size)
    order = np.argsort(values)
    below = np.cumsum(area[order])
    found = np.searchsorted(below, percentile / 100 * below[-1])
    return float(values[order[min(found, order.size - 1)]])


def split(cells: np.ndarray) -> np.ndarray:
    """Triangles of three nodes (k, 3): those of six nodes (corners, then midsides) become four each."""
    if cells.shape[1] == 3:
        return cells
    a, b, c, ab, bc, ca = cells.T[:6]
    return np.concatenate([np.column_stack(t) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _edges(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Node lists of all edges (e, 2 or 3) and of those that belong to one element only."""
    corners = ((0, 1), (1, 2), (2, 0)) if cells.shape[1] == 3 else ((0, 3, 1), (1, 4, 2), (2, 5, 0))
    edges = np.concatenate([cells[:, c] for c in corners])
    ends = np.sort(edges[:, [0, -1]], axis=1)
    _, first, count = np.unique(ends, axis=0, return_index=True, return_counts=True)
    return edges[first], edges[first[count == 1]]


def draw_half(axes: Axes, half: Half, case: Case, top_kPa: float, line: float) -> TriMesh:
    """Field, mesh, surfaces and blade into ``axes``; returns what the colour bar needs."""
    for side in half.sides:
        mesh = Triangulation(side * half.x[:, 0], half.x[:, 1], half.triangles)
        colours = axes.tripcolor(
            mesh, half.stress_kPa, shading="gouraud", cmap=FIELD_MAP, vmin=0, vmax=top_kPa, rasterized=True
        )
        flip = np.array([side, 1.0])
        axes.add_collection(LineCollection(half.inner * flip, colors="white", linewidths=line, alpha=0.35))
        axes.add_collection(
            LineCollection(half.outline * flip, colors="black", linewidths=0.6, capstyle="round")
        )
    outline = blade_outline(case, half.travel_mm, 1.2 * case.p.height)
    axes.add_patch(Polygon(outline, facecolor="#D9D9D9", edgecolor="black", lw=0.6, hatch="", zorder=3))
    axes.set_aspect("equal")
    return colours


def frame(axes, snapshots: Sequence[Snapshot], height_mm: float) -> None:
    """Limits that hold all ``snapshots``, so that blocks compare by eye."""
    places = [s.current[:, :2] for s in snapshots]
    reach = max(float(np.abs(x[:, 0]).max()) for x in places)
    roof = max(float(x[:, 1].max()) for x in places)
    floor = min(float(x[:, 1].min()) for x in places)
    axes.set_xlim(-1.04 * reach, 1.04 * reach)
    axes.set_ylim(floor - 0.03 * height_mm, max(roof, height_mm) + 0.1 * height_mm)
    axes.set_xlabel("width (mm)")


def _zoom(whole, near, half: Half, case: Case, *, lines: bool) -> None:
    """Limits of the close look: some tip lengths round the tip; its frame in the whole picture."""
    p, tool = case.p, case.model.tool
    reach = max(4 * p.thickness, 1.6 * tool.height(p) if tool else 0.0)
    middle = min(p.height - half.travel_mm + 0.35 * reach, whole.get_ylim()[1] - reach)
    near.set_xlim(-reach, reach)
    near.set_ylim(middle - reach, middle + reach)
    near.set_xlabel("width (mm)")
    for spine in near.spines.values():
        spine.set_visible(True)
    frame = whole.indicate_inset_zoom(near, edgecolor="black", alpha=0.9, lw=0.6)
    for line in frame.connectors:
        line.set(linewidth=0.4, alpha=0.5)
        if not lines:
            line.set_visible(False)
