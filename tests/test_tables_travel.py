"""Travel that jumps is refused, and travel that only looks odd is not; contact is sought on the way out."""

from __future__ import annotations

import numpy as np
import pytest
import tables_made as made

from cutbench.base.errors import BadInput
from cutbench.calibration.fitting import fit
from cutbench.data.campaign import load_campaign

COLUMNS = {"timed": made.COLUMNS, "untimed": '{ displacement = "Extension", force = "Load" }'}


def table(values: np.ndarray, cell=lambda k, u: f"{u:.6f}") -> str:
    return made.HEAD + "\n" + "".join(f"{t:.4f},{cell(k, u)},{F:.5f}\n" for k, (t, u, F) in enumerate(values))


# -- contact -----------------------------------------------------------------------------------------
def pressed(stray: str) -> str:
    """A cylinder of 10 by 10 mm, met at 0.4 mm; ``stray`` says what comes before."""
    u = 0.015 * np.arange(1, 240)
    before = {
        "nothing": [],
        "one reading": [0.6],
        "one beyond all": [5.0],
        "three readings": [0.5, 0.55, 0.6],
        "a drive back": np.linspace(2.5, 0.0, 60),
        "a rest": np.full(30, 0.015),
    }[stray]
    u = np.append(before, u)
    pushed = np.maximum(u - 0.4, 0.0)
    pushed[: len(before)] = 0.0
    stretch = 1 - pushed / 10
    F = np.pi / 4 * 100 * 0.05 * (stretch**-2 - stretch) + 0.05
    F += 0.003 * np.random.default_rng(2).standard_normal(u.size)
    return table(np.column_stack([0.1 * np.arange(u.size), u, F]))


@pytest.mark.parametrize(
    "stray", ["nothing", "one reading", "one beyond all", "three readings", "a drive back", "a rest"]
)
def test_contact_is_sought_on_the_way_out(tmp_path, stray):
    more = 'factors = { displacement = -1, force = -1 }\nzero = "auto"\nforce_zero = "auto"\n'
    path = made.campaign(tmp_path, pressed(stray), more, specimen='{ length = "10 mm", diameter = "10 mm" }')
    campaign = load_campaign(path)
    (r,) = campaign.experiments[0].repetitions
    assert r.contact.at == pytest.approx(0.4, abs=4 * r.contact.sd) and r.contact.sd < 0.02
    assert np.all(np.diff(r.x) < 0.01) and r.x[0] > 0.99
    early = any("left out" in note for note in campaign.all_notes())
    assert early == (stray not in ("nothing", "a rest"))
    if stray == "one reading":
        estimate = fit(campaign).estimate("G")
        assert estimate.low < 0.05 < estimate.high and estimate.value == pytest.approx(0.05, rel=0.02)


def test_a_zero_that_is_written_counts_on_the_way_out(tmp_path):
    more = 'factors = { displacement = -1, force = -1 }\nzero = "0.4 mm"\n'
    path = made.campaign(
        tmp_path, pressed("one reading"), more, specimen='{ length = "10 mm", diameter = "10 mm" }'
    )
    (r,) = load_campaign(path).experiments[0].repetitions
    assert r.x[0] > 0.998 and np.all(np.diff(r.x) < 0)


def test_cycles_that_grow_keep_their_first(tmp_path):
    way = np.concatenate(
        [np.linspace(a, b, 40, endpoint=False) for a, b in ((0, 1.5), (1.5, 0), (0, 3), (3, 0))]
    )
    u = np.append(way, 0.0) + 0.0005 * np.random.default_rng(1).standard_normal(161)
    stretch = 1 - np.maximum(u - 0.4, 0) / 10
    F = np.pi / 4 * 100 * 0.05 * (stretch**-2 - stretch) + 0.002 * np.random.default_rng(3).standard_normal(
        161
    )
    path = made.campaign(
        tmp_path, table(np.column_stack([np.arange(161), u, F])),
        'factors = { displacement = -1, force = -1 }\nzero = "auto"\n',
        specimen='{ length = "10 mm", diameter = "10 mm" }',
    )  # fmt: skip
    (r,) = load_campaign(path).experiments[0].repetitions
    assert r.time_s[0] < 15


# -- jumps -------------------------------------------------------------------------------------------
def lost(k: int, u: float) -> str:
    """Decimal points lost above 1 by a locale that takes them for signs between thousands."""
    text = f"{u:.4f}"
    return text if u < 1 else f"{10 * u:.3f}" if not text.endswith("0") else text.rstrip("0")


def scaled(factor: float, where):
    """Write readings of the numbers ``where`` times ``factor``."""
    return lambda k, u: f"{u * factor if k in where else u:.4f}"


