"""Force over elongation of a strip in tension, whole and notched."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from cutbench.base.figure_style import SINGLE_MM, force_from_zero, new_figure, save, style
from cutbench.run.files import write_curve, write_json
from cutbench.run.tension import Tension


def plot_tension(test: Tension) -> Figure:
    """Force (N) over elongation (mm); a dot where the cut has begun."""
    with style():
        figure = new_figure(SINGLE_MM, 62)
        axes = figure.subplots()
        notch = f"notch {test.notch_mm:g} mm" if test.notch_mm else "whole"
        axes.plot(test.curve["elongation_mm"], test.curve["force_N"], "k-", label=notch)
        if (onset := test.measures["onset_mm"]) > 0:
            axes.plot(onset, test.measures["onset_N"], "ko", ms=4, label="the cut begins")
        force_from_zero(axes, "elongation (mm)")
        axes.legend()
        figure.suptitle(f"{test.case.name}: strip in tension", x=0.02, ha="left")
    return figure


def save_tension(test: Tension, folder: str | Path) -> dict[str, Path]:
    """Write tension.json, curve.csv and tension.png into ``folder``; returns the paths by name."""
    folder = Path(folder)
    paths = {"curve": folder / "curve.csv", "record": folder / "tension.json"}
    write_curve(test.curve, paths["curve"], list(test.curve))
    paths["picture"] = save(plot_tension(test), folder / "tension.png")[0]
    record = {
        "id": test.case.id,
        "computation": test.case.computation,
        "case": test.case.to_dict(),
        "notch_mm": test.notch_mm,
        "outcome": {"kind": test.outcome.kind, "message": test.outcome.message},
        "measures": test.measures,
        "counts": test.counts,
        "timings_s": test.timings,
    }
    write_json(record, paths["record"])
    return paths
