"""What laws of films share: the thickness that gives the bending stiffness, B = G t³/3."""

from cutbench.base.units import Parameter
from cutbench.mechanisms.base import Group


def stiffness(name: str, symbol: str, what: str) -> Parameter:
    """B itself: what a film changes first is in proportion to it, not to its thickness."""
    # A tenth of a millimetre of a gel of 9 kPa.
    return Parameter.effect(name, "nN m", symbol, f"bending stiffness of {what}", high=1e9, typical=3.0)


def thickness(name: str, of: str, what: str) -> Group:
    """t in its place: B = G t³/3 is that of a plate in plane strain, 4 G t³/12, of the block's modulus."""

    def value(p):
        return (3 * getattr(p, of) / p.G) ** (1 / 3)

    def solve(p, x):
        return p.G * x**3 / 3

    return Group(
        name, f"(3 {of}/G)^(1/3)", "t", of, ("G",), value, solve, "mm", f"thickness of {what}; sets {of}"
    )
