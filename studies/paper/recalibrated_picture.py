"""What is published of three experiments, beside the published model and the recalibrated one.

    python -m studies.paper.recalibrated_picture DIR docs/figures/published-recalibrated.png

Numbers of the experiments are bands and lines; both curves are computed. DIR keeps the six runs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cutbench.base.figure_style import COLOURS, DOUBLE_MM, GREY, legend_below, new_figure, save, style
from cutbench.case.case import Case, load_case
from cutbench.data.campaign import load_campaign
from cutbench.data.measures import MeasuredCut
from cutbench.run.result import Result
from cutbench.run.runner import run_case
from cutbench.run.store.runs import Store

HERE = Path(__file__).parents[1] / "published"
#: By material, how the source describes its transition.
SAID = {"gelatin": "a sharp fall", "elastomer": "smooth", "meat": "a plateau, no fall"}


def computed(case: Case, store: Store) -> Result:
    """The run of a case, out of the store or computed and left there."""
    found = store.get(case.id)
    if found is None:
        store.put(found := run_case(case))
    return found


def panel(axes: Axes, e: MeasuredCut, runs: dict[str, Result]) -> None:
    """One material."""
    looks = {
        "the published model, converged": {"color": GREY, "ls": (0, (4, 1.5))},
        "recalibrated": {"color": COLOURS["blue"], "ls": "-"},
    }
    for name, run in runs.items():
        axes.plot(run.curve["displacement_mm"], run.curve["force_N"], lw=1.3, label=name, **looks[name])
    measures = {m.name: m for m in e.measures}
    band = {"facecolor": COLOURS["orange"], "alpha": 0.3, "lw": 0}
    if m := measures.get("onset"):
        axes.axvspan(m.value - m.sd, m.value + m.sd, label="published: indentation ends", **band)
    if m := measures.get("plateau"):
        begins = measures["plateau_from"]
        axes.fill_between([begins.low, e.depth_mm], m.low, m.high, label="published: plateau", **band)
    if m := measures.get("slope"):
        # Its slope is published and not its level: it stands above the curve.
        after = runs["recalibrated"].curve
        x = np.array([5.2, e.depth_mm])
        level = np.interp(x[0], after["displacement_mm"], after["force_N"]) + 0.12
        for value, lw in ((m.value, 1.6), (m.value - m.sd, 0.6), (m.value + m.sd, 0.6)):
            label = "published: slope behind it, ± its error" if value == m.value else None
            axes.plot(x, level + value * (x - x[0]), color=COLOURS["vermilion"], ls="-", lw=lw, label=label)
    axes.set(xlabel="travel of the blade (mm)", xlim=(0, e.depth_mm), ylim=(0, None))


def main(folder: Path, file: Path) -> None:
    store = Store(folder)
    with style():
        figure = new_figure(DOUBLE_MM, 72)
        places = figure.subplots(1, 3)
        for axes, material in zip(places, SAID, strict=True):
            e = load_campaign(HERE / f"{material}.toml").experiments[0]
            assert isinstance(e, MeasuredCut)
            depth = {"depth": f"{e.depth_mm} mm"}
            names = {"the published model, converged": material, "recalibrated": f"{material}_recalibrated"}
            runs = {key: computed(load_case(name, depth), store) for key, name in names.items()}
            panel(axes, e, runs)
            axes.set_title(f"{material}: {SAID[material]}", loc="left", fontsize=8)
        places[0].set_ylabel("force (N)")
        legend_below(figure, places, 3)
        save(figure, file)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
