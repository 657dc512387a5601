"""One thread a process: the suite runs several at once, and threads that wait for each other would spin.

Runs that several files read.
"""

import os

import pytest

from cutbench.base.fused import fused
from cutbench.base.threads import ONE_THREAD

for name, count in ONE_THREAD.items():
    os.environ.setdefault(name, count)


@pytest.fixture
def laws_in_numpy(monkeypatch):
    """For modules that ask many different laws a few times each: compiling takes far longer than it saves."""
    monkeypatch.setattr("cutbench.base.fused.COMPILED", False)
    monkeypatch.setattr("cutbench.forms.bulk.COMPILED", False)
    fused.cache_clear()
    yield
    fused.cache_clear()


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
