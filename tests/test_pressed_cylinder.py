"""A cylinder pressed between plates: that they may hold it is said, with how much that would be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cutbench.data.campaign import load_campaign

CAMPAIGN = """baseline = ["neo_hookean", "volumetric"]
[parameters]
G = "50 kPa"
[[experiment]]
id = "press"
kind = "uniaxial"
data = "press.csv"
columns = {{ displacement = "u [mm]", force = "F [N]" }}
factors = {{ displacement = {sign}, force = {sign} }}
specimen = {{ length = "{height}", {across} }}
"""


def notes(folder: Path, sign: int, height: str, across: str) -> str:
    u = np.linspace(0.02, 0.2, 20) * float(height.split()[0])
    stretch = 1 + sign * u / float(height.split()[0])
    force = sign * 113.1 * 0.05 * (stretch - stretch**-2)
    rows = [f"{a:.4f},{b:.5f}" for a, b in zip(u, force, strict=True)]
    (folder / "press.csv").write_text("\n".join(["u [mm],F [N]", *rows]))
    path = folder / "campaign.toml"
    path.write_text(CAMPAIGN.format(sign=sign, height=height, across=across))
    (test,) = load_campaign(path).experiments
    return " ".join(test.notes)


#: 1 + 2 S², S = d/(4 h): Gent and Lindley's shape factor of a disc.
@pytest.mark.parametrize(
    ("height", "across", "factor"),
    [
        ("12 mm", 'diameter = "12 mm"', "1.12"),
        ("6 mm", 'diameter = "12 mm"', "1.5"),
        ("6 mm", 'area = "113.1 mm^2"', "1.5"),
    ],
)
def test_a_compression_of_forces_says_what_held_faces_would_do(tmp_path, height, across, factor):
    assert f" {factor} " in notes(tmp_path, -1, height, across)


def test_a_tension_does_not(tmp_path):
    assert "1959" not in notes(tmp_path, 1, "12 mm", 'diameter = "12 mm"')
