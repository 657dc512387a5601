"""The workbench in a browser: local pages on what Python and the command line do; they hold no physics.

A server on this machine alone, in one folder, for whom has its token. NiceGUI draws the pages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "case_choices": ["Choice", "blades", "materials", "sliders"],
        "server": ["serve", "workbench"],
    },
)
