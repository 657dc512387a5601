"""What the paper claims, one claim a file, found by being there: a module's ``CLAIM``.

A claim names the runs it needs and reads them; the same reading is applied to the paper's numerics, to the
converged defaults, and, where the two differ or fail, to runs that change one thing at a time.
"""

from __future__ import annotations

import importlib
import pkgutil

from studies.paper.base import Ask, Claim, Finding


def claims() -> dict[str, Claim]:
    """All claims by id: the units first, then by number."""
    found = {}
    for info in pkgutil.iter_modules(__path__):
        claim = getattr(importlib.import_module(f"{__name__}.{info.name}"), "CLAIM", None)
        if claim is not None:
            found[claim.id] = claim
    return {id: found[id] for id in sorted(found, key=lambda id: int(id[1:] if id[1:].isdigit() else 0))}


__all__ = ["Ask", "Claim", "Finding", "claims"]
