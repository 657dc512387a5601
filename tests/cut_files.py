"""Files of a campaign of one coarse cut, for tests of what a fit takes along with the force."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cutbench.case.case import Case
from cutbench.data.campaign import Campaign, load_campaign

#: The mesh of such a cut, as ``Case.set`` takes it.
COARSE = {"h": "0.8 mm", "corner": 0.5, "shallow": 1, "slender": 1, "step": "0.1 mm"}


def write_readings(path: Path, head: str, columns: Sequence[np.ndarray], digits: Sequence[int]) -> None:
    """Write ``columns`` under ``head``; a cell that is nan stays empty."""
    rows = (
        ",".join("" if np.isnan(x) else f"{x:.{n}f}" for x, n in zip(row, digits, strict=True))
        for row in zip(*columns, strict=True)
    )
    path.write_text("\n".join([head, *rows]) + "\n")


def campaign_of(
    folder: Path, id: str, truth: Case, *, parameters: str, fit: str, experiment: str, top="", numerics=""
) -> Campaign:
    """A campaign of the cut ``id`` on the readings ID.csv with the blade of ``truth``; the texts are lines of
    its sections."""
    path = folder / "campaign.toml"
    step = "" if "step = " in numerics else 'step = "' + COARSE["step"] + '"'
    path.write_text(f"""
material = "gelatin"
{top}
[parameters]
{parameters}
[numerics]
h = "{COARSE["h"]}"
corner = {COARSE["corner"]}
shallow = {COARSE["shallow"]}
{step}
slender = {COARSE["slender"]}
{numerics}
[fit]
{fit}
[[experiment]]
id = "{id}"
kind = "cut"
data = "{id}.csv"
specimen = {{ width = "30 mm", length = "30 mm", height = "21 mm" }}
blade = {{ thickness = "0.7 mm", tip = "{truth.values["tip"]!r} mm" }}
{experiment}
""")
    return load_campaign(path)
