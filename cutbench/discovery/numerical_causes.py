"""Numerical causes beside the physical ones: would another mesh or contact normal explain the residual?

The change of a computed curve by a numerical choice is one more column for the score test. The mesh and the
steps have been halved, roughly, by the fit already, which corrects for what that changes and allows for what
it leaves open (``cutbench.calibration.mesh_error``); what is scored here is what remains along that change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cutbench.base.units import Parameter
from cutbench.calibration.posterior import Estimated
from cutbench.calibration.settings import SETTINGS
from cutbench.case.case import Case
from cutbench.data.covariance import with_discrepancy
from cutbench.discovery.candidates import Candidate
from cutbench.discovery.comparison import ComparisonRound, squared_discrepancy
from cutbench.discovery.score import Score, score
from cutbench.discovery.screening import CandidateSensitivity, Sensitivities


@dataclass(frozen=True)
class NumericalCauses:
    """What numerical choices would explain.

    Attributes
    ----------
    scores : tuple of Score
        Of each choice, the best first.
    shares : mapping
        By name, the part of what the baseline misses that it would explain.
    evidence : mapping
        By name, the logarithm of the ratio of marginal likelihoods, as of a candidate.
    explains : str or None
        Name of one that has more evidence than any candidate that convinces.
    alike : str or None
        Name of one that the evidence cannot tell from that candidate.
    missing : mapping
        What could not be computed, and why.
    """

    scores: tuple[Score, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)
    evidence: Mapping[str, float] = field(default_factory=dict)
    explains: str | None = None
    alike: str | None = None
    missing: Mapping[str, str] = field(default_factory=dict)


def numerical_causes(step: ComparisonRound, seed: int) -> NumericalCauses:
    """Of tests that are known from runs, where the baseline fails."""
    null = step.null
    if not null.posterior.tests_with_runs or not (step.significant or step.group):
        return NumericalCauses()
    columns, missing = _numerical_sensitivities(null)
    if not columns:
        return NumericalCauses(missing=missing)
    sensed = Sensitivities(null.at.y, null.at.J, columns)
    scores = score(sensed, null.w.noise, null.at.residual, seed=seed)
    shares = {
        s.name: max(1 - _remaining_square(null, sensed, s) / squared_discrepancy(null), 0.0)
        for s in scores.scores
    }
    evidence = {s.name: _evidence(s) for s in scores.scores}
    good = [s.name for s in scores.scores if s.p < SETTINGS.chance and shares[s.name] >= SETTINGS.share]
    best = max(good, key=lambda name: evidence[name], default=None)
    of_others = max((c.evidence for c in step.group), default=-math.inf)
    ahead = -math.inf if best is None or evidence[best] <= 0 else evidence[best] - of_others
    explains = best if ahead > SETTINGS.undecided else None
    alike = best if abs(ahead) <= SETTINGS.undecided else None
    return NumericalCauses(tuple(scores.scores), shares, evidence, explains, alike, missing)


def _evidence(s: Score) -> float:
    """Logarithm of the ratio of marginal likelihoods of the model that takes a share of the change: normal
    beforehand about none, with all of it as standard deviation."""
    (share,) = s.strengths
    steep = float(s.direction @ s.direction) / share**2 if share else 0.0
    return 0.5 * (s.gain * steep / (1 + steep) - math.log1p(steep))


def _numerical_sensitivities(null: Estimated) -> tuple[list[CandidateSensitivity], dict[str, str]]:
    """A column for each numerical choice of the cuts, and why others are missing."""
    post, p, columns = null.posterior, null.posterior.predictions, []
    by = {id: mesh.change for id, mesh in post.mesh.items()}
    if any(np.any(change) for change in by.values()):
        what = "elements and steps about half as large"
        columns.append(_sensitivity_to_choice("element size and step", what, by, null))
    name, by = "contact normal", {}
    cuts = [(e, p.case(e, post.values(e, null.q))) for e in post.tests_with_runs]
    plain, turned = p.runs([case for _, case in cuts]), p.runs([_with_other_normal(case) for _, case in cuts])
    for (e, case), one, other in zip(cuts, plain, turned, strict=True):
        if one is None or other is None:
            return columns, {
                name: p.runs.failed.get((case if one is None else _with_other_normal(case)).id, "")
            }
        values = post.values(e, null.q)
        by[e.id] = p.read(e, values, other.course) - p.read(e, values, one.course)
    what = "another direction of the contact pressure"
    return [*columns, _sensitivity_to_choice(name, what, by, null)], {}


def _with_other_normal(case: Case) -> Case:
    """The run with the contact pressure in its other direction."""
    return case.set(normal="tool" if case.numerics.normal == "material" else "material")


def _sensitivity_to_choice(
    name: str, what: str, by: Mapping[str, np.ndarray], null: Estimated
) -> CandidateSensitivity:
    share = Parameter("share", "1", "s", "part of the change that is taken", off=0.0)
    columns = {id: by.get(id, np.zeros(y.size))[:, None] for id, y in null.at.y.items()}
    return CandidateSensitivity(Candidate(name, what, "numerics", (share,), (), ({},)), {}, columns)


def _remaining_square(null: Estimated, sensed: Sensitivities, s: Score) -> float:
    """What is missed after the score's step."""
    residual = {
        id: r + sensed.J[id] @ s.free + s.sensitivity.by[id] @ s.strengths
        for id, r in null.at.residual.items()
    }
    w = with_discrepancy(null.w.noise, residual, null.at.J)
    at = Estimated(null.posterior, type(null.at)(null.q, null.at.y, residual, null.at.J, null.at.error), w)
    return squared_discrepancy(at)
