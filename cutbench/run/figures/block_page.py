"""``solid.html``: the deformed block as one page that needs no network, to be turned and walked through.

Plotly draws it; its part for space lies in ``web/plotly`` and is written into the page. It has colours that
have numbers, edges and lines, and answers to a finger; the viewers that PyVista exports to have none of the
numbers.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, to_hex

from cutbench.base.figure_style import FIELD_MAP
from cutbench.base.report import filled, packaged_text
from cutbench.run.figures.block_picture import BLADE_GREY, DAMAGE_MAP, SEEN_DAMAGE, BlockScene, solid
from cutbench.run.figures.cut_open import BLADE_SHOWN, CutOpen, cut_open
from cutbench.run.figures.section import spread
from cutbench.run.figures.view import TOWARDS_EYE
from cutbench.run.result import Result, Snapshot

#: What the numbers of a page take at the most, and one node of one travel does, in bytes: of a large block
#: fewer travels are shown.
_MOST_BYTES, _NODE_BYTES = 8_000_000, 32
#: Where the parts of a page lie.
_PLACE = "cutbench.run.figures"
#: Colours of a table.
_COLOURS = 41
#: Ambient and diffuse light; distance of the eye and size of the block in plotly's own unit; how far the
#: front is lifted off the cut plane, and room round all, in lengths of the block.
_LIGHT, _EYE, _ZOOM, _LIFT, _ROOM = [0.9, 0.35], 1.6, 1.7, 0.004, 0.02


def block_page(result: Result) -> str:
    """The whole page as HTML. Raises ValueError without a snapshot of a solid."""
    found = block_contents(result)
    parts = {
        "TITLE": escape(result.case.name),
        "LAST": str(len(found["steps"]) - 1),
        "HALF": f"{found['top'] / 2:.3g}",
        "TOP": f"{found['top']:.3g}",
        "BLADE": found["bladeColour"],
        "DATA": json.dumps(found, separators=(",", ":")),
        "PLOTLY": packaged_text(_PLACE, "web/plotly/plotly-gl3d.min.js"),
        "SCRIPT": packaged_text(_PLACE, "web/solid.js"),
    }
    return filled(_PLACE, "web/solid.html", parts)


def block_contents(result: Result) -> dict:
    """What the script draws, as plain data: triangles and edges once a mesh; for each travel its mesh, the
    places of the nodes (mm), their stress (kPa), the damage of those on the cut plane, the front, the blade.
    """
    shown = solid(result)
    first = cut_open(shown[-1], result.case)
    shown = spread(shown, max(_MOST_BYTES // (_NODE_BYTES * len(first.points)), 1))
    scene = BlockScene(result.case, shown)
    blocks = [cut_open(s, result.case) for s in shown]
    meshes, which = _meshes(blocks)
    both = np.concatenate([points for b in blocks for points in (b.points, b.blade_points)])
    # What lies on the frame of plotly's axes is cut away by rounding.
    room = _ROOM * np.ptp(both)
    low, high = both.min(axis=0) - room, both.max(axis=0) + room
    return {
        "top": scene.top_kPa,
        "seen": SEEN_DAMAGE,
        "stressColours": _table(colormaps[FIELD_MAP]),
        "damageColours": _table(DAMAGE_MAP),
        "bladeColour": to_hex((BLADE_GREY,) * 3),
        "light": _LIGHT,
        "eye": [_EYE * part for part in TOWARDS_EYE],
        "zoom": _ZOOM,
        "lift": _LIFT * float(np.ptp(both[:, 2])),
        "range": np.array([low, high]).T.tolist(),
        "symmetric": bool(shown[-1].points[:, 0].min() > -1e-9 * np.ptp(shown[-1].points[:, 0])),
        "meshes": meshes,
        "blade": first.blade.tolist(),
        "bladeEdges": first.blade_edges.tolist(),
        "loop": (len(first.blade_points) - 2) // 2,
        "shown": BLADE_SHOWN,
        "steps": [_step(s, b, which[n]) for n, (s, b) in enumerate(zip(shown, blocks, strict=True))],
    }  # fmt: skip


def _meshes(blocks: Sequence[CutOpen]) -> tuple[list[dict], list[int]]:
    """The meshes of ``blocks``, which follow the front, each once; and which each of them has."""
    found: list[CutOpen] = []
    which = []
    for block in blocks:
        if not found or not np.array_equal(found[-1].reference, block.reference):
            found.append(block)
        which.append(len(found) - 1)
    meshes = [
        {
            "skin": b.skin.tolist(),
            "cut": b.cut.tolist(),
            "cutNodes": np.unique(b.cut).tolist(),
            "edges": b.edges.tolist(),
        }
        for b in found
    ]
    return meshes, which


def _step(s: Snapshot, block: CutOpen, mesh: int) -> dict:
    return {
        "mesh": mesh,
        "travel": f"{s.displacement_mm:.2f}",
        "points": block.points.round(3).tolist(),
        "stress": block.stress_kPa.round(2).tolist(),
        "damage": block.damage[np.unique(block.cut)].round(3).tolist(),
        "front": block.front.round(3).tolist(),
        "blade": block.blade_points.round(3).tolist(),
    }


def _table(colours: Colormap) -> list[str]:
    return [to_hex(colour) for colour in colours(np.linspace(0, 1, _COLOURS))]
