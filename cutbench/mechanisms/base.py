"""What a mechanism is: one effect, in numpy, without a mesh.

A law sees arrays whose last axis runs over points and returns new arrays; it stores nothing. It stays clear
of ``abs`` and ``norm``, so a complex step has its tangents (by kinematics) and sensitivities (by parameters).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cutbench.base.units import Parameter

#: Length of the complex step: far below rounding of the real part, so no cancellation.
STEP = 1e-30

#: What laws read as the stiffness of the bulk: a parameter where a bulk law declares it, else what the bulk
#: laws of a model come to under slow loading at small strain.
MODULUS = "G"

State = dict[str, np.ndarray]
Params = Any  # attribute access by parameter name: p.G, p.nu


class Points(SimpleNamespace):
    """What a law may know about the points it is evaluated at, besides its kinematics: ``X`` (3, N) reference
    position in mm with X[1] the height; ``depth`` (N,) distance below the top face in the reference state;
    ``dt`` seconds; ``speed`` blade speed mm/s; slots add theirs (``jump_old``, ``slip_rate``, …). ``laws``
    (slot bulk): all bulk laws of the model, for one that scales what others answer. ``before`` (slot cut):
    what the laws of lower ``Mechanism.rank`` have answered, by role. ``held``: internal variables keep their
    old values, and ``dt`` is not needed. ``closing`` (slot cut): pressure in G at which closed faces would
    overlap by δ_c.
    """

    held = False
    before: Mapping[str | None, Answer] = {}
    #: With a pressure of G closed faces overlap by δ_c/70. A softer cut plane gives way under a blunt tip and
    #: wrinkles, and the onset of cutting then follows the mesh.
    closing = 5000.0


@dataclass(frozen=True)
class Group:
    """A number that a person may set in place of a parameter: a dimensionless group, or one with a ``unit``.

    ``text`` is its formula as in ``Mechanism.groups``, ``symbol`` as pictures write it, ``title`` in words.
    ``value(p)`` is the number, ``solve(p, x)`` the ``parameter`` that gives it, from what it ``needs``."""

    name: str
    text: str
    symbol: str
    parameter: str
    needs: tuple[str, ...]
    value: Callable[[Params], float]
    solve: Callable[[Params, float], float]
    unit: str = "1"
    title: str = ""

    @property
    def quantity(self) -> Parameter:
        """The number as a parameter, for reading what a person wrote."""
        return Parameter(self.name, self.unit, self.text, self.title or f"sets {self.parameter}", low=0)


class Estimate(NamedTuple):
    """What a law adds to estimates with pencil and paper; those of a model's laws add up.

    ``strength`` MPa and ``opening`` mm at the peak of the cohesion, ``work`` mJ/mm² of cutting at a steady
    rate, ``drag`` MPa on the blade's flanks at no pressure."""

    strength: float = 0.0
    opening: float = 0.0
    work: float = 0.0
    drag: float = 0.0


