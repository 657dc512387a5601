"""The numerical choices of a run: how, not what, is computed.

Lengths are in thicknesses of the blade, and stiffnesses in G over ``detail``: the same problem in another
size has the same answer. One that is written with its unit stays what it is when the blade changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from cutbench.base.errors import require
from cutbench.base.toml import among, written
from cutbench.base.units import parse_quantity
from cutbench.case.tuning import MeshTuning, StepTuning, Tuning, WindowTuning

#: Bare numbers under these names are in mm.
ALIASES = {f"{name}_mm": name for name in ("h", "step", "step_min", "release", "damping")}
#: A specimen without a blade is a strip: what stands in for the thickness, in widths of it.
STRIP_UNIT = 7 / 120


@dataclass(frozen=True)
class Fixed:
    """A ``value`` in ``mm`` or ``1/mm`` that a person has given with its unit."""

    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value!r} {self.unit}"

    def __mul__(self, factor: float) -> Fixed:
        return replace(self, value=self.value * factor)

    __rmul__ = __mul__


def unit_mm(values: Mapping[str, Any]) -> Any:
    """The length that numerics are in, mm: the blade's thickness."""
    return values["thickness"] if "thickness" in values else STRIP_UNIT * values["width"]


def _within(default: float, low: float, high: float, chosen: bool = False, unit: str = "") -> Any:
    """A number with its bounds; ``chosen``: 0 lets the code choose. ``unit``: of one in thicknesses of the
    blade, or per thickness, that may be given so, too."""
    return field(default=default, metadata={"low": low, "high": high, "chosen": chosen, "unit": unit})


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
    h : float, thicknesses
        Element size at the cut plane, from where elements grow.
    corner : float
        Element size under the tip, in units of ``h``; 0: h/16, but not below 1/45 of the blade's thickness.
    shallow : float
        Element size on the cut plane down to three blade thicknesses, where cutting begins, in units of
        ``h``; further down it grows to ``h``. 0: h/4, but not below 1/11 of the blade's thickness.
    detail : float, thicknesses
        The finest length at the cut: elements around its front, the contact and the damping go with it, as
        all else goes with the thickness. 0: the thickness, six radii of the edge, or four cohesive zones,
        whichever is least, but not below an eighth of the thickness.
    around : float
        How far above and below the front of the cut elements are that small, in units of ``detail``; the
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
    penalty : float, 1/detail
        Contact stiffness, in G per penetration.
    stick : float, 1/detail
        Stiffness of sticking, in G per slip.
    release : float, thicknesses
        A face of the cut that had touched the blade keeps its adhesion up to this gap; 0: for ever, as in the
        paper.
    scaled : {"none", "cell"}
        Stiffnesses of contact as they are, or times a thickness over the diameter of the element, as in the
        paper.
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
    step : float, thicknesses
        Largest step of blade travel.
    step_min : float, thicknesses
        Smallest step; a run that needs a smaller one ends as stalled, with its curve.
    damage_step : float
        Growth of damage in a step that makes the next one smaller; twice as much refuses the step.
    energy_step : float
        Part of the blade's work over the largest step that a step may leave open; more refuses the step.
    damping : float, detail
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
    >>> str(coarse.h), coarse.element
    ('0.2 mm', 'P1')
    >>> coarse.step == 1 / 7  # of the blade's thickness
    True
    """

    h: float | Fixed = _within(5 / 56, 1e-3, 3.0, unit="mm")
    corner: float = _within(0.0, 0.005, 1.0, chosen=True)
    shallow: float = _within(0.0, 0.02, 1.0, chosen=True)
    detail: float | Fixed = _within(0.0, 1e-4, 1.0, chosen=True, unit="mm")
    around: float = _within(1.25, 0.0, 100.0)
    slender: float = _within(2.0, 1.0, 50.0)
    along: float = _within(4.0, 1.0, 20.0)
    layers: int = _within(0, 0, 200)
    layer_ratio: float = _within(1.0, 1.0, 20.0)
    element: str = _one_of("P2", "P1", "P2P1")
    normal: str = _one_of("tool", "material")
    gap: str = _one_of("distance", "ellipse")
    penalty: float | Fixed = _within(44800.0, 1e-3, 1e7, unit="1/mm")
    stick: float | Fixed = _within(1120.0, 1e-3, 1e7, unit="1/mm")
    release: float | Fixed = _within(1 / 700, 0.0, 10.0, unit="mm")
    scaled: str = _one_of("none", "cell")
    closing: float = _within(5000.0, 0.0, 1e6)
    multiplier: str = _one_of("carried", "none")
    augmentations: int = _within(0, 0, 50)
    facet_degree: int = _within(6, 1, 20)
    bulk_degree: int = _within(0, 0, 10)
    scheme: str = _one_of("monolithic", "staggered")
    stepping: str = _one_of("adaptive", "paper")
    predictor: str = _one_of("front", "line")
    step: float | Fixed = _within(1 / 7, 1e-6, 10.0, unit="mm")
    step_min: float | Fixed = _within(1 / 7000, 1e-9, 1.0, unit="mm")
    damage_step: float = _within(0.7, 1e-3, 1.0)
    energy_step: float = _within(0.1, 1e-4, 1.0)
    damping: float | Fixed = _within(3 / 7000, 0.0, 1.0, unit="mm")
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

        return asdict(self, dict_factory=lambda pairs: {name: _digits(value) for name, value in pairs})

    def written(self) -> dict[str, Any]:
        """Write the choices as ``set`` takes them, without the tuning.

        Returns
        -------
        dict
            Values by name; what has a unit as text.
        """
        values = {name: getattr(self, name) for name in _FIELDS}
        return {k: str(v) if isinstance(v, Fixed) else v for k, v in values.items()}

    def sizes(self, unit_mm: float, detail_mm: float = math.inf) -> Sizes:
        """Say what lengths and stiffnesses come to.

        Parameters
        ----------
        unit_mm : float, mm
            The blade's thickness.
        detail_mm : float, mm
            What ``detail`` is where it is chosen, if less than the thickness.

        Returns
        -------
        Sizes
            In mm, and G per mm.
        """
        of = dict.fromkeys(_SCALED, unit_mm)
        chosen = max(detail_mm, self.tuning.mesh.least_detail * unit_mm)
        detail = min(self._in_mm("detail", unit_mm) or chosen, unit_mm)
        of |= dict.fromkeys(("penalty", "stick", "damping"), detail)
        values = {name: self._in_mm(name, of[name]) for name in _SCALED}
        return Sizes(*(values | {"detail": detail}).values())

    def _in_mm(self, name: str, unit_mm: float) -> float:
        """A length in mm, or a stiffness in G per mm, of ``unit_mm``."""
        value = getattr(self, name)
        if isinstance(value, Fixed):
            return value.value
        return value * unit_mm if _SCALED[name].metadata["unit"] == "mm" else value / unit_mm

    def misfits(self, unit_mm: float) -> Iterator[tuple[str, str, str]]:
        """Say which lengths and stiffnesses are out of bounds for a blade.

        Parameters
        ----------
        unit_mm : float, mm
            The blade's thickness.

        Returns
        -------
        iterator of tuple of str
            The key, its value, and what would be right, of each.
        """
        for name, f in _SCALED.items():
            if not isinstance(value := getattr(self, name), Fixed):
                continue
            low, high = f.metadata["low"], f.metadata["high"]
            of = value.value / unit_mm if value.unit == "mm" else value.value * unit_mm
            if not (low * (1 - 1e-12) <= of <= high * (1 + 1e-12) or (of == 0 and f.metadata["chosen"])):
                bounds = (b * unit_mm if value.unit == "mm" else b / unit_mm for b in (low, high))
                low_mm, high_mm = (f"{b:.4g} {value.unit}" for b in bounds)
                expected = f"{low_mm} <= {name} <= {high_mm}, beside a blade of {unit_mm:g} mm"
                yield name, f"{value.value:g} {value.unit}", expected
        sizes = self.sizes(unit_mm)
        if sizes.step_min_mm > sizes.step_mm:
            expected = f"at most the largest step, {sizes.step_mm:g} mm"
            yield "step_min", f"{sizes.step_min_mm:g} mm", expected

    def finer(self, **factors: float) -> Numerics:
        """Multiply single choices.

        Parameters
        ----------
        **factors : float
            By name, such as ``h=0.5``.

        Returns
        -------
        Numerics
            All others stay; a unit does, too.
        """
        return replace(self, **{name: factor * getattr(self, name) for name, factor in factors.items()})

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
            among(key, key, KEYS, value=raw)
            name = ALIASES.get(key, key)
            require(name not in new, key, raw, f"one of '{key}' and '{name}', they are the same")
            new[name] = _read(name, key, raw)
        return replace(self, **new)


@dataclass(frozen=True)
class Sizes:
    """Lengths and stiffnesses of ``Numerics`` for one blade: mm, and G per mm; with the names of theirs."""

    h_mm: float
    detail_mm: float
    penalty_per_mm: float
    stick_per_mm: float
    release_mm: float
    step_mm: float
    step_min_mm: float
    damping_mm: float


#: Elements of a first look.
_COARSE: dict[str, Any] = {"h": 5 / 28, "corner": 0.25}
#: A block is a section drawn out: where it differs from the section's defaults. Elements are those of a first
#: look, for each of a section's is one in each layer, and under the tip as large whatever h is: gelatin meets
#: larger ones by the edge alone, and is not cut. Its surface does not see itself. Its planes jump one after
#: the other, and contacts switch in each: with a contact that yields by less than a fiftieth of an element,
#: ten times the damping and a ledger that may leave 2 % open the elastomer comes to 5 mm in minutes;
#: docs/validation/blocks.md says what that costs.
_SOLID = replace(
    Numerics(),
    h=_COARSE["h"],
    layers=2,
    self_contact="off",
    penalty=2800.0,
    stick=1792.0,
    damping=3 / 700,
    tuning=Tuning(
        steps=StepTuning(drift=0.02),
        mesh=MeshTuning(corner=(1 / 16, 1 / 22.4)),
        # A factorization of the part around the front costs more, against the rest, than in a section.
        window=WindowTuning(reach=0.5),
    ),
)
#: And of a quick look at a block: one layer, and elements that grow on below the first cut.
_QUICK: dict[str, Any] = {"h": 5 / 14, "layers": 1}
#: A block of tetrahedra of its own, as few as a run in minutes allows. Faces larger than the tip is round
#: meet its apex alone: along the tool's normal they would be pushed down, not apart. Their contact is the
#: soft one that such blocks were measured with.
_TETRAHEDRA = Numerics(
    h=10 / 7,
    detail=1.0,
    corner=0.25,
    shallow=1.0,
    around=0.0,
    slender=8.0,
    facet_degree=4,
    bulk_degree=2,
    damage_step=0.5,
    energy_step=0.05,
    normal="material",
    penalty=700.0,
    stick=280.0,
    multiplier="none",
)
#: Where a preset for first looks differs, in sections: larger elements and a contact four times as soft.
_FAST: dict[str, Any] = {**_COARSE, "penalty": 11200.0, "stick": 280.0}


def defaults(dim: int) -> Numerics:
    """Return the numerical choices of a case that makes none."""
    return _SOLID if dim == 3 else Numerics()


#: The paper's mean edge, 1.5 mm, of 47,801 tetrahedra in 30 × 30 × 21 mm, beside a blade of 0.7 mm.
PAPER_EDGE = 15 / 7
#: Its penalties are printed without units. t_N = ε_N/h g, with a gap that is a number, makes ε_N = 1 N/mm: in
#: SI units it were no contact. t_T = ε_T/h Δu makes ε_T = 1e8 a stress. It is read in Pa, 100 N/mm²: what 1e8
#: N/mm² makes of the rounding of Δu is more than a tolerance bears. From half of this on results are the same
#: to 0.4 %, for nothing slips before it has to.
PAPER_PENALTY, PAPER_STICK = 1.0, 100.0
#: Updates of its multipliers, "successive iterations", at the most.
PAPER_UPDATES = 50
#: In three dimensions elements grow away from the cut plane: this size on it gives as many as the paper's.
PAPER_SOLID: dict[str, Any] = {"h": 17 / 14, "along": 1.25}
#: Sets of choices under one word.
PRESETS = ("converged", "fast", "paper")
#: And what only blocks have.
SOLID_PRESETS = (*PRESETS, "tetrahedra")


def preset(name: object, dim: int, modulus: float, thickness: float) -> Numerics:
    """Return a named set of numerical choices, for a shear modulus and a blade.

    ``converged``: the defaults. ``fast``: elements twice as tall and a contact four times as soft;
    docs/validation/convergence.md says what that costs; of a block, elements twice as tall in fewer
    layers. ``tetrahedra``: a block of elements of its own, coarse and graded along the blade, too, as a
    mesh file's are. ``paper``: linear elements of the paper's size, the material's normal, its
    dimensionless gap 1 − (x−c)ᵀA(x−c) with ε_N/h, h the element's diameter, and multipliers that are
    updated until they stand still, sticking with ε_T/h, a cut plane that resists closing as it resists
    opening, damage staggered, its steps. Strengths of friction and adhesion follow the last step's
    pressure all the same, not this one's. Raises BadInput.
    """
    among("numerics", name, SOLID_PRESETS if dim == 3 else PRESETS)
    start = defaults(dim)
    if name == "fast":
        return replace(start, **(_QUICK if dim == 3 else _FAST))
    if name == "tetrahedra":
        return _TETRAHEDRA
    if name == "converged":
        return start
    # Our ellipse gap is a/2 times the dimensionless one. Both are divided by the element's diameter in mm.
    penalty = 2 * PAPER_PENALTY / (modulus * thickness / 2)
    size = PAPER_SOLID if dim == 3 else {"h": PAPER_EDGE}
    return replace(
        _TETRAHEDRA if dim == 3 else start,
        **size,
        detail=1.0,
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
        release=0.0,
        closing=0.0,
        self_contact="off",
        scheme="staggered",
        stepping="paper",
        predictor="line",
        step=2 / 7,
        damage_step=0.1,
    )


#: What stands for something that no test has measured: choices that are scaled together, and the factors.
UNMEASURED = {"contact stiffness": (("penalty", "stick"), (0.5, 4.0))}

#: What a person may set.
_FIELDS = {f.name: f for f in fields(Numerics) if f.name != "tuning"}
#: All names that may be set, long and short.
KEYS = (*_FIELDS, *ALIASES)
#: Lengths and stiffnesses.
_SCALED = {name: f for name, f in _FIELDS.items() if f.metadata.get("unit")}


def _digits(value: object) -> object:
    if isinstance(value, tuple):
        return [_digits(each) for each in value]
    return f"{value:.14g}" if isinstance(value, float) else value


def _read(name: str, key: str, raw: object) -> object:
    about = _FIELDS[name].metadata
    if not about:
        return None if raw is None else written(key, raw, "the path of a mesh file")
    if "choices" in about:
        among(key, raw, about["choices"])
        return raw
    if about["unit"] and isinstance(value := _scaled(key, raw, about["unit"]), Fixed):
        return value  # its bounds are in thicknesses of a blade, see ``misfits``
    low, high, whole = about["low"], about["high"], _FIELDS[name].type == "int"
    value = parse_quantity(raw, "1", key=key)
    wanted = "0 or " * about["chosen"] + "a whole number, " * whole + f"{low:g} <= {key} <= {high:g}"
    if about["unit"]:
        wanted += " thicknesses of the blade, or a length with its unit" * (about["unit"] == "mm")
    inside = low <= value <= high or (value == 0 and about["chosen"])
    require(inside and (not whole or value == int(value)), key, raw, wanted)
    return int(value) if whole else value + 0.0  # turns -0.0 into 0.0


def _scaled(key: str, raw: object, unit: str) -> object:
    """``raw`` with its unit, where it has one, or the key has."""
    bare = raw
    if isinstance(raw, str):
        try:
            bare = float(raw)
        except ValueError:
            bare = Fixed(parse_quantity(raw, unit, key=key), unit)
    if key in ALIASES and isinstance(bare, (int, float)) and not isinstance(bare, bool):
        bare = Fixed(float(bare), unit)
    if isinstance(bare, Fixed):
        sized = math.isfinite(bare.value) and bare.value >= 0
        require(sized, key, raw, "a number above 0 with its unit, such as '0.1 mm'")
    return bare
