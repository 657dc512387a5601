"""What the workbench computes, each in a process of its own: a run, a map, a fit, a discovery."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import cutbench
from cutbench.app.jobs import Teller
from cutbench.base.display import Displayed
from cutbench.base.figure_style import SINGLE_MM, new_figure, save, style
from cutbench.case.case import Case
from cutbench.maps.atlas_map import write_estimated
from cutbench.run.figures.section import Half, draw_half, frame
from cutbench.run.result import Snapshot

#: The section is drawn so many times on the way down.
_SECTIONS = 24
#: What a run under way shows of its section.
SECTION = "section.png"
#: A map under way is drawn this often at first, and later, in seconds.
_FIRST_PICTURE_S, _PICTURE_EVERY_S = 5.0, 20.0


def run(case: Case, folder: Path, tell: Teller) -> None:
    """Compute ``case`` and write it to ``folder``; tells points of its curve, draws sections on the way."""

    def on_step(row: Mapping[str, float], snapshot: Snapshot | None) -> None:
        tell(point=(float(row["displacement_mm"]), float(row["force_N"])))
        if snapshot is not None:
            _draw_section(case, snapshot, folder / SECTION)

    tell.unit = "mm"
    wanted = [case.p.depth * (k + 1) / _SECTIONS for k in range(_SECTIONS)]
    result = cutbench.run_case(case, on_progress=tell.progress, on_step=on_step, snapshots_mm=wanted)
    result.snapshots = result.snapshots[-1:]
    result.save(folder)
    tell(said=result.sentence())


def run_map(study: Path, folder: Path, tell: Teller) -> None:
    """Compute a study's map, with pictures on the way."""
    tell.unit = "runs"
    done = cutbench.run_study(
        study, folder, on_progress=tell.progress, first_picture_s=_FIRST_PICTURE_S,
        picture_every_s=_PICTURE_EVERY_S,
    )  # fmt: skip
    tell(said="\n".join(done.words()))


def estimate_map(study: Path, folder: Path, tell: Teller) -> None:
    """A study's map from the atlas, without a run."""
    write_estimated(cutbench.load_study(study), folder)
    tell(said="Estimated from the runs that cutbench brings along; hatched where it is unsure.")


def run_fit(campaign: Path, folder: Path, tell: Teller) -> None:
    """Fit the campaign's free parameters."""
    _find(cutbench.fit, campaign, folder, tell)


def run_discovery(campaign: Path, folder: Path, tell: Teller) -> None:
    """Look for what the model lacks."""
    _find(cutbench.discover, campaign, folder, tell)


def _find(search: Callable[..., Displayed], campaign: Path, folder: Path, tell: Teller) -> None:
    def on_stage(there: Displayed) -> None:
        there.save(folder)

    loaded = cutbench.load_campaign(campaign)
    found = search(loaded, on_progress=tell.progress, on_stage=on_stage, store=folder / "runs")
    found.save(folder)
    tell(said=str(found))


def _draw_section(case: Case, snapshot: Snapshot, target: Path) -> None:
    """The deformed section with the stress in it."""
    half = Half(snapshot)
    with style():
        figure = new_figure(SINGLE_MM, 70)
        axes = figure.subplots()
        colours = draw_half(axes, half, case, half.top_kPa or 1.0, line=0.1)
        frame(axes, [snapshot], case.p.height)
        axes.set_title(f"blade travel {snapshot.displacement_mm:.2f} mm", loc="left")
        figure.colorbar(colours, ax=axes, label="von Mises stress (kPa)", shrink=0.8)
    save(figure, target)
