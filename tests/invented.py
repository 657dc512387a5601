"""Tension there and back, made up in closed form: not by the package, and by none of its mechanisms."""

from __future__ import annotations

from pathlib import Path

import numpy as np

G_MPA, AREA_MM2, LENGTH_MM = 0.03, 20.0, 50.0


def nominal_stress(stretch: np.ndarray, softening: float) -> np.ndarray:
    """One term of Ogden's law with the exponent 2.4 (MPa), less by a part that grows on the way back."""
    way_out = (stretch - 1) / (stretch.max() - 1)
    back = np.arange(stretch.size) > stretch.argmax()
    stress = 2 * G_MPA / 2.4 * (stretch**1.4 - stretch**-2.2)
    return stress * np.where(back, 1 - softening * np.sin(np.pi / 2 * (1 - way_out)), 1.0)


def write_campaign(
    folder: Path, *, softening: float = 0.5, specimens: int = 4, seed: int = 0, head: str = ""
) -> Path:
    """``campaign.toml`` in ``folder`` with two fitted tests and a predicted one; ``head`` goes on top."""
    rng = np.random.default_rng(seed)
    text = 'title = "there and back"\n' + (head or 'material = "meat"\nbaseline = ["neo_hookean"]\n')
    for name, reach, rate, role in (
        ("far", 2.4, 0.01, "train"),
        ("near", 1.8, 0.1, "train"),
        ("test", 2.1, 0.03, "test"),
    ):
        stretch = np.concatenate([np.linspace(1, reach, 81), np.linspace(reach, 1, 81)[1:]])
        time = np.cumsum(np.abs(np.diff(stretch, prepend=1.0))) / rate
        rows, u = ["rep,t,u,F"], LENGTH_MM * (stretch - 1)
        for k in range(specimens):
            F = AREA_MM2 * nominal_stress(stretch, softening) * (1 + 0.03 * rng.standard_normal())
            F = F + 0.01 * F.max() * rng.standard_normal(F.size)
            rows += [f"{k},{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(time, u, F, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        text += f"""
[[experiment]]
id = "{name}"
kind = "uniaxial"
data = "{name}.csv"
columns = {{ displacement = "u", force = "F", time = "t", repetition = "rep" }}
units = {{ displacement = "mm", force = "N", time = "s" }}
specimen = {{ length = "{LENGTH_MM:g} mm", area = "{AREA_MM2:g} mm^2" }}
role = "{role}"
"""
    path = folder / "campaign.toml"
    path.write_text(text, encoding="utf-8")
    return path
