"""The discrete problem and its solution: Newton, linear solvers, steps, derivatives, arc length.

Free of dimension, of files and of what a case is.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "march": ["Accepted", "March", "Progress"],
        "newton": ["NewtonSettings", "NoConvergence", "newton"],
        "problem": ["Problem"],
    },
)
