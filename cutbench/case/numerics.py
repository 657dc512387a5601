"""The numerical choices of a run: how, not what, is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from cutbench.base.errors import BadInput
from cutbench.base.toml import one_of
from cutbench.base.units import parse_quantity

CHOICES: dict[str, tuple[str, ...]] = {
    "element": ("P1", "P2", "P2P1"),
    "normal": ("tool", "material"),
    "gap": ("distance", "ellipse"),
    "multiplier": ("carried", "none"),
    "scheme": ("monolithic", "staggered"),
    "symmetry": ("auto", "quarter", "half", "full"),
    "stepping": ("adaptive", "paper"),
    "predictor": ("front", "line", "repeat"),
    "solver": ("auto", "superlu", "pardiso", "kept", "multigrid"),
}
#: Smallest and largest value of each number (None: no bound); ``h`` and steps are in mm.
_RANGES: dict[str, tuple[float | None, float | None]] = {
    "h_mm": (1e-3, 10.0),
    "corner": (0.005, 1.0),
    "shallow": (0.02, 1.0),
    "around": (0.0, 100.0),
    "slender": (1.0, 50.0),
    "along": (1.0, 20.0),
    "penalty": (1e-3, 1e6),
    "stick": (1e-3, 1e6),
    "closing": (0.0, 1e6),
    "augmentations": (0, 50),
    "damping_mm": (0.0, 1.0),
    "layer": (0.0, 100.0),
    "facet_degree": (1, 20),
    "bulk_degree": (0, 10),
    "step_mm": (1e-6, 5.0),
    "step_min_mm": (1e-9, 1.0),
    "damage_step": (1e-3, 1.0),
    "energy_step": (1e-4, 1.0),
    "tolerance": (1e-14, 1e-2),
}
#: Sizes that are chosen where they are 0.
_CHOSEN = ("corner", "shallow")
#: A length may be written with its unit under the short name (h = "0.4 mm") or bare under the long (h_mm).
ALIASES = {"h": "h_mm", "step": "step_mm", "step_min": "step_min_mm"}


@dataclass(frozen=True)
class Numerics:
    """Every choice that is numerical; part of a case's identity."""

    h_mm: float = 0.03125  # element size along the cut plane
    corner: float = 0.0  # the same under the tip, in units of h; 0: h/16, but not below 1/90 of the blade
    shallow: float = 0.0  # and where the cut surges, in units of h; 0: h/4, but not below 1/22 of the blade
    around: float = (
        1.25  # where they are small: blade thicknesses about the front, going with it; 0: all (2D)
    )
    slender: float = 2.0  # elements at the cut plane are this many times taller than wide
    along: float = 4.0  # and this many times longer along the blade than tall, at the most (3D)
    element: str = "P2"  # P1 | P2 | P2P1 (mixed)
    normal: str = "tool"  # tool | material
    gap: str = "distance"  # distance | ellipse (the paper's dimensionless one)
    penalty: float = 64000.0  # contact stiffness, in G per mm of penetration
    stick: float = 25600.0  # stiffness of sticking, G per mm of slip
    closing: float = 5000.0  # pressure at which the closed cut plane would overlap by delta_c, in G
    multiplier: str = "carried"  # a step begins with the last one's contact pressure | none
    augmentations: int = 0  # Uzawa updates a step at the most
    facet_degree: int = 6  # quadrature degree on faces
    bulk_degree: int = 0  # 0: what the element needs
    scheme: str = "monolithic"  # monolithic | staggered (damage lags, repeated until it stands still)
    stepping: str = "adaptive"  # adaptive | paper (a tenth when damage jumps, else five times)
    predictor: str = "front"  # front (solved there first) | line | repeat (what was one element higher)
    step_mm: float = 0.05  # largest step
    step_min_mm: float = 1e-4
    damage_step: float = 0.5  # the step shrinks if damage grows by more in one
    energy_step: float = 0.05  # a step is refused if its energy closes worse than this
    damping_mm: float = 3e-4  # bulk viscosity over G, times the speed: carries the run through snaps
    layer: float = 1.0  # the surfaces at the blade resist bending as a layer that many delta_c thick
    tolerance: float = 1e-8
    symmetry: str = "auto"  # auto (the smallest part) | quarter (3D) | half | full
    solver: str = "auto"  # auto | superlu | pardiso | kept | multigrid
    mesh: str | None = None  # a mesh file of the user's

    def set(self, values: Mapping[str, object]) -> Numerics:
        """With ``values`` as a person wrote them. BadInput names the key and what would be right."""
        new: dict[str, object] = {}
        for key, raw in values.items():
            name = ALIASES.get(key, key)
            if name not in _KINDS:
                raise BadInput(key=key, value=raw, expected=one_of(key, KEYS))
            if name in new:
                raise BadInput(key=key, value=raw, expected=f"one of '{key}' and '{name}', they are the same")
            new[name] = _read(name, key, raw)
        made = replace(self, **new)
        if made.step_min_mm > made.step_mm:
            key = next((k for k in values if ALIASES.get(k, k) in ("step_mm", "step_min_mm")), "step_min_mm")
            value = made.step_mm if ALIASES.get(key, key) == "step_mm" else made.step_min_mm
            raise BadInput(
                key=key,
                value=f"{value:g} mm",
                expected=f"the smallest step ({made.step_min_mm:g} mm) to be at most"
                f" the largest ({made.step_mm:g} mm)",
            )
        return made


