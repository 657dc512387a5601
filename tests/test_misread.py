"""Readings that are not what they are said to be: each is refused or doubted, with a cure that cures."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import tables_made as made

from cutbench.base.errors import BadInput
from cutbench.data.campaign import Campaign, load_campaign
from cutbench.data.fields import read_fields
from cutbench.discovery import discover
from cutbench.discovery.report import verdict_sentence

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


def test_one_specimen_in_two_units_is_one(tmp_path):
    F = noisy(made.force(U))
    head = "Extension (mm),Load (N),Extension (in),Load (lbf)"
    text = table(head, U, F, U / 25.4, F / 4.4482216)
    message, _ = said(write(tmp_path, text, PULLED))
    assert "'Extension (mm)'" in message
    named = {"displacement": "Extension (mm)", "force": "Load (N)"}
    message, campaign = said(write(tmp_path, text, named))
    assert not message and campaign is not None and len(campaign.experiments[0].repetitions) == 1


def test_a_copy_is_no_second_specimen(tmp_path):
    F = noisy(made.force(U))
    files = {
        "a.csv": table("Extension (mm),Load (N)", U, F),
        "b.csv": table("Extension (mm),Load (mN)", U[5:], 1e3 * F[5:]),
        "c.csv": table("Extension (mm),Load (N)", U, noisy(made.force(U), seed=2)),
    }
    message, campaign = said(write(tmp_path, files, PULLED, data='["a.csv", "b.csv"]'))
    assert campaign is None and "'a'" in message
    message, campaign = said(write(tmp_path, files, PULLED, data='["a.csv", "c.csv"]'))
    assert campaign is not None and not message


@pytest.mark.parametrize("column", ["time (s)", "speed (mm/min)"])
def test_specimens_at_speeds_far_apart_are_two_tests(tmp_path, column):
    rows = [f"rep,{column},u (mm),F (N)"]
    for name, speed, seed in (("A", 1.0, 1), ("B", 1.1, 2), ("C", 60.0, 3)):
        timed = U / speed if column == "time (s)" else np.full(U.size, 60 * speed)
        each = zip(timed, U, noisy(made.force(U), seed=seed), strict=True)
        rows += [f"{name},{t:.5f},{u:.4f},{F:.5f}" for t, u, F in each]
    role = column.split()[0]
    columns = {"displacement": "u", "force": "F", role: role, "repetition": "rep"}
    _, campaign = said(write(tmp_path, "\n".join(rows), columns))
    assert campaign is not None
    assert [len(e.repetitions) for e in campaign.experiments] == [2, 1]
    assert [e.travel_speed for e in campaign.experiments] == pytest.approx([1.05 / 40, 60 / 40], rel=0.01)


def held(tick: float) -> tuple[np.ndarray, str]:
    t = 0.25 + 0.1 * np.arange(300)
    u = np.minimum(6 * t, 12)
    F = made.force(u) * (1 + np.exp(-np.maximum(t - 2, 0) / 4))
    shown = np.floor(t / tick + 1e-9) * tick if tick else t
    return t, table("Time (s),Extension (mm),Load (N)", shown, u, noisy(F))


def test_times_lie_between_the_ticks_of_a_coarse_clock(tmp_path):
    t, text = held(1.0)
    _, campaign = said(write(tmp_path, text, {"time": "Time"} | PULLED))
    assert campaign is not None
    (r,) = campaign.experiments[0].repetitions
    assert np.ptp(r.time_s - t) < 0.1 and not campaign.experiments[0].monotone


def test_a_clock_that_stands_still_is_refused(tmp_path):
    lines = held(0.0)[1].splitlines()
    lines[100:140] = [",".join([lines[100].split(",")[0], *line.split(",")[1:]]) for line in lines[100:140]]
    message, campaign = said(write(tmp_path, "\n".join(lines), {"time": "Time"} | PULLED))
    assert campaign is None and "speed" not in message


def test_cells_may_carry_their_unit(tmp_path):
    F = noisy(made.force(U))
    rows = [f"{k},{f / 4.4482216:.5f} lbF,{u:.2f} mm" for k, (u, f) in enumerate(zip(U, F, strict=True), 1)]
    text = "\n".join(["Reading,Load,Extension", *rows])
    _, campaign = said(write(tmp_path, text, PULLED))
    assert campaign is not None
    assert campaign.experiments[0].repetitions[0].y * 20 == pytest.approx(F, abs=1e-4)
    rows[30] = rows[30].replace("lbF", "N")
    with pytest.raises(BadInput) as caught:
        load_campaign(write(tmp_path, "\n".join(["Reading,Load,Extension", *rows]), PULLED))
    assert caught.value.line == 32 and "lbF" in caught.value.expected


CUT = """material = "gelatin"
[[experiment]]
id = "cut"
kind = "cut"
data = "cut.csv"
columns = { displacement = "Travel", force = "Force" }
specimen = { width = "30 mm", length = "LENGTH", height = "21 mm" }
blade = { thickness = "0.7 mm", tip = "1.05 mm" }
speed = "0.021 mm/s"
"""


def cut(folder: Path, force: np.ndarray, far: float, length: str = "30 mm", more: str = "") -> Path:
    (folder / "cut.csv").write_text(table("Travel (mm),Force (N)", np.linspace(0.1, far, force.size), force))
    path = folder / "cut.toml"
    path.write_text(CUT.replace("LENGTH", length) + more)
    return path


FORCE = 0.3 * np.minimum(np.linspace(0.1, 12, 120), 3)


def test_a_blade_that_meets_the_plate_is_said_with_its_line(tmp_path):
    with pytest.raises(BadInput) as caught:
        load_campaign(cut(tmp_path, noisy(FORCE), 22.5))
    assert caught.value.line is not None and Path(caught.value.file or "").name == "cut.csv"
    (_, until) = _PROPOSED.findall(caught.value.expected)[0]
    message, campaign = said(cut(tmp_path, noisy(FORCE), 22.5, more=f"until = {until}\n"))
    assert campaign is not None and not message


def test_a_force_that_shoots_up_is_named(tmp_path):
    force = noisy(FORCE) + 0.8 * np.maximum(np.arange(120) - 112, 0)
    message, _ = said(cut(tmp_path, force, 12))
    assert "plate" in message and "until = '11." in message


def test_lost_samples_of_a_cut_are_named(tmp_path):
    force = noisy(FORCE)
    force[[50, 51, 90]] = 0
    message, _ = said(cut(tmp_path, force, 12))
    assert "line 52" in message


def test_stick_and_slip_is_no_fault(tmp_path):
    force = FORCE * (1 - 0.4 * (np.arange(120) % 12 == 11) * (np.arange(120) > 40))
    assert said(cut(tmp_path, noisy(force, 0.002), 12))[0] == ""


@pytest.mark.parametrize(("length", "doubted"), [("30 mm", False), ("1 mm", True)])
def test_a_section_of_a_thin_sheet_is_doubted(tmp_path, length, doubted):
    campaign = load_campaign(cut(tmp_path, noisy(FORCE) * float(length.split()[0]) / 30, 12, length))
    assert any("plane stress" in note for note in campaign.all_notes()) == doubted


@pytest.mark.parametrize("path", ["data\\new.csv", "C:\\gel\\new.csv", "C:\\Users\\new.csv"])
def test_a_path_of_windows_is_shown_how_to_be_written(tmp_path, path):
    with pytest.raises(BadInput) as caught:
        load_campaign(write(tmp_path, made.HEAD + "\n", PULLED, data=f'"{path}"'))
    assert "'C:\\data\\gel.csv'" in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_a_campaign_may_begin_with_the_mark_of_utf_8(tmp_path):
    path = write(tmp_path, table("Extension (mm),Load (N)", U, noisy(made.force(U))), PULLED)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_campaign(path).experiments


@pytest.mark.parametrize("until", ['"15 mm"', "1.375"])
def test_until_is_a_displacement_where_the_file_has_them(tmp_path, until):
    text = table("Extension (mm),Load (N)", U, noisy(made.force(U)))
    _, campaign = said(write(tmp_path, text, PULLED, until=until))
    assert campaign is not None and campaign.experiments[0].reach == pytest.approx(1.375, abs=0.007)
    message, campaign = said(write(tmp_path, text, PULLED, until="15"))
    assert campaign is None and "20 mm" in message


HONEST = {
    "linear to a strain of 0.9": (X - 1, 250 * (X - 1), STRESS),
    "a strain of 8": (np.linspace(0.1, 8, 90), stress(np.linspace(1.1, 9, 90)), STRESS),
    "a tissue that stiffens": (X - 1, stress(X, 40.0) * np.exp(0.6 * (X**2 + 2 / X - 3)), STRESS),
    "a step and its relaxation": (
        np.append(0, np.full(60, 0.2)),
        np.append(0, 20 + 20 * np.exp(-np.arange(60) / 20)),
        STRESS,
    ),
    "a stretch": (X, stress(X), {"stretch": "Strain", "stress": "Stress"}),
}


@pytest.mark.parametrize("case", HONEST)
def test_what_may_well_be_true_is_not_doubted(tmp_path, case):
    x, y, columns = HONEST[case]
    message, campaign = said(write(tmp_path, table("Strain,Stress (kPa)", x, noisy(y)), columns))
    assert campaign is not None and not message


@pytest.mark.parametrize(
    ("keys", "doubted"), [({}, True), ({"configuration": "reference"}, False), ({"y": 1.0}, False)]
)
def test_points_that_stay_are_positions_before_deformation(tmp_path, keys, doubted):
    moves = keys.pop("y", 0.0)
    rows = [
        f"{x},{y - moves * 0.02 * t * y:.5f},{0.02 * t * x:.5f},{-0.02 * t * y:.5f},{t}"
        for t in (1.0, 2.0)
        for y in (2.0, 4.0, 6.0, 8.0)
        for x in (-3.0, -1.0, 1.0, 3.0)
    ]
    path = tmp_path / "f.csv"
    path.write_text("x [mm],y [mm],u [mm],v [mm],travel [mm]\n" + "\n".join(rows))
    fields = read_fields(path, **keys)
    assert all(bool(field.doubt) == doubted for field in fields)


def test_a_discovery_begins_with_what_is_in_doubt(tmp_path):
    path = write(tmp_path, table("Extension (mm),Load (N)", U, np.minimum(noisy(made.force(U)), 1.2)), PULLED)
    path.write_text('candidates = ["gent"]\n' + path.read_text())
    told = verdict_sentence(discover(load_campaign(path), workers=0))
    assert "line" in told.split(". ")[0] and "until = " in told
