"""The machine that a benchmark ran on, as far as it tells."""

from __future__ import annotations

import os
import platform
from importlib import metadata

PACKAGES = ("cutbench", "numpy", "scipy", "scikit-fem", "py-mkl-pardiso")


def facts(threads: str) -> dict:
    """Processor, cores, system, versions; ``threads`` is what each run was given."""
    return {
        "cpu": cpu(), "cores": os.cpu_count(), "threads_per_run": threads, "system": platform.platform(),
        "python": platform.python_version(), "versions": {name: version(name) for name in PACKAGES},
    }  # fmt: skip


def cpu() -> str:
    """The processor's name; its architecture where no name is to be had."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        if package != "cutbench":
            return None
        from cutbench import __version__  # run from its folder without being installed

        return __version__
