"""Where the cut starts along the blade (paper, figure 4a)."""

from cutbench.claims.base import Claim

CLAIM = Claim(
    "C5",
    "The cut starts at the middle of the blade and runs to its edges.",
    beyond="a section has no place along the blade: nothing can be said",
)