class Mechanism:
    """Base of all slots. Subclasses are stateless; one instance of each lives in the registry."""

    name: ClassVar[str]
    slot: ClassVar[str]
    title: ClassVar[str]
    #: Its class of effects (if none, its title); parameters of which cuts at several speeds seem to differ.
    family: ClassVar[str] = ""
    resembles: ClassVar[tuple[str, ...]] = ()
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    #: Names of parameters of other mechanisms that the law reads (G_c, for a term scaled by it).
    reads: ClassVar[tuple[str, ...]] = ()
    #: Laws of one slot run in ascending rank; what a law shares is there for higher ranks.
    rank: ClassVar[int] = 0
    #: At most one mechanism of a role is in a model (the cohesive law, the viscous form, …).
    role: ClassVar[str | None] = None
    #: Roles without whose answers the law has none: a model that has the law has them too.
    follows: ClassVar[tuple[str, ...]] = ()
    #: Whether the law, not what is derived from it, is in the default model, and in the paper's.
    standard: ClassVar[bool] = False
    published: ClassVar[bool] = False
    #: Whether it is there for the march's sake alone: paths of equilibria leave it out.
    regularises: ClassVar[bool] = False
    #: Of a law whose effect has a direction in the body: its angle by which a specimen is turned that was
    #: cut out otherwise.
    directed: ClassVar[str] = ""
    #: Words for it that set nothing, and what to write instead.
    meant: ClassVar[Mapping[str, str]] = {}
    #: What a person may set in place of the law's parameters, in case files, studies and options.
    settable: ClassVar[tuple[Group, ...]] = ()
    #: Laws, by name, that could stand in its place for all that tests have told.
    alternatives: ClassVar[tuple[str, ...]] = ()

    def __repr__(self) -> str:
        return f"<{self.slot} law {self.name}: {self.title}>"

    def __init_subclass__(cls) -> None:
        for flag in ("standard", "published"):
            setattr(cls, flag, vars(cls).get(flag, False))

    def groups(self, p: Params) -> Mapping[str, float]:
        """The law's dimensionless groups, by their text: ``{"(G_c/delta_c)/G": 10.1}``."""
        return {}

    def like(self, p: Params) -> Mapping[str, Any]:
        """Values of what it ``resembles`` with which a model without it does the same; none if unknown."""
        return {}

    def estimate(self, p: Params, rate: float, width: float) -> Estimate:
        """The law's part in steady cutting, where faces part at ``rate`` mm/s until ``width`` mm apart."""
        return Estimate()

    def start(self, n: int, p: Params) -> State:
        """State of ``n`` virgin points."""
        return {}

    @property
    def off(self) -> dict[str, float]:
        """Parameter values (edge units) that remove the effect; empty if none does."""
        return {q.name: q.off for q in self.parameters if q.off is not None}


class Bulk(Mechanism):
    """First Piola stress from the deformation gradient; the stresses of a model's laws add up."""

    slot = "bulk"
    #: True where ``stress`` is the derivative of ``energy`` and there is no state.
    conservative: ClassVar[bool] = True

    @property
    def adds_stiffness(self) -> bool:
        """Whether it has a part in the shear modulus of slow loading; if not it may read that modulus."""
        return self.conservative

    def shear_modulus(self, p: Params) -> float:
        """Of slow loading at small strain, MPa: what stiffnesses and times of the numerics are scaled by, and
        what others read as ``p.G`` in a model where no law declares G."""
        if not self.adds_stiffness:
            return 0.0
        F = np.eye(3)[:, :, None].copy()
        F[0, 1] = 1e-6
        return self.stress(F, p, self.start(1, p), Points(laws=(self,), dt=1.0))[0][0, 1, 0] / 1e-6

    def mirrored(self, p: Params) -> tuple[bool, bool, bool]:
        """Whether it is the same where x, y or z is reversed; if not, a part does not stand for the whole."""
        return True, True, True

    def stress(self, F: np.ndarray, p: Params, state: State, at: Points) -> tuple[np.ndarray, State]:
        """P (3, 3, N) in MPa and the new state, for F (3, 3, N) and the state at the step's start.

        With ``at.held`` the given state is that of F itself: it is used as it is.
        """
        raise NotImplementedError(self.name)

    def energy(self, F: np.ndarray, p: Params, state: State, at: Points) -> np.ndarray:
        """Stored energy per reference volume (N,), mJ/mm³, at F with the *new* state."""
        raise NotImplementedError(self.name)

    def work(self, F: np.ndarray, p: Params, state: State, at: Points) -> np.ndarray | None:
        """Work ∫ P : dF taken up so far (N,), where it is a function of F and the *new* state.

        ``None`` (the default of laws that are not conservative): the ledger integrates P : ΔF over
        the steps instead.
        """
        return self.energy(F, p, state, at) if self.conservative else None

    def tangent(self, F: np.ndarray, p: Params, state: State, at: Points, dim: int) -> np.ndarray:
        """dP/dF (dim, dim, dim, dim, N), in-plane components; by complex step unless a law knows better."""
        by = []
        for k, L in np.ndindex(dim, dim):
            probe = F.astype(complex)
            probe[k, L] += 1j * STEP
            by.append(self.stress(probe, p, state, at)[0][:dim, :dim].imag / STEP)
        # Stacked, so that symbols may stand for numbers.
        return np.stack(by, axis=2).reshape(dim, dim, dim, dim, F.shape[-1])


