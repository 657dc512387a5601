"""Calibration: what a model says an experiment reads, how much each reading counts, the best parameters.

``homogeneous`` computes tests that need no mesh through the mechanism files of the runs.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "fitted": ["Fit"],
        "fitting": ["fit"],
        "identifiability": ["Identifiability", "identifiability"],
        "report": ["summary", "write_fit"],
    },
)
