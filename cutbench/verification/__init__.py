"""Verification: reference problems with known answers, convergence, the claims of the paper."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "convergence": ["load_plan"],
        "paper": ["claims"],
        "reference": ["references"],
    },
)
