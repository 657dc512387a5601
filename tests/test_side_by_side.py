"""Searches side by side: what is computed at one time, what each finds, and how they end."""

from __future__ import annotations

import threading

import pytest

from cutbench.base.errors import ComputationFailed
from cutbench.calibration.side_by_side import ask, side_by_side


def search(start: int, steps: int):
    """Doubles a number so many times, as others compute it."""

    def go() -> int:
        value = start
        for _ in range(steps):
            (value,) = ask([value])
        return value

    return go


def test_what_searches_ask_for_at_one_time_is_computed_at_once():
    batches = []

    def compute(tasks):
        batches.append(list(tasks))
        return [2 * task for task in tasks]

    assert side_by_side([search(1, 3), search(10, 1), search(100, 2)], compute) == [8, 20, 400]
    assert batches == [[1, 10, 100], [2, 200], [4]]
    assert ask([1]) is None


def test_one_that_fails_leaves_the_others():
    def fails():
        ask([1, 2])
        raise ComputationFailed("too tough")

    found, failed = side_by_side([search(1, 2), fails], lambda tasks: [2 * task for task in tasks])
    assert found == 4 and isinstance(failed, ComputationFailed)
    assert side_by_side([], list) == []
    with pytest.raises(ZeroDivisionError):
        side_by_side([search(1, 5), lambda: 1 // 0], list)


@pytest.mark.parametrize("first", [True, False])
def test_an_interruption_reaches_every_search(first):
    ended, threads = [], threading.active_count()

    def careful():
        try:
            while True:
                ask([1])
        except KeyboardInterrupt:
            ended.append("careful")
            return 1

    def compute(tasks):
        if first or len(tasks) < 3:
            raise KeyboardInterrupt
        return list(tasks)

    with pytest.raises(KeyboardInterrupt):
        side_by_side([careful, search(1, 1), careful], compute)
    assert ended == ["careful", "careful"] and threading.active_count() == threads


def test_one_thinks_at_a_time():
    thinking, most = [0], []

    def thinks():
        for _ in range(3):
            thinking[0] += 1
            most.append(thinking[0])
            thinking[0] -= 1
            ask([0])

    side_by_side([thinks] * 4, list)
    assert max(most) == 1
