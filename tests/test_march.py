"""Histories as compiled loops answer as NumPy does, step by step."""

from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.base.compiled import COMPILED
from cutbench.base.errors import ComputationFailed
from cutbench.data.campaign import start_case
from cutbench.homogeneous import LoadingHistory, march, stretching
from cutbench.mechanisms.base import STEP

pytestmark = pytest.mark.skipif(not COMPILED, reason="numba is not installed")

CYCLE = LoadingHistory.along(
    1 + np.append(np.linspace(0.1, 1.2, 8), np.linspace(1.0, 0.3, 8)), np.linspace(1.0, 60.0, 16), 1.0
)
STRENGTHS = ("g_1", "g_2", "g_p", "softening", "c2", "b_fung")


def stress(laws, kind, times=1, **values):
    """P (n, count) with complex steps in the strengths and G, of the last of so many times."""
    parameters = {"G": "0.3 MPa", **({"nu": 0.4999} if "volumetric" in laws else {})}
    case, _ = start_case(None, baseline=list(laws), kinds=(kind,), parameters=parameters)
    p = case.p
    vars(p).update({name: 0.3 for name in STRENGTHS if hasattr(p, name)} | values)
    names = ["G", *(name for name in STRENGTHS if hasattr(p, name))]
    many = SimpleNamespace(**vars(p))
    for name in names:
        setattr(many, name, getattr(p, name) + 1j * STEP * np.array([n == name for n in names]))
    for _ in range(times):
        made = stretching.nominal_stress(kind, CYCLE, case.model, many, count=len(names))
    return made


def both(laws, kind, monkeypatch, **values):
    """In NumPy, and by loops, which are there once a model has been asked for often enough, and used once
    they have been found to answer alike."""
    monkeypatch.setenv("CUTBENCH_FUSED", "0")
    plain = stress(laws, kind, **values)
    monkeypatch.setenv("CUTBENCH_FUSED", "1")
    return plain, stress(laws, kind, march.MARCHES_BEFORE_COMPILING + 3, **values)


def alike(plain, loops):
    assert not np.array_equal(loops.imag, plain.imag), "these are not the loops"
    assert np.allclose(loops.real, plain.real, rtol=1e-10, atol=0)
    size = np.abs(plain.imag).max(axis=0)
    assert np.all(np.abs(loops.imag - plain.imag) <= 1e-7 * size)


MAXWELL, VOLUME = ("neo_hookean", "volumetric", "maxwell"), "volumetric"


@pytest.mark.parametrize(
    ("laws", "kind"),
    [
        (MAXWELL, "uniaxial"),
        pytest.param(("fung", VOLUME, "maxwell2"), "equibiaxial", marks=pytest.mark.slow),
        pytest.param(("yeoh", VOLUME, "mullins"), "uniaxial", marks=pytest.mark.slow),
        pytest.param(("neo_hookean", VOLUME, "maxwell", "mullins"), "pure_shear", marks=pytest.mark.slow),
        pytest.param(("gent", VOLUME, "power_law"), "pure_shear", marks=pytest.mark.slow),
        pytest.param(("gent", VOLUME, "power_law"), "uniaxial", marks=pytest.mark.slow),
    ],
)
def test_compiled_loops_answer_as_numpy_does(laws, kind, monkeypatch, compiled_laws):
    alike(*both(laws, kind, monkeypatch))


def test_a_softening_of_next_to_no_energy_is_no_overflow(monkeypatch, compiled_laws):
    plain, loops = both(
        ("neo_hookean", VOLUME, "maxwell", "mullins"), "pure_shear", monkeypatch, softening_energy=1e-3
    )
    assert np.isfinite(loops).all() and np.allclose(loops.real, plain.real, rtol=1e-10)


def test_a_step_without_balance_is_said_alike(monkeypatch, compiled_laws):
    """κ far below what holds a lateral stretch together."""
    both(MAXWELL, "uniaxial", monkeypatch)
    said = []
    for switch in "01":
        monkeypatch.setenv("CUTBENCH_FUSED", switch)
        with pytest.raises(ComputationFailed) as error:
            stress(MAXWELL, "uniaxial", G=np.nan)
        said.append(str(error.value))
    assert said[0] == said[1]
