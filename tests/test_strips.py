"""The cut plane in strips: in each the cut has a front of its own, which steps and predictions go by."""

from __future__ import annotations

import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.forms.strips import Strips
from cutbench.run.build import build

SMALL = {
    "width": "6 mm", "height": "6 mm", "length": "8 mm", "depth": "0.3 mm", "h": "0.6 mm", "corner": 0.25,
    "layers": 2,
}  # fmt: skip


@pytest.fixture(scope="module")
def block():
    return build(load_case("gelatin", SMALL, dim=3))


def uneven(built, depth_at):
    """States in which the cut is ``depth_at(z)`` mm deep at z."""
    states = built.problem.start()
    X = built.form("cohesion").faces.X
    damage = (built.case.p.height - X[1] < depth_at(X[2])).astype(float).ravel()
    return states | {"cohesion": {**states["cohesion"], "damage": damage}}


def test_a_section_is_one_strip():
    built = build(load_case("gelatin", {key: SMALL[key] for key in ("width", "height", "depth", "h")}))
    strips = Strips(built.space, built.form("cohesion").faces)
    assert strips.z.tolist() == [0.0]
    assert strips.width == pytest.approx([1.0])
    assert not strips.of(built.space.X).any()


def test_a_block_has_a_strip_in_each_plane(block):
    strips = Strips(block.space, block.form("cohesion").faces)
    np.testing.assert_allclose(strips.z, block.space.z, atol=1e-8)
    np.testing.assert_allclose(strips.z[strips.of(block.space.X)], block.space.X[2], atol=1e-8)
    # A quarter block's planes stand for half of its length.
    assert strips.width.sum() == pytest.approx(block.case.p.length / 2)


@pytest.mark.parametrize("count", [2, 5])
def test_strips_of_tetrahedra_are_equally_wide(count):
    changes = {key: SMALL[key] for key in ("width", "height", "length", "depth")}
    built = build(load_case("gelatin", {"numerics": "tetrahedra", **changes, "h": "1.5 mm"}, dim=3))
    strips = Strips(built.space, built.form("cohesion").faces, count=count)
    half = built.case.p.length / 2
    assert strips.z == pytest.approx((np.arange(count) + 0.5) * half / count)
    assert strips.width.sum() == pytest.approx(half)


def test_each_strip_has_its_length_and_its_front(block):
    faces, height = block.form("cohesion").faces, block.case.p.height
    strips = Strips(block.space, faces)
    deep = 1.0 + strips.z / 4
    states = uneven(block, lambda z: 1.0 + z / 4)
    lengths = strips.lengths(block.form("cohesion").cut_area(states["cohesion"]))
    tall = np.ptp(block.space.X[1, faces.nodes], axis=0).max()
    assert lengths == pytest.approx(deep, abs=tall)
    lowest = strips.lowest(faces.X[1].ravel(), states["cohesion"]["damage"] > 0.5, height)
    assert height - lowest == pytest.approx(deep, abs=tall)
    none = np.zeros(faces.w.size, bool)
    assert (strips.lowest(faces.X[1].ravel(), none, height) == height).all()


def test_half_of_the_blade_has_at_most_so_much(block):
    strips = Strips(block.space, block.form("cohesion").faces)
    end = strips.z[-1]
    assert strips.half(2.0 + 0 * strips.z, end) == pytest.approx(2.0)
    # Half of it lies on either side of half of the way to its end.
    for values in (1.0 + strips.z / 4, 2.0 - strips.z / 4):
        assert strips.half(values, end) == pytest.approx(np.interp(end / 2, strips.z, values), abs=0.1)
    # A corner alone does not make half of the blade, however early it is.
    assert strips.half(np.where(strips.z == end, 0.0, 3.0), end) == pytest.approx(3.0)
    # Where the blade does not reach, nothing is asked.
    assert strips.half(np.where(strips.z > 1.5, np.nan, 3.0), 1.5) == pytest.approx(3.0)
    assert np.isnan(strips.half(np.where(strips.z > 1.5, np.nan, 3.0), end))


def test_the_window_is_around_the_front_of_each_plane(block):
    """Of fronts that lie farther apart than a window is tall, none is left out."""
    tall = np.median(np.ptp(block.space.X[1, block.form("cohesion").faces.nodes], axis=0))
    fronts = {z: 0.5 + 4.0 * k / (block.space.z.size - 1) for k, z in enumerate(block.space.z)}
    states = uneven(block, np.vectorize(lambda z: fronts[min(fronts, key=lambda at: abs(at - z))]))
    part = block.march.window.around(states)
    X = block.space.X[:, part.inside]
    for z, depth in fronts.items():
        there = block.case.p.height - X[1, np.abs(X[2] - z) < 1e-6]
        assert there.min() < depth < there.max()
        assert np.ptp(there) < 3 * max(block.case.p.thickness, 3 * tall)


def test_a_step_is_as_short_as_its_place_needs(block):
    """Damage may grow by more where a plane is cut already than where one is not."""
    edge = block.space.z[-1]
    states = uneven(block, lambda z: np.where(z > edge - 1e-6, 1.0, 0.0))
    whole = block.march.whole(states)
    z = block.form("cohesion").faces.X[2].ravel()
    np.testing.assert_array_equal(whole, z < edge - 1e-6)
