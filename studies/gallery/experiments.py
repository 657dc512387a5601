"""The experiments, one by one: what is published, which runs answer it, and what those say.

A finding is *verified* where the number had to come out, *predicted* where nothing was fitted to it, and
*fitted* where something was; where what is computed does not hold, it is *missed*. An *open* one has no
published number to be held to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from studies.gallery.runs import Run, exponent, measured_onset, onset, onset_force, slope, steady, wires

#: What results, by the names of an experiment's runs, say.
Say = Callable[[Mapping[Any, Any]], float]


@dataclass(frozen=True)
class Finding:
    """``value`` of the results; it holds between ``low`` and ``high``."""

    what: str
    kind: str
    published: str
    value: Say
    low: float
    high: float
    digits: int = 3


@dataclass(frozen=True)
class Experiment:
    """``folder`` of ``studies/published``; ``runs`` by what a finding calls them."""

    title: str
    folder: str
    runs: Mapping[Any, Run]
    findings: tuple[Finding, ...]


WIRES_MM = (0.25, 0.5, 1.0)
#: Friction of wires on gelatin, in proportion to the pressure and saturating.
PROPORTIONAL, SATURATES = (0.05, 0.1, 0.2), 0.3
RUBBED = wires("gelatin-wires", WIRES_MM, mu=SATURATES)
WIRES = {
    **{("no friction", d): run for d, run in wires("gelatin-wires", WIRES_MM).items()},
    **{("saturates", d): run.saturating() for d, run in RUBBED.items()},
    **{mu: wires("gelatin-wires", (0.5,), mu=mu)[0.5] for mu in PROPORTIONAL},
}


def line(name: str) -> Callable[[Mapping[Any, Any]], tuple[float, float]]:
    """Intercept and slope (1/mm) of F/(b G_c) over the diameter."""
    return lambda found: slope({d: steady(found[name, d]) for d in WIRES_MM})


def straight(found: Mapping[Any, Any]) -> float:
    """How far the middle of three wires is off the line through the others."""
    thin, middle, thick = (steady(found["saturates", d]) for d in WIRES_MM)
    part = (WIRES_MM[1] - WIRES_MM[0]) / (WIRES_MM[2] - WIRES_MM[0])
    return middle / (thin + part * (thick - thin))


def in_moduli(found: Mapping[Any, Any]) -> float:
    """The slope of F/b over the diameter, over G."""
    p = found["saturates", 0.5].case.p
    return line("saturates")(found)[1] * p.G_c / p.G


#: r E/G_c is 1 and 3.5; the blunter edge is steady sooner.
RAZORS = {**wires("razor-pdms", (0.2,), travel=14), **wires("razor-pdms", (0.7,))}

EDGES_MM = (0.025, 0.05, 0.1)
EDGES = {r: Run("blade-edges", {"edge_radius": f"{r} mm", "until": "transition"}) for r in EDGES_MM}

#: Their openings are 10 and 20 times δ_c: a finer wire does not spend the cohesion.
CHEESE = wires("cheddar-wires", (1.0, 2.0), G="50 kPa", g_Y=0.0)


def in_yield_stresses(found: Mapping[Any, Any]) -> float:
    """The slope of F/b over the diameter, over the stress at which cheese yields."""
    p = found[1.0].case.p
    return slope({d: steady(each) for d, each in found.items()})[1] * p.G_c / p.sigma_Y


SPEEDS = {v: wires("gelatin-speeds", (2.0,), travel=16, speed=f"{v} mm/s")[2.0] for v in (0.25, 2.0)}

#: Friction coefficients, in proportion to the pressure and saturating, and how deep blades go at most.
COULOMB = {"gelatin": (0.0, 0.01, 0.05, 0.3), "elastomer": (0.0, 0.3), "meat": (0.0, 0.05, 0.3)}
SATURATING = {"gelatin": (0.1, 0.3), "elastomer": (0.3,), "meat": (0.3,)}
DEPTH_MM = {"gelatin": 8.0, "elastomer": 4.0, "meat": 12.0}


def entering(material: str, mu: float, **changes) -> Run:
    """A wedge on the whole block, until its transition."""
    ends = {"depth": f"{DEPTH_MM[material]} mm", "until": "transition"}
    return Run(f"{material}_recalibrated", {"mu": mu, **ends, **changes})


ENTERING = {
    **{(m, "coulomb", mu): entering(m, mu) for m in COULOMB for mu in COULOMB[m]},
    **{(m, "saturating", mu): entering(m, mu).saturating() for m in SATURATING for mu in SATURATING[m]},
    ("gelatin", "a third", 0.3): entering("gelatin", 0.3).saturating(3),
    ("gelatin", "softly stuck", 0.05): entering("gelatin", 0.05, stick=11),
    ("gelatin", "weak", 0.3): entering("gelatin", 0.3, delta_c="0.2 mm"),
}  # fmt: skip


def begins(kind: str, material: str, *how: Any, what: str) -> Finding:
    """The onset of a blade that enters, held to the measured one."""
    value, error = measured_onset(material)
    published = f"{value:g} ± {error:g}"
    say = lambda found: onset(found[material, *how])  # noqa: E731
    return Finding(f"{material}, {what}: onset, mm", kind, published, say, value - error, value + error)


EXPERIMENTS = (
    Experiment("blades that enter (Moreno-Mateos & Steinmann 2026)", "", ENTERING, (
        begins("fitted", "gelatin", "coulomb", 0.0, what="no friction"),
        begins("predicted", "gelatin", "coulomb", 0.3, what="friction 0.3"),
        begins("predicted", "gelatin", "a third", 0.3, what="friction 0.3 that saturates at G/3"),
        begins("fitted", "elastomer", "coulomb", 0.3, what="friction 0.3"),
        begins("predicted", "elastomer", "saturating", 0.3, what="friction 0.3 that saturates at G"),
    )),
    Experiment("gelatin by wires (Forte et al. 2015)", "gelatin-wires", WIRES, (
        Finding("F/(b G_c) without friction at no diameter", "verified", "1, the intercept is G_c",
                lambda found: line("no friction")(found)[0], 0.97, 1.03),
        Finding("its slope without friction, 1/mm", "verified", "0: nothing else takes energy",
                lambda found: line("no friction")(found)[1], -0.05, 0.05, 2),
        Finding("F/b at 0.5 mm over a line from 0.25 to 1 mm, friction 0.3 that saturates at G", "predicted",
                "1: a straight line", straight, 0.95, 1.05),
        Finding("where that line begins, G_c", "predicted", "1",
                lambda found: line("saturates")(found)[0], 0.9, 1.1),
        Finding("its slope, G", "open", "(1 + μ) σ_y, of a σ_y that is not at hand", in_moduli,
                -math.inf, math.inf, 2),
    )),
    Experiment("edges without friction in PDMS (Zhang & Hutchens 2021)", "razor-pdms", RAZORS, tuple(
        Finding(f"cutting energy at r E/G_c = {sharp}, over that of a sharp edge", "verified",
                "1 ± 0.03", lambda found, d=d: steady(found[d]), 0.97, 1.03)
        for d, sharp in ((0.2, 1), (0.7, 3.5))
    )),
    Experiment("blades of different edges (McCarthy et al. 2007, 2010)", "blade-edges", EDGES, (
        Finding("depth of onset: exponent over the edge's radius", "predicted", "above 0: blunter, deeper",
                lambda found: exponent({r: onset(found[r]) for r in EDGES_MM}), 0.05, 2.0, 2),
        Finding("force of onset: exponent over the radius", "predicted", "1: in proportion",
                lambda found: exponent({r: onset_force(found[r]) for r in EDGES_MM}), 0.7, 1.3, 2),
    )),
    Experiment("cheddar by wires (Kamyab et al. 1998, Goh et al. 2005)", "cheddar-wires", CHEESE, (
        Finding("slope of F/b over d, over σ_Y, of a body that does not yield", "predicted",
                "1 to 1.4: (1 + μ)", in_yield_stresses, 1.0, 1.4, 2),
    )),
    Experiment("gelatin at several speeds (Oldfield et al. 2013)", "gelatin-speeds", SPEEDS, (
        Finding("force at 2 mm/s over that at 0.25 mm/s", "predicted", "more than double, of G_c",
                lambda found: steady(found[2.0]) / steady(found[0.25]), 2.0, 2.9),
    )),
)  # fmt: skip
