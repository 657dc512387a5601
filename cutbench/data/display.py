"""A campaign in words, as a picture, as tables."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from cutbench.data.campaign import Campaign


def summary_lines(campaign: Campaign) -> list:
    """Head, then pairs of words."""
    lines = [("baseline", campaign.model.described)]
    for e in campaign.experiments:
        count = len(e.repetitions)
        if not e.curve:
            lines.append((e.id, f"{e.kind}, {e.readings} measures, {e.role}"))
            continue
        times = f"{count} repetition{'s' if count > 1 else ''}, {e.readings} readings"
        lines.append((e.id, f"{e.kind}, {times}, {e.role}"))
    return [campaign.title, *lines]


def plot(campaign: Campaign, ax: Axes) -> None:
    """Every repetition, as parts of its experiment's reach and largest value."""
    for e in (e for e in campaign.experiments if e.curve):
        top, reach = max(float(np.abs(r.y).max()) for r in e.repetitions), e.reach - e.rest or 1.0
        first, *rest = ((r.x - e.rest) / reach for r in e.repetitions)
        (line,) = ax.plot(first, e.repetitions[0].y / top, lw=0.8, label=e.id)
        for x, r in zip(rest, e.repetitions[1:], strict=True):
            ax.plot(x, r.y / top, lw=0.8, color=line.get_color(), ls=line.get_linestyle())
    ax.set(xlabel="part of the way", ylabel="part of the largest value")
    ax.set_title(campaign.title, loc="left")
    ax.legend()


def table(campaign: Campaign) -> dict[str, np.ndarray]:
    """All readings, a row each: x and y in mm, N, MPa, or stretches, as ``x_unit`` and ``y_unit`` say."""
    rows = [(e, str(r.name or k), r) for e in campaign.experiments for k, r in enumerate(e.repetitions, 1)]
    return {
        "experiment": np.concatenate([np.full(len(r.x), e.id) for e, _, r in rows]),
        "repetition": np.concatenate([np.full(len(r.x), name) for _, name, r in rows]),
        "x": np.concatenate([r.x for _, _, r in rows]),
        "y": np.concatenate([r.y for _, _, r in rows]),
        "x_unit": np.concatenate([np.full(len(r.x), e.x_unit) for e, _, r in rows]),
        "y_unit": np.concatenate([np.full(len(r.x), e.y_unit) for e, _, r in rows]),
    }
