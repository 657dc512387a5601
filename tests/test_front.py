"""The front along the blade: where it starts, how fast it runs, the effect of the ends."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.models3d.block import block
from cutbench.models3d.mesh import quarter
from cutbench.run.build import build
from cutbench.run.front import FRONT, Front, end_effect

#: A block so small that a run of it takes seconds.
SMALL = {"width": "6 mm", "height": "6 mm", "length": "8 mm", "element": "P1", "numerics": "tetrahedra"}


@pytest.fixture(scope="module")
def built():
    case = load_case("gelatin", {**SMALL, "depth": "0.1 mm"}, dim=3)
    return build(case, block(quarter(6.0, 6.0, 8.0, 1.0)))


def made_up(built, travel, damage):
    """A step with displacements at rest and this damage on the cut plane."""
    states = built.problem.start()
    states["cohesion"]["damage"] = damage
    return SimpleNamespace(travel=travel, u=np.zeros(built.problem.ndof), states=states, between=False)


def test_front_finds_where_the_cut_starts_and_how_fast_it_runs(built):
    front = Front(built, strips=4)
    faces = built.form("cohesion").faces
    z, y = np.abs(faces.X[2]).ravel(), faces.X[1].ravel()
    # The front lies at a depth of travel − 1 − z/2: it runs sideways by 2 mm per mm of blade travel.
    for travel in np.linspace(0, 4.5, 451):
        front.add(made_up(built, travel, (6.0 - y < travel - 1 - z / 2).astype(float)))
    found = front.measures()
    assert front.z == pytest.approx([0.5, 1.5, 2.5, 3.5])
    assert found["front_start_z_mm"] == 0.5
    assert found["front_start_mm"] == found["front_centre_mm"]
    # Quadrature points are discrete: the depth that they see is that of an element at the most off.
    assert found["front_centre_mm"] == pytest.approx(1 + front.z[0] / 2 + 0.1, abs=0.2)
    assert found["front_edge_mm"] == pytest.approx(1 + front.z[-1] / 2 + 0.1, abs=0.2)
    assert found["front_lateral_speed"] == pytest.approx(2.0, rel=0.1)
    assert front.lengths(made_up(built, 9.0, np.ones(y.size)).states) == pytest.approx([6.0] * 4)
    assert found.keys() == FRONT.keys()


def test_a_front_that_leaves_ligaments_says_along_how_much_of_the_blade(built):
    faces = built.form("cohesion").faces
    z, shallow = np.abs(faces.X[2]).ravel(), 6.0 - faces.X[1].ravel() < 2.0
    # The third of four strips is cut first, then the fourth, then the middle.
    parts = {
        "third": (z > 2) & (z < 3),
        "and fourth": z > 2,
        "and middle": (z > 2) | (z < 1),
        "all": z >= 0,
    }
    front, found = Front(built, strips=4), {}
    for travel, (name, part) in enumerate(parts.items(), 1):
        front.add(made_up(built, float(travel), (shallow & part).astype(float)))
        found[name] = front.measures()["front_bridged"]
    assert found == pytest.approx({"third": 0.5, "and fourth": 0.5, "and middle": 0.25, "all": 0.0}, abs=0.03)


def test_stress_is_read_in_the_process_zone_only(built):
    front = Front(built, strips=2)
    faces = built.form("cohesion").faces
    z, y = np.abs(faces.X[2]).ravel(), faces.X[1].ravel()
    rng = np.random.default_rng(1)
    step = made_up(built, 1.0, np.where(z < 2, np.where(y > 5, 1.0, 0.5), 0.0))
    step.u[:] = 1e-3 * rng.standard_normal(step.u.size)
    front.add(step)
    found = front.measures()
    assert found["front_von_mises_start_MPa"] > 0
    assert np.isnan(found["front_von_mises_running_MPa"])
    whole = Front(built, strips=2)
    whole.add(replace_damage(step, np.where(z < 2, 1.0, 0.0)))
    assert np.isnan(whole.measures()["front_von_mises_start_MPa"])  # no process zone, no front


def replace_damage(step, damage):
    states = {**step.states, "cohesion": {**step.states["cohesion"], "damage": damage}}
    return SimpleNamespace(travel=step.travel, u=step.u, states=states, between=False)


def test_an_uncut_block_has_no_front(built):
    front = Front(built)
    front.add(made_up(built, 1.0, np.zeros(built.form("cohesion").faces.w.size)))
    assert all(np.isnan(value) for value in front.measures().values())


def test_end_effect_is_the_ratio_of_the_two_runs():
    found = end_effect({"peak_N": 1.0, "steady_N": 2.0}, {"peak_N": 2.0, "steady_N": float("nan")})
    assert found["end_effect_peak"] == 0.5
    assert np.isnan(found["end_effect_steady"])
    assert set(found) == {f"end_effect_{stage}" for stage in ("peak", "max", "steady", "slope", "onset")}