#: Where a solid's defaults differ: its elements are as few as a run in minutes allows. Faces larger than the
#: tip is round meet its apex alone: along the tool's normal they would be pushed down, not apart. Their
#: contact is the soft one that blocks were measured with.
_SOLID = {
    "h_mm": 1.0,
    "corner": 0.25,
    "shallow": 1.0,
    "around": 0.0,
    "step_mm": 0.1,
    "slender": 8.0,
    "facet_degree": 4,
    "bulk_degree": 2,
    "normal": "material",
    "penalty": 1000.0,
    "stick": 400.0,
    "multiplier": "none",
}


def defaults(dim: int) -> Numerics:
    """The choices of a case that makes none, in 2 or 3 dimensions."""
    return Numerics(**_SOLID) if dim == 3 else Numerics()


#: The paper's mean edge in mm, of 47,801 tetrahedra in 30 × 30 × 21 mm, and its penalty ε_N in N/mm².
PAPER_EDGE, PAPER_PENALTY = 1.5, 1.0
#: The paper does not give its stiffness of sticking; in G per mm.
PAPER_STICK = 400.0
#: In three dimensions elements grow away from the cut plane: this size on it gives as many as the paper's.
PAPER_SOLID = {"h_mm": 0.85, "along": 1.25}
#: Sets of choices under one word.
PRESETS = ("converged", "paper")


def preset(name: object, values: Mapping[str, float], dim: int) -> Numerics:
    """The numerics called ``name``; ``values`` give G and the blade. BadInput for an unknown name.

    ``converged``: the defaults. ``paper``: linear elements of the paper's size, the material's normal, its
    dimensionless gap 1 − (x−c)ᵀA(x−c) with ε_N = 1 N/mm² and no multiplier, a cut plane that resists closing
    as it resists opening, damage and adhesion staggered, its steps.
    """
    if name not in PRESETS:
        raise BadInput(key="numerics", value=name, expected=one_of(str(name), PRESETS))
    start = defaults(dim)
    if name == "converged":
        return start
    # Our ellipse gap is a/2 times the dimensionless one, and the penalty is in G per mm of it.
    penalty = 2 * PAPER_PENALTY / (values["G"] * values["thickness"] / 2)
    size = PAPER_SOLID if dim == 3 else {"h_mm": PAPER_EDGE}
    return replace(
        start,
        **size,
        corner=1.0,
        shallow=1.0,
        around=0.0,
        slender=1.0,
        element="P1",
        normal="material",
        gap="ellipse",
        penalty=penalty,
        stick=PAPER_STICK,
        multiplier="none",
        closing=0.0,
        layer=0.0,
        scheme="staggered",
        stepping="paper",
        predictor="line",
        step_mm=0.2,
        step_min_mm=1e-4,
        damage_step=0.1,
        augmentations=0,
    )


_KINDS = {f.name: str(f.type) for f in fields(Numerics)}
#: All names that may be set, long and short.
KEYS = (*ALIASES, *_KINDS)


def _read(name: str, key: str, raw: object) -> object:
    if name == "mesh":
        if raw is None:
            return None
        if not isinstance(raw, str) or not raw:
            raise BadInput(key=key, value=raw, expected="the path of a mesh file")
        return raw
    if name in CHOICES:
        if not isinstance(raw, str) or raw not in CHOICES[name]:
            raise BadInput(key=key, value=raw, expected=one_of(str(raw), CHOICES[name]))
        return raw
    low, high = _RANGES[name]
    unit = " mm" if name.endswith("_mm") else ""
    wanted = f"{low:g}{unit} <= {key} <= {high:g}{unit}"
    if name in _CHOSEN:
        wanted = f"0 or {wanted}"
    value = _number(name, key, raw, wanted)
    if value == 0 and name in _CHOSEN:
        return 0.0
    if not math.isfinite(value) or not low <= value <= high:
        raise BadInput(key=key, value=raw, expected=wanted)
    if _KINDS[name] == "int":
        if value != int(value):
            raise BadInput(key=key, value=raw, expected=f"a whole number, {wanted}")
        return int(value)
    return float(value)


def _number(name: str, key: str, raw: object, wanted: str) -> float:
    if not name.endswith("_mm"):
        return parse_quantity(raw, "1", key=key)
    if key == name:  # the unit is in the name, so the number may stand bare
        if isinstance(raw, (int, float)) and not isinstance(raw, bool):
            return float(raw)
        if isinstance(raw, str):
            try:
                return float(raw)
            except ValueError:
                pass
    return parse_quantity(raw, "mm", key=key)
