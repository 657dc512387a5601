"""One thread a process: the suite runs several at once, and threads that wait for each other would spin.

Laws in NumPy, where a test does not ask for them compiled, and runs that several files read.
"""

import os
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import pytest

from cutbench.base.threads import ONE_THREAD

for name, count in ONE_THREAD.items():
    os.environ.setdefault(name, count)


def pytest_configure(config):
    """Many laws are asked a few times each, and compiling them takes far longer than it saves; in the long
    runs of the slow tests it does not."""
    if config.option.markexpr == "not slow":
        os.environ.setdefault("CUTBENCH_FUSED", "0")
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        # Loops are compiled once on a machine, and not by each of several processes at a time.
        script = Path(__file__).with_name("numbers_of_a_run.py")
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, str(script), f"{folder}/numbers.npz"], check=False)


@pytest.fixture
def compiled_laws(monkeypatch, tmp_path):
    """Laws as a user has them, with a place for their machine code in which there is none."""
    monkeypatch.setenv("CUTBENCH_FUSED", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


# Places at which a test puts something of its own where the package has none to give it; there are no others.
@pytest.fixture
def runs_by(monkeypatch):
    """Calling it with a function makes that what computes runs in this process."""
    return lambda run: monkeypatch.setattr("cutbench.run.runner.run_case", run)


@pytest.fixture
def newton_by(monkeypatch):
    """Calling it with a function makes that what solves a step, with Newton's method or instead of it."""
    return lambda newton: monkeypatch.setattr("cutbench.solver.fixed_point.newton", newton)


@pytest.fixture
def other_code(monkeypatch):
    """Calling it gives this process another computation, as if a file of the engine had changed."""

    def change(computation):
        for module in ("case", "computation"):
            monkeypatch.setattr(f"cutbench.case.{module}.computation_of", lambda model: computation)

    return change


@pytest.fixture
def law_of(monkeypatch, tmp_path):
    """Calling it with a slot, a name and a text makes that text a law of the slot's folder."""
    from cutbench import mechanisms

    def take_up(slot, name, text):
        (tmp_path / "laws").mkdir()
        (tmp_path / "laws" / f"{name}.py").write_text(text, encoding="utf-8")
        folder = import_module(f"cutbench.mechanisms.{slot}")
        monkeypatch.setattr(folder, "__path__", [*folder.__path__, str(tmp_path / "laws")])
        mechanisms.registry.cache_clear()
        return name

    yield take_up
    monkeypatch.undo()
    mechanisms.registry.cache_clear()


@pytest.fixture
def benchmarks_of(monkeypatch):
    """Calling it with a folder makes that the repository whose runs benchmarks compare."""
    from benchmarks import __main__ as bench
    from benchmarks import tools

    def change(folder):
        for module in (tools, bench):
            monkeypatch.setattr(module, "ROOT", folder)

    return change


# Coarse runs that several files read; computed once a process, and only where they are asked for.
@pytest.fixture
def pressed():
    import coarse_runs

    return coarse_runs.pressed_run()


@pytest.fixture
def cutting():
    import coarse_runs

    return coarse_runs.cutting_run()


@pytest.fixture
def brief():
    import coarse_runs

    return coarse_runs.brief_run()


@pytest.fixture
def quick():
    import coarse_runs

    return coarse_runs.quick_run()


@pytest.fixture
def log(tmp_path, monkeypatch):
    """The file in which stand-in runs (``analytic_runs``) leave their ids."""
    path = tmp_path / "log"
    path.touch()
    monkeypatch.setenv("FAKE_RUN_LOG", str(path))
    return path
