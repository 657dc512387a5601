"""``cutbench runs`` and the list behind it: what the folders hold, whoever writes and whatever breaks."""

from __future__ import annotations

import csv
import json
import multiprocessing
import shutil
import time

import numpy as np
import pytest
from analytic_runs import computed
from refusals import refused
from typer.testing import CliRunner

from cutbench.base.files import csv_text
from cutbench.case.case import load_case
from cutbench.cli.main import app
from cutbench.maps.sweep import run_study
from cutbench.run.files import read_run
from cutbench.run.measures import measures
from cutbench.run.store.listing import parse_condition, row_of, table_of
from cutbench.run.store.runs import Store


def result_of(**changes):
    result = computed(load_case("gelatin").set(**changes))
    result.measures = measures(result.curve, window_mm=0.7)
    result.timings = {"total": 1.5}
    return result


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "runs")
    for G in (5, 10, 20):
        store.put(result_of(G=f"{G} kPa", name=f"gel {G}"))
    store.put(result_of(without="adhesion", name="bare"))
    return store


def test_the_list_holds_what_the_folders_hold(store):
    heads = store.heads()
    assert list(heads) == sorted(result.case.id for result in store) and len(heads) == 4
    for id, head in heads.items():
        result = store.get(id)
        assert head["name"] == result.case.name and head["outcome"] == "done" and head["seconds"] == 1.5
        assert head["values"]["G"] == [pytest.approx(result.case.p.G * 1e3), "kPa"]
        assert head["computation"] == result.case.computation and head["versions"]["cutbench"]


def test_a_run_that_is_replaced_removed_or_copied_in_is_noticed(store, tmp_path):
    first, second, *_ = store.heads()
    result = store.get(first)
    result.timings = {"total": 99.0}
    store.put(result, replace=True)
    store.remove(second)
    assert store.heads()[first]["seconds"] == 99.0 and second not in store.heads()
    other = Store(tmp_path / "other")
    other.put(result_of(G="7 kPa"))
    (id,) = other.heads()
    shutil.copytree(other.path(id), store.path(id))
    assert id in store.heads() and id in store.heads()


def write_some(root, n):
    store = Store(root)
    for k in range(6):
        store.put(result_of(G=f"{5 + n + 0.1 * k:.6g} kPa"))


@pytest.mark.slow
def test_several_processes_write_at_once(tmp_path):
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=write_some, args=(tmp_path / "runs", n)) for n in range(2)]
    for writer in writers:
        writer.start()
    store = Store(tmp_path / "runs")
    while any(writer.is_alive() for writer in writers):
        assert set(store.heads()) <= {folder.name for folder in store.root.glob("??/*")}
        time.sleep(0.1)
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert set(store.heads()) == {r.case.id for r in store} and len(store) == 12


def test_what_cannot_be_used_is_named_with_what_to_do(store):
    first, second, third, _ = store.heads()
    path = store.path(first) / "run.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | {"schema": 99}))
    (store.path(second) / "run.json").write_text("{")
    record = json.loads((store.path(third) / "run.json").read_text())
    del record["case"]["values"]
    (store.path(third) / "run.json").write_text(json.dumps(record))
    found = Store(store.root).unreadable()
    assert set(found) == {first, second, third}
    assert "schema = 99" in found[first] and "cutbench 0." in found[first] and "damaged" in found[second]
    assert "inputs" in found[third]


# -- runs of another computation ------------------------------------------------------------------------
OTHER = "0123456789ab"


def test_a_run_of_other_code_is_not_found_and_stays_listed_with_what_wrote_it(store, other_code):
    before = store.heads()
    here = {head["computation"] for head in before.values()}
    other_code(OTHER)
    assert result_of(G="5 kPa").id not in store
    fresh = result_of(G="5 kPa", name="gel 5")
    assert store.put(fresh) and store.get(fresh.id).computation == OTHER
    heads = store.heads()
    assert heads.keys() == {*before, fresh.id}
    done = run(store.root)
    assert done.exit_code == 0 and "3 of 5" in done.output and fresh.versions["cutbench"] in done.output
    assert all(found in done.output for found in here) and OTHER not in done.output
    assert row_of(fresh.id, heads[fresh.id])["computation"] == OTHER


def test_a_sweep_that_goes_on_with_other_code_computes_anew(tmp_path, other_code):
    study = tmp_path / "study.toml"
    study.write_text('base = "gelatin"\n[[axis]]\nname = "cohesion"\nvalues = [2.0, 4.0]\n')
    first = run_study(study, tmp_path / "out", workers=0, run=computed, pictures=False)
    other_code(OTHER)
    second = run_study(study, tmp_path / "out", workers=0, run=computed, pictures=False)
    assert first.map.attrs["computation"] != second.map.attrs["computation"] == OTHER
    ids = [set(sweep.map["run_id"].values) for sweep in (first, second)]
    assert second.status.reused == 0 and not ids[0] & ids[1]
    assert {Store(tmp_path / "out/runs").get(id).computation for id in ids[1]} == {OTHER}


