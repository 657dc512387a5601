"""A discovery in words, as a picture, as a table, as files."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes

from cutbench.base.figure_style import COLOURS, GREY
from cutbench.base.files import check_writable
from cutbench.discovery.candidates import family_of
from cutbench.discovery.page import write_discovery
from cutbench.discovery.report import cause_title, gain_sentence, ranking, verdict_sentence
from cutbench.discovery.search import Discovery


def summary_lines(d: Discovery) -> list:
    """Head, then pairs of words."""
    lines = [("baseline", d.fit.case.model.described), ("said", verdict_sentence(d))]
    if text := gain_sentence(d):
        lines.append(("gain", text))
    return [f"{d.campaign.title}: {d.verdict}", *lines, ("next", d.next_experiment)]


def plot(d: Discovery, ax: Axes) -> None:
    """The candidates' scores; what was added is dark."""
    shown = [] if d.telling is None else ranking(d.telling)[:12][::-1]
    colours = [COLOURS["blue"] if s.name in d.names else GREY for s, _ in shown]
    ax.barh([cause_title(s.name) for s, _ in shown], [s.z for s, _ in shown], color=colours)
    ax.set_xlabel("score (standard deviations)")
    ax.set_title(f"{d.campaign.title}: {d.verdict}", loc="left")


def table(d: Discovery) -> dict[str, list]:
    """The candidates of the round that found, a row each; not a number where one was not fitted."""
    rows = [] if d.telling is None else ranking(d.telling)
    return {
        "candidate": [s.name for s, _ in rows],
        "class": [family_of(s.name) for s, _ in rows],
        "kind": [s.sensitivity.candidate.cause for s, _ in rows],
        "score": [s.z for s, _ in rows],
        "log_evidence": [math.nan if c is None else c.evidence for _, c in rows],
        "explains": [math.nan if c is None else c.explained_variance for _, c in rows],
        "gain_heldout": [math.nan if c is None else c.held_out.gain for _, c in rows],
        "gain_se": [math.nan if c is None else c.held_out.gain_se for _, c in rows],
        "added": [s.name in d.names for s, _ in rows],
    }


def write(d: Discovery, folder: Path) -> None:
    """What ``cutbench discover --out`` writes."""
    write_discovery(d, check_writable(folder))