MANGLED = {
    "points lost by a locale": (lost, 201),
    "all points lost from one reading on": (scaled(1e4, range(100, 400)), 100),
    "one point lost": (scaled(10, [250]), 250),
    "the second reading": (scaled(100, [1]), 1),
    "the last": (scaled(10, [399]), 399),
    "the last but one": (scaled(-0.1, [398]), 398),
    "one point lost twice": (scaled(100, [150]), 150),
    "points lost for three readings": (scaled(10, [150, 151, 152]), 150),
    "thousands for decimals": (lambda k, u: f"{1000 * u:.0f}" if u < 1 else f"{u:.3f}", 201),
    "one reading of another sensor": (scaled(-3, [300]), 300),
}


@pytest.mark.parametrize("columns", COLUMNS)
@pytest.mark.parametrize("name", MANGLED)
def test_travel_that_jumps_is_refused_with_file_and_line(tmp_path, name, columns):
    cell, at = MANGLED[name]
    u = 0.00503 * np.arange(1, 401)
    values = np.column_stack([u / 0.05, u, made.force(u)])
    with pytest.raises(BadInput) as wrong:
        load_campaign(made.campaign(tmp_path, table(values, cell), columns=COLUMNS[columns]))
    assert wrong.value.file.endswith("data.csv") and wrong.value.key in ("displacement", "number")
    assert abs(wrong.value.line - (at + 2)) <= 3, wrong.value


def test_a_sign_between_thousands_beside_whole_numbers(tmp_path):
    u = 10.0 * np.arange(1, 201)
    values = "".join(
        f"{t:.1f};{f'{u:,.0f}'};{F:.3f}\n".replace(".", ";").replace(";", "|").replace("|", ";")
        for t, u, F in np.column_stack([u / 100, u, made.force(u / 1000)])
    )
    head = "Time;x;Extension;Load;y\ns;;um;N;\n"
    path = made.campaign(tmp_path, head + values, 'units = { force = "N" }\n',
                         columns='{ displacement = "Extension", force = "Load" }')  # fmt: skip
    message = made.refused(["data", str(path)])
    assert "data.csv, line 102" in message and "1,000" in message and "thousands" in message


def test_a_time_that_jumps_is_refused(tmp_path):
    values = made.readings(n=100)
    values[60:, 0] *= 10
    message = made.refused(["data", str(made.campaign(tmp_path, table(values)))])
    assert "time" in message and "data.csv, line 62" in message


def steps_of_a_relaxation():
    levels = np.repeat([0.0, 0.1, 1.0, 10.0], 50)
    return np.arange(200.0) / 10, levels + 1e-5 * np.random.default_rng(0).standard_normal(200)


def logged_on_change():
    rng = np.random.default_rng(4)
    u = np.unique(
        np.concatenate([np.linspace(0, 1, 200), np.linspace(1, 20, 12), np.linspace(20, 20.5, 100)])
    )
    return np.cumsum(rng.uniform(0.01, 3, u.size)), u


def fast_then_slow():
    u = np.concatenate([np.linspace(0, 2, 80), np.linspace(12, 14, 80), np.linspace(14, 4, 5)])
    return np.arange(u.size) / 10.0, u


def a_gap():
    u = np.delete(np.linspace(0, 20, 400), np.arange(100, 180))
    return u / 0.5, u


def a_return():
    u = np.concatenate([np.linspace(0, 10, 100), np.linspace(10, 0, 6), np.linspace(0, 10, 100)])
    return np.arange(u.size) / 5.0, u


def coarse_sensor():
    return np.arange(400) / 10.0, np.round(np.linspace(0, 8, 400), 1)


def log_spaced():
    u = np.geomspace(1e-3, 20, 120)
    return u / 0.1, u


def noisy():
    u = np.linspace(0, 20, 300) + 0.03 * np.random.default_rng(5).standard_normal(300)
    return np.arange(300) / 10.0, u


def decades():
    t = np.concatenate([np.linspace(0.1, 10, 100), [100, 1000, 10000, 100000, 200000]])
    return t, np.concatenate([np.linspace(0.1, 10, 100), np.linspace(10, 10.001, 5)])


def levels_that_creep():
    u = np.concatenate([np.linspace(a, a * 1.02, 40) for a in (0.1, 1.0, 10.0)])
    return np.arange(u.size) / 10.0, u


def tap():
    u = np.zeros(100) + 2e-4 * np.random.default_rng(6).standard_normal(100)
    u[50:52] = 4.0
    return np.arange(100) / 10.0, u + np.linspace(0, 0.001, 100)


@pytest.mark.parametrize("columns", COLUMNS)
@pytest.mark.parametrize(
    "way",
    [
        steps_of_a_relaxation,
        logged_on_change,
        fast_then_slow,
        a_gap,
        a_return,
        coarse_sensor,
        log_spaced,
        noisy,
        decades,
        levels_that_creep,
        tap,
    ],
)
def test_travel_that_only_looks_odd_is_read(tmp_path, way, columns):
    t, u = way()
    values = np.column_stack([t, u, made.force(np.maximum(u, 0))])
    campaign = load_campaign(made.campaign(tmp_path, table(values), columns=COLUMNS[columns]))
    (r,) = campaign.experiments[0].repetitions
    assert r.x.size == u.size
