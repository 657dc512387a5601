"""How fast the front is at the transition, and what it has to spare there, on curves known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from coarse_runs import COARSE

from cutbench import load_case
from cutbench.run.ledger import freed_rel
from cutbench.run.measures import FRONT, KNOWN, MEASURES, measures
from cutbench.run.runner import run_case

CASE = load_case("gelatin")
WINDOW = CASE.p.thickness
SHORT = FRONT * WINDOW


def speed(d, c):
    curve = {"displacement_mm": np.array(d), "force_N": np.ones(len(d)), "cut_length_mm": np.array(c)}
    return measures(curve, window_mm=WINDOW)["front_speed"]


@pytest.mark.parametrize("n", [3, 50, 2001])
def test_steady_cutting_goes_as_fast_as_the_blade(n):
    d = np.linspace(0, 10, n)
    assert speed(d, d) == pytest.approx(1)


def test_a_faster_stretch_counts_in_full_where_it_lasts():
    d = [0, 2, 2 + SHORT, 10]
    assert speed(d, [0, 0, 5 * SHORT, 5 * SHORT]) == pytest.approx(5)
    d = [0, 2, 2 + SHORT / 2, 10]
    assert speed(d, [0, 0, 5 * SHORT, 5 * SHORT]) == pytest.approx(5)  # twice as fast, half as long


def test_a_jump_is_its_length_over_the_stretch():
    assert speed([0, 2, 2, 10], [0, 0, 3, 3]) == pytest.approx(3 / SHORT)
    assert speed([0, 2, 2, 10], [0, 0, 3, 11]) == pytest.approx(3 / SHORT + 1)


def test_what_comes_after_the_transition_does_not_count():
    onset = 2.0
    d = np.array([0, onset, onset + 5.5 * WINDOW, onset + 5.6 * WINDOW, 10])
    late = np.array([0, 0.1, 3, 9, 9])
    cut = speed(d[:3], late[:3])
    assert speed(d, late) == pytest.approx(cut)
    assert speed(d, late) < 2
    to_the_transition = d <= onset + KNOWN * WINDOW
    known = np.append(d[to_the_transition], onset + KNOWN * WINDOW)
    assert speed(known, np.interp(known, d, late)) == pytest.approx(cut)


def test_without_a_cut_there_is_no_front():
    assert math.isnan(speed([0, 10], [0, 0.05]))
    assert "front_speed" in MEASURES


def ledger(d, c, **work):
    return {"displacement_mm": np.array(d), "cut_length_mm": np.array(c)} | {
        f"work_{name}_mJ": np.array(values) for name, values in work.items()
    }


def test_what_is_freed_is_what_viscosity_and_damping_take_where_the_front_is_fastest():
    (viscous,) = (law.name for law in CASE.model.all if law.regularises)
    per_mm = CASE.p.G_c * CASE.p.length
    d, c = [0, 1, 2, 2 + SHORT / 2, 8], [0, 0.2, 0.2, 3.2, 3.2]
    taken = {"snap": np.array([0, 5, 5, 9.5, 9.5]) * per_mm, viscous: np.array([0, 1, 1, 2.5, 2.5]) * per_mm}
    curve = ledger(d, c, adhesion=[0, 0, 0, 1, 7], **taken)
    assert freed_rel(CASE, curve, 1.0) == pytest.approx((4.5 + 1.5) / 3)


def test_rest_frees_nothing_where_the_front_keeps_pace():
    d = np.linspace(0, 8, 81)
    curve = ledger(d, np.maximum(d - 2, 0), snap=0 * d)
    assert freed_rel(CASE, curve, 2.1) == 0


def test_nothing_is_freed_without_a_cut():
    d = np.linspace(0, 8, 81)
    assert math.isnan(freed_rel(CASE, ledger(d, 0 * d, snap=0 * d), math.nan))


@pytest.mark.slow
def test_viscosity_holds_the_front_back_and_takes_what_a_jump_would_free():
    case = COARSE.set(element="P1", cohesion=0.5, depth="6 mm", until="transition")
    slow, fast = (run_case(case.set(viscosity=v)).measures for v in (20, 0.01))
    assert 2 < slow["front_speed"] < fast["front_speed"] / 3
    assert slow["freed_rel"] > 2 * fast["freed_rel"] > 2
