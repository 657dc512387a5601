"""Wedges whose edge is small beside all else: they cut without crawling, and what they find is converged."""

from __future__ import annotations

import pytest

from cutbench.case.case import load_case
from cutbench.run.runner import run_case


def wedge(material, depth, **changes):
    case = load_case(material).set(with_="wedge", edge_radius="0.05 mm", depth=depth, **changes)
    result = run_case(case)
    assert result.outcome.done
    assert abs(result.measures["closure"]) < 0.012
    return result


@pytest.mark.slow
def test_a_blade_that_sticks_takes_no_more_steps_than_its_way_has_elements():
    """Points turn from sliding to sticking all along its flanks, and each was a step of its own."""
    result = wedge("elastomer", "2.2 mm")
    assert result.counts["steps"] < 130
    assert result.counts["iterations"] < 8 * result.counts["steps"]
    assert result.measures["onset_mm"] == pytest.approx(1.40, rel=0.02)


@pytest.mark.slow
def test_how_far_the_force_falls_is_the_same_in_finer_steps():
    """Where the front jumps, no step is fine enough for the growth of damage, and none is damped for it."""
    falls = []
    for damage_step in (0.7, 0.2):
        groups = {"cohesion": 30, "viscosity": 0.05}
        falls.append(wedge("gelatin", "5 mm", damage_step=damage_step, **groups).measures["drop_rel"])
    assert falls[0] > 0.4
    assert falls[1] == pytest.approx(falls[0], abs=0.03)
