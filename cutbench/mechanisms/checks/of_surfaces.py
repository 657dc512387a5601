"""What every law of blade, skin, support and rig must satisfy."""

from __future__ import annotations

import numpy as np

from cutbench.mechanisms.base import STEP, Tool
from cutbench.mechanisms.checks.base import ROUNDING, check, close
from cutbench.mechanisms.checks.trial import (
    NEW_UNITS,
    PRESSURE,
    WAY,
    N,
    Trial,
    factors,
    in_new_units,
    of_surfaces,
    points,
    recorded,
    rng,
    sliding,
)


@check("blade")
def strength_is_not_negative(t: Trial) -> None:
    """Shear strengths are finite and never negative."""
    value = t.strength(PRESSURE)
    assert np.shape(value) == (N,), f"a strength a point, {N} here: the shape is {np.shape(value)}"
    assert np.isfinite(value).all() and value.min() >= 0, f"a strength is {value.min():.2g} MPa"
    assert isinstance(t.law, Tool) or value.max() > 0, "the strength is 0 at all pressures"


@check("blade")
def strength_differentiates(t: Trial) -> None:
    """A complex step in the pressure gives the derivative of the strength."""
    t_N, h = PRESSURE[1:].min() + PRESSURE, 1e-6
    exact = np.imag(t.strength(t_N + 1j * STEP)) / STEP + np.zeros(N)
    central = (t.strength(t_N + h) - t.strength(t_N - h)) / (2 * h)
    close(exact, central, 1e-6, 1e-9, what="complex step and differences by the pressure")


@check("blade")
def strength_has_its_dimension(t: Trial) -> None:
    """Strengths change with the units as stresses do."""
    p, at = t.numbers(), sliding(NEW_UNITS["[length]"], NEW_UNITS["[time]"])
    there = t.strength(in_new_units(PRESSURE, "MPa"), t.rewritten(p), at)
    close(
        there,
        in_new_units(t.strength(PRESSURE, p), "MPa"),
        1e-12,
        what="strengths, those from other units",
    )


@check("blade", applies=lambda law: isinstance(law, Tool))
def contact_keeps_out_and_never_pulls(t: Trial) -> None:
    """The blade's own law: the deeper, the harder, and nothing at a distance."""
    p, stiffness, h = t.numbers(), 3.0, 1e-8
    gap = np.linspace(-0.1, 0.1, 401) + 1e-5
    for multiplier in (0.0, 0.02):
        t_N, slope = t.law.pressure(gap, multiplier, stiffness, p)
        assert t_N.min() >= 0, "a contact pressure is below 0: the blade pulls"
        falls = slope.max() <= 0 and np.all(np.diff(t_N) <= 0)
        assert falls, "the pressure grows as the gap opens"
        assert t_N[-1] == 0, "there is a pressure far from the blade"
        bracket = np.maximum(multiplier - stiffness * gap, 0)
        near = np.abs(t_N - bracket).max() <= 0.005 * stiffness * p.thickness
        assert near, "the pressure is not ⟨λ − ε g⟩, but for a rounded corner"
        up, down = (t.law.pressure(gap + s * h, multiplier, stiffness, p)[0] for s in (1, -1))
        close(slope, (up - down) / (2 * h), 1e-5, what="the pressure's slope and its differences")
        probe = t.law.pressure(gap + 1j * STEP, multiplier, stiffness, p)[0]
        close(probe.imag / STEP, slope, 1e-13, what="the pressure's slope and its complex step")


@check("blade", applies=lambda law: isinstance(law, Tool))
def tool_is_a_profile(t: Trial) -> None:
    """The blade's own law: signed distance to its outline, with both derivatives, in any units."""
    p, law, r = t.numbers(), t.law, rng()
    radius, (left, right, _) = law.edge_radius(p), law.extent(p)
    outer = np.stack([r.uniform(1.5 * left, 1.5 * right, 400), r.uniform(-0.5, 1.3, 400) * law.height(p)])
    apex = radius * np.stack([r.uniform(-1, 1, 100), r.uniform(-1, 0.2, 100)])
    x, y = np.hstack([outer, apex])
    near = law.distance(x, y, p)[0] > -0.1 * radius
    x, y = x[near], y[near]
    g, n, H = law.distance(x, y, p)
    off = np.abs(np.sqrt(g**2) - _to_line(law.outline(p), law.band, x, y)).max()
    assert off < 2e-3 * p.thickness, f"distance() is off the distance to outline() by {off:.2g} mm"
    close((n**2).sum(axis=0), 1.0, 1e-12, what="the square of distance()'s gradient, and 1")
    turn = np.einsum("ijn,jn->in", H, n)
    close(turn, 0.0, 0, 1e-9 / radius, what="distance()'s second derivative along its gradient, and 0")
    for j, (dx, dy) in enumerate([(1j * STEP, 0), (0, 1j * STEP)]):
        along, turned, _ = law.distance(x + dx, y + dy, p)
        close(along.imag / STEP, n[j], 1e-11, what=f"distance()'s gradient {j} and its complex step")
        close(turned.imag / STEP, H[:, j], 1e-8, what=f"distance()'s second derivative {j}, complex step")
    h = 1e-6 * radius
    for j, (dx, dy) in enumerate([(h, 0), (0, h)]):
        up, down = law.distance(x + dx, y + dy, p)[0], law.distance(x - dx, y - dy, p)[0]
        close((up - down) / (2 * h), n[j], 1e-5, what=f"distance()'s gradient {j} and its differences")
    origin = law.distance(np.zeros(1), np.zeros(1), p)
    close(origin[0], 0, 0, 1e-12 * p.thickness, what="distance() at the origin, where the apex is, and 0")
    close(origin[1][:, 0], [0, -1], 1e-12, what="distance()'s gradient at the apex and straight down")
    close(origin[2][0, 0], 1 / radius, 1e-9, what="the curvature at the apex and 1/edge_radius()")
    if law.alike(p):
        mirrored, flip = law.distance(-x, y, p), np.array([[-1.0], [1.0]])
        same = np.array_equal(mirrored[0], g) and np.array_equal(mirrored[1], flip * n)
        assert same, "alike() says that both flanks are, and distance() that they are not"
    L = NEW_UNITS["[length]"]
    there = law.distance(x * L, y * L, t.rewritten(p))
    for value, factor, here in zip(there, (1 / L, 1, L), (g, n, H), strict=True):
        close(value * factor, here, 1e-9, what="distances, and those from other units")


