"""``python docs/pictures.py [NAME …]``: the pictures of the tutorials, from the commands that stand there.

A page of HTML is photographed by Chromium, where there is one. ``tools``, ``readings``, ``rooms``,
``slicing`` and ``edge-stress`` are drawn here.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

import cutbench
from cutbench.base.figure_style import DOUBLE_MM, LINE_COLOURS, new_figure, save, style
from cutbench.data.contact import find_contact
from cutbench.mechanisms import registry
from cutbench.run.figures.section import Half, draw_half

HERE = Path(__file__).resolve().parent
FIGURES = HERE / "figures"
#: Pixels across: what a page of the site shows.
WIDTH = 1400

#: Of each picture: a tutorial whose files it needs, a command, what that leaves, and the part that is shown.
PICTURES = {
    "first-cut-curve": ("first-cut", "run2d gelatin --until transition --out gelatin", "gelatin/curve.png"),
    "first-cut-section": (
        "first-cut",
        "run2d gelatin --until transition --out gelatin",
        "gelatin/section.png",
    ),
    "cut-in-motion": (
        "first-cut",
        "run2d gelatin --until transition --frames 24 --out motion",
        "motion/frames/frame-014.png",
    ),
    "estimate": ("first-cut", "estimate gelatin --out estimate", "estimate/estimate.png"),
    "first-map": ("first-map", "sweep knife.toml --out knife", "knife/phase.png"),
    "discovery-page": (
        "my-curves",
        "discover examples/rubber/treloar.toml --out rubber",
        "rubber/discovery.html",
    ),
    "fit": ("my-curves", "fit examples/silicone/meunier.toml --out silicone", "silicone/fit.png"),
}


def draw(name: str, folder: Path) -> None:
    """Put one picture into docs/figures; ``folder`` keeps what commands leave."""
    tutorial, command, left = PICTURES[name]
    text = (HERE / "tutorials" / f"{tutorial}.md").read_text(encoding="utf-8")
    for path, content in re.findall(r"^```toml\n# file: (\S+)\n(.*?)^```$", text, re.M | re.S):
        (folder / path).write_text(content, encoding="utf-8")
    program = [sys.executable, "-m", "cutbench"]
    if "examples/" in command and not (folder / "examples").exists():
        subprocess.run([*program, "examples", "--out", "examples"], cwd=folder, check=True)
    if not (folder / left).exists():
        subprocess.run([*program, *command.split()], cwd=folder, check=True)
    source = folder / left
    if source.suffix == ".html":
        browser = (
            shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        )
        if browser is None:
            print(f"{name}: no Chromium to photograph {left} with")
            return
        source = folder / f"{name}.png"
        flags = ["--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1100,1500"]
        subprocess.run(
            [browser, *flags, f"--screenshot={source}", (folder / left).as_uri()],
            check=True,
            capture_output=True,
        )
    with Image.open(source) as picture:
        small = picture.convert("RGB")
        small.thumbnail((WIDTH, 4 * WIDTH))
        # Colours that few points have, such as those of the largest stress, stay.
        small.quantize(256, method=Image.Quantize.MAXCOVERAGE).save(FIGURES / f"{name}.png", optimize=True)


def profiles() -> None:
    """The blades of the package side by side, each with its own sizes."""
    laws = [law for law in registry().values() if law.role == "contact" and not law.measured]
    figure, places = plt.subplots(1, len(laws), figsize=(10, 3.2), sharey=True, layout="constrained")
    for place, law in zip(places, laws, strict=True):
        p = SimpleNamespace(**{q.name: q.default * q.factor for q in law.parameters})
        if law.name == "blunt_tip":
            p.blunting = 1.0
        x, y = law.outline(p).T
        top = 2.2 if law.band else max(y)
        x, y = ([x[0], *x, x[-1]], [top, *y, top]) if law.band else (x, y)
        place.fill(x, y, color="0.85", ec="black", lw=1.2)
        place.set(xlim=(-0.45, 0.75), ylim=(-0.1, 2.2), aspect="equal", title=law.name, xlabel="mm")
    places[0].set_ylabel("mm")
    figure.savefig(FIGURES / "tools.png", dpi=140)


def readings() -> None:
    """Invented readings: a contact that is found, and three specimens that differ by a factor."""
    rng = np.random.default_rng(1)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    u = np.arange(0, 3, 0.04)
    force = 0.02 + 0.1 * np.maximum(u - 1.2, 0) ** 1.5 + 0.002 * rng.standard_normal(u.size)
    found = find_contact(u, force)
    left.plot(u, force, "k.", ms=4, label="readings")
    left.axvspan(found.at - 2 * found.sd, found.at + 2 * found.sd, color="C1", alpha=0.3, lw=0)
    left.axvline(found.at, color="C1", label=f"$u_0$ = {found.at:.2f} ± {found.sd:.2f} mm (true: 1.2)")
    left.plot([0, found.at], [found.force] * 2, "C0", lw=2, label="$F_0$")
    left.set(xlabel="displacement of the machine (mm)", ylabel="force (N)")
    left.legend(framealpha=1, edgecolor="white")
    s = np.linspace(0, 4, 80)
    for r, factor in enumerate((-0.08, 0.01, 0.1), start=1):
        course = 0.3 * s / (1 + 0.4 * s) * (1 + factor)
        noise = 0.006 * rng.standard_normal(s.size)
        right.plot(s, course + noise, ".", ms=4, color=f"C{r}", label=f"$a_{r}$ = {factor:+.2f}")
        right.plot(s, course, color=f"C{r}", lw=0.8)
    right.set(xlabel="travel $s$ (mm)", ylabel="force (N)")
    right.legend(frameon=False)
    figure.savefig(FIGURES / "readings.png", dpi=140)


def rooms() -> None:
    """The folders of the package, each above what it imports; arrows are wider where more files import."""
    root = Path(cutbench.__file__).parent
    names = [p.parent.name for p in sorted(root.glob("*/__init__.py"))]
    uses: Counter[tuple[str, str]] = Counter()
    for file in root.glob("*/**/*.py"):
        here = file.relative_to(root).parts[0]
        text = file.read_text(encoding="utf-8")
        for there in set(re.findall(r"^\s*(?:from|import) cutbench\.(\w+)", text, re.M)) - {here}:
            uses[here, there] += there in names
    below = {name: {b for (a, b), count in uses.items() if a == name and count} for name in names}
    floors: list[list[str]] = []
    order = TopologicalSorter(below)
    order.prepare()
    while order.is_active():
        floors.append(sorted(order.get_ready()))
        order.done(*floors[-1])
    at = {
        name: ((k + 1) / (len(floor) + 1) + 0.035 * (-1) ** level, level)
        for level, floor in enumerate(floors)
        for k, name in enumerate(floor)
    }
    figure, axes = plt.subplots(figsize=(7.2, 7.6), layout="constrained")
    boxes = {}
    for name, (x, y) in at.items():
        count = sum(1 for _ in (root / name).rglob("*.py"))
        look = {"boxstyle": "round,pad=0.4", "fc": "white", "ec": "0.2"}
        text = axes.text(
            x, y, f"{name}\n{count} files", ha="center", va="center", fontsize=9, bbox=look, zorder=5
        )
        boxes[name] = text.get_bbox_patch()
    for (a, b), count in uses.items():
        # What a direct neighbour imports as well is not drawn: nearly all import base.
        if count and not any(b in below[c] for c in below[a]):
            look = {"arrowstyle": "-|>", "color": "0.45", "lw": 0.7 + min(count, 30) / 12}
            axes.annotate("", at[b], at[a], arrowprops={**look, "patchA": boxes[a], "patchB": boxes[b]})
    axes.set(xlim=(0.1, 0.9), ylim=(-0.5, len(floors) - 0.5))
    axes.axis("off")
    figure.savefig(FIGURES / "rooms.png", dpi=200)


def slicing() -> None:
    """Gelatin under a wedge that rubs: its force at several ratios of the speeds, and when it is cut."""
    runs = {
        ratio: cutbench.run2d(
            "gelatin_recalibrated", mu=0.05, slice_push=ratio, depth="7 mm", snapshots_mm=()
        )
        for ratio in (0.0, 0.5, 1.0, 4.0)
    }
    data = cutbench.load_map(HERE.parent / "studies" / "results" / "slicing" / "map.nc")
    ratios, deepest = data["slice_push"].values, 6.0
    with style():
        figure = new_figure(DOUBLE_MM, 65)
        left, right = figure.subplots(1, 2)
        for colour, (ratio, run) in zip(LINE_COLOURS, runs.items(), strict=False):
            left.plot(run.displacement_mm, run.force_N, color=colour, label=f"ξ = {ratio:g}")
            if ratio:
                left.plot(run.displacement_mm, run.curve["force_along_N"], ":", color=colour)
        left.set(xlabel="blade travel (mm)", ylabel="force (N)", title="μ = 0.05", ylim=(0, 3))
        for colour, mu, marker in zip(LINE_COLOURS, data["mu"].values, "osD", strict=False):
            onset = data["onset_mm"].sel(mu=mu).values
            right.plot(ratios, onset, f"{marker}-", color=colour, ms=4, label=f"μ = {mu:g}")
            held = ratios[np.isnan(onset)]
            right.plot(held, np.full(held.size, deepest), "^", color=colour, mfc="white", ms=4)
        right.set(
            xlabel="speed along the edge over speed down, ξ", ylabel="travel at which the cut begins (mm)"
        )
        right.set_ylim(0, 1.05 * deepest)
        for axes in (left, right):
            axes.legend(frameon=False)
        save(figure, FIGURES / "slicing.png")


def edge_stress() -> None:
    """Stress across the cut plane under a wedge that rubs, pushed and drawn, where neither has cut yet."""
    travel, ends, reach = 3.9, 25.0, 0.22  # mm; colours end at so many G; mm
    with style():
        figure = new_figure(DOUBLE_MM, 70)
        panels = figure.subplots(1, 2, sharey=True)
        for axes, ratio in zip(panels, (0.0, 2.0), strict=True):
            run = cutbench.run2d(
                "gelatin_recalibrated", mu=0.05, slice_push=ratio, depth=f"{travel} mm", snapshots_mm=[travel]
            )
            half, G = Half(run.snapshots[-1]), run.case.p.G
            half.stress_kPa = run.snapshots[-1].point_data["cauchy"][:, 0] / G
            colours = draw_half(axes, half, run.case, ends, line=0.1)
            for each in axes.collections:
                if each.get_cmap() is not None and each.get_array() is not None:
                    each.set(cmap="RdBu_r", clim=(-ends, ends))
            apex = run.case.p.height - travel
            axes.set(xlim=(-reach, reach), ylim=(apex - 0.7 * reach, apex + 0.7 * reach), xlabel="width (mm)")
            axes.set_title(
                f"pushed and drawn, ξ = {ratio:g}" if ratio else "pushed", loc="left", fontsize=8.5
            )
        panels[0].set_ylabel("height (mm)")
        figure.colorbar(
            colours, ax=panels, label="stress across the cut plane, over G", extend="both", shrink=0.75
        )
        save(figure, FIGURES / "edge-stress.png")


if __name__ == "__main__":
    drawn_here = {
        "tools": profiles,
        "readings": readings,
        "rooms": rooms,
        "slicing": slicing,
        "edge-stress": edge_stress,
    }

    asked = sys.argv[1:] or [*PICTURES, *drawn_here]
    with tempfile.TemporaryDirectory() as folder:
        for name in asked:
            drawn_here[name]() if name in drawn_here else draw(name, Path(folder))
