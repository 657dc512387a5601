"""What a block costs before it is run, from the section of equal numerics, which costs little."""

from __future__ import annotations

import math

import numpy as np

from cutbench.base.progress import Pace, duration
from cutbench.case.case import Case
from cutbench.forms.base import Step
from cutbench.models3d.extruded import planes
from cutbench.run.remeshing import RemeshedMarch
from cutbench.run.result import Result
from cutbench.solver.linear import SingularMatrix
from cutbench.solver.problem import Timer

#: An iteration is timed where the unknowns are moved by so many thicknesses, in waves of so many of them.
_MOVED, _WAVES = 3 / 7000, 100.0


def expected_seconds(block: Case, like: Result) -> float:
    """About how long ``block`` takes: the time of the section of equal numerics, part by part as much longer
    as the part is in the block. nan where the section did not say."""
    built = RemeshedMarch(block).built  # the mesh that it begins on
    problem = built.problem
    u, apex = np.zeros(problem.ndof), built.march.centre0
    step = Step(built.march.rules.first / built.march.speed, u, apex, apex)
    states = problem.touched(problem.start())
    # First what is compiled or analysed once, and a factorization to keep; then an iteration as most are, a
    # little further on.
    for way_mm in (0.0, _MOVED * block.unit_mm):
        problem.timer = timer = Timer()
        moved = u + way_mm * np.sin(np.arange(u.size) / _WAVES)
        state = problem.evaluate(moved, states, step)
        try:
            problem.factorize(state.data)
            problem.back_substitute(state.residual)
        except SingularMatrix:
            return math.nan
        problem.evaluate(moved * (1 + 1e-6), states, step)
    total = 0.0
    for part, seconds in timer.seconds.items():
        calls, own = like.counts.get(f"{part}_calls", 0), like.timings.get(part, 0.0)
        if calls and own:
            total += (own + like.timings.get(f"window_{part}", 0.0)) * seconds * calls / own
    return total or math.nan


def pace_of(block: Case, like: Result) -> Pace:
    """How fast ``block`` goes on: its steps are spread over the travel as those of the section are, few until
    the cut begins and many behind."""
    way = like.curve["time_s"] * block.p.speed
    steps = np.arange(way.size, dtype=float)
    beyond = steps[-1] / max(float(way[-1]), 1e-300)

    def effort(mm: float) -> float:
        return float(np.interp(mm, way, steps)) + beyond * max(mm - float(way[-1]), 0.0)

    return Pace(effort, expected_seconds(block, like))


def cost_sentence(name: str, seconds: float) -> str:
    """``name`` and about how long it takes."""
    return f"{name}: {f'about {duration(seconds)}' if math.isfinite(seconds) else 'its cost is not known'}"


def layer_zones(block: Case) -> float:
    """How many of its cohesive zones the thickest layer of a block is thick; nan where it has no layers."""
    n = block.numerics
    if not n.layers:
        return math.nan
    thickest = float(np.diff(planes(block.values["length"] / 2, n.layers, n.layer_ratio)).max())
    return thickest / float(block.model.cohesive_zone(block.p))


def layers_sentence(block: Case) -> str:
    """How far apart the planes of a block are beside its cohesive zone, and what that means; empty where it
    has no layers. In a small block falls are right to 0.004 where planes are one zone apart."""
    zones, zone = layer_zones(block), block.model.cohesive_zone(block.p)
    if math.isnan(zones):
        return ""
    means = "that resolves it"
    if zones > 1:
        means = "planes give way one by one, and the force falls by too little"
    return f"planes up to {zones * zone:.2g} mm apart, {zones:.2g} cohesive zones: {means}"
