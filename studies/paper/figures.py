"""Pictures of the claims: curves under both numerics, one thing changed at a time, the choice of b."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, LINE_COLOURS, LINES, new_figure, style
from cutbench.base.files import replacing
from cutbench.run.result import Result
from studies.paper.base import CONVERGED, PAPER
from studies.paper.cases import CHANGES
from studies.paper.judgement import Judged, Scan
from studies.paper.runner import Runner

#: The claims whose first run is a material's curve, with what was published of it: travel, mm.
CURVES = {"C1": ("gelatin", (4.19, 4.19)), "C2": ("elastomer", (1.56, 1.56)), "C3": ("meat", (8.0, 10.0))}
_NAMES = {PAPER: "paper's numerics", CONVERGED: "converged defaults"}
_SHOWN = {PAPER: "black", CONVERGED: "blue", "printed_viscous": "vermilion", "folds": "green"}
#: Enough for print at the width of a page, small enough for a repository.
_DPI = 130


def draw(judged: Sequence[Judged], scans: Mapping[str, Scan], runner: Runner, out: str | Path) -> list[Path]:
    """Write published-curves.png, published-changes.png and published-tips.png into ``out``."""
    by_id = {one.claim.id: one for one in judged if one.claim.id in CURVES}
    paths = []
    with style():
        figures = (
            {"curves": _curves(by_id, runner), "changes": _one_at_a_time(by_id, runner)} if by_id else {}
        )
        figures |= {"tips": _tips(scans)} if scans else {}
        for name, figure in figures.items():
            paths.append(Path(out) / f"published-{name}.png")
            with replacing(paths[-1]) as draft:
                figure.savefig(draft, dpi=_DPI)
    return paths


def _curve(axes, result: Result, label: str, place: int, colour: str) -> None:
    axes.plot(result.displacement_mm, result.force_N, color=colour, ls=LINES[place], lw=1.1, label=label)


def _panels(by_id, height_mm: float):
    figure = new_figure(DOUBLE_MM, height_mm)
    axes = figure.subplots(1, len(by_id), squeeze=False)[0]
    for ax, id in zip(axes, by_id, strict=True):
        material, (low, high) = CURVES[id]
        ax.set_title(material)
        ax.axvspan(low - 0.04, high + 0.04, color="#D9D9D9", lw=0, zorder=0)
        ax.set_xlabel("blade travel (mm)")
        ax.set_xlim(0, 14)
    axes[0].set_ylabel("force (N)")
    return figure, axes


def _with_legend(figure):
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def _curves(by_id: Mapping[str, Judged], runner: Runner):
    figure, axes = _panels(by_id, 66)
    for ax, one in zip(axes, by_id.values(), strict=True):
        for place, (word, colour) in enumerate(_SHOWN.items()):
            if word in one.ids:
                text = _NAMES.get(word) or CHANGES[word].text
                _curve(ax, runner.results[one.ids[word]["base"]], text, place, COLOURS[colour])
        ax.set_ylim(bottom=0)
    return _with_legend(figure)


def _one_at_a_time(by_id: Mapping[str, Judged], runner: Runner):
    figure, axes = _panels(by_id, 82)
    names = [name for name, change in CHANGES.items() if change.start == PAPER]
    colours = [*LINE_COLOURS[1:], GREY]
    for ax, one in zip(axes, by_id.values(), strict=True):
        base = runner.results[one.ids[PAPER]["base"]]
        for place, name in enumerate(names):
            if name in one.ids:
                result = runner.results[one.ids[name]["base"]]
                _curve(
                    ax, result, CHANGES[name].text, (place + 1) % len(LINES), colours[place % len(colours)]
                )
        _curve(ax, base, _NAMES[PAPER], 0, COLOURS["black"])
        # A run that never cuts grows without bound and would hide the rest.
        ax.set_ylim(0, 1.6 * float(base.force_N.max(initial=1e-9)))
    return _with_legend(figure)


def _tips(scans: Mapping[str, Scan]):
    figure = new_figure(DOUBLE_MM, 55)
    for ax, scan in zip(figure.subplots(1, len(scans), squeeze=False)[0], scans.values(), strict=True):
        tips = sorted(scan.found_mm)
        ax.plot(tips, [scan.found_mm[tip] for tip in tips], "o-", color=COLOURS["blue"])
        ax.axhline(scan.published_mm, color=GREY, ls="--", lw=0.8)
        ax.plot([scan.tip_mm], [scan.found_mm[scan.tip_mm]], "s", color=COLOURS["vermilion"], ms=6)
        ax.set_title(f"{scan.material}: {scan.measure}")
        ax.set_xlabel("tip length b (mm)")
        ax.set_ylim(bottom=0)
    figure.axes[0].set_ylabel("travel (mm)")
    return figure
