"""A case: mechanisms, their numbers, numerics, and the motion of the blade.

A person writes a material's name or a TOML file; a case is what comes of it, complete, checked, with an id.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "case": ["Case", "load_case"],
        "values": ["parse_overrides"],
        "model": ["DEFAULT", "Model", "PAPER"],
        "motion": ["Motion"],
        "numerics": ["Numerics", "defaults", "preset"],
    },
)
