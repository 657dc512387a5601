"""Calibration: what a model says a test reads, how much each reading counts, the most probable parameters.

``prediction`` answers for any test, ``posterior`` has the one likelihood of all of them, ``estimation`` finds
its maximum, and ``fitting`` says it with intervals.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "fitting": ["Fit", "fit"],
        "identifiability": ["Identifiability", "identifiability"],
        "report": ["summary", "write_fit"],
    },
)
