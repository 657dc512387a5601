"""The command line: parse, show, exit status; no physics. One command a file in ``commands``."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "main": ["main"],
    },
)