class Answer(NamedTuple):
    """What a cut law has answered in this step: its traction (3, N) and its ``new`` state; ``old`` is all
    that the slot knew at the step's start."""

    traction: np.ndarray
    new: State
    old: State

    @property
    def mean_damage(self) -> np.ndarray:
        """Of the step (N,): the law's own ``mean_damage``, or half way between both ends if it has none."""
        mean = self.new.get("mean_damage")
        return (self.old["damage"] + self.new["damage"]) / 2 if mean is None else mean


class Cut(Mechanism):
    """Traction on the cut plane from the displacement jump. Each law names its ``role``.

    That of the role ``cohesive`` parts the faces: its state has ``damage`` (N,), 0 where the interface is
    whole and 1 where it is cut, which never falls. Where faces are cut, how far the cut is and how long steps
    may be are read off it, and other laws find it in ``at.before["cohesive"]``, an ``Answer``. It may have
    ``mean_damage`` (N,), the mean over the step, too."""

    slot = "cut"
    #: Whether ``traction`` is its mean over the step, as of a rate: what it is at the end follows from two.
    over_step: ClassVar[bool] = False

    def traction(self, jump: np.ndarray, p: Params, state: State, at: Points) -> tuple[np.ndarray, State]:
        """T (3, N) in MPa — normal, two tangential components — and the new state, with all of ``start``.

        ``jump`` (3, N) in mm in the same components; ``at.jump_old`` at the start of the step."""
        raise NotImplementedError(self.name)

    def ending(self, rate: np.ndarray, p: Params, before: Mapping[str | None, Answer]) -> np.ndarray | None:
        """T (3, N) at a step's end, where the jump changes at ``rate`` (3, N), mm/s, after what laws of lower
        rank answered ``before``. For what is ``over_step``; ``None`` (the default): its means tell all."""

    def work(self, jump: np.ndarray, p: Params, state: State, at: Points) -> np.ndarray | None:
        """Work taken up so far per reference area (N,), where it is a function of jump and state.
        ``None`` (the default): the ledger integrates T·d[[u]] over the steps instead."""
        return None


def cut_answers(laws: Sequence[Cut], jump: np.ndarray, p: Params, state: State, at: Points) -> list[Answer]:
    """What the cut laws of a model, by rank, answer, each with ``at.before``; ``state`` is of all."""
    answers: list[Answer] = []
    for law in laws:
        seen = {other.role: answer for other, answer in zip(laws, answers, strict=False)}
        traction, new = law.traction(jump, p, state, Points(**{**vars(at), "before": seen}))
        answers.append(Answer(traction, new, state))
    return answers


class Blade(Mechanism):
    """Shear strength of the blade–material interface; strengths of all laws add (eq. slip criterion)."""

    slot = "blade"

    def strength(self, t_N: np.ndarray, p: Params, state: State, at: Points) -> np.ndarray:
        """Largest tangential traction (N,) in MPa that this law lends, at contact pressure t_N ≥ 0.

        ``at.touched`` (N,) is 1 where the point counts as in contact for adhesion (Θ of the paper, kept on
        cut faces once they touched), ``at.slid`` the sliding distance so far, mm, ``at.slip_rate`` mm/s."""
        raise NotImplementedError(self.name)


