"""The blade's outline: gap, normal and curvature against brute force and differences."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cutbench.mechanisms import registry
from cutbench.mechanisms.base import STEP

CONTACT = registry()["contact"]


def distance(x, y, a, b):
    """From the centre of an ellipse with the half axes a and b."""
    return CONTACT.distance(x, y + b, SimpleNamespace(thickness=2 * a, tip=b))


def ellipse(x, y, a, b):
    return CONTACT.number(x, y + b, SimpleNamespace(thickness=2 * a, tip=b))


GAPS = {"distance": distance, "ellipse": ellipse}

PAPER = (0.35, 1.05)
BLADES = [PAPER, (0.35, 0.35), (0.35, 0.2), (0.35, 3.5), (1.0, 0.4)]
blades = pytest.mark.parametrize("a, b", BLADES)

half_thickness = st.floats(0.05, 2.0)
slenderness = st.floats(0.4, 10.0)
place = st.tuples(st.floats(-4, 4), st.floats(-2, 2))  # in units of a and b


def one(x: float) -> np.ndarray:
    return np.array([x])


def outline_distance(x: float, y: float, a: float, b: float) -> float:
    """Unsigned distance to the outline: a dense sampling of the ellipse, refined where it is nearest."""
    lo, hi = -np.pi, 0.0
    for _ in range(10):
        t = np.linspace(lo, hi, 401)
        d = np.hypot(x - a * np.cos(t), y - b * np.sin(t))
        i = int(d.argmin())
        lo, hi = t[max(i - 1, 0)], t[min(i + 1, t.size - 1)]
    wall = np.hypot(abs(x) - a, min(y, 0.0))
    return min(float(d.min()), float(wall))


def inside(x: float, y: float, a: float, b: float) -> bool:
    return abs(x) < a if y >= 0 else (x / a) ** 2 + (y / b) ** 2 < 1


def cloud(a: float, b: float, n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Points around the outline, inside no deeper than a third of the sharpest radius of curvature."""
    r = np.random.default_rng(5)
    x, y = r.uniform(-4 * a, 4 * a, n), r.uniform(-2 * b, b, n)
    g = distance(x, y, a, b)[0]
    # Both sides of the band's edge are kept; the points on it are not differentiable twice.
    keep = (g > -min(a * a / b, b * b / a) / 3) & (np.abs(y) > 1e-3)
    return x[keep], y[keep]


@settings(max_examples=80, deadline=None)
@given(a=half_thickness, ratio=slenderness, at=place)
def test_distance_against_the_sampled_outline(a, ratio, at):
    b = ratio * a
    x, y = at[0] * a, at[1] * b
    within = inside(x, y, a, b)
    # The inside of a blunt blade above its tip is nearer to the tip than to the band, which the band's
    # gap leaves out.
    assume(not within or y < -1e-9 or b >= a)
    expected = outline_distance(x, y, a, b) * (-1 if within else 1)
    assert distance(one(x), one(y), a, b)[0][0] == pytest.approx(expected, abs=2e-6 * max(a, b))


@pytest.mark.parametrize("x", [0.0, 1e-12, 1e-6])
@pytest.mark.parametrize("depth", [0.02, 0.1, 0.12, 0.5, 0.95, 1.05 - 1e-9])
def test_a_point_of_the_cut_plane_deep_inside_is_driven_to_the_side(x, depth):
    """The cut plane is x = 0: near the tip it is driven down, farther in to the nearer flank."""
    a, b = PAPER
    y = depth - b
    g, n, H = distance(one(x), one(y), a, b)
    assert g[0] == pytest.approx(-outline_distance(x, y, a, b), abs=2e-6)
    assert np.isfinite(H).all() and np.hypot(*n[:, 0]) == pytest.approx(1, rel=1e-12)
    if depth > a * a / b + 1e-3:
        assert n[0, 0] > 0
    else:
        assert n[1, 0] == pytest.approx(-1, abs=1e-4)


