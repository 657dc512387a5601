"""The contact of one test: where the machine met the specimen, and how surely that is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Standard deviations within which a contact that was found is believed.
COVERAGE_FACTOR = 4.0


@dataclass(frozen=True)
class Contact:
    """Contact at ``at`` mm of the recorded displacement, known to ``sd``, after so many ``readings``; before
    it the force is ``force``, known to ``force_sd``, later ``largest`` at the most, in ``unit``.
    ``taken_off``: which of ``displacement`` and ``force`` was found and taken off; a force that was given is
    taken off ``force``, too. ``first``: so many readings come before the way out begins, as of a machine that
    first drives back."""

    at: float
    sd: float
    force: float
    force_sd: float
    readings: int
    largest: float
    unit: str = "N"
    taken_off: tuple[str, ...] = ()
    first: int = 0

    def remaining_uncertainty(self, what: str) -> float:
        """How far the ``displacement`` (mm) or ``force`` (N) that was found here and taken off may be wrong,
        with room for what the rule itself may be off; infinite where it was not."""
        sd = self.sd if what == "displacement" else self.force_sd if self.unit == "N" else np.inf
        return COVERAGE_FACTOR * sd if what in self.taken_off and sd > 0 else np.inf
