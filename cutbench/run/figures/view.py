"""How a block is looked at: a parallel projection, and what paints surfaces in it.

PyVista paints where it is there (the extra ``pictures``); else matplotlib does, from the back to the front.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from cutbench.base.figure_style import Look

_log = logging.getLogger(__name__)

#: From the block to the eye: from the side that is taken away, a little from above and from the near end.
TOWARDS_EYE = (-1.0, 0.42, 0.55)
#: Share of the light that comes from everywhere: colours stay near those of the colour bar.
_AMBIENT, _DIFFUSE = 0.62, 0.42
#: Of the light from the eye, and of that from above.
_LIGHTS = 0.75, 0.35
#: Surfaces are smooth where they turn by less, in degrees.
_SMOOTH_DEG = 40.0
#: Edges: their width, and how far they are lifted off their surface, in heights of the picture.
_EDGE_PIXELS, _LIFT = 2.0, 0.002
#: Said where matplotlib stands in.
STANDS_IN = "PyVista does not draw here ({}): matplotlib's picture of the block stands in"


@dataclass(frozen=True)
class Surface:
    """Triangles (m, 3) of nodes (n, 3), mm, with a colour (n, 3) in 0 … 1 at each node; its edges (e, 2)."""

    points: np.ndarray
    triangles: np.ndarray
    colours: np.ndarray
    edges: np.ndarray


@dataclass(frozen=True)
class View:
    """A parallel projection from ``towards_eye``; y points up."""

    towards_eye: tuple[float, float, float] = TOWARDS_EYE

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors (3, 3) to the right, up, and towards the eye."""
        back = np.array(self.towards_eye) / np.linalg.norm(self.towards_eye)
        right = np.cross([0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Places (n, 2) in the picture of ``points`` (n, 3), both mm."""
        return points @ self.axes[:2].T


class NoPyVista(Exception):
    """PyVista is missing, or cannot render here; says why."""


def paint(axes: Axes, view: View, surfaces: Sequence[Surface]) -> None:
    """Put ``surfaces`` into ``axes``, whose limits say what is seen, and say so once where PyVista does not
    draw. What lies before another comes after it in ``surfaces``."""
    limits = (*axes.get_xlim(), *axes.get_ylim())
    try:
        image = rendered(view, surfaces, limits, axes.get_window_extent().width / (limits[1] - limits[0]))
    except NoPyVista as why:
        _say(STANDS_IN.format(why))
        _paint_flat(axes, view, surfaces)
        return
    axes.imshow(image, extent=limits, aspect="equal", zorder=0, interpolation="none")


@cache
def _say(sentence: str) -> None:
    _log.warning(sentence)


def _pixels(axes: Axes, dpi: float) -> float:
    """Pixels per mm of the block."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    width_in = axes.get_position().width * figure.get_figwidth()
    return dpi * width_in / float(np.ptp(axes.get_xlim()))


def rendered(
    view: View, surfaces: Sequence[Surface], limits: tuple[float, float, float, float], per_mm: float
) -> np.ndarray:
    """An image (rows, columns, 4) by PyVista of what lies within ``limits`` (left, right, bottom, top), mm.

    Raises NoPyVista.
    """
    try:
        import pyvista  # noqa: F401
    except ImportError as error:
        raise NoPyVista("pip install 'cutbench[pictures]'") from error
    try:
        with _quiet():
            return _render(view, surfaces, limits, per_mm)
    except Exception as error:  # no EGL, no OSMesa, a broken VTK: all raise what they like
        raise NoPyVista(str(error) or type(error).__name__) from error


@contextmanager
def _quiet() -> Iterator[None]:
    """VTK tells of every window that it tries in vain."""
    from vtkmodules.vtkCommonCore import vtkLogger

    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


def _render(view: View, surfaces: Sequence[Surface], limits: tuple[float, ...], per_mm: float) -> np.ndarray:
    import pyvista as pv

    left, right, bottom, top = limits
    size = [max(round(per_mm * length), 1) for length in (right - left, top - bottom)]
    plotter = pv.Plotter(off_screen=True, window_size=size, lighting="none")
    across, up, back = view.axes
    plotter.add_light(pv.Light(light_type="headlight", intensity=_LIGHTS[0]))
    plotter.add_light(pv.Light(position=back + 1.5 * up - 0.5 * across, intensity=_LIGHTS[1]))
    for surface in surfaces:
        _add(plotter, surface, _LIFT * (top - bottom) * back)
    focus = 0.5 * (left + right) * across + 0.5 * (bottom + top) * up
    reach = 4 * max(float(np.abs(s.points).max()) for s in surfaces)
    camera = plotter.camera
    camera.position, camera.focal_point, camera.up = focus + reach * back, focus, up
    camera.parallel_projection, camera.parallel_scale = True, 0.5 * (top - bottom)
    camera.clipping_range = 0.01 * reach, 2 * reach
    plotter.enable_anti_aliasing("ssaa")
    try:
        return np.asarray(plotter.screenshot(transparent_background=True, return_img=True))
    finally:
        plotter.close()


def _add(plotter, surface: Surface, lift: np.ndarray) -> None:
    """``surface`` into ``plotter``, its edges lifted towards the eye: they would half drown in it."""
    import pyvista as pv

    mesh = pv.PolyData.from_regular_faces(surface.points, surface.triangles)
    mesh["colour"] = np.rint(255 * surface.colours).astype(np.uint8)
    plotter.add_mesh(
        mesh, scalars="colour", rgb=True, smooth_shading=True, split_sharp_edges=True,
        feature_angle=_SMOOTH_DEG, ambient=_AMBIENT, diffuse=_DIFFUSE,
    )  # fmt: skip
    if surface.edges.size:
        lines = pv.PolyData(surface.points + lift, lines=np.insert(surface.edges, 0, 2, axis=1).ravel())
        plotter.add_mesh(lines, color="black", line_width=_EDGE_PIXELS, lighting=False)


def _paint_flat(axes: Axes, view: View, surfaces: Sequence[Surface]) -> None:
    """One surface over the other, of each the triangles from the back to the front, each in one colour."""
    for surface in surfaces:
        corners = surface.points[surface.triangles]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        facing = normal @ view.axes[2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
        order = np.argsort(corners.mean(axis=1) @ view.axes[2], kind="stable")
        order = order[facing[order] > 0]
        light = _AMBIENT + _DIFFUSE * facing[order, None]
        colours = np.clip(surface.colours[surface.triangles[order]].mean(axis=1) * light, 0, 1)
        look: Look = {"facecolors": colours, "edgecolors": colours, "linewidths": 0.2, "rasterized": True}
        axes.add_collection(PolyCollection(list(view.flat(corners[order])), zorder=0, **look), autolim=False)
