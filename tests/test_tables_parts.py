"""One test in several files, blocks below each other in one, lines that are no readings, specimens of their
own sizes, and patterns for files."""

from __future__ import annotations

import numpy as np
import pytest
import tables_made as made

from cutbench.base.errors import BadInput
from cutbench.data.campaign import load_campaign

HOLD_S = 30


def ramp_and_hold(start_s: float | None) -> dict[str, str]:
    """Two files; the second begins at ``start_s``, or goes on by the clock of the first."""
    ramp = made.readings()
    t = np.arange(1.0, HOLD_S + 1)
    hold = np.column_stack(
        [
            t + (20 if start_s is None else start_s - 1),
            np.full(t.size, 20.0),
            0.5 * made.force(20) * (1 + np.exp(-t / 9)),
        ]
    )
    head = "Test: pull and hold\n\nExtension\tLoad\tTime\nmm\tN\tsec\n"
    return {
        name: head + made.rows(part[:, [1, 2, 0]], "\t")
        for name, part in (("ramp.txt", ramp), ("hold.txt", hold))
    }


def experiment(path):
    (found,) = load_campaign(path).experiments
    return found


@pytest.mark.parametrize(("start_s", "first"), [(None, 21.0), (0.0, 21.0), (1.0, 21.0)])
def test_files_that_follow_one_another_are_one_specimen(tmp_path, start_s, first):
    path = made.campaign(tmp_path, ramp_and_hold(start_s), data='[["ramp.txt", "hold.txt"]]')
    e = experiment(path)
    (r,) = e.repetitions
    assert r.x.size == 40 + HOLD_S and not e.monotone
    assert r.time_s[40] == pytest.approx(first) and np.all(np.diff(r.time_s) > 0)
    assert r.time_s[-1] == pytest.approx(50)
    assert any("ramp.txt" in note and "hold.txt" in note for note in e.notes)


def test_what_is_recorded_twice_counts_once(tmp_path):
    files = ramp_and_hold(18.2)
    path = made.campaign(tmp_path, files, data='[["ramp.txt", "hold.txt"]]')
    e = experiment(path)
    (r,) = e.repetitions
    assert np.all(np.diff(r.time_s) > 0) and r.x.size == 36 + HOLD_S and r.time_s[36] == pytest.approx(18.2)
    assert any("4 of the last readings" in note for note in e.notes)


def test_several_specimens_of_several_files(tmp_path):
    files = {f"{name}{k}": text for k in (1, 2) for name, text in ramp_and_hold(0.0).items()}
    files = {name.replace(".txt", "_") + ".txt": text for name, text in files.items()}
    data = '[["ramp_1.txt", "hold_1.txt"], ["ramp_2.txt", "hold_2.txt"]]'
    e = experiment(made.campaign(tmp_path, files, data=data))
    assert [r.name for r in e.repetitions] == ["ramp_1", "ramp_2"]
    assert {r.x.size for r in e.repetitions} == {70}


def test_a_travel_that_was_set_to_zero_between_files_is_noted(tmp_path):
    files = ramp_and_hold(None)
    files["hold.txt"] = files["hold.txt"].replace("20.0000\t", "0.0000\t")
    e = experiment(made.campaign(tmp_path, files, data='[["ramp.txt", "hold.txt"]]'))
    assert any("20 mm" in note for note in e.notes)


def test_a_plain_list_of_such_files_leads_there(tmp_path):
    message = made.refused(
        ["data", str(made.campaign(tmp_path, ramp_and_hold(None), data='["ramp.txt", "hold.txt"]'))]
    )
    assert "data = [['ramp.txt', 'hold.txt']]" in message and "campaign.toml, line" in message


def test_a_fault_in_a_later_file_is_found_there(tmp_path):
    files = ramp_and_hold(None)
    lines = files["hold.txt"].splitlines()
    lines[10], lines[11] = lines[11], lines[10]
    files["hold.txt"] = "\n".join(lines)
    with pytest.raises(BadInput) as wrong:
        load_campaign(made.campaign(tmp_path, files, data='[["ramp.txt", "hold.txt"]]'))
    assert (
        wrong.value.file.endswith("hold.txt")
        and wrong.value.line == 12
        and wrong.value.key.startswith("time")
    )