def test_an_old_run_is_handed_on_with_what_wrote_it(store, other_code, tmp_path):
    other_code(OTHER)
    id, head = next(iter(store.heads().items()))
    assert run(store.root, "--export", tmp_path / "out").exit_code == 0
    back = read_run(tmp_path / "out" / id)
    assert (back.id, back.computation, back.versions) == (id, head["computation"], head["versions"])
    assert Store(tmp_path / "copy").put(back) and Store(tmp_path / "copy").get(id).computation != OTHER


def test_a_run_with_numerics_of_then_is_listed_and_its_writer_named(store, tmp_path):
    id = next(iter(store.heads()))
    path = store.path(id) / "run.json"
    record = json.loads(path.read_text())
    record["case"]["numerics"]["normal"] = "blended"
    del record["computation"]
    record["versions"]["cutbench"] = "0.0.7"
    path.write_text(json.dumps(record))
    store = Store(store.root)
    assert store.heads()[id]["numerics"]["normal"] == "blended" and store.get(id) is None
    assert not store.unreadable()
    done = run(store.root, "--export", tmp_path / "out")
    assert done.exit_code == 0 and "blended" in done.output and "cutbench 0.0.7" in done.output
    assert len(list((tmp_path / "out").iterdir())) == 3


def test_a_row_has_values_groups_and_measures(store):
    rows = {row["name"]: row for row in (row_of(id, head) for id, head in store.heads().items())}
    gel = rows["gel 10"]
    assert gel["G"] == pytest.approx(10) and gel["cohesion"] == pytest.approx(7.571, rel=1e-3)
    assert 0 < gel["drop_rel"] < 1 and gel["element"] and "tau_W" not in rows["bare"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G > 7 kPa", {"gel 10", "gel 20", "bare"}),
        ("G >= 0.01 MPa", {"gel 10", "gel 20"}),
        ("G = 5 kPa", {"gel 5"}),
        ("name = bare", {"bare"}),
        ("name != bare", {"gel 5", "gel 10", "gel 20"}),
        ("mechanisms = adhesion", {"gel 5", "gel 10", "gel 20"}),
        ("tau_W < 1 kPa", {"gel 5", "gel 10", "gel 20"}),
        ("cohesion<8", {"gel 10", "gel 20"}),
        ("drop_rel > 2", set()),
    ],
)
def test_conditions_choose(store, text, expected):
    names, rows = table_of(store.heads(), [text], ["name"], None)
    assert names == ["name"] and {row[0] for row in rows} == expected


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("G", "sign"),
        ("G > 7", "unit"),
        ("G > 7 mm", "kPa"),
        ("Q > 7", "one of"),
        ("drop > 1", "drop_rel"),
        ("", "sign"),
    ],
)
def test_a_condition_that_cannot_be_read_is_refused(store, text, hint):
    known = [k for id, head in store.heads().items() for k in row_of(id, head)]
    with refused(hint=hint):
        parse_condition(text, known, {"G": "kPa"})


def test_sorting_puts_what_is_missing_last_and_csv_names_units(store):
    names, rows = table_of(store.heads(), [], ["name", "tau_W", "G"], "tau_W")
    assert names == ["name", "tau_W [kPa]", "G [kPa]"] and rows[-1][0] == "bare"
    lines = list(csv.reader(csv_text(names, rows).splitlines()))
    assert lines[0] == names and lines[-1][1] == ""


def run(*args):
    return CliRunner().invoke(app, ["runs", *map(str, args)])


def test_the_command_lists_filters_and_exports(store, tmp_path):
    out = run(store.root)
    assert out.exit_code == 0 and "4 of 4 runs" in out.output and "gel 10" in out.output
    chosen = ("--where", "G > 7 kPa", "--where", "name != bare", "--sort", "G")
    files = ("--csv", tmp_path / "a.csv", "--json", tmp_path / "a.json", "--export", tmp_path / "picked")
    out = run(tmp_path, *chosen, *files)
    assert out.exit_code == 0 and "2 of 4 runs" in out.output
    with open(tmp_path / "a.csv", newline="") as file:
        table = list(csv.DictReader(file))
    plain = json.loads((tmp_path / "a.json").read_text())
    assert [row["name"] for row in table] == [row["name"] for row in plain] == ["gel 10", "gel 20"]
    for row in plain:
        back, kept = read_run(tmp_path / "picked" / row["id"]), store.get(row["id"])
        assert back.case.id == row["id"]
        np.testing.assert_array_equal(back.force_N, kept.force_N)


def test_the_command_refuses_what_it_cannot_use(store, tmp_path):
    for args, hint in (
        ([tmp_path / "none"], "folder of a sweep"),
        ([store.root, "--where", "G > 7"], "unit"),
        ([store.root, "--columns", "id,drp"], "one of"),
        ([store.root, "--sort", "drp"], "one of"),
    ):
        out = run(*args)
        assert out.exit_code == 2 and hint in out.output and "Traceback" not in out.output
