"""What looks on at a run: it takes in each accepted step, and adds columns and measures to the result."""

from __future__ import annotations

from copy import copy
from typing import ClassVar

import numpy as np

from cutbench.run.remeshing import Transfer
from cutbench.solver.march import Accepted


class Observer:
    """The base of ledger, front, fields and derivatives; a new one needs ``add`` and what it answers.

    ``kept`` names the attributes with which an observer goes on in a resumed run: arrays, plain values, and
    lists and dictionaries of them, whose entries do not change any more.
    """

    kept: ClassVar[tuple[str, ...]] = ()
    #: What is said beside how the run ended; nothing but where there is something to beware of.
    caution = ""

    def add(self, step: Accepted) -> None:
        """Take in one accepted step, which may lie between two points of the curve."""
        raise NotImplementedError

    def renewed(self, transfer: Transfer) -> None:
        """Go on where the march has a new mesh: that of ``transfer``."""

    def columns(self) -> dict[str, np.ndarray]:
        """Columns of the curve, a value a point."""
        return {}

    def measures(self) -> dict[str, float]:
        """Numbers of the run that its curve does not say."""
        return {}

    def state(self) -> dict:
        """What a later ``restore`` needs."""
        return {name: copy(getattr(self, name)) for name in self.kept}

    def restore(self, state: dict) -> None:
        """Go on from where ``state`` was taken."""
        for name, value in state.items():
            setattr(self, name, value)