# -- blocks ------------------------------------------------------------------------------------------
def blocks(titles: list[str], starts: list[float], head: str = made.HEAD, first: str = "") -> str:
    """A table under a heading of its own for each title; the time of each begins at its start."""
    return first + "".join(
        f"\n{title}\n{head}\n" + made.rows(made.readings(start_s=start))
        for title, start in zip(titles, starts, strict=True)
    )


@pytest.mark.parametrize(
    ("titles", "starts", "how"),
    [
        (["Cycle 1", "Cycle 2", "Cycle 3"], [0, 20, 40], "cycles"),
        (["Cycle 1", "Cycle 2"], [0, 0], "cycles"),
        (["[Segment 1]", "[Segment 2]"], [0, 20], "cycles"),
        (["", ""], [0, 20], "cycles"),
        (["Specimen 1", "Specimen 2", "Specimen 3"], [0, 0, 0], "specimens"),
        (["Sample A", "Sample B"], [0, 20], "specimens"),
        (["Test: pull", "Test: pull", "Test: pull"], [0, 20, 40], "cycles"),
        (["Test: pull", "Test: pull"], [0, 0], "specimens"),
        (["", ""], [0, 0], "specimens"),
        (["left half", "right half"], [0, 0], "specimens"),
    ],
)
def test_blocks_are_cycles_or_specimens(tmp_path, titles, starts, how):
    e = experiment(made.campaign(tmp_path, blocks(titles, starts, first="Test: strip\nOperator: -\n")))
    sizes = [r.x.size for r in e.repetitions]
    assert sizes == ([40 * len(titles)] if how == "cycles" else [40] * len(titles))
    assert all(np.all(np.diff(r.time_s) > 0) for r in e.repetitions)
    assert any(how in note for note in e.notes)
    if how == "specimens" and all(titles) and len(set(titles)) == len(titles):
        assert [r.name for r in e.repetitions] == titles


def test_what_blocks_are_can_be_written(tmp_path):
    text = blocks(["Cycle 1", "Cycle 2"], [0, 0])
    for how, count in (("specimens", 2), ("cycles", 1)):
        assert len(experiment(made.campaign(tmp_path, text, f'blocks = "{how}"\n')).repetitions) == count
    assert "blocks" in made.refused(["data", str(made.campaign(tmp_path, text, 'blocks = "cycle"\n'))])


def test_blocks_that_nothing_tells_apart_are_asked_for(tmp_path):
    columns = '{ displacement = "Extension", force = "Load" }'
    path = made.campaign(tmp_path, blocks(["", ""], [0, 0]), columns=columns)
    message = made.refused(["data", str(path)])
    assert "blocks" in message and "data.csv, line 47" in message
    path = made.campaign(tmp_path, blocks(["", ""], [0, 0]), 'blocks = "specimens"\n', columns=columns)
    assert [r.name for r in experiment(path).repetitions] == ["1", "2"]


def test_headings_with_units_below_and_lines_between(tmp_path):
    head = "Time,Extension,Load\n(s),(mm),(N)"
    text = "".join(
        f"Specimen {k}\n{head}\n" + made.rows(made.readings()) + "Mean,10.0,0.9\nMaximum,20.0,1.7\n\n"
        for k in (1, 2)
    )
    e = experiment(made.campaign(tmp_path, text))
    assert [r.x.size for r in e.repetitions] == [40, 40]
    assert any("Maximum,20.0" in note for note in e.notes)


def test_a_name_between_readings_begins_a_block(tmp_path):
    part = made.rows(made.readings())
    text = f"{made.HEAD}\nCycle 1\n{part}Cycle 2\n{part}"
    (r,) = experiment(made.campaign(tmp_path, text)).repetitions
    assert r.x.size == 80


def test_a_heading_in_other_units_is_no_repetition_of_the_first(tmp_path):
    text = blocks(["", ""], [0, 0], "Time,Extension,Load\n(s),(mm),(N)")
    at = text.rindex("(N)")
    assert "data.csv, line" in made.refused(
        ["data", str(made.campaign(tmp_path, text[:at] + "(kN)" + text[at + 3 :]))]
    )


FOOTERS = {
    "a summary": "\nMaximum,20.0,2.4\nEnd of test\n",
    "short lines": "Results\nMax load,1.7\n1,2\nBreak: no\n",
    "a ruled line": "--------\nMean = 0.9 N\n",
    "statistics": "Mean,,0.9\nStd.dev.,,0.1\n",
}


