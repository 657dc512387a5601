"""What every room stands on: errors, units, TOML, mesh files, atomic files, reports, the style of figures.

Nothing here knows what is computed.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "errors": ["BadInput", "ComputationFailed", "CutbenchError"],
        "toml": ["read_toml"],
        "units": ["Parameter", "parse_quantity"],
    },
)
