"""With compiled loops and without, numbers are the same; and who waits for a compiler is told."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from form_checks import FRICTIONLESS, P, blade, blade_case, space_of, spaces

from cutbench.base.compiled import COMPILED, announced
from cutbench.case.model import DEFAULT
from cutbench.forms.blade import ContactNumerics

needs_numba = pytest.mark.skipif(not COMPILED, reason="numba is not there, or switched off")
LOOP = """
from cutbench.base.compiled import compiled

@compiled()
def summed(x):
    total = 0.0
    for value in x:
        total += value
    return total
"""


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Numbers of the same computations, with and without."""
    script, found = Path(__file__).parent / "numbers_of_a_run.py", []
    for switch in ("1", "0"):
        out = tmp_path_factory.mktemp("numbers") / f"{switch}.npz"
        env = os.environ | {"CUTBENCH_COMPILED": switch, "CUTBENCH_FUSED": "1"}
        subprocess.run([sys.executable, str(script), str(out)], check=True, env=env)
        with np.load(out) as kept:
            found.append({name: kept[name] for name in kept.files})
    return found


@needs_numba
def test_evaluations_are_the_same_without(both):
    mine, plain = both
    assert mine.keys() == plain.keys()
    compared = [name for name in plain if not name.startswith("curve ")]
    assert any(np.any(plain[f"{seed} matrix"]) for seed in range(4)) and len(compared) > 30
    for name in compared:
        size = np.abs(plain[name], where=np.isfinite(plain[name]), out=np.zeros(plain[name].shape)).max(
            initial=0
        )
        np.testing.assert_allclose(mine[name], plain[name], rtol=0, atol=1e-12 * float(size), err_msg=name)


@needs_numba
def test_a_run_is_the_same_without(both):
    mine, plain = both
    curves = [name for name in plain if name.startswith("curve ")]
    assert plain["curve force_N"].max() > 0
    for name in curves:
        size = float(np.nanmax(np.abs(plain[name])))
        np.testing.assert_allclose(mine[name], plain[name], rtol=0, atol=1e-6 * size, err_msg=name)


@needs_numba
def test_who_waits_for_a_compiler_is_told(tmp_path):
    (tmp_path / "loops.py").write_text(LOOP)

    def summed():
        spec = importlib.util.spec_from_file_location("loops", tmp_path / "loops.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        said: list[str] = []
        parts = (module.summed(np.ones(n)) for n in (2, 3))
        assert list(announced(parts, lambda: said.append("wait"))) == [2.0, 3.0]
        return said

    assert summed() == ["wait"]
    assert summed() == []  # its code is kept


@spaces
@pytest.mark.parametrize("normal", ["tool", "material"])
@pytest.mark.parametrize("names", [FRICTIONLESS, DEFAULT, (*DEFAULT, "adhesion_speed")])
def test_compiled_loops_and_numpy_answer_the_same(dim, order, normal, names):
    """Numbers that may be complex go through NumPy, real ones through compiled loops where there are any."""
    turned = {"tilt": 0.2, "incline": 0.1, "length": 1.0}
    p = SimpleNamespace(**vars(P) | turned | {"tau_v": 0.002, "adhesion_reference": 0.01})
    p.overhang = -0.2
    space = space_of(dim, order)
    form = blade(space, normal=normal, names=names).with_numerics(
        ContactNumerics(5 * P.G, 25 * P.G, normal=normal, release=0.01)
    )
    for seed in range(3):
        u, state, step = blade_case(space, form, p)
        u = u + 0.02 * np.random.default_rng(seed).standard_normal(u.size)
        state["touched"] = np.random.default_rng(seed).integers(0, 2, state["touched"].shape).astype(float)
        real, other = (form.evaluate(v, p, state, step) for v in (u, u + 0j))
        assert other.vector.dtype == complex and real.vector.any()
        answers = {"vector": (real.vector, other.vector)} | {
            k: (v, other.state[k]) for k, v in real.state.items()
        }
        for name, (mine, its) in answers.items():
            size = np.abs(its).max(initial=1e-9)
            np.testing.assert_allclose(mine, its.real, rtol=0, atol=1e-12 * size, err_msg=name)