@pytest.mark.parametrize("name", FOOTERS)
def test_lines_behind_the_readings_are_passed_over(tmp_path, name):
    text = f"{made.HEAD}\n" + made.rows(made.readings()) + FOOTERS[name]
    e = experiment(made.campaign(tmp_path, text))
    assert e.repetitions[0].x.size == 40
    assert any("passed over" in note and "line 4" in note for note in e.notes)


def test_lines_amid_the_readings_are_passed_over_where_that_is_written(tmp_path):
    lines = made.rows(made.readings()).splitlines()
    text = "\n".join([made.HEAD, *lines[:20], "Operator pressed pause", *lines[20:]])
    message = made.refused(["data", str(made.campaign(tmp_path, text))])
    assert "data.csv, line 22" in message and "skip" in message
    assert experiment(made.campaign(tmp_path, text, 'skip = "Operator"\n')).repetitions[0].x.size == 40
    assert "skip" in made.refused(["data", str(made.campaign(tmp_path, text, "skip = [1]\n"))])


@pytest.mark.parametrize("columns", [made.COLUMNS, "{ time = 1, displacement = 2, force = 3 }"])
def test_results_above_the_table_are_not_read(tmp_path, columns):
    results = "Results\nTime (s),Extension (mm),Load (N)\n20.0,20.0,1.7\n20.1,20.0,1.8\n\n"
    text = results + f"Readings\n{made.HEAD}\n" + made.rows(made.readings())
    (r,) = experiment(made.campaign(tmp_path, text, columns=columns)).repetitions
    assert r.x.size == 40 and r.lines[0] == 8


# -- sizes and names ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "areas", ['["20 mm^2", "22 mm^2", "18 mm^2"]', '{ S1 = "20 mm^2", S2 = "22 mm^2", S10 = "18 mm^2" }']
)
def test_specimens_have_sizes_of_their_own_and_files_a_pattern(tmp_path, areas):
    files = {}
    for name, area in (("S1", 20), ("S10", 18), ("S2", 22)):
        t, u, _ = made.readings().T
        files[f"{name}.csv"] = f"{made.HEAD}\n" + made.rows(
            np.column_stack([t, u, made.force(u, area=area)]), digits=7
        )
    specimen = f'{{ length = "40 mm", area = {areas} }}'
    e = experiment(made.campaign(tmp_path, files, data='"S*.csv"', specimen=specimen))
    assert [r.name for r in e.repetitions] == ["S1", "S2", "S10"]
    for r in e.repetitions:
        np.testing.assert_allclose(r.y, made.force(u) / made.AREA_MM2, rtol=1e-4)
    assert e.on_grid().scatter.max() < 1e-4 and e.area_mm2 == pytest.approx(20)
    assert any("area by repetition" in note for note in e.notes)


def test_zeros_may_be_a_list_in_the_order_of_the_files(tmp_path):
    files = {}
    for name, air in (("a", 1.0), ("b", 2.0)):
        t, u, F = made.readings().T
        files[f"{name}.csv"] = f"{made.HEAD}\n" + made.rows(np.column_stack([t, u + air, F]))
    e = experiment(made.campaign(tmp_path, files, 'zero = ["1 mm", "2 mm"]\n', data='["a.csv", "b.csv"]'))
    np.testing.assert_allclose(e.repetitions[0].x, e.repetitions[1].x)


def test_a_pattern_without_a_file_says_what_is_there(tmp_path):
    path = made.campaign(tmp_path, {"S1.csv": made.HEAD, "S2.csv": made.HEAD}, data='"T*.csv"')
    message = made.refused(["data", str(path)])
    assert "T*.csv" in message and "S1.csv, S2.csv" in message


@pytest.mark.parametrize(
    ("specimen", "doubtful"),
    [
        ('{ length = "40 mm", area = "20 mm^2" }', False),
        ('{ length = "40 cm", area = "20 mm^2" }', True),
        ('{ length = "25 mm", width = "10 mm", thickness = "2 mm" }', False),
        ('{ length = "25 cm", width = "10 mm", thickness = "2 mm" }', True),
        ('{ length = "80 mm", area = "22 mm^2" }', False),
        ('{ length = "33 mm", width = "6 mm", thickness = "2 mm" }', False),
    ],
)
def test_sizes_that_are_not_likely_are_noted(tmp_path, specimen, doubtful):
    path = made.campaign(tmp_path, f"{made.HEAD}\n" + made.rows(made.readings()), specimen=specimen)
    notes = experiment(path).notes
    assert any("another unit" in note for note in notes) == doubtful
