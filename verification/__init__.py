"""Reference problems, one a file, found by being there: a module's ``REFERENCE``.

Each computes numbers through the product's own forms, mechanisms and solver, and holds them against
values from formulas, from the literature or from an independent program.
"""

from __future__ import annotations

import importlib
import pkgutil

from verification.base import Check, Reference, Verified, verify

#: In this order they stand in the table; others follow by name.
FIRST = (
    "cohesive_law", "viscous_law", "patch", "manufactured", "objectivity", "cook", "inclusions", "strip",
    "hertz", "elliptic_punch", "sliding", "crease", "symmetry",
)  # fmt: skip


def references() -> dict[str, Reference]:
    """Return the reference problems: computations whose answers are known.

    Returns
    -------
    dict of str to Reference
        By name; each has a title, the source of its numbers, and the seconds that it takes.

    Examples
    --------
    >>> from verification import references
    >>> references()["objectivity"].quick
    True
    """
    found = {}
    for info in pkgutil.iter_modules(__path__):
        if info.name == "__main__":
            continue
        reference = getattr(importlib.import_module(f"{__name__}.{info.name}"), "REFERENCE", None)
        if reference is not None:
            found[reference.name] = reference
    place = {name: i for i, name in enumerate(FIRST)}
    return {name: found[name] for name in sorted(found, key=lambda n: (place.get(n, len(place)), n))}


__all__ = ["Check", "Reference", "Verified", "references", "verify"]
