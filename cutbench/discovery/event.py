"""What happened once: in one cut of one specimen, behind its transition, no longer than the blade is thick.

There a piece gives way at once, or the cut runs into a bubble. No cause can be told from it, and none is
needed: a cause works all along a cut. Where such a stretch holds most of what is wrong, its readings count
for no more than how wrong they are, as if their noise were so large; what is left is asked what causes it.
The same test, repeated, tells whether it returns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats
from scipy.linalg import cholesky, solve_triangular

from cutbench.data.discrepancy import allowing
from cutbench.data.experiment import Experiment
from cutbench.data.jags import behind
from cutbench.discovery.outcome import CHANCE
from cutbench.discovery.point import Point
from cutbench.discovery.score import Freed

#: What is more than this part of χ² beyond its degrees of freedom is most of what is wrong.
MOST = 0.5


def events(point: Point) -> tuple[Point, tuple[str, ...]]:
    """``point`` without what happened once in a cut, and what that was, in sentences."""
    found = _found(point)
    if found is None:
        return point, ()
    e, inside = found
    grid, size = point.inverse.grids[e.id], float(np.abs(point.residual[e.id][inside]).max())
    noise = np.where(inside, np.maximum(grid.reading, size), grid.reading)
    grids = {**point.inverse.grids, e.id: replace(grid, reading=noise)}
    first, last = grid.x[inside][[0, -1]]
    said = (
        f"'{e.id}': from {first:.3g} to {last:.3g} mm the force is off by up to {size:.2g} N, most of all"
        " that is wrong, and nowhere else like that. It happened once in one specimen, and no cause is"
        " looked for in it: repeat the test to see whether it returns."
    )
    w = allowing(point.w.reading(grids), point.residual, point.J_inside)
    return replace(point, inverse=point.inverse.weighing(grids), w=w), (said,)


def _found(point: Point) -> tuple[Experiment, np.ndarray] | None:
    """A cut and its readings (m,) that hold most of χ² beyond what chance makes; None where none do, or
    there is their like elsewhere. In each cut with what values of its own would take up: what a cause changes
    from cut to cut is not to hide what happened in one of them, nor to be taken for it."""
    excess, tried = 0.0, []
    for e in point.campaign.train:
        grid = point.inverse.grids[e.id]
        chi2 = _chi2(point, e.id, np.ones(grid.x.size, dtype=bool))
        # A cut that is described better than chance does makes no other less wrong.
        excess += max(chi2 - (grid.x.size - point.q.size), 0.0)
        if e.kind != "cut" or not e.monotone:
            continue
        thick = point.inverse.case(e, point.q).values.get("thickness", 0.0)
        # What begins with the transition, measured or computed, is the transition's.
        begins = grid.x[behind(grid.mean) & behind(point.y[e.id])][1:]
        stretches = [(grid.x >= x) & (grid.x <= x + thick) for x in begins]
        tried += [(chi2 - _chi2(point, e.id, ~inside), e, inside) for inside in stretches]
    if not tried:
        return None
    fall, e, inside = max(tried, key=lambda each: each[0])
    others = [f for f, at, there in tried if at is not e or not (there & inside).any()]
    surely = len(tried) * stats.chi2.sf(fall, inside.sum()) < CHANCE
    once = point.inverse.grids[e.id].repetitions == 1 and all(other < MOST * fall for other in others)
    if not (surely and once) or fall <= MOST * excess:
        return None
    return e, inside


def _chi2(point: Point, id: str, kept: np.ndarray) -> float:
    """χ² in the noise alone of the readings of one test that are ``kept`` (m,), freed of what the parameters
    take up."""
    covariance = point.w.noise.tests[id].total[np.ix_(kept, kept)]
    both = np.column_stack([point.J_inside[id], point.residual[id]])[kept]
    white = solve_triangular(cholesky(covariance, lower=True), both, lower=True)
    left = Freed(white[:, :-1]).of(white[:, -1])
    return float(left @ left)
