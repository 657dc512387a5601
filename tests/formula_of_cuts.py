"""A campaign of cuts whose forces are a formula: what reads it has its answers at once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cutbench.calibration.inverse import Inverse
from cutbench.calibration.looked_for import unknowns
from cutbench.calibration.prediction import Prediction, Task
from cutbench.data.campaign import Campaign, load_campaign

TRUE = {"G": 0.008, "G_c": 0.005}
X = np.linspace(0.05, 5, 100)
SPEEDS = {"slow": 0.005, "fast": 0.1}


def force(x: np.ndarray, G: float, G_c: float, speed: float) -> np.ndarray:
    """A blade that indents with a force ∝ G x^1.5, and at a depth ∝ (G_c/G)^½ falls to one ∝ G_c."""
    begins = 3.0 * np.sqrt((G_c / 0.005) / (G / 0.008)) * (speed / 0.02) ** 0.05
    before, after = 0.3 * G / 0.008 * x**1.5, 0.5 * G_c / 0.005 * np.ones_like(x)
    return np.where(x < begins, before, np.minimum(after, before))


class Formula:
    """Predicts by ``force``; exact derivatives, which know nothing of the drop's place. ``fails`` after so
    many places, with what it raises."""

    def __init__(self, fails: int = 10**6, error: type[BaseException] = KeyboardInterrupt):
        self.places, self.fails, self.error = 0, fails, error

    def __call__(self, tasks: list[Task]) -> list[Prediction]:
        self.places += 1
        if self.places > self.fails:
            raise self.error("no more")
        return [self._one(task) for task in tasks]

    @staticmethod
    def _one(task: Task) -> Prediction:
        values, x = task.case.values, task.grid.x
        given = {name: values[name] + 0j for name in TRUE} | {"speed": values["speed"]}
        y = force(x, **{name: np.real(value) for name, value in given.items()})
        columns = []
        for name in task.names:
            step = 1e-30
            moved = force(x, **{**given, name: given[name] + 1j * step})
            columns.append(moved.imag / step)
        return Prediction(y, np.array(columns).T.reshape(x.size, len(task.names)), task.names)


def campaign_in(tmp_path: Path, toughness: Mapping[str, float] | None = None) -> Campaign:
    """A campaign whose start is 40 and 50 % away, so that drops are a millimetre from the measured ones;
    ``toughness`` by id, where it is not that of all."""
    text = ['material = "gelatin"', "[parameters]", 'G = "11.2 kPa"', 'G_c = "2.5 J/m^2"', "[fit]"]
    text += ['free = ["G", "G_c"]']
    for id, speed in SPEEDS.items():
        true = {**TRUE, "G_c": (toughness or {}).get(id, TRUE["G_c"])}
        y = force(X, **true, speed=speed)
        rows = [f"{x:.6g},{f:.6g}" for x, f in zip(X, y, strict=True)]
        (tmp_path / f"{id}.csv").write_text("\n".join(["u [mm],F [N]", *rows]) + "\n")
        text += [
            "[[experiment]]", f'id = "{id}"', 'kind = "cut"', f'data = "{id}.csv"', 'role = "train"',
            f'speed = "{speed} mm/s"', 'columns = { displacement = "u", force = "F" }',
            'blade = { thickness = "0.7 mm", tip = "1.05 mm" }',
            'specimen = { width = "20 mm", length = "30 mm", height = "14 mm" }',
        ]  # fmt: skip
    (tmp_path / "campaign.toml").write_text("\n".join(text) + "\n")
    return load_campaign(tmp_path / "campaign.toml")


def inverse_of(campaign: Campaign, run: Formula, across: bool = True) -> Inverse:
    return Inverse(campaign, unknowns(campaign), run, across=across)
