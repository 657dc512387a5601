"""One thread a process: the suite runs several at once, and threads that wait for each other would spin.

Laws in NumPy, where a test does not ask for them compiled, and runs that several files read.
"""

import os

import pytest

from cutbench.base.threads import ONE_THREAD

for name, count in ONE_THREAD.items():
    os.environ.setdefault(name, count)


def pytest_configure(config):
    """Many laws are asked a few times each, and compiling them takes far longer than it saves; in the long runs
    of the slow tests it does not."""
    if config.option.markexpr == "not slow":
        os.environ.setdefault("CUTBENCH_FUSED", "0")


@pytest.fixture
def compiled_laws(monkeypatch, tmp_path):
    """Laws as a user has them, with a place for their machine code in which there is none."""
    monkeypatch.setenv("CUTBENCH_FUSED", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


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
