"""Notched strips in tension (paper, supplementary figure of tensile tests)."""

from cutbench.claims.base import Claim

CLAIM = Claim(
    "C12",
    "Notched strips (12 × 30 × 3 mm, notch 2.4 mm) in tension, up to the cut.",
    beyond="a strip 3 mm thick is not in plane strain: `cutbench tension MATERIAL --notched` pulls it",
)
