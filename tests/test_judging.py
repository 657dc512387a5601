"""Which of the candidates that were fitted is accepted."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.discovery import judging
from cutbench.discovery.heldout import TESTS, Heldout
from cutbench.discovery.outcome import Tried


def tried(name: str, gain: float, better: float) -> Tried:
    """One that explains enough, and gains so much in the fitted tests and in those that were not."""
    c = SimpleNamespace(parameters=(1, 2), cause="mechanism")
    score = SimpleNamespace(name=name, column=SimpleNamespace(candidate=c), gain=gain, direction=np.zeros(1))
    held = Heldout(TESTS, better, 5.0, np.sign(better) * 0.3, 0.1, 2.0, 1.4, 0.5, "N")
    return Tried(score, SimpleNamespace(likelihood=gain, meshed=True), held, gain, 1e-4, 0.6)


@pytest.mark.parametrize("meshed, accepted", [(True, "sound"), (False, None)])
def test_of_cuts_what_fits_best_but_predicts_nothing_hides_no_other(monkeypatch, meshed, accepted):
    monkeypatch.setattr(judging, "better_than", lambda one, other: (other.likelihood - one.likelihood, 1.0))
    scores = SimpleNamespace(p_residual=0.0, scores=[])
    point = SimpleNamespace(meshed=meshed)
    both = [tried("fits", 120.0, -6.0), tried("sound", 90.0, 22.0)]
    found = judging.judged(point, None, scores, both, {}, {})
    assert found.accepted == accepted
    # What fits as well is named beside it.
    assert found.group == (("sound", "fits") if meshed else ("fits",))


def test_of_two_that_convince_the_better_fit_is_accepted(monkeypatch):
    monkeypatch.setattr(judging, "better_than", lambda one, other: (other.likelihood - one.likelihood, 1.0))
    scores, point = SimpleNamespace(p_residual=0.0, scores=[]), SimpleNamespace(meshed=True)
    found = judging.judged(point, None, scores, [tried("a", 90.0, 22.0), tried("b", 120.0, 20.0)], {}, {})
    assert found.accepted == "b" and found.group == ("b",)
