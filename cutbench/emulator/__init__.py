"""Emulator: what cuts that were not computed would give, from those that were, and how sure that is.

from cutbench.emulator import RunDatabase
runs = RunDatabase()
runs.add(case, result_course, onset_mm)  # as often as there are runs
emulator = runs.emulator([case], free=["G", "G_c"])
force_N = emulator.forces([values])[0]
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "atlas": ["Atlas", "Estimate", "NotInAtlas", "shipped"],
        "estimates": ["estimate"],
        "atlas_cuts": ["AtlasCuts"],
        "cokriging": ["CokrigedCuts"],
        "database": ["CutEmulator", "OutOfRange", "Run", "RunDatabase"],
        "groups": ["Groups"],
        "gaussian_process": ["GaussianProcess", "Kernel"],
    },
)
