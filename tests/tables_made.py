"""A strip of neo-Hookean rubber that is pulled, by formula, and campaigns about tables of its readings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from cutbench.cli.main import app

G_MPA, LENGTH_MM, AREA_MM2 = 0.08, 40.0, 20.0
SPECIMEN = f'{{ length = "{LENGTH_MM:g} mm", area = "{AREA_MM2:g} mm^2" }}'
COLUMNS = '{ time = "Time", displacement = "Extension", force = "Load" }'
HEAD = "Time (s),Extension (mm),Load (N)"


def force(u, G=G_MPA, area=AREA_MM2):
    """N at an extension of ``u`` mm."""
    stretch = 1 + np.asarray(u) / LENGTH_MM
    return area * G * (stretch - stretch**-2)


def readings(n: int = 40, reach: float = 20.0, start_s: float = 0.0) -> np.ndarray:
    """Time (s), extension (mm) and force (N), (n, 3): 1 mm/s from rest."""
    u = np.linspace(reach / n, reach, n)
    return np.column_stack([start_s + u, u, force(u)])


def rows(values: np.ndarray, separator: str = ",", digits: int = 4) -> str:
    return "".join(separator.join(f"{v:.{digits}f}" for v in row) + "\n" for row in values)


def campaign(folder: Path, text: str | dict[str, str], more: str = "", **keys: str) -> Path:
    """``campaign.toml`` about the files in ``text``, by default ``data.csv``; ``more`` in its experiment."""
    files = {"data.csv": text} if isinstance(text, str) else text
    for name, content in files.items():
        (folder / name).write_text(content, encoding="utf-8")
    keys = {"kind": '"uniaxial"', "data": '"data.csv"', "columns": COLUMNS, "specimen": SPECIMEN} | keys
    path = folder / "campaign.toml"
    path.write_text(
        'baseline = ["neo_hookean", "volumetric"]\n[parameters]\nG = "80 kPa"\nnu = 0.4999\n'
        + '[[experiment]]\nid = "pull"\n'
        + "".join(f"{key} = {value}\n" for key, value in keys.items() if value)
        + more,
        encoding="utf-8",
    )
    return path


def refused(args: list[str]) -> str:
    """The one line with which a command refuses its input, with exit status 2 and no traceback."""
    done = CliRunner().invoke(app, args)
    assert done.exception is None or isinstance(done.exception, SystemExit), repr(done.exception)
    assert done.exit_code == 2, done.output
    assert len(done.output.strip().splitlines()) == 1, done.output
    return done.output.strip()
