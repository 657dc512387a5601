"""From what a claim asks for to cases: the two numerics, the one free choice, one change at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cutbench.case.case import Case, load_case
from cutbench.case.numerics import PAPER_EDGE, PAPER_UPDATES, Numerics
from cutbench.run.result import Result
from studies.paper.base import BLOCK, CONVERGED, CUT, NOTCH_MM, NOTCHED, PAPER, TENSION, Ask
from studies.paper.reading import end_of_indentation, measure


@dataclass(frozen=True)
class ModelChange:
    """One difference from the numerics ``start``; ``text`` says what a run with it has. It is tried for
    ``claims``, for all unless given."""

    text: str
    start: str
    values: Mapping[str, object]
    claims: tuple[str, ...] = ()


#: The choices that say how hard the blade and the closed cut are, and how far adhesion reaches.
HARD = ("penalty", "stick", "scaled", "multiplier", "augmentations", "closing", "release")
#: And how long steps are.
STEPS = ("step", "damage_step")
#: What tells the paper's numerics and model from the converged ones, one by one; and from there, its laws.
CHANGES: dict[str, ModelChange] = {
    "size": ModelChange("elements of 0.5 mm", PAPER, {"h": "0.5 mm"}),
    "order": ModelChange("quadratic elements", PAPER, {"element": "P2"}),
    "viscous": ModelChange("viscosity that fades with damage", PAPER, {"with_": "viscous_degraded"}),
    "contact": ModelChange(
        "hard contact, of the cut's faces too; distance as gap", PAPER,
        {"gap": "distance", **{key: getattr(Numerics, key) for key in HARD}},
    ),
    "steps": ModelChange(
        "damage solved with the displacements, steps by their error", PAPER,
        {"scheme": "monolithic", "stepping": "adaptive", **{key: getattr(Numerics, key) for key in STEPS}},
    ),
    "normal": ModelChange("the tool's normal", PAPER, {"normal": "tool"}),
    "cohesion": ModelChange("a cohesive law that is stiff at first", PAPER, {"with_": "stiff_cohesion"}),
    "surfaces": ModelChange("surfaces with a length", PAPER, {"with_": "surface_gradient"}),
    "printed_viscous": ModelChange("viscosity as printed, else converged", CONVERGED, {"with_": "viscous"}),
    "printed_cohesion": ModelChange(
        "the cohesive law as printed, else converged", CONVERGED, {"with_": "smith_ferrante"},
        claims=("C1", "C2"),
    ),
    "folds": ModelChange(
        "surfaces without a length, else converged", CONVERGED, {"without": "surface_gradient"},
        claims=("C1", "C2"),
    ),
}  # fmt: skip

#: What the paper leaves open of its contact: quadrature on faces, and how often multipliers are updated. What
#: ``--numerics paper`` takes, degree 6 and updates until they stand still, is one choice of six.
OPEN: dict[str, ModelChange] = {
    f"degree {degree}, {text}": ModelChange(
        f"faces of degree {degree}, {text}", PAPER, {"facet_degree": degree, "augmentations": updates}
    )
    for degree in (2, 6, 12)
    for text, updates in (("no updates", 0), ("updated", PAPER_UPDATES))
    if (degree, updates) != (Numerics.facet_degree, PAPER_UPDATES)
}

#: Of blocks with the defaults: through a drop on smaller elements, or one that closes better, takes hours.
BLOCK_CHOICES = {"corner": 1.0, "energy_step": 1.0}
#: Tip lengths b that are tried, mm, on the paper's numerics, whose elements resolve none beyond 1.6 mm.
TIPS = (0.35, 0.5, 0.7, 0.85, 1.05, 1.3, 1.6)


_END = "end of indentation"


def left_open(ask: Ask) -> bool:
    """Whether what the paper leaves open can change a run."""
    return ask.test == CUT and ask.numerics != CONVERGED


@dataclass(frozen=True)
class Target:
    """What the tip length of a material is chosen for: ``measure`` at ``published_mm``."""

    measure: str
    published_mm: float

    def of(self, result: Result) -> float:
        if not result.outcome.done:
            return math.nan
        return end_of_indentation(result) if self.measure == _END else measure(result, "onset_mm")


#: Where indentation ends in the paper's figures: the first maximum of the force; the elastomer's force has
#: none there, and the onset of the cut is taken.
TARGETS = {
    "gelatin": Target(_END, 4.19),
    "elastomer": Target("onset of the cut", 1.56),
    "meat": Target(_END, 9.76),
}


def scan(material: str) -> dict[float, Case]:
    """The runs by which a material's b is chosen, by b in mm."""
    return {tip: case_of(Ask(material), PAPER, tip) for tip in TIPS}


def best_tip(material: str, results: Mapping[float, Result]) -> float:
    """The b, mm, of those tried whose run comes nearest to the target.

    The material's own stays where no other comes nearer by an element of the paper's: fronts jump by as much.
    """
    target, own = TARGETS[material], load_case(material).p.tip
    miss = {tip: abs(target.of(result) - target.published_mm) for tip, result in results.items()}
    told = {tip: m for tip, m in miss.items() if math.isfinite(m)}
    best = min(told, key=lambda tip: told[tip], default=own)
    return own if told.get(own, math.inf) < told.get(best, 0.0) + PAPER_EDGE else best


def case_of(ask: Ask, numerics: str, tip_mm: float, change: ModelChange | None = None) -> Case:
    """The case of ``ask`` under one set of numerics, with at most one ``change`` of it."""
    word = ask.numerics or numerics
    if ask.test in (TENSION, NOTCHED):
        return _strip(ask, word, change)
    changes = {"tip": f"{tip_mm} mm", "depth": f"{ask.depth_mm} mm", **ask.changes}
    if ask.test == BLOCK:
        chosen = {"numerics": "tetrahedra", **BLOCK_CHOICES} if word == CONVERGED else {"numerics": word}
        return load_case(ask.material, {**changes, **chosen}, dim=3)
    case = load_case(ask.material, {**changes, "numerics": word})
    return case if change is None or ask.numerics else case.set(**change.values)


def _strip(ask: Ask, word: str, change: ModelChange | None) -> Case:
    from cutbench.run.tension import strip_case

    case = load_case(ask.material, {**ask.changes, "numerics": word}, dim=3)
    notch_mm = NOTCH_MM if ask.test == NOTCHED else 0.0
    if change is not None and not ask.numerics and not notch_mm:
        case = case.set(**change.values)
    return strip_case(case, {"depth": f"{ask.depth_mm} mm"}, notch_mm=notch_mm)
