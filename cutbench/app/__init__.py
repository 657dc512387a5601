"""The workbench in a browser: one local page on what Python and the command line do; it holds no physics.

A server on this machine alone, in one folder, for whom has its token.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "case_choices": ["case_from_request", "materials", "case_preview"],
        "server": ["serve", "workbench"],
    },
)
