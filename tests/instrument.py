"""What a texture analyser writes: gelatin pressed between plates, after travel in air, in grams; made up in
closed form, not by the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np

G_MPA, HEIGHT_MM, DIAMETER_MM, AIR_MM, SPEED_MM_S = 0.0075, 20.0, 20.0, 2.0, 1.0
GRAM_N = 9.80665e-3
AREA_MM2 = np.pi / 4 * DIAMETER_MM**2


def specimen(
    rng: np.random.Generator, air: float, returned: bool, stiffening: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force (g), distance (mm) and time (s); ``stiffening`` makes the force grow with the squared stretch."""
    step = 0.05
    u = np.arange(0, air + 6 + step / 2, step)
    if returned:
        u = np.append(u, u[-2::-1])
    stretch = 1 - np.maximum(u - air, 0) / HEIGHT_MM
    invariant = stretch**2 + 2 / stretch - 3
    scale = 1 + 0.03 * rng.standard_normal()
    force = AREA_MM2 * scale * G_MPA * (stretch**-2 - stretch) * (1 + stiffening * invariant)
    grams = force / GRAM_N + 2.5 + 0.5 * rng.standard_normal(u.size)  # the balance was not set to zero
    return grams, u, np.arange(u.size) * step / SPEED_MM_S


def write_export(
    path: Path, *, specimens: int = 3, returned: bool = False, stiffening: float = 0.0, seed: int = 0
) -> None:
    """A table as such machines export it: specimens side by side, titles, and units in a row of their own."""
    rng = np.random.default_rng(seed)
    made = [specimen(rng, AIR_MM, returned, stiffening) for _ in range(specimens)]
    rows = [",".join(f"gelatin {k + 1},," for k in range(specimens))]
    rows += [",".join(["Force,Distance,Time"] * specimens), ",".join(["(g),(mm),(sec)"] * specimens)]
    for readings in zip(*(column for one in made for column in one), strict=True):
        rows.append(",".join(f"{value:.3f}" for value in readings))
    path.write_text("\r\n".join(rows) + "\r\n", encoding="utf-8")


def write_held(path: Path, *, g: float, tau: float, length: float = 40.0, area: float = 25.0) -> None:
    """Three strips (mm, mm²) pulled for 12 s and held: ``g`` of G more at first, gone in some ``tau`` s."""
    rng = np.random.default_rng(2)
    t = np.concatenate([np.arange(0, 12.01, 0.2), np.arange(13, 61, 1.0)])
    u = np.minimum(t, 12.0) * SPEED_MM_S
    stretch, over = 1 + u / length, np.zeros(t.size)
    stress = G_MPA * (stretch - stretch**-2)
    for k, step in enumerate(np.diff(t)):
        fresh = g * (stress[k + 1] - stress[k]) * np.exp(-step / tau / 2)
        over[k + 1] = over[k] * np.exp(-step / tau) + fresh
    rows = ["specimen,time (s),Distance (mm),Force (N)"]
    for name in "ABC":
        force = area * (1 + 0.03 * rng.standard_normal()) * (stress + over)
        force += 2e-4 * rng.standard_normal(t.size)
        rows += [f"{name},{a:.2f},{b:.3f},{c:.5f}" for a, b, c in zip(t, u, force, strict=True)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def write_campaign(folder: Path, *, head: str = "", more: str = "", **export) -> Path:
    """``campaign.toml`` beside ``press.csv``: ``head`` above all experiments, ``more`` in this one."""
    write_export(folder / "press.csv", **export)
    path = folder / "campaign.toml"
    path.write_text(
        f"""title = "gelatin between plates"
material = "gelatin"
{head or 'baseline = ["neo_hookean", "volumetric"]'}

[[experiment]]
id = "press"
kind = "uniaxial"
data = "press.csv"
columns = {{ displacement = "Distance", force = "Force", time = "Time" }}
factors = {{ displacement = -1, force = -1 }}    # pressed, not pulled
specimen = {{ length = "{HEIGHT_MM:g} mm", area = "{AREA_MM2:.6g} mm^2" }}
{more}""",
        encoding="utf-8",
    )
    return path