def _to_line(line: np.ndarray, band: bool, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Distance (N,) of points to a line (n, 2) that goes on upwards from both ends, if it has a band."""
    if band:
        top = line[[0, -1]]
        top[:, 1] += 10 * np.ptp(line)
        line = np.vstack([top[:1], line, top[1:]])
    a, way = line[:-1], np.diff(line, axis=0)
    off = np.stack([x, y])[:, :, None] - a.T[:, None]
    part = np.clip(np.einsum("ink,ki->nk", off, way) / (way**2).sum(axis=1), 0, 1)
    return np.hypot(*(off - part * way.T[:, None])).min(axis=1)


@check("skin")
def skin_scales(t: Trial) -> None:
    """Factors are positive, 1 where the skin is off, and have no unit."""
    p, at = t.numbers(), points()
    off = {q.name: q.off_value for q in t.law.parameters if q.off is not None}
    assert factors([t.law], p).min() > 0, "a factor is 0 or below"
    close(factors([t.law], t.numbers(**off)), np.ones((2, N)), ROUNDING, what="its factors where off, and 1")
    at.X, at.depth = at.X * NEW_UNITS["[length]"], at.depth * NEW_UNITS["[length]"]
    there = factors([t.law], t.rewritten(p), at)
    close(there, factors([t.law], p), 1e-12, what="factors, and those from other units")


@check("skin")
def surfaces_have_it(t: Trial) -> None:
    """Tension and stiffnesses are not negative, 0 where off, and have their units and their
    surfaces."""
    p, off = t.numbers(), {q.name: q.off_value for q in t.law.parameters if q.off is not None}
    here, there = of_surfaces([t.law], p), of_surfaces([t.law], t.rewritten(p))
    assert here.min() >= 0, "a tension or stiffness is below 0"
    assert not off or not of_surfaces([t.law], t.numbers(**off)).any(), "off there is a tension or stiffness"
    changed = [in_new_units(x, unit) for x, unit in zip(here, ("N/mm", "N mm", "N mm"), strict=True)]
    close(there, changed, 1e-12, what="tension and stiffnesses, and those from other units")
    assert set(t.law.surfaces) <= {"top", "cut"}, "surfaces are 'top' and 'cut'"
    assert bool(t.law.surfaces) == bool(here.any()), (
        "it names surfaces and has tension or stiffness, or neither"
    )


@check("rig")
def rig_records(t: Trial) -> None:
    """Off it records what happened, and the same in other units."""
    p = t.numbers()
    off = recorded([t.law], t.numbers(**t.switches()))
    close(off, [WAY, np.sin(WAY)], ROUNDING, what="what it records where it is off, and what happened")
    L, T, F = NEW_UNITS["[length]"], NEW_UNITS["[time]"], in_new_units(1.0, "N")
    here, there = recorded([t.law], p), recorded([t.law], t.rewritten(p), L, T, F)
    close(there[0], here[0] * L, 1e-12, what="recorded travels, and those from other units")
    close(there[1], here[1] * F, 1e-12, what="recorded forces, and those from other units")


@check("support")
def support_gives(t: Trial) -> None:
    """Its compliance is not negative, and changes with the units as a length per stress does."""
    p = t.numbers()
    here, there = t.law.compliance(p), t.law.compliance(t.rewritten(p))
    assert here >= 0, "the compliance is below 0"
    same = abs(there - in_new_units(here, "mm/MPa")) <= 1e-12 * abs(there)
    assert same, "the compliance does not change with the units as mm/MPa does"
