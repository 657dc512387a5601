"""The pure-shear strip with its cut running slowly: its stretch, and what is spent per length."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutbench.solver.newton import NoConvergence
from cutbench.solver.problem import Problem
from verification._common import nu_of, parameters, solve, step_at_rest
from verification._strip import (
    H,
    Strip,
    held_ahead,
    process_zone,
    pulled,
    stretch_for,
    strip,
)
from verification.base import Check, Reference

#: Pulled to this part of G_c; then the front is led on.
REST = 0.9
#: Elements on the way, way of the front and its last part, over which is measured, in process zones.
FINE, RUN, MEASURED = 1 / 5, 3.0, 1.5
#: Elements that the front is led on in a step.
STRIDE = 1
#: κ/G: nearly incompressible, by the mixed element.
BULK = 5000.0
#: λ_c of incompressible strips of 21 mm by the formula below, to four digits.
CRITICAL = {"gelatin": 1.138, "elastomer": 1.056, "meat": 1.148}


def compute() -> Iterator[Check]:
    for name, critical in CRITICAL.items():
        p = parameters(name, nu=nu_of(BULK))
        stretch, spent, released = running(p)
        yield Check(f"{name}: λ at which the cut runs", "1", critical, stretch, 1e-3)
        exact = stretch_for(p.G_c, p)
        what = f"{name}: the same less 1, where the plane ahead gives a little"
        yield Check(what, "1", exact - 1, stretch - 1, 5e-3, "energy balance")
        # Five quadratic elements to the process zone: they hold the front back by some tenths of a percent.
        # Ahead of the front the plane holds a little already; the solid gives the rest.
        left = p.G_c - held_ahead(exact, p)
        what = f"{name}: work of separation per length, by the ledger"
        yield Check(what, "J/m^2", 1e3 * left, 1e3 * spent, 2e-4)
        what = f"{name}: energy released per length, by the ledger"
        yield Check(what, "J/m^2", 1e3 * left, 1e3 * released, 1e-2)


def running(p) -> tuple[float, float, float]:
    """Stretch at the end, work of separation and energy released (mJ/mm²) per length of the front's way.

    The front is led: the opening at one node is held at δ_c and the stretch sought at which nothing
    pulls there. So each position is an equilibrium, though a strip held at its grips would run away.
    """
    zone = process_zone(p)
    body = strip(p, "P2P1", FINE * zone, (RUN + 1) * zone, viscosity=1e-6 * p.G)
    ((u, states),) = pulled(body, (REST,))
    stretch, ways, rows = stretch_for(REST * p.G_c, p), [], []
    for node in led(body, u, RUN * zone):
        old = u
        u, new, stretch, pull = equilibrium(body, u, states, stretch, node, p.delta_c / 2)
        work: dict[str, float] = {}
        for form in body.problem.forms:
            work |= form.work(u, p, states[form.name], new[form.name], step_at_rest(old))
        states = new
        work.pop("snap")  # the viscosity is there for Newton's method only
        spent = 2 * work.pop("smith_ferrante")
        given = pull * (u[body.grip[0]] - old[body.grip[0]])  # by the grips, as the stretch settles
        rows.append((spent, given - 2 * sum(work.values())))
        ways.append(body.front - float(body.space.X[1, node]))
    way = np.array(ways)
    first = np.flatnonzero(way <= way[-1] - MEASURED * zone)[-1]
    spent, released = np.array(rows)[first + 1 :].sum(axis=0) / (way[-1] - way[first])
    return stretch, float(spent), float(released)


def led(body: Strip, u: np.ndarray, run: float) -> np.ndarray:
    """Nodes ahead of the front, one after the other, that are not yet open to δ_c."""
    X = body.space.X
    nodes = np.intersect1d(body.space.nodes_on("ahead"), np.unique(body.space.mesh.facets))
    nodes = nodes[np.argsort(-X[1, nodes])]
    nodes = nodes[(2 * u[2 * nodes] < body.problem.p.delta_c) & (X[1, nodes] > body.front - run)]
    return nodes[::STRIDE]


def equilibrium(body: Strip, u, states: dict, stretch: float, node: int, opening: float):
    """Unknowns, states, stretch and force of both grips (N/mm): ``node`` moved to ``opening``, unforced."""
    fixed = np.append(body.problem.fixed, 2 * node)
    problem = Problem(body.problem.forms, body.problem.ndof, fixed, body.problem.p)
    step = step_at_rest(u)

    def led_to(u: np.ndarray, value: float, opening: float):
        """In parts as small as need be: all at once would turn elements inside out."""
        goal = np.array([(value - 1) * H / 2, opening])
        here = np.array([u[body.grip[0]], u[2 * node]])
        way, done, part = goal - here, 0.0, 1.0
        while done < 1:
            part = min(part, 1 - done)
            guess = u.copy()
            guess[body.grip], guess[2 * node] = here + (done + part) * way
            try:
                u, result = solve(problem, guess, states, step)
            except NoConvergence:
                part /= 2
                if part < 1e-3:
                    raise
                continue
            done += part
        return u, result

    u, result = led_to(u, stretch, opening)
    tried = [(stretch, float(result.residual[2 * node]))]
    value = stretch + 2e-3 * (stretch - 1)
    for _ in range(12):
        u, result = led_to(u, value, opening)
        tried.append((value, float(result.residual[2 * node])))
        (x, r), (y, s) = tried[-2:]
        if abs(s) < 1e-6 * result.scale:
            # The residual is that of one half; both pull on the grips alike.
            return u, result.states, value, 2 * float(result.residual[body.grip].sum())
        value = y - s * (y - x) / (s - r)
    raise ArithmeticError("no stretch leaves the front in equilibrium")


REFERENCE = Reference(
    "strip_running",
    "The cut of the pure-shear strip led on slowly: the stretch at which it runs, energy per length.",
    "W(λ_c) H = G_c (Rivlin and Thomas 1953): (λ_c − 1/λ_c)² = 2 G_c/(G H)",
    compute,
    laws=("neo_hookean", "smith_ferrante"),
    quick=False,
    seconds=60.0,
)
