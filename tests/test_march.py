"""Histories as compiled loops answer as NumPy does, step by step."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.base.compiled import COMPILED
from cutbench.base.errors import ComputationFailed
from cutbench.calibration.homogeneous import LoadingHistory, march, stretching
from cutbench.data.campaign import start_case
from cutbench.mechanisms.base import STEP

pytestmark = pytest.mark.skipif(not COMPILED, reason="numba is not installed")

CYCLE = LoadingHistory.along(
    1 + np.append(np.linspace(0.1, 1.2, 8), np.linspace(1.0, 0.3, 8)), np.linspace(1.0, 60.0, 16), 1.0
)
STRENGTHS = ("g_1", "g_2", "g_p", "softening", "c2", "b_fung")


def answers(laws, kind, monkeypatch, compiled: bool, **values):
    """P (n, count) with complex steps in the strengths and G, compiled or not."""
    parameters = {"G": "0.3 MPa", **({"nu": 0.4999} if "volumetric" in laws else {})}
    case, _ = start_case(None, baseline=list(laws), kinds=(kind,), parameters=parameters)
    p = case.p
    vars(p).update({name: 0.3 for name in STRENGTHS if hasattr(p, name)} | values)
    names = ["G", *(name for name in STRENGTHS if hasattr(p, name))]
    many = SimpleNamespace(**vars(p))
    for name in names:
        setattr(many, name, getattr(p, name) + 1j * STEP * np.array([n == name for n in names]))
    monkeypatch.setattr(march, "COMPILED", compiled)
    monkeypatch.setattr(march, "PATIENCE", 0)
    monkeypatch.setattr(march, "_known", {})
    monkeypatch.setattr(march, "mark", lambda source: Path("/nowhere/right"))
    made = stretching.nominal_stress(kind, CYCLE, case.model, many, count=len(names))
    return made, list(march._known.values())


@pytest.mark.parametrize("kind", ["uniaxial", "pure_shear", "equibiaxial"])
@pytest.mark.parametrize(
    "laws",
    [
        ("neo_hookean", "volumetric", "maxwell"),
        ("fung", "volumetric", "maxwell2"),
        ("yeoh", "volumetric", "mullins"),
        ("neo_hookean", "volumetric", "maxwell", "mullins"),
        ("gent", "volumetric", "power_law"),
    ],
)
def test_compiled_loops_answer_as_numpy_does(laws, kind, monkeypatch):
    plain, none = answers(laws, kind, monkeypatch, compiled=False)
    # What is asked first is held against NumPy; what counts is the loops' own answer.
    monkeypatch.setattr(march.March, "holds", lambda self, found, plain: found)
    loops, known = answers(laws, kind, monkeypatch, compiled=True)
    assert not none and known and all(known)
    assert np.allclose(loops.real, plain.real, rtol=1e-10, atol=0)
    size = np.abs(plain.imag).max(axis=0)
    assert np.all(np.abs(loops.imag - plain.imag) <= 1e-7 * size)


def test_a_softening_of_next_to_no_energy_is_no_overflow(monkeypatch):
    laws = ("neo_hookean", "volumetric", "mullins")
    plain, _ = answers(laws, "uniaxial", monkeypatch, compiled=False, softening_energy=1e-3)
    loops, _ = answers(laws, "uniaxial", monkeypatch, compiled=True, softening_energy=1e-3)
    assert np.isfinite(loops).all() and np.allclose(loops.real, plain.real, rtol=1e-10)


def test_loops_that_differ_are_not_used(monkeypatch):
    laws = ("neo_hookean", "volumetric", "maxwell")
    plain, _ = answers(laws, "uniaxial", monkeypatch, compiled=False)
    whole = march.March.along

    def wrong(self, *given):
        found = whole(self, *given)
        return found if found is None else (1.01 * found[0], found[1])

    monkeypatch.setattr(march.March, "along", wrong)
    loops, known = answers(laws, "uniaxial", monkeypatch, compiled=True)
    assert np.array_equal(loops, plain) and known[0]._march is None


def test_a_step_without_balance_is_said(monkeypatch):
    """κ far below what holds a lateral stretch together."""
    laws = ("neo_hookean", "volumetric", "maxwell")
    said = []
    for compiled in (False, True):
        with pytest.raises(ComputationFailed, match="no lateral stretch balances") as error:
            answers(laws, "uniaxial", monkeypatch, compiled=compiled, G=np.nan)
        said.append(str(error.value))
    assert said[0] == said[1]
