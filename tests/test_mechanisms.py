"""What every mechanism must satisfy, held over the registry: a new file is tested by being there.

No law is named here.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

from cutbench.mechanisms import SLOTS, registry
from cutbench.mechanisms.checks import checks_of, finding
from cutbench.mechanisms.checks.base import close
from cutbench.mechanisms.checks.trial import Trial

LAWS = registry().values()


@pytest.mark.parametrize("law", [pytest.param(law, id=law.name) for law in LAWS])
def test_a_law_passes_its_checks(law):
    wrong = {check.name: finding(check, Trial(law)).wrong for check in checks_of(law)}
    assert wrong and not any(wrong.values()), wrong


def test_a_law_stands_in_the_folder_of_its_slot():
    assert {law.slot for law in LAWS} <= {*SLOTS}
    places = {law.name: sys.modules[type(law).__module__].__name__ for law in LAWS}
    assert places == {law.name: f"cutbench.mechanisms.{law.slot}.{law.name}" for law in LAWS}


@pytest.mark.parametrize("law", [pytest.param(law, id=law.name) for law in LAWS if law.role == "cohesive"])
def test_unloading_is_linear_to_the_origin(law):
    trial = Trial(law)
    peak = trial.jumps(closing=False)
    T, states, _ = trial.cut(peak, np.zeros_like(peak))
    damage = states[law.name]["damage"]
    assert damage.min() > 0
    for part in (0.9, 0.5, 0.1, 0.0):
        back, kept, _ = trial.cut(part * peak, peak, states)
        close(back, part * T, 1e-13)
        assert np.array_equal(kept[law.name]["damage"], damage)


@pytest.mark.parametrize("law", [pytest.param(law, id=law.name) for law in LAWS if law.role == "cohesive"])
def test_the_ledger_has_the_work_of_separation_as_a_function(law):
    trial = Trial(law)
    p, wide = trial.numbers(), np.array([[100 * trial.length], [0.0], [0.0]])
    T, states, at = trial.cut(wide, np.zeros((3, 1)))
    spent = law.work(wide, p, states[law.name], at)
    assert np.abs(T).max() < 1e-12 * law.estimate(p, 0.0, 0.0).strength
    assert spent[0] == pytest.approx(law.estimate(p, 0.0, 0.0).work, rel=1e-12)