def test_the_distance_is_exact_where_the_foot_is_unique():
    a, b = PAPER
    r = np.random.default_rng(2)
    for x, y in zip(r.uniform(0.01, 1, 60), r.uniform(-2, 1, 60), strict=True):
        expected = outline_distance(x, y, a, b) * (-1 if inside(x, y, a, b) else 1)
        assert distance(one(x), one(y), a, b)[0][0] == pytest.approx(expected, abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(a=half_thickness, ratio=slenderness, at=place)
def test_both_gaps_agree_on_inside_and_outside(a, ratio, at):
    b = ratio * a
    x, y = one(at[0] * a), one(at[1] * b)
    d, e = distance(x, y, a, b)[0][0], ellipse(x, y, a, b)[0][0]
    assume(abs(e) > 1e-9)
    assert np.sign(d) == np.sign(e)


@pytest.mark.parametrize("kind", GAPS)
@settings(max_examples=60, deadline=None)
@given(a=half_thickness, ratio=slenderness, at=place)
def test_left_mirrors_right(kind, a, ratio, at):
    b = ratio * a
    x, y = one(at[0] * a), one(at[1] * b)
    assume(abs(x[0]) > 1e-6 * a)  # the normal jumps where both sides are equally near
    g, n, H = GAPS[kind](x, y, a, b)
    m, k, L = GAPS[kind](-x, y, a, b)
    flip = np.array([[-1.0], [1.0]])
    np.testing.assert_allclose(m, g, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(k, flip * n, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(L, flip[:, None] * flip[None] * H, rtol=1e-9, atol=1e-12)


@blades
def test_the_normal_has_length_one(a, b):
    n = distance(*cloud(a, b), a, b)[1]
    np.testing.assert_allclose(np.hypot(*n), 1, rtol=1e-14)


@blades
def test_the_second_derivative_leaves_the_normal_alone(a, b):
    """|∇g| = 1 everywhere, so H n = 0."""
    _, n, H = distance(*cloud(a, b), a, b)
    np.testing.assert_allclose(np.einsum("ijn,jn->in", H, n), 0, atol=1e-12 * (1 + np.abs(H).max()))


@blades
@pytest.mark.parametrize("kind", GAPS)
def test_derivatives_against_differences(kind, a, b):
    gap, (x, y), h = GAPS[kind], cloud(a, b), 1e-6 * min(a, b)
    _, n, H = gap(x, y, a, b)
    for j, (dx, dy) in enumerate([(h, 0.0), (0.0, h)]):
        up, down = gap(x + dx, y + dy, a, b), gap(x - dx, y - dy, a, b)
        np.testing.assert_allclose(n[j], (up[0] - down[0]) / (2 * h), rtol=0, atol=1e-7 * np.abs(n).max())
        np.testing.assert_allclose(H[:, j], (up[1] - down[1]) / (2 * h), rtol=0, atol=1e-6 * np.abs(H).max())


@blades
@pytest.mark.parametrize("kind", GAPS)
def test_a_complex_step_in_the_place_gives_the_normal_and_its_derivative(kind, a, b):
    gap, (x, y) = GAPS[kind], cloud(a, b)
    _, n, H = gap(x, y, a, b)
    for j, (dx, dy) in enumerate([(1j * STEP, 0), (0, 1j * STEP)]):
        g, m, _ = gap(x + dx, y + dy, a, b)
        np.testing.assert_allclose(g.imag / STEP, n[j], rtol=0, atol=1e-12 * np.abs(n).max())
        np.testing.assert_allclose(m.imag / STEP, H[:, j], rtol=0, atol=1e-10 * np.abs(H).max())


@blades
@pytest.mark.parametrize("kind", GAPS)
@pytest.mark.parametrize("which", [0, 1], ids=["a", "b"])
def test_a_complex_step_in_the_blade_gives_its_sensitivity(kind, which, a, b):
    gap, (x, y), h = GAPS[kind], cloud(a, b), 1e-6
    size = np.array([a, b])

    def at(change):
        moved = size.astype(np.result_type(change, float))
        moved[which] += change
        return gap(x, y, moved[0], moved[1])

    exact, up, down = at(1j * STEP), at(h), at(-h)
    assert np.abs(exact[0].imag).max() > 0
    for k in range(2):  # gap and normal
        central = (up[k] - down[k]) / (2 * h)
        np.testing.assert_allclose(
            exact[k].imag / STEP, central, rtol=0, atol=1e-5 * max(1.0, np.abs(central).max())
        )


@blades
@pytest.mark.parametrize("kind", GAPS)
def test_tip_and_band_join_smoothly(kind, a, b):
    # Inside a blunt blade the tip may be nearer than the band; outside and on the outline never.
    x = np.array([0.9 * a, a, 1.5 * a]) if b >= a else np.array([a, 1.5 * a])
    below, above = GAPS[kind](x, -1e-10 + 0 * x, a, b), GAPS[kind](x, 1e-10 + 0 * x, a, b)
    np.testing.assert_allclose(below[0], above[0], atol=1e-8)
    np.testing.assert_allclose(below[1], above[1], atol=1e-6)


def test_known_places():
    a, b = PAPER
    x, y = np.array([0.0, a, 1.0, 0.0]), np.array([-b, 0.0, 5.0, -2.0])
    g, n, _ = distance(x, y, a, b)
    np.testing.assert_allclose(g, [0, 0, 1 - a, 2 - b], atol=1e-14)
    np.testing.assert_allclose(n, [[0, 1, 1, 0], [-1, 0, 0, -1]], atol=1e-14)
    np.testing.assert_allclose(ellipse(x, y, a, b)[0], [0, 0, 1 / a**2 - 1, 4 / b**2 - 1], atol=1e-13)


def test_curvature_at_the_tip():
    a, b = PAPER
    H = distance(one(0.0), one(-b), a, b)[2][:, :, 0]
    np.testing.assert_allclose(H, [[b / a**2, 0], [0, 0]], atol=1e-12)
