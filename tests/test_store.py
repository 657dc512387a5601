"""The store keeps whole runs, and nothing else."""

from __future__ import annotations

import json
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from analytic_runs import fake_run
from refusals import refused

from cutbench.case.case import load_case
from cutbench.run.result import Outcome
from cutbench.run.store.runs import Store


@pytest.fixture
def result():
    return fake_run(load_case("gelatin"))


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "runs")


def test_a_run_comes_back_as_it_was(store, result):
    result.measures = {"drop_rel": 0.25, "peak_mm": float("nan")}
    id = result.case.id
    assert id not in store and store.get(id) is None
    assert store.put(result)
    back = store.get(id)
    assert back.case == result.case and back.case.id == id
    assert back.outcome == result.outcome and back.counts == result.counts
    assert back.measures["drop_rel"] == 0.25 and np.isnan(back.measures["peak_mm"])
    assert list(back.curve) == list(result.curve)
    for name in result.curve:
        np.testing.assert_array_equal(back.curve[name], result.curve[name])
    assert store.path(id) == store.root / id[:2] / id
    record = json.loads((store.path(id) / "run.json").read_text())
    assert record["case"]["values"]["G"] == {"value": 7.5, "unit": "kPa"}
    assert set(record["versions"]) >= {"numpy", "scipy"}


def test_only_whole_entries_are_listed(store, result):
    store.put(result)
    other = fake_run(load_case("meat"))
    store.put(other)
    assert [r.case.id for r in store] == sorted([result.case.id, other.case.id]) and len(store) == 2
    (store.path(other.case.id) / "run.json").unlink()
    assert [r.case.id for r in store] == [result.case.id]


@pytest.mark.parametrize("file", ["run.json", "curve.npz"])
@pytest.mark.parametrize("damage", ["gone", "empty", "half", "flipped"])
def test_a_damaged_entry_is_not_there_and_is_written_again(store, result, file, damage):
    store.put(result)
    path = store.path(result.case.id) / file
    content = path.read_bytes()
    if damage == "gone":
        path.unlink()
    elif damage == "flipped":
        middle = len(content) // 3
        path.write_bytes(content[:middle] + b"\x00\xff\x00\xff\x00" + content[middle + 5 :])
    else:
        path.write_bytes(b"" if damage == "empty" else content[: len(content) // 2])
    assert result.case.id not in store
    assert store.put(result)
    np.testing.assert_array_equal(store.get(result.case.id).curve["force_N"], result.curve["force_N"])


def test_an_entry_under_a_foreign_name_is_not_believed(store, result):
    store.put(result)
    other = store.root / "ff" / "ff00000000000000"
    other.parent.mkdir(exist_ok=True)
    os.rename(store.path(result.case.id), other)
    assert "ff00000000000000" not in store


def test_a_pickle_in_the_curve_is_refused(store, result):
    store.put(result)
    with open(store.path(result.case.id) / "curve.npz", "wb") as file:
        np.savez(file, force_N=np.array([{"a": 1}], dtype=object))
    assert store.get(result.case.id) is None


def test_the_first_of_two_equal_runs_stays_unless_replaced(store, result):
    failed = replace_outcome(result, "failed")
    assert store.put(failed)
    assert not store.put(result)
    assert store.get(result.case.id).outcome.kind == "failed"
    assert store.put(result, replace=True)
    assert store.get(result.case.id).outcome.kind == "done"


def test_a_failed_run_is_kept_with_its_reason_and_an_interrupted_one_is_not(store, result):
    assert store.put(replace_outcome(result, "stalled", "the step fell below 1e-4 mm"))
    assert "1e-4" in store.get(result.case.id).outcome.message
    store.remove(result.case.id)
    assert not store.put(replace_outcome(result, "interrupted"))
    assert result.case.id not in store


def test_many_writers_of_one_run_leave_one_entry(store, result):
    with ThreadPoolExecutor(8) as pool:
        written = list(pool.map(lambda _: Store(store.root).put(result), range(24)))
    assert sum(written) == 1 and result.case.id in store
    assert not list(store.root.glob(".*"))


def test_leftovers_of_dead_writers_are_cleared_and_fresh_ones_are_not(store):
    old, new = store.root / ".new-old", store.root / ".new-new"
    old.mkdir()
    new.mkdir()
    long_ago = time.time() - 7200
    os.utime(old, (long_ago, long_ago))
    Store(store.root)
    assert not old.exists() and new.exists()


def test_a_folder_that_cannot_be_one_is_bad_input(tmp_path):
    (tmp_path / "file").write_text("")
    with refused("store"):
        Store(tmp_path / "file")


def replace_outcome(result, kind, message="no"):
    return replace(result, outcome=Outcome(kind, message, "try smaller steps", 3.0))
