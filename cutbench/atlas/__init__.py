"""Atlas: runs of a blunt blade in a neo-Hookean gel that the package brings along, and what lies between them.

from cutbench.atlas import estimate
found = estimate("gelatin")
found.peak_N, found.chance
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"box": ["BLUNT", "Box", "Side"]})
