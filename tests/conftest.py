"""One thread a process: the suite runs several at once, and threads that wait for each other would spin.

Runs that several files read.
"""

import os
from contextlib import contextmanager

import pytest

from cutbench.base.fused import fused
from cutbench.base.threads import ONE_THREAD

for name, count in ONE_THREAD.items():
    os.environ.setdefault(name, count)


@contextmanager
def _in_numpy():
    """Where many different laws are asked a few times each, compiling takes far longer than it saves."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cutbench.base.fused.COMPILED", False)
        patch.setattr("cutbench.forms.bulk.COMPILED", False)
        fused.cache_clear()
        yield
    fused.cache_clear()


@pytest.fixture
def laws_in_numpy():
    with _in_numpy():
        yield


@pytest.fixture(scope="module")
def module_in_numpy():
    with _in_numpy():
        yield


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
