"""What rigs, readings, and values of each cut's own would explain, foreseen from all cuts that are known.

A model that lacks one bends its values, far at times, until derivatives where it ended say nothing. What a
rig makes of a run, and what a cut is with other values, is foreseen anywhere without a run, see
``calibration.survey``, so each is asked for where it would explain most, wherever the model itself has ended.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.survey import Survey
from cutbench.discovery.candidates import Candidate
from cutbench.discovery.point import Point


@dataclass(frozen=True)
class Foreseen:
    """Of the model at ``point``."""

    point: Point

    @cached_property
    def able(self) -> bool:
        """Whether other cuts are foreseen from those that are known."""
        return Survey(self.point.inverse, [self.point.q]).problem.able

    @cached_property
    def without(self) -> tuple[float, float]:
        """χ² of the works and of the forces, as the model itself is foreseen to have it at its best."""
        return self._best(self.point.inverse, self.point.q)

    @property
    def by_work(self) -> bool:
        """Whether works are foreseen to disagree; where they do not, forces tell, of what is near."""
        return self.without[0] > Survey(self.point.inverse, [self.point.q]).agreeing

    def rigs(self, chosen: Sequence[Candidate]) -> dict[str, float]:
        """The part of χ² that is left with each of the rigs and readings among ``chosen``, by name."""
        found, here = {}, self.point.inverse.at(self.point.q)
        for c in (c for c in chosen if c.slot == "rig" and not c.shapes):
            new = [Unknown(s, s.off_value + s.typical * s.factor, *s.bounds) for s in c.strengths]
            base = self.point.case
            model, off = base.model.extended(*c.added)
            case = replace(base, mechanisms=model.mechanisms, values={**base.values, **off})
            inverse = self.point.inverse.other([*here, *new], case)
            none = [u.q(s.off_value) for u, s in zip(new, c.strengths, strict=True)]
            found[c.name] = self._left(inverse, np.append(np.zeros(len(here)), none))
        return found

    def _left(self, inverse: Inverse, start: np.ndarray) -> float:
        works, forces = self._best(inverse, start)
        return works / self.without[0] if self.by_work else forces / max(self.without[1], 1e-300)

    def _best(self, inverse: Inverse, start: np.ndarray) -> tuple[float, float]:
        survey = Survey(inverse, [start])
        works = survey.foreseen()
        return works.chi2, survey.foreseen_forces(self.point.w.noise, [works.q, start]).chi2


def owning(point: Point, name: str) -> tuple[Inverse, np.ndarray]:
    """The model of ``point`` with ``name`` a test's own, as the point has it, and S (k, n): 1 where one of
    its k unknowns stands for one of the point's n."""
    unknowns, rows = [], []
    for j, u in enumerate(point.inverse.at(point.q)):
        split = [replace(u, experiment=e.id) for e in point.campaign.train] if u.name == name else [u]
        unknowns += split
        rows += [j] * len(split)
    inverse = point.inverse.other(unknowns, point.case)
    inverse.across = True
    inverse.know(np.zeros(len(unknowns)), point.inverse.predictions(point.q))
    return inverse, np.eye(len(point.inverse.unknowns))[rows]
