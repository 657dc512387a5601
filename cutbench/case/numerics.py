"""The numerical choices of a run: how, not what, is computed."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from cutbench.base.errors import BadInput
from cutbench.base.toml import among, one_of
from cutbench.base.units import parse_quantity
from cutbench.case.tuning import MeshTuning, StepTuning, Tuning, WindowTuning

#: A length may be written with its unit under the short name (h = "0.4 mm") or bare under the long (h_mm).
ALIASES = {"h": "h_mm", "step": "step_mm", "step_min": "step_min_mm", "release": "release_mm"}


def _within(default: float, low: float, high: float, chosen: bool = False) -> Any:
    """A number with its bounds; ``chosen``: 0 lets the code choose. Names that end in _mm are lengths."""
    return field(default=default, metadata={"low": low, "high": high, "chosen": chosen})


def _one_of(default: str, *others: str) -> Any:
    return field(default=default, metadata={"choices": (default, *others)})


@dataclass(frozen=True)
class Numerics:
    """Numerics holds every numerical choice of a run: mesh, elements, contact, steps and tolerances.

    All are part of a case's identity. docs/made.py makes its table of the texts below.

    ``Case.set`` takes them by their names, with a unit where there is one (``h="0.2 mm"`` for ``h_mm``), and
    ``preset`` has named sets of them.

    Attributes
    ----------
    h_mm : float, mm
        Element size at the cut plane, from where elements grow; at most 3 times the blade's thickness.
    corner : float
        Element size under the tip, in units of ``h``; 0: h/16, but not below 1/45 of the blade's thickness.
    shallow : float
        Element size on the cut plane down to three blade thicknesses, where cutting begins, in units of
        ``h``; further down it grows to ``h``. 0: h/4, but not below 1/11 of the blade's thickness.
    around : float
        How far above and below the front of the cut elements are that small, in blade thicknesses; the
        section is meshed anew as the front goes down. 0: one mesh with small elements all the way.
    slender : float
        Elements at the cut plane are so many times taller than wide.
    along : float
        Tetrahedra of a block that has no layers are at most so many times longer along the blade than tall.
    layers : int
        Layers along half the blade of a block that is a section drawn out; 0: tetrahedra of its own.
    layer_ratio : float
        The layer in the middle of the blade is so many times as thick as that at its end.
    element : {"P2", "P1", "P2P1"}
        Quadratic or linear displacements, or quadratic ones with a linear pressure. P1 locks near ν = 0.5.
    normal : {"tool", "material"}
        Direction of the contact pressure: the blade's normal, or the material's, as in the paper.
    gap : {"distance", "ellipse"}
        Signed distance to the blade, or the paper's number times half the blade's thickness.
    penalty : float, 1/mm
        Contact stiffness, in G per mm of penetration.
    stick : float, 1/mm
        Stiffness of sticking, in G per mm of slip.
    release_mm : float, mm
        A face of the cut that had touched the blade keeps its adhesion up to this gap; 0: for ever, as in the
        paper.
    scaled : {"none", "cell"}
        Stiffnesses of contact as they are, or times 1 mm over the diameter of the element, as in the paper.
    closing : float
        Pressure at which the closed cut plane would overlap by δ_c, in G.
    multiplier : {"carried", "none"}
        A step begins with the contact pressure and shear foreseen from the last two, or with no pressure and
        the last shear.
    augmentations : int
        Uzawa updates a step at the most, until pressures stand still.
    facet_degree : int
        Quadrature degree on faces.
    bulk_degree : int
        Quadrature degree in elements; 0: what the element needs beside a cut.
    scheme : {"monolithic", "staggered"}
        Damage solved with the displacements, or held and repeated until it stands still.
    stepping : {"adaptive", "paper"}
        Steps by effort and damage growth, or the paper's rule: a tenth when damage jumps, else five times.
    predictor : {"front", "line"}
        Newton's method begins on a line through the last two states; with ``front`` the elements around the
        front are solved first.
    step_mm : float, mm
        Largest step of blade travel.
    step_min_mm : float, mm
        Smallest step; a run that needs a smaller one ends as stalled, with its curve.
    damage_step : float
        Growth of damage in a step that makes the next one smaller; twice as much refuses the step.
    energy_step : float
        Part of the blade's work over the largest step that a step may leave open; more refuses the step.
    damping_mm : float, mm
        Bulk viscosity over G, times the speed; it carries a run through jumps.
    self_contact : {"on", "off"}
        Whether a section's surface beside the blade is kept from passing through itself.
    tolerance : float
        Newton's residual relative to the forces in balance.
    symmetry : {"auto", "quarter", "half", "full"}
        Part of the block that is meshed; auto: the smallest that will do.
    solver : {"auto", "superlu", "pardiso", "kept", "multigrid"}
        Linear solver; auto: PARDISO where installed, else SuperLU.
    mesh : str or None
        A mesh file.
    tuning : Tuning
        The numbers that nobody sets.

    Examples
    --------
    >>> import cutbench
    >>> coarse = cutbench.Numerics().set({"h": "0.2 mm", "element": "P1"})
    >>> coarse.h_mm, coarse.element
    (0.2, 'P1')
    """

    h_mm: float = _within(0.0625, 1e-3, 10.0)
    corner: float = _within(0.0, 0.005, 1.0, chosen=True)
    shallow: float = _within(0.0, 0.02, 1.0, chosen=True)
    around: float = _within(1.25, 0.0, 100.0)
    slender: float = _within(2.0, 1.0, 50.0)
    along: float = _within(4.0, 1.0, 20.0)
    layers: int = _within(0, 0, 200)
    layer_ratio: float = _within(1.0, 1.0, 20.0)
    element: str = _one_of("P2", "P1", "P2P1")
    normal: str = _one_of("tool", "material")
    gap: str = _one_of("distance", "ellipse")
    penalty: float = _within(64000.0, 1e-3, 1e6)
    stick: float = _within(1600.0, 1e-3, 1e6)
    release_mm: float = _within(0.001, 0.0, 10.0)
    scaled: str = _one_of("none", "cell")
    closing: float = _within(5000.0, 0.0, 1e6)
    multiplier: str = _one_of("carried", "none")
    augmentations: int = _within(0, 0, 50)
    facet_degree: int = _within(6, 1, 20)
    bulk_degree: int = _within(0, 0, 10)
    scheme: str = _one_of("monolithic", "staggered")
    stepping: str = _one_of("adaptive", "paper")
    predictor: str = _one_of("front", "line")
    step_mm: float = _within(0.1, 1e-6, 5.0)
    step_min_mm: float = _within(1e-4, 1e-9, 1.0)
    damage_step: float = _within(0.7, 1e-3, 1.0)
    energy_step: float = _within(0.1, 1e-4, 1.0)
    damping_mm: float = _within(3e-4, 0.0, 1.0)
    self_contact: str = _one_of("on", "off")
    tolerance: float = _within(1e-7, 1e-14, 1e-2)
    symmetry: str = _one_of("auto", "quarter", "half", "full")
    solver: str = _one_of("auto", "superlu", "pardiso", "kept", "multigrid")
    mesh: str | None = None
    tuning: Tuning = field(default_factory=Tuning)

    def digits(self) -> dict[str, Any]:
        """Write the choices as they count in a case's id.

        Returns
        -------
        dict
            Values by name, floats as text of 14 digits.
        """

        def shown(value: object) -> object:
            if isinstance(value, dict):
                return {k: shown(v) for k, v in value.items()}
            if isinstance(value, tuple):
                return [shown(v) for v in value]
            return f"{value:.14g}" if isinstance(value, float) else value

        return {k: shown(v) for k, v in asdict(self).items()}

    def set(self, values: Mapping[str, object]) -> Numerics:
        """Return new choices with values as a person wrote them.

        Parameters
        ----------
        values : mapping of str to object
            By name: numbers, words, or text with a unit, such as ``{"h": "0.2 mm"}``.

        Returns
        -------
        Numerics
            All others stay.

        Raises
        ------
        BadInput
            For an unknown name or a value that is not allowed; it names the key and what would be right.
        """
        new: dict[str, Any] = {}
        for key, raw in values.items():
            name = ALIASES.get(key, key)
            if name not in _FIELDS:
                raise BadInput(key=key, value=raw, expected=one_of(key, KEYS))
            if name in new:
                raise BadInput(key=key, value=raw, expected=f"one of '{key}' and '{name}', they are the same")
            new[name] = _read(name, key, raw)
        made = replace(self, **new)
        if made.step_min_mm > made.step_mm:
            key = next((k for k in values if ALIASES.get(k, k) in ("step_mm", "step_min_mm")), "step_min_mm")
            value = made.step_mm if ALIASES.get(key, key) == "step_mm" else made.step_min_mm
            expected = (
                f"the smallest step ({made.step_min_mm:g} mm) to be at most the largest ({made.step_mm:g} mm)"
            )
            raise BadInput(key=key, value=f"{value:g} mm", expected=expected)
        return made


#: Elements of a first look.
_COARSE: dict[str, Any] = {"h_mm": 0.125, "corner": 0.25}
#: A block is a section drawn out: where it differs from the section's defaults. Elements are those of a first
#: look, for each of a section's is one in each layer, and under the tip as large whatever h is: gelatin meets
#: larger ones by the edge alone, and is not cut. Its surface does not see itself. Its planes jump one after
#: the other, and contacts switch in each: with a contact that yields by less than a fiftieth of an element,
#: ten times the damping and a ledger that may leave 2 % open the elastomer comes to 5 mm in minutes;
#: docs/validation/blocks.md says what that costs.
_SOLID = replace(
    Numerics(),
    h_mm=_COARSE["h_mm"],
    layers=2,
    self_contact="off",
    penalty=4000.0,
    stick=2560.0,
    damping_mm=3e-3,
    tuning=Tuning(
        steps=StepTuning(drift=0.02),
        mesh=MeshTuning(corner=(1 / 16, 1 / 22.4)),
        # A factorization of the part around the front costs more, against the rest, than in a section.
        window=WindowTuning(reach=0.5),
    ),
)
#: And of a quick look at a block: one layer, and elements that grow on below the first cut.
_QUICK: dict[str, Any] = {"h_mm": 0.25, "layers": 1}
#: A block of tetrahedra of its own, as few as a run in minutes allows. Faces larger than the tip is round
#: meet its apex alone: along the tool's normal they would be pushed down, not apart. Their contact is the
#: soft one that such blocks were measured with.
_TETRAHEDRA = Numerics(
    h_mm=1.0,
    corner=0.25,
    shallow=1.0,
    around=0.0,
    step_mm=0.1,
    slender=8.0,
    facet_degree=4,
    bulk_degree=2,
    damage_step=0.5,
    energy_step=0.05,
    normal="material",
    penalty=1000.0,
    stick=400.0,
    multiplier="none",
)
#: Where a preset for first looks differs, in sections: larger elements and a contact four times as soft.
_FAST: dict[str, Any] = {**_COARSE, "penalty": 16000.0, "stick": 400.0}


def defaults(dim: int) -> Numerics:
    """Return the numerical choices of a case that makes none.

    Parameters
    ----------
    dim : int
        2 for plane strain, 3 for a block.

    Returns
    -------
    Numerics
        The converged ones.
    """
    return _SOLID if dim == 3 else Numerics()


#: The paper's mean edge in mm, of 47,801 tetrahedra in 30 × 30 × 21 mm.
PAPER_EDGE = 1.5
#: Its penalties are printed without units. t_N = ε_N/h g, with a gap that is a number, makes ε_N = 1 N/mm: in
#: SI units it were no contact. t_T = ε_T/h Δu makes ε_T = 1e8 a stress. It is read in Pa, 100 N/mm²: what 1e8
#: N/mm² makes of the rounding of Δu is more than a tolerance bears. From half of this on results are the same
#: to 0.4 %, for nothing slips before it has to.
PAPER_PENALTY, PAPER_STICK = 1.0, 100.0
#: Updates of its multipliers, "successive iterations", at the most.
PAPER_UPDATES = 50
#: In three dimensions elements grow away from the cut plane: this size on it gives as many as the paper's.
PAPER_SOLID: dict[str, Any] = {"h_mm": 0.85, "along": 1.25}
#: Sets of choices under one word.
PRESETS = ("converged", "fast", "paper")
#: And what only blocks have.
SOLID_PRESETS = (*PRESETS, "tetrahedra")


def preset(name: object, dim: int, modulus: float, thickness: float) -> Numerics:
    """Return a named set of numerical choices, for a shear modulus and a blade.

    ``converged``: the defaults. ``fast``: elements twice as tall and a contact four times as soft;
    docs/validation/convergence.md says what that costs; of a block, elements twice as tall in fewer layers.
    ``tetrahedra``: a block of elements of its own, coarse and graded along the blade, too, as a mesh file's
    are. ``paper``: linear elements of the paper's size, the material's normal, its dimensionless gap 1 −
    (x−c)ᵀA(x−c) with ε_N/h, h the element's diameter, and multipliers that are updated until they stand
    still, sticking with ε_T/h, a cut plane that resists closing as it resists opening, damage staggered, its
    steps. Strengths of friction and adhesion follow the last step's pressure all the same, not this one's.

    Parameters
    ----------
    name : object
        The name of the set.
    dim : int
        2 for plane strain, 3 for a block.
    modulus : float, MPa
        Shear modulus, by which the paper's stiffnesses become those of this package.
    thickness : float, mm
        Thickness of the blade, for the same.

    Returns
    -------
    Numerics
        The whole set.

    Raises
    ------
    BadInput
        For an unknown name.
    """
    among("numerics", name, SOLID_PRESETS if dim == 3 else PRESETS)
    start = defaults(dim)
    if name == "fast":
        return replace(start, **(_QUICK if dim == 3 else _FAST))
    if name == "tetrahedra":
        return _TETRAHEDRA
    if name == "converged":
        return start
    # Our ellipse gap is a/2 times the dimensionless one, and the penalty is in G per mm of it.
    penalty = 2 * PAPER_PENALTY / (modulus * thickness / 2)
    size = PAPER_SOLID if dim == 3 else {"h_mm": PAPER_EDGE}
    return replace(
        _TETRAHEDRA if dim == 3 else start,
        **size,
        corner=1.0,
        shallow=1.0,
        around=0.0,
        slender=1.0,
        element="P1",
        normal="material",
        gap="ellipse",
        penalty=penalty,
        stick=PAPER_STICK / modulus,
        scaled="cell",
        multiplier="none",
        augmentations=PAPER_UPDATES,
        release_mm=0.0,
        closing=0.0,
        self_contact="off",
        scheme="staggered",
        stepping="paper",
        predictor="line",
        step_mm=0.2,
        damage_step=0.1,
    )


#: What stands for something that no test has measured: choices that are scaled together, and the factors.
UNMEASURED = {"contact stiffness": (("penalty", "stick"), (0.5, 4.0))}

#: What a person may set.
_FIELDS = {f.name: f for f in fields(Numerics) if f.name != "tuning"}
#: All names that may be set, long and short.
KEYS = (*ALIASES, *_FIELDS)


def _read(name: str, key: str, raw: object) -> object:
    if name == "mesh":
        if raw is None:
            return None
        if not isinstance(raw, str) or not raw:
            raise BadInput(key=key, value=raw, expected="the path of a mesh file")
        return raw
    about = _FIELDS[name].metadata
    if "choices" in about:
        among(key, raw, about["choices"])
        return raw
    low, high = about["low"], about["high"]
    unit = " mm" if name.endswith("_mm") else ""
    wanted = f"{low:g}{unit} <= {key} <= {high:g}{unit}"
    if about["chosen"]:
        wanted = f"0 or {wanted}"
    value = _length(name, key, raw) if unit else parse_quantity(raw, "1", key=key)
    if value == 0 and about["chosen"]:
        return 0.0
    if not math.isfinite(value) or not low <= value <= high:
        raise BadInput(key=key, value=raw, expected=wanted)
    if _FIELDS[name].type == "int":
        if value != int(value):
            raise BadInput(key=key, value=raw, expected=f"a whole number, {wanted}")
        return int(value)
    return float(value)


def _length(name: str, key: str, raw: object) -> float:
    if key == name and isinstance(raw, (int, float, str)) and not isinstance(raw, bool):
        with contextlib.suppress(ValueError):
            return float(raw)  # the unit is in the name, so the number may stand bare
    return parse_quantity(raw, "mm", key=key)
