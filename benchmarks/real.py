"""``python -m benchmarks.real [NAME …] [--halves] [--picture FILE] [--json FILE]``: discovery on what ships.

NAME is a campaign of measured data, such as ``silicone/rtv615``; all of ``CAMPAIGNS`` by default. Prints the
rows of the table in docs/validation/real-data.md. ``--halves``: the lower half of each test alone is fitted,
and what both models make of the upper half is said. ``--picture``: data, baseline and extended model, a panel
for each test; ``--json``: what discovery.json has of each. Exit status 2 for a name that is not among them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.tools import ROOT, check_json
from cutbench.base.figure_style import COLOURS, DOUBLE_MM, Size, new_figure, save, style
from cutbench.base.files import write_json
from cutbench.calibration.posterior import Estimated
from cutbench.data.campaign import Campaign, load_campaign
from cutbench.data.experiment import Experiment
from cutbench.discovery import Discovery, discover
from cutbench.discovery.candidates import cause_of, family_of
from cutbench.discovery.report import to_dict

CAMPAIGNS = {
    "rubber/treloar": "Treloar's rubber",
    "rubber/kawabata": "Kawabata's rubber",
    "silicone/meunier": "Meunier's silicone",
    "silicone/rtv615": "RTV615",
    "silicone/ecoflex_00_30": "Ecoflex 00-30",
    "silicone/ecoflex_00_50": "Ecoflex 00-50",
    "silicone/dragon_skin_20": "Dragon Skin 20",
}


def found_in(name: str) -> Discovery:
    """What discovery says of a shipped campaign."""
    return discover(load_campaign(ROOT / "studies" / f"{name}.toml"), workers=0)


def curves(fitted: Estimated | None) -> dict[str, np.ndarray]:
    """What a model says of each test (m,), by id."""
    assert fitted is not None, "these tests have formulas"
    return {e.id: fitted.predicted(e).y for e in fitted.posterior.predictions.campaign.experiments}


def missed(fitted: Estimated | None, where: Mapping[str, np.ndarray] | None = None) -> dict[str, float]:
    """Measured less computed by id of each test, root mean square in per cent of the largest reading;
    ``where``: of these of its values on the grid."""
    assert fitted is not None, "these tests have formulas"
    found = {}
    for id, y in curves(fitted).items():
        mean = fitted.posterior.predictions.grids[id].mean
        part = (y - mean) if where is None else (y - mean)[where[id]]
        found[id] = 100 * float(np.sqrt(np.mean(part**2)) / np.abs(mean).max())
    return found


def said(d: Discovery) -> str:
    """Verdict, class and formulas that cannot be told apart."""
    if not d.found:
        return d.verdict
    first = d.found[0]
    kind = family_of(first.name) if cause_of(first.name) == "mechanism" else cause_of(first.name)
    return f"{d.verdict}: {kind} ({', '.join(first.group)})"


def row(name: str, d: Discovery) -> str:
    """Of the table: campaign, verdict, gain on held-out data, what is left of each curve before and after."""
    before, after = missed(d.first), missed(d.final)
    roles = {e.id: e.role for e in d.campaign.experiments}
    left = "; ".join(
        f"{id}{' (held out)' if roles[id] == 'test' else ''} {before[id]:.1f} → {after[id]:.1f}"
        for id in after
    )
    gain = d.held_out.percent if d.found and d.held_out is not None else "–"
    return f"| `{name}` | {said(d)} | {gain} | {left} |"


def halves(campaign: Campaign) -> tuple[Campaign, dict[str, float]]:
    """The campaign with the lower half of each fitted test's way fitted, and the whole of it predicted;
    and where these halves end, by id."""
    parts: list[Experiment] = []
    ends = {}
    for e in campaign.train:
        (r,) = e.repetitions
        ends[e.id] = e.rest + (r.x[np.argmax(np.abs(r.x - e.rest))] - e.rest) / 2
        near = np.abs(r.x - e.rest) <= abs(ends[e.id] - e.rest)
        time = None if r.time_s is None else r.time_s[near]
        lower = replace(r, x=r.x[near], y=r.y[near], time_s=time)
        parts += [replace(e, id=f"lower half of {e.id}", repetitions=(lower,)), replace(e, role="test")]
    return replace(campaign, experiments=tuple(parts)), ends


def half_row(name: str, d: Discovery, ends: Mapping[str, float]) -> str:
    """What is missed of the upper half by the model fitted to the lower one: baseline, extended."""
    grids = d.first.posterior.predictions.grids
    everywhere = {e.id: np.ones(grids[e.id].x.size, bool) for e in d.campaign.train}
    upper = {id: grids[id].x > end for id, end in ends.items()}
    before, after = (missed(each, {**everywhere, **upper}) for each in (d.first, d.final))
    told = "; ".join(f"{before[id]:.1f} → {after[id]:.1f}" for id in ends)
    return f"| `{name}` | {', '.join(f'{end:.3g}' for end in ends.values())} | {said(d)} | {told} |"


def picture(found: Mapping[str, Discovery], path: Path) -> None:
    """Reduced stress would hide what a person reads: stress over stretch, a panel for each test."""
    panels = [(name, d, e) for name, d in found.items() for e in d.campaign.experiments]
    columns = 4
    lines = -(-len(panels) // columns)
    with style():
        figure = new_figure(DOUBLE_MM, 0.27 * DOUBLE_MM * lines)
        places = figure.subplots(lines, columns, squeeze=False)
        for place in places.flat[len(panels) :]:
            place.remove()
        for place, (name, d, e) in zip(places.flat, panels, strict=False):
            grid = d.first.posterior.predictions.grids[e.id]
            base, more = (curves(each)[e.id] for each in (d.first, d.final))
            place.plot(grid.x, grid.mean, ".", color=COLOURS["black"], ms=2.5, label="measured")
            place.plot(grid.x, base, color=COLOURS["vermilion"], ls=(0, (5, 1.5)), label="baseline")
            place.plot(grid.x, more, color=COLOURS["blue"], label="extended model")
            role = "fitted" if e.role == "train" else "held out"
            place.set_title(f"{CAMPAIGNS[name]}\n{e.id}, {role}", fontsize=7)
            place.tick_params(labelsize=6)
            place.set_ylim(min(0.0, 1.1 * grid.mean.min()), 1.25 * grid.mean.max())
        figure.supxlabel("stretch", fontsize=8)
        figure.supylabel("nominal stress (MPa)", fontsize=8)
        figure.legend(*places[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    save(figure, path, size=Size(DOUBLE_MM, 8.0, dpi=200.0))


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", default=list(CAMPAIGNS))
    parser.add_argument("--halves", action="store_true")
    parser.add_argument("--picture", type=Path, metavar="FILE")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(arguments)
    for name in asked.names:
        if name not in CAMPAIGNS:
            parser.error(f"{name}: one of {', '.join(CAMPAIGNS)}")
    check_json(parser, asked.json)
    if asked.halves and asked.picture:
        parser.error("--picture: of whole tests, without --halves")
    found = {}
    for name in asked.names:
        if asked.halves:
            campaign, ends = halves(load_campaign(ROOT / "studies" / f"{name}.toml"))
            found[name] = discover(campaign, workers=0)
            print(half_row(name, found[name], ends), flush=True)
        else:
            found[name] = found_in(name)
            print(row(name, found[name]), flush=True)
    if asked.picture:
        picture(found, asked.picture)
    if asked.json:
        write_json({name: to_dict(d) for name, d in found.items()}, asked.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