class Tool(Blade):
    """The blade itself, which keeps the material out; its parameters are those of the section [blade].

    Its profile is given in its own frame: x across, y up, mm, the apex at the origin. ``thickness``, which
    each tool has, is its largest; lengths of the numerics and of measures are scaled by it.
    """

    role = "contact"
    #: The parameter that makes the edge as round as it is, and the edge's radius in terms of parameters.
    edge: ClassVar[tuple[str, str]] = ("thickness", "its radius d/2")
    #: Whether a band goes on upwards from both ends of the outline; else the outline is closed.
    band: ClassVar[bool] = True
    #: Whether its shape is the case's measured outline, ``p.outline`` (n, 2) in mm.
    measured: ClassVar[bool] = False

    def distance(self, x: np.ndarray, y: np.ndarray, p: Params) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Signed distance (N,) in mm, above 0 outside, its gradient (2, N) and second derivative (2, 2, N).

        A point belongs to the flank on whose side it lies; x = -0.0 is on the left. Takes complex numbers."""
        raise NotImplementedError(self.name)

    def outline(self, p: Params) -> np.ndarray:
        """Points (n, 2) along the profile, from the top of the left flank to that of the right."""
        raise NotImplementedError(self.name)

    def edge_radius(self, p: Params) -> float:
        """Radius of curvature at the apex, mm: what elements under it have to resolve."""
        raise NotImplementedError(self.name)

    def height(self, p: Params) -> float:
        """From the apex to where the tool is as thick as it gets, mm."""
        raise NotImplementedError(self.name)

    def extent(self, p: Params) -> tuple[float, float, float]:
        """How far it reaches to the left (below 0), to the right and up, mm."""
        x, y = np.real(self.outline(p)).T
        return x.min(), x.max(), np.inf if self.band else y.max()

    def edge_for(self, p: Params, radius: float) -> float:
        """The parameter ``edge`` of a blade that is round by ``radius``."""
        raise NotImplementedError(self.name)

    def misfits(self, p: Params) -> Iterator[tuple[str, str, str]]:
        """Of a profile that cannot be: the parameter, its value and what would be right, in words."""
        return iter(())

    def alike(self, p: Params) -> bool:
        """Whether both flanks are alike; if not, half a specimen does not stand for the whole."""
        return True

    def pressure(self, gap: np.ndarray, multiplier, stiffness, p: Params) -> tuple[np.ndarray, np.ndarray]:
        """Contact pressure t_N (N,) in MPa and its derivative by the gap."""
        raise NotImplementedError(self.name)


class Skin(Mechanism):
    """How properties vary with place: factors on what all laws of a slot answer, 1 where it is off. And what
    the ``surfaces`` themselves have, 0 where it is off."""

    slot = "skin"
    #: Where there is tension or bending stiffness: nowhere, on the top, or on the cut plane's faces too.
    surfaces: ClassVar[tuple[str, ...]] = ()
    #: Whether the top goes on across the cut plane until that is cut, or ends there.
    continuous: ClassVar[bool] = True

    def stiffness(self, p: Params, at: Points) -> np.ndarray | float:
        """Factor (N,) on the bulk laws' stresses, energies and viscosities, at ``at.X``, ``at.depth``."""
        return 1.0

    def toughness(self, p: Params, at: Points) -> np.ndarray | float:
        """Factor (N,) on the cut laws' tractions and works."""
        return 1.0

    def tension(self, p: Params) -> float:
        """Energy γ of the deformed surface per area, N/mm; on the cut plane of what is cut."""
        return 0.0

    def bending(self, p: Params) -> float:
        """Bending stiffness B of the surface, N mm."""
        return 0.0

    def gradient(self, p: Params) -> float:
        """Stiffness B against bends and gradients of the stretch alike, N mm."""
        return 0.0


class Support(Mechanism):
    """How the base of the specimen gives; without such a law it is clamped."""

    slot = "support"

    def compliance(self, p: Params) -> float:
        """Tangential displacement per shear traction, mm/MPa."""
        raise NotImplementedError(self.name)


class Rig(Mechanism):
    """What the testing machine does between the material and the recorded curve."""

    slot = "rig"

    def record(self, displacement: np.ndarray, force: np.ndarray, time: np.ndarray, p: Params):
        """Recorded (displacement, force) for the true ones; all (n,), mm, N, s.

        Laws are applied in ascending rank, each to what the one before has recorded.
        """
        raise NotImplementedError(self.name)


#: What belongs to the test, not to a law, and what every law may read: the block and the blade's way.
SPECIMEN = (
    Parameter.positive(
        "width",
        "mm",
        "W",
        "specimen across the blade",
        default=30.0,
        trial=("with a specimen half as wide", 0.5),
    ),
    Parameter.positive("length", "mm", "L", "specimen along the blade", default=30.0),
    Parameter.positive("height", "mm", "H", "specimen height", default=21.0),
    Parameter(
        "precut", "mm", "c_0", "depth to which it is cut before the test", low=0, default=0.0, typical=5.0
    ),
)
PROTOCOL = (
    Parameter.positive(
        "speed", "mm/s", "v", "blade speed", default=0.021, lever="speed", trial=("ten times as fast", 10.0)
    ),
    Parameter(
        "slice_push",
        "1",
        "ξ",
        "speed of the blade along its edge over its speed down",
        low=0,
        high=100,
        default=0.0,
        typical=1.0,
        sought=False,
        lever="slicing",
    ),
    Parameter.positive(
        "depth", "mm", "u", "blade travel (default: to 4 thicknesses above the base)", typical=21.0
    ),
)
