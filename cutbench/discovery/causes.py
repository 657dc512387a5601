"""More than one cause: what each adds beside the others, and those that the others have made idle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress
from cutbench.calibration.prediction import Predictor
from cutbench.discovery.candidates import Candidate
from cutbench.discovery.heldout import Heldout, compare, decide
from cutbench.discovery.point import Point, refitted

#: What one more parameter must gain in χ² to be kept.
PRICE = 4.0


@dataclass(frozen=True)
class Cause:
    """One of those found. ``alone``: what it gains on held-out data over the model that has all but it, with
    ``alone.gain`` the fall of the error; None where that model could not be computed."""

    candidate: Candidate
    alone: Heldout | None

    @property
    def name(self) -> str:
        return self.candidate.name


def without(
    first: Point, final: Point, others: Sequence[Candidate], gone: Candidate, run: Predictor
) -> Point:
    """``final`` fitted again without ``gone``: ``first``, the baseline, with the ``others`` alone.

    Raises ComputationFailed or BadInput where that cannot be computed, KeyboardInterrupt.
    """
    if not others:
        return first
    model, off = first.case.model.extended(*(name for c in others for name in c.added))
    lost = {q.name for q in gone.parameters}
    values: Mapping[str, float] = {**first.case.values, **off}
    there = final.case.values
    kept = {name: there.get(name, value) for name, value in values.items() if name not in lost}
    case = replace(first.case, mechanisms=model.mechanisms, values={**values, **kept})
    known = [u for u in final.inverse.at(final.q) if u.name not in lost]
    return refitted(final, known, case, run)


def pruned(
    first: Point, final: Point, found: Sequence[Candidate], run: Predictor, on_progress: OnProgress
) -> tuple[Point, list[Cause]]:
    """The model without causes that predict nothing beside the others, and what each of the rest gains."""
    kept = list(found)
    while len(kept) > 1:
        idle: list[tuple[float, Candidate, Point]] = []
        causes = []
        for c in kept:
            on_progress(math.nan, math.nan, f"the model without {c.name}")
            others = [o for o in kept if o is not c]
            try:
                less = without(first, final, others, c, run)
            except (ComputationFailed, BadInput):
                causes.append(Cause(c, None))
                continue
            gain = final.likelihood - less.likelihood
            if gain < PRICE * len(c.parameters) or not decide(less, final).accepted:
                idle.append((gain, c, less))
            causes.append(Cause(c, compare(less, final)))
        if not idle:
            return final, causes
        _, gone, final = min(idle, key=lambda each: each[0])
        kept.remove(gone)
    return final, [Cause(c, compare(first, final)) for c in kept]
