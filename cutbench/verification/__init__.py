"""Verification: reference problems with known answers, and convergence."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"convergence": ["load_plan"], "reference": ["references"]}
)
