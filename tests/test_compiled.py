"""With compiled loops and without, numbers are the same; and who waits for a compiler is told."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cutbench.base.compiled import COMPILED, announced

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
        env = os.environ | {"CUTBENCH_COMPILED": switch}
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
