"""How a mechanism looks in pictures: laws of one role replace each other, and look the same."""

from __future__ import annotations

import zlib

from cutbench.mechanisms import registry

#: Colour, by its name in the palette, and pattern, as plotly writes it, by role.
ROLES = {
    "isochoric": ("blue", ""),
    "volumetric": ("vermilion", "/"),
    "viscoelastic": ("vermilion", "x"),
    "softening": ("blue", "x"),
    "cohesive": ("green", "."),
    "rate": ("green", "x"),
    "viscous": ("orange", "\\"),
    "contact": ("sky", "x"),
    "adhesion": ("purple", "-"),
    "friction": ("yellow", "/"),
    "gradient": ("blue", "+"),
    "bond": ("orange", "."),
}
#: What those without a known role have, one of each by a digest of the name.
COLOURS, PATTERNS = ("orange", "purple", "sky", "green", "vermilion"), "|+-x/"


def mechanism_look(name: str) -> tuple[str, str]:
    """Name of the colour and pattern of a mechanism; of a law of one's own, too, the same everywhere."""
    law = registry().get(name)
    digest = zlib.crc32(name.encode())
    own = COLOURS[digest % len(COLOURS)], PATTERNS[digest // len(COLOURS) % len(PATTERNS)]
    return ROLES.get(law.role or "", own) if law else own
