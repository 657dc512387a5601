"""Readings that are not what they are said to be: each is refused or doubted, with a cure that cures."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import tables_made as made

from cutbench.base.errors import BadInput
from cutbench.data.campaign import Campaign, load_campaign

U = np.linspace(0.2, 20, 80)
X = np.linspace(1.01, 1.9, 90)
PRESSED = -made.force(-U / 2)
PULLED = {"displacement": "Extension", "force": "Load"}
STRESS = {"strain": "Strain", "stress": "Stress"}


def noisy(y: np.ndarray, part: float = 0.004, seed: int = 1) -> np.ndarray:
    return y + part * np.abs(y).max() * np.random.default_rng(seed).standard_normal(y.size)


def table(head: str, *columns: np.ndarray) -> str:
    return head + "\n" + made.rows(np.column_stack(columns))


def write(folder: Path, text, columns: dict[str, str], **keys: str) -> Path:
    named = ", ".join(f'{role} = "{name}"' for role, name in columns.items())
    return made.campaign(folder, text, **{"columns": f"{{ {named} }}"} | keys)


def stress(x: np.ndarray, G_kPa: float = 80.0) -> np.ndarray:
    return G_kPa * (x - x**-2)


def tared() -> np.ndarray:
    F = noisy(made.force(U))
    F[50:] -= F[50]
    return F


def wrapped() -> np.ndarray:
    F = noisy(made.force(U))
    return np.where(F > 1.0, F - 2.0, F)


def broken() -> np.ndarray:
    return np.where(U > 15, 0.0, noisy(made.force(U)))


#: Table, columns, more keys, which key cures it, and the largest stretch and stress (kPa) that are then read.
CASES = {
    "pressed, titles say so": (
        table("Compressive extension (mm),Druckkraft (N)", U / 2, noisy(PRESSED)),
        {"displacement": "Compressive extension", "force": "Druckkraft"},
        {},
        "factors",
        (0.75, 82.2),
    ),
    "pressed, load counts down": (
        table("Extension (mm),Load (N)", U / 2, noisy(-PRESSED)),
        PULLED,
        {},
        "factors",
        (0.75, 82.2),
    ),
    "pressed, half of the factors": (
        table("Extension (mm),Load (N)", U / 2, noisy(PRESSED)),
        PULLED,
        {"factors": "{ displacement = -1 }"},
        "factors",
        (0.75, 82.2),
    ),
    "pressed, and nothing says so": (
        table("Extension (mm),Load (N)", U / 2, noisy(PRESSED, 0.002)),
        PULLED,
        {},
        "factors",
        (0.75, 82.2),
    ),
    "stress counts down": (
        table("Strain (%),Stress (kPa)", 100 * (X - 1), noisy(-stress(X))),
        STRESS,
        {},
        "factors",
        (1.9, 130),
    ),
    "percent, small": (
        table("Strain,Stress (kPa)", 100 * (X - 1) / 10, noisy(stress(1 + (X - 1) / 10))),
        STRESS,
        {},
        "units",
        (1.09, 20),
    ),
    "percent, large": (
        table("Strain,Stress (kPa)", 100 * (X - 1), noisy(stress(X))),
        STRESS,
        {},
        "units",
        (1.9, 130),
    ),
    "a stretch as a strain": (
        table("Strain,Stress (kPa)", X, noisy(stress(X))),
        STRESS,
        {},
        "columns",
        (1.9, 130),
    ),
    "a strain as a stretch": (
        table("Strain,Stress (kPa)", X - 1, noisy(stress(X))),
        {"stretch": "Strain", "stress": "Stress"},
        {},
        "columns",
        (1.9, 130),
    ),
    "a true stress": (
        table("Strain (%),True stress (kPa)", 100 * (X - 1), noisy(X * stress(X))),
        {"strain": "Strain", "stress": "True stress"},
        {},
        "stress",
        (1.9, 130),
    ),
    "a true strain": (
        table("Log strain (%),Stress (kPa)", 100 * np.log(X), noisy(stress(X))),
        {"strain": "Log strain", "stress": "Stress"},
        {},
        "strain",
        (1.9, 130),
    ),
    "a gap": (
        table("Gap (mm),Load (N)", 40 - (U / 2 - 0.1), noisy(-PRESSED)),
        {"displacement": "Gap", "force": "Load"},
        {},
        "zero",
        (0.75, 82.2),
    ),
    "reset under load": (
        table("Extension (mm),Load (N)", U - 0.2, noisy(made.force(U + 1), 0.001)),
        PULLED,
        {},
        "zero",
        (1.52, 90),
    ),
    "a load cell at its end": (
        table("Extension (mm),Load (N)", U, np.minimum(noisy(made.force(U)), 1.2)),
        PULLED,
        {},
        "until",
        (1.32, 60),
    ),
    "tared amid the test": (
        table("Extension (mm),Load (N)", U, tared()),
        PULLED,
        {},
        "until",
        (1.31, 59),
    ),
    "a load cell that turns over": (
        table("Extension (mm),Load (N)", U, wrapped()),
        PULLED,
        {},
        "until",
        (1.25, 49),
    ),
    "a strip that broke": (
        table("Extension (mm),Load (N)", U, broken()),
        PULLED,
        {},
        "until",
        (1.37, 67),
    ),
}
_PROPOSED = re.compile(
    r"\b(factors|units|columns|stress|strain|zero|until) = (\{[^}]*\}|'[^']*'|[\d.]+)", re.DOTALL
)


def said(path: Path) -> tuple[str, Campaign | None]:
    """What reading says that is to be settled, and the campaign if there is one."""
    try:
        campaign = load_campaign(path)
    except BadInput as error:
        return error.expected, None
    return "; ".join(campaign.doubts), campaign


def cured(folder: Path, text: str, columns: dict, keys: dict, proposed: tuple[str, str]) -> Path:
    key, value = proposed
    if key == "columns":
        role, title = re.findall(r"(\w+) = '([^']*)'", value)[0]
        return write(folder, text, {role: title, "stress": columns["stress"]}, **keys)
    return write(folder, text, columns, **keys | {key: value})


@pytest.mark.parametrize("case", CASES)
def test_what_is_proposed_settles_it(tmp_path, case):
    text, columns, keys, key, (stretch, kPa) = CASES[case]
    message, _ = said(write(tmp_path, text, columns, **keys))
    proposals = _PROPOSED.findall(message)
    assert proposals and proposals[0][0] == key, message
    for _ in range(3):  # a cure may show what else is wrong, but never the same again
        before = message
        message, campaign = said(cured(tmp_path, text, columns, keys, proposals[0]))
        assert message != before, message
        if campaign is not None and not message:
            break
        keys = keys | {proposals[0][0]: proposals[0][1]}
        proposals = _PROPOSED.findall(message)
    assert campaign is not None and not message, message
    (r,) = campaign.experiments[0].repetitions
    far = r.x[np.argmax(np.abs(r.x - 1))]
    assert far == pytest.approx(stretch, rel=0.02)
    assert 1e3 * np.abs(r.y).max() == pytest.approx(kPa, rel=0.06)


def test_a_sign_is_never_proposed_where_it_stands(tmp_path):
    path = write(
        tmp_path, table("Extension (mm),Load (N)", U, noisy(made.force(U))), PULLED, factors="{ force = -1 }"
    )
    message, _ = said(path)
    assert "force = -1 }" not in message.split(" for ")[0] and "factors" in message
