"""The experiments, one by one: what is published, which runs answer it, and what those say.

A finding is *verified* where the number had to come out, *predicted* where nothing was fitted to it, and
*fitted* where something was; where what is computed does not hold, it is *missed*. An *open* one has no
published number to be held to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from studies.gallery.runs import Run, exponent, onset, onset_force, slope, steady, wires

#: Runs by name, with what ``Batch`` has made of them.
Runs = Mapping[object, Run]
Say = Callable[[Mapping], float]


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
    runs: Runs
    findings: tuple[Finding, ...]


WIRES_MM = (0.25, 0.5, 1.0)
#: The friction of wires on gelatin, and a pressure of saturation that is its modulus.
SATURATED = {"mu": 0.3, "with_": "coulomb_saturating", "inv_p_s": f"{1 / 5.02:.4g} 1/kPa"}
WIRES = {
    **{("no friction", d): run for d, run in wires("gelatin-wires", WIRES_MM).items()},
    **{("saturates", d): run for d, run in wires("gelatin-wires", WIRES_MM, **SATURATED).items()},
    **{mu: run for mu in (0.1, 0.2) for run in wires("gelatin-wires", (0.5,), mu=mu).values()},
}
#: G_c (N/mm) and G (MPa) of the wires' gelatin.
G_C, G = 1.1e-3, 5.02e-3


def per_toughness(name: str) -> Callable[[Mapping], tuple[float, float]]:
    """Intercept and slope of F/(b G_c) over the diameter in mm."""
    return lambda found: slope({d: steady(found[name, d]) / G_C for d in WIRES_MM})


EDGES_MM = (0.025, 0.05, 0.1)
EDGES = {r: Run("blade-edges", {"edge_radius": f"{r} mm", "until": "transition"}) for r in EDGES_MM}


def straight(found: Mapping) -> float:
    """How far the middle of three wires is off the line through the others."""
    thin, middle, thick = (steady(found["saturates", d]) for d in WIRES_MM)
    part = (WIRES_MM[1] - WIRES_MM[0]) / (WIRES_MM[2] - WIRES_MM[0])
    return middle / (thin + part * (thick - thin))


CHEESE_MM = (0.5, 1.0)
#: Stress at which cheese yields, MPa.
SIGMA_Y = 0.05
STIFF = {"G": "50 kPa", "g_Y": 0.0}
CHEESE = {
    **{("elastic", d): run for d, run in wires("cheddar-wires", CHEESE_MM, **STIFF).items()},
}


def cheese(name: str) -> Say:
    """The slope of F/b over the diameter, over the stress at which it yields."""
    return lambda found: slope({d: steady(found[name, d]) for n, d in found if n == name})[1] / SIGMA_Y


SPEEDS = {v: Run("gelatin-speeds", {"speed": f"{v} mm/s"}) for v in (0.25, 2.0)}

#: A blunter edge is steady sooner, in thicknesses.
RAZORS = {d: wires("razor-pdms", (d,), depth=f"{travel * d:g} mm")[d] for d, travel in ((0.2, 14), (0.7, 9))}

#: Friction coefficients, and friction that saturates at the pressure G, or a third of it.
COULOMB = {"gelatin": (0.0, 0.01, 0.05, 0.3), "elastomer": (0.0, 0.3), "meat": (0.0, 0.05, 0.3)}
SATURATING = {"gelatin": (0.1, 0.3), "elastomer": (0.3,), "meat": (0.3,)}
DEPTH_MM = {"gelatin": 8.0, "elastomer": 4.0, "meat": 12.0}
#: 1/G, 1/kPa.
PER_G = {"gelatin": 1 / 7.5, "elastomer": 1 / 120, "meat": 1 / 25}


def entering(material: str, mu: float, **changes) -> Run:
    ends = {"depth": f"{DEPTH_MM[material]} mm", "until": "transition"}
    return Run(f"{material}_recalibrated", {"mu": mu, **ends, **changes})


def saturating(material: str, mu: float, times: float = 1.0) -> Run:
    """Friction that saturates at the pressure G/``times``."""
    inverse = f"{times * PER_G[material]:.6g} 1/kPa"
    return entering(material, mu, with_="coulomb_saturating", inv_p_s=inverse)


ENTERING = {
    **{(m, "coulomb", mu): entering(m, mu) for m, all_mu in COULOMB.items() for mu in all_mu},
    **{(m, "saturating", mu): saturating(m, mu) for m, all_mu in SATURATING.items() for mu in all_mu},
    ("gelatin", "soft", 0.3): saturating("gelatin", 0.3, times=3.0),
}

EXPERIMENTS = (
    Experiment("blades that enter (Moreno-Mateos & Steinmann 2026)", "", ENTERING, (
        Finding("gelatin, no friction: onset, mm", "fitted", "4.19 ± 0.3",
                lambda found: onset(found["gelatin", "coulomb", 0.0]), 3.89, 4.49),
        Finding("gelatin, friction 0.3: onset, mm", "predicted", "4.19 ± 0.3",
                lambda found: onset(found["gelatin", "coulomb", 0.3]), 3.89, 4.49),
        Finding("gelatin, friction 0.3 that saturates at G/3: onset, mm", "predicted", "4.19 ± 0.3",
                lambda found: onset(found["gelatin", "soft", 0.3]), 3.89, 4.49),
        Finding("elastomer, friction 0.3: onset, mm", "fitted", "1.56 ± 0.3",
                lambda found: onset(found["elastomer", "coulomb", 0.3]), 1.26, 1.86),
        Finding("elastomer, friction 0.3 that saturates at G: onset, mm", "predicted", "1.56 ± 0.3",
                lambda found: onset(found["elastomer", "saturating", 0.3]), 1.26, 1.86),
    )),
    Experiment("gelatin by wires (Forte et al. 2015)", "gelatin-wires", WIRES, (
        Finding("F/(b G_c) without friction at no diameter", "verified", "1, the intercept is G_c",
                lambda found: per_toughness("no friction")(found)[0], 0.97, 1.03),
        Finding("its slope without friction, 1/mm", "verified", "0: nothing else takes energy",
                lambda found: per_toughness("no friction")(found)[1], -0.05, 0.05, 2),
        Finding("F/b at 0.5 mm over a line from 0.25 to 1 mm, friction 0.3 that saturates at G", "predicted",
                "1: a straight line", straight, 0.95, 1.05),
        Finding("where that line begins, G_c", "predicted", "1",
                lambda found: per_toughness("saturates")(found)[0], 0.9, 1.1),
        Finding("F/b at r E/G_c = 6.7 over that at 3.4, with that friction (Goda et al. 2024)", "predicted",
                "above a radius it grows in proportion",
                lambda found: steady(found["saturates", 1.0]) / steady(found["saturates", 0.5]), 1.2, 2.0),
        Finding("its slope, G", "open", "(1 + μ) σ_y, of a σ_y that is not at hand",
                lambda found: per_toughness("saturates")(found)[1] * G_C / G, -math.inf, math.inf, 2),
    )),
    Experiment("edges without friction in PDMS (Zhang & Hutchens 2021)", "razor-pdms", RAZORS, (
        Finding("cutting energy at r E/G_c = 1, J/m²", "verified", "132.9 ± 3.4",
                lambda found: 1e3 * steady(found[0.2]), 129.5, 136.3, 4),
        Finding("the same at r E/G_c = 3.5, J/m²", "verified", "flat below r ≈ G_c/E",
                lambda found: 1e3 * steady(found[0.7]), 129.5, 136.3, 4),
    )),
    Experiment("pet food by a blade (Skamniotis et al. 2016)", "razor-pdms", RAZORS, (
        Finding("cutting energy over the toughness, without friction", "predicted",
                "0.83, 1.30, 1.21 at 5, 10, 30 mm/s, of toughness measured apart",
                lambda found: steady(found[0.2]) / found[0.2].case.p.G_c, 0.8, 1.3),
    )),
    Experiment("blades of different edges (McCarthy et al. 2007, 2010)", "blade-edges", EDGES, (
        Finding("depth of onset: exponent over the edge's radius", "predicted", "above 0: blunter, deeper",
                lambda found: exponent({r: onset(found[r]) for r in EDGES_MM}), 0.05, 2.0, 2),
        Finding("force of onset: exponent over the radius", "predicted", "1: in proportion",
                lambda found: exponent({r: onset_force(found[r]) for r in EDGES_MM}), 0.7, 1.3, 2),
    )),
    Experiment("cheddar by wires (Kamyab et al. 1998, Goh et al. 2005)", "cheddar-wires", CHEESE, (
        Finding("slope of F/b over d, over σ_Y, of a body that does not yield", "predicted",
                "1 to 1.4: (1 + μ)",
                cheese("elastic"), 1.0, 1.4, 2),
    )),
    Experiment("gelatin at several speeds (Oldfield et al. 2013)", "gelatin-speeds", SPEEDS, (
        Finding("force at 2 mm/s over that at 0.25 mm/s", "predicted", "more than double, of G_c",
                lambda found: steady(found[2.0]) / steady(found[0.25]), 2.0, 2.9),
    )),
)  # fmt: skip
