"""Atlas: runs of blunt blades in neo-Hookean gels that the package brings along, and what lies between.

from cutbench.atlas import estimate
found = estimate("gelatin")
found.peak_N, found.chance
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"box": ["BLUNT", "Box", "Side"]})
