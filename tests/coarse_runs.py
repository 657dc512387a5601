"""Cases of coarse runs in plane strain and what tests read from them; each run is computed once."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from cutbench.case.case import load_case
from cutbench.mechanisms import registry
from cutbench.run.runner import run_case

COARSE = load_case("gelatin").set(h="0.6 mm", corner=0.0625, shallow=1.0, detail=1.0, step="0.1 mm")
#: Pressed in, nothing cut yet.
PRESSED = COARSE.set(depth="1.5 mm")
#: A weak cut plane and a slender tip: cuts from the first millimetre on, with friction and adhesion.
CUTTING = COARSE.set(cohesion=0.5, tip="3.5 mm", mu=0.2, depth="2 mm")
#: The same, fewer steps.
BRIEF = CUTTING.set(depth="1.1 mm")
#: A contact that gives way by 1 µm where the pressure is G: onsets come early.
SOFT = {"penalty": "1000 1/mm", "stick": "400 1/mm", "multiplier": "none"}
#: For comparisons that hold on any element and in any contact: the quickest.
QUICK = BRIEF.set(element="P1", **SOFT)


def tuned(case, part, **changes):
    """``case`` with other tuned numbers in one part of them."""
    tuning = case.numerics.tuning
    tuning = replace(tuning, **{part: replace(getattr(tuning, part), **changes)})
    return replace(case, numerics=replace(case.numerics, tuning=tuning))


@cache
def pressed_run():
    return run_case(PRESSED)


@cache
def cutting_run():
    return run_case(CUTTING, snapshots_mm=(0.3, 2.0))


@cache
def brief_run():
    return run_case(BRIEF)


@cache
def quick_run():
    return run_case(QUICK)


def force_at(result, travel):
    return np.interp(travel, result.displacement_mm, result.force_N)


def work(result, name):
    return result.curve[f"work_{name}_mJ"]


def blade_work(result):
    """Work of the blade by the trapezoidal rule, mJ."""
    d, F = result.displacement_mm, result.force_N
    return np.concatenate([[0.0], np.cumsum(np.diff(d) * (F[1:] + F[:-1]) / 2)])


def seen_by_blade(face, p, travel):
    """Gap (m,) and its gradient (2, m) at a face's points. Beyond the mid-plane the gap goes on linearly."""
    x, y = face["x"][:, 0], face["x"][:, 1] - (p.height + p.tip - travel)
    over = np.minimum(x, 0)
    g, n, H = registry()["contact"].distance(x - over, y + p.tip, p)
    n[1] += over * H[0, 1]
    return g + over * n[0], n
