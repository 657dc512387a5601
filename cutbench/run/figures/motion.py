"""A cut in motion: a picture a frame, and all of them as one animation.

The stress is beside the force, which grows as the blade goes on. Axes and colours are the same in all frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.layout_engine import PlaceHolderLayoutEngine
from PIL import Image

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, FIELD_MAP, new_figure, style
from cutbench.base.files import replacing
from cutbench.run.figures.block_picture import BlockScene
from cutbench.run.figures.section import Half, draw_half, frame
from cutbench.run.result import Result, Snapshot

#: Folder of the single pictures.
FOLDER = "frames"
#: Pixels of a picture: 180 mm by 80 mm.
_HEIGHT_MM, _DPI = 80.0, 140
#: What an animation lasts, the least and the most of a frame, and the last one more, ms.
_DURATION_MS, _MIN_FRAME_MS, _MAX_FRAME_MS, _LAST_FRAME_MS = 6000, 40, 300, 1500
#: Where on its curve the force is.
_POINT = COLOURS["vermilion"]


class _Scene(Protocol):
    """How a snapshot is drawn: the name of its animation, the end of its colours in kPa, its axes, itself."""

    stem: str
    top_kPa: float

    def limits(self, axes: Axes) -> None: ...

    def draw(self, axes: Axes, snapshot: Snapshot) -> None: ...


@dataclass
class _Section:
    """The deformed section with the blade, both halves."""

    result: Result
    stem = "section"

    def __post_init__(self) -> None:
        self.top_kPa = max(Half(s).top_kPa for s in self.result.frames) or 1.0

    def limits(self, axes: Axes) -> None:
        frame(axes, self.result.frames, self.result.case.p.height)

    def draw(self, axes: Axes, snapshot: Snapshot) -> None:
        draw_half(axes, Half(snapshot), self.result.case, self.top_kPa, line=0.12)


def save_frames(result: Result, folder: str | Path) -> dict[str, Path]:
    """Write ``frames/frame-000.png`` and so on, and section.gif, of a block solid.gif, from the frames.

    Returns the animation's path by name. Where there are no frames nothing is written, and earlier pictures
    are removed.
    """
    folder = Path(folder)
    pictures = folder / FOLDER
    written: list[Path] = []
    paths: dict[str, Path] = {}
    if result.frames:
        pictures.mkdir(exist_ok=True)
        plane = result.frames[0].cell_type.startswith("triangle")
        scene: _Scene = _Section(result) if plane else BlockScene(result.case, result.frames)
        for i, picture in enumerate(_pictures(result, scene)):
            written.append(pictures / f"frame-{i:03d}.png")
            with replacing(written[-1]) as draft:
                picture.save(draft, format="png")
        paths[f"{scene.stem}_gif"] = folder / f"{scene.stem}.gif"
        _animate(written, paths[f"{scene.stem}_gif"])
    for old in set(pictures.glob("frame-*.png")) - set(written):
        old.unlink()
    for stem in (_Section.stem, BlockScene.stem):
        if f"{stem}_gif" not in paths:
            (folder / f"{stem}.gif").unlink(missing_ok=True)
    if pictures.is_dir() and not any(pictures.iterdir()):
        pictures.rmdir()
    return paths


def _pictures(result: Result, scene: _Scene) -> Iterator[Image.Image]:
    """A picture a frame: of one figure, in which all but the axes' own things changes."""
    with style():
        figure, body, force = _figure(result, scene)
        words = _words(result)
        line = force.plot([], [], color="black", ls="-", lw=1.1)[0]
        point = force.plot([], [], "o", color=_POINT, mec="white", mew=0.6, ms=6)[0]
        lasting = set(body.get_children())
        times, travel, force_N = (result.curve[name] for name in ("time_s", "displacement_mm", "force_N"))
        for shown in result.frames:
            scene.draw(body, shown)
            count = int(np.searchsorted(times, shown.time_s * (1 + 1e-12), side="right"))
            line.set_data(travel[:count], force_N[:count])
            point.set_data(travel[count - 1 : count], force_N[count - 1 : count])
            body.set_title(words(shown), loc="left", fontsize=8.5)
            canvas = FigureCanvasAgg(figure)
            canvas.draw()
            yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
            for artist in set(body.get_children()) - lasting:
                artist.remove()


def _figure(result: Result, scene: _Scene) -> tuple[Figure, Axes, Axes]:
    """The figure, and in it the axes of the body and of the force, placed once and for all."""
    figure = new_figure(DOUBLE_MM, _HEIGHT_MM)
    figure.set_dpi(_DPI)
    body, force = figure.subplots(1, 2, width_ratios=(1.6, 1))
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, scene.top_kPa), FIELD_MAP), ax=body, extend="max", pad=0.015, aspect=28,
        shrink=0.85, label="von Mises stress (kPa)",
    )  # fmt: skip
    bar.outline.set_linewidth(0.5)
    scene.limits(body)
    body.set(ylabel="height (mm)", aspect="equal")
    body.set_title(_words(result)(result.frames[-1]), loc="left", fontsize=8.5)
    travel, force_N = result.displacement_mm, result.force_N
    force.set_xlim(0, 1.03 * float(travel.max()))
    force.set_ylim(1.12 * float(force_N.min(initial=0.0)), 1.12 * float(force_N.max(initial=1e-9)))
    force.set(xlabel="blade travel (mm)", ylabel="force (N)", box_aspect=0.85)
    figure.suptitle(result.case.name, x=0.02, ha="left")
    for _ in range(2):  # the axes that are as wide as high move the others once more
        figure.canvas.draw()
    figure.set_layout_engine(PlaceHolderLayoutEngine(adjust_compatible=True, colorbar_gridspec=False))
    return figure, body, force


def _words(result: Result):
    """What a frame is called, with as many digits as tell one from the next."""
    frames = result.frames
    moves = bool(result.case.motion)
    apart = float(np.ptp(result.displacement_mm)) / len(frames)
    digits = max(2, math.ceil(-math.log10(apart))) if apart > 0 else 2

    def words(shown: Snapshot) -> str:
        text = f"blade travel {shown.displacement_mm:.{digits}f} mm"
        return f"{text}, {shown.time_s:.4g} s" if moves else text

    return words


def _palette(pictures: list[Path]) -> Image.Image:
    """The colours of all frames, at most 256, as they are in three of them."""
    shown = []
    for path in (pictures[0], pictures[len(pictures) // 2], pictures[-1]):
        with Image.open(path) as picture:
            shown.append(np.asarray(picture))
    holder = Image.fromarray(np.concatenate(shown)).quantize(256)
    colours = np.array(holder.getpalette()).reshape(-1, 3)
    colours[colours.sum(axis=1).argmax()] = 255  # paper is white
    holder.putpalette(colours.ravel().tolist())
    return holder


def _animate(pictures: list[Path], path: Path) -> None:
    """``pictures`` one after the other as a GIF."""
    palette = _palette(pictures)

    def turned() -> Iterator[Image.Image]:
        for each in pictures:
            with Image.open(each) as picture:
                yield picture.quantize(palette=palette, dither=Image.Dither.NONE)

    each_ms = int(np.clip(_DURATION_MS / len(pictures), _MIN_FRAME_MS, _MAX_FRAME_MS))
    frames = turned()
    with replacing(path) as draft:
        next(frames).save(
            draft, format="gif", save_all=True, append_images=frames, loop=0,
            duration=[each_ms] * (len(pictures) - 1) + [each_ms + _LAST_FRAME_MS], disposal=1,
        )  # fmt: skip
