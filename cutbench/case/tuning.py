"""The tuned numbers of a computation, each with its reason: part of a case's identity; nobody sets them.

What a user may choose stands in ``numerics``. These decide how quickly and how surely a run gets to its end.
Lengths are in thicknesses of the blade; ``sized`` gives them in mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self


class Sized:
    """Tuned numbers of which some are lengths."""

    lengths: ClassVar[tuple[str, ...]] = ()

    def sized(self, unit_mm: float) -> Self:
        """The same with lengths in mm."""
        values = {name: getattr(self, name) for name in self.lengths}
        return replace(  # type: ignore[type-var]
            self,
            **{k: tuple(unit_mm * x for x in v) if isinstance(v, tuple) else unit_mm * v
               for k, v in values.items()},
        )  # fmt: skip


@dataclass(frozen=True)
class StepTuning(Sized):
    """How long the next step is, and when damping is raised. Lengths are blade travels."""

    lengths = ("first", "gentle", "finest", "begun")

    #: First step, and the one after a corner of the motion: the tip indents by less than it is round.
    first: float = 1 / 35
    #: A step that needs no more lets the next one grow; one that needs three more makes it shorter. Where
    #: surfaces meet and stick a step needs some seven, however short it is: with 6 the elastomer takes a
    #: third more steps, and as many more iterations as a fifth.
    iterations: int = 9
    #: Growth from one step to the next at most: steps that double are refused as often as they are taken.
    grow: float = 1.5
    #: Steps longer by more than this than the last one begin anew, with rates of first order: those of second
    #: order are unstable beyond 1 + √2.
    ratio: float = 2.0
    #: What is left of a step that was refused, and of raised damping after a step at rest that was hard.
    shrink: float = 0.5
    #: What is left of a step that was taken, but hard; and the part of the energy allowed that counts as it.
    shorter: float = 0.7
    #: What is left of a refused step below ``gentle`` that did not converge. With a tenth the elastomer takes
    #: 258 steps to ten thicknesses, with this 223.
    snap: float = 0.4
    #: Part of what damage and the ledger may do in a step that the next one is made for: its prediction errs.
    target: float = 0.9
    #: Below this step, where Newton's method fails, a snap has begun.
    gentle: float = 3 / 70
    #: Below this step growth of damage refuses none, nor does a front that is not found by itself, and one
    #: whose energy does not close is taken where damping has been raised in vain. Refused further down, what
    #: jumps was damped: under a wedge with an edge of 50 µm gelatin's drop was then 0.25 with a
    #: ``damage_step`` of 0.1, and 0.45 with 0.7.
    finest: float = 1 / 140
    #: Refused steps after which shorter ones are not tried, but damping: a crawl at the smallest step costs a
    #: thousand steps a tenth of a millimetre.
    patience: int = 40
    #: Steps at rest that may be refused before the blade goes on against raised damping.
    tries: int = 30
    #: What is left of raised damping after a step at rest that was easy.
    calm: float = 0.2
    #: Damping is raised to this many times its value before a run gives up: it then holds all in place.
    largest_damping: float = 1e7
    #: And to this before a step is taken whose energy does not close: a jump then spreads over several.
    jump_damping: float = 1e4
    #: Where the ledger has left more than this part of the whole work open, steps that add to it may leave
    #: twice this part of their own work open: errors of one sign must not add up. With 0.008 gelatin and the
    #: elastomer close to 1.1 % under wedges with edges of 20 and 50 µm; with 0.006 they take a tenth more
    #: steps.
    drift: float = 0.007
    #: Where the cut has not begun, in a block in each plane, damage may grow by this part of ``damage_step``
    #: in a step: where it starts to run away a step that is long against that finds it open before its time.
    #: Without this and ``resolved`` the elastomer's onset is 4.4 % early, with both 1.5 %; gelatin's 2.0 and
    #: 0.9 %.
    nascent: float = 0.06
    #: So long is a cut that has begun: in a block in a plane.
    begun: float = 1 / 14
    #: Until then a step is at most this part of that over which damage grows e times faster.
    resolved: float = 0.4
    #: Where damage grows by less than this part of ``damage_step`` in a step, that is left out.
    noticed: float = 0.01


@dataclass(frozen=True)
class NewtonTuning(Sized):
    """Newton's method, its regularisation and its line search."""

    lengths = ("reach", "trust")

    #: Residual that is accepted where rounding keeps it from falling further.
    stagnant: float = 1e-6
    #: At the most: a step that needs more is cheaper in two.
    iterations: int = 60
    #: Largest change of a displacement in one iteration: some elements.
    reach: float = 3 / 7
    #: The one beyond which the tangent is regularised: a direction so long comes of a near singularity.
    trust: float = 2 / 7
    #: Regularisation at the most, in G: no element moves by more than a part of itself then.
    largest_shift: float = 300.0
    #: Regularisation to begin with, in G, where the guess leaves more than ``far`` of the forces.
    cautious: float = 0.0
    #: Part of the forces beyond which a guess is far from equilibrium.
    far: float = 0.2
    #: How much less regularisation the next iteration has, where a direction was found at once.
    relax: float = 4.0
    #: Part of a Newton step that has to be free of inverted elements, or the tangent is regularised.
    whole: float = 0.5
    #: Part of the work of the residual that a line search may leave. Beyond a point that turns from sliding
    #: to sticking the work falls at once; with 0.8 a search stopped short of it, iteration after iteration.
    slack: float = 0.3
    #: A Newton step that leaves less than this of the residual is followed by steps with its factorization.
    close: float = 0.3
    #: As long as each of them leaves less than this: a new factorization costs as much as three.
    chord: float = 0.5
    #: Part of the last step's smallest volume ratio below which a state is not tried.
    smallest_ratio: float = 0.25
    #: Change of contact pressures from one augmentation to the next, in units of the largest, at which they
    #: stand still.
    multipliers: float = 1e-3
    #: Change of damage at which it stands still.
    staggered_change: float = 1e-4
    #: Residual over the forces at which a loop ends whose damage is not yet the last.
    staggered_tolerance: float = 1e-5


@dataclass(frozen=True)
class WindowTuning:
    """The elements around the front that are solved first."""

    #: Half of its width, and how far it goes ahead of the front and behind: what the front moves in a step.
    reach: float = 1.0
    #: And at least so many elements of the cut plane.
    elements: int = 3
    #: It goes down with the front in steps of this part of its reach: its pattern is analysed anew each time.
    follows: float = 0.25
    #: A part's residual over its own forces that is small enough: what surrounds it is not exact either.
    enough: float = 0.01
    #: Newton's iterations on a part at the most.
    iterations: int = 15
    #: Where they do not get to ``enough``, what is still a better beginning than a shorter step.
    usable: float = 0.02
    #: Regularisation to begin with where the front has been moved, in G: elements there are wrong by much.
    cautious: float = 64.0
    #: How much less of that each iteration has.
    relax: float = 8.0
    #: Parts of the front's expected advance that are tried where all of it inverts elements.
    caution: tuple[float, ...] = (1.0, 0.75, 0.5)
    #: So near to the front.
    near: float = 0.15
    #: Nodes nearer to the blade than this keep their distance in a prediction.
    touch: float = 1 / 70
    #: Elements of the cut plane that the past is remembered for: a step is at most as long.
    remembered: int = 3


@dataclass(frozen=True)
class RemeshTuning:
    """Meshes that follow the front. Lengths are in the finest length at the cut."""

    #: The front goes so far on one mesh.
    stride: float = 1.0
    #: And so many elements of the plane at least: as many are small above it and below, too.
    fewest: int = 8
    #: Where more than this part of the height had small elements, one mesh serves.
    worth: float = 0.5
    #: And down to so many thicknesses below the top: there a cut may open first. With elements made for the
    #: front alone meat under a wedge was not cut, and its force was twice as large.
    opens: float = 2.25
    #: What displacements within an element may differ by on a new mesh, in units of its size, where the
    #: finest length is the thickness, and less in proportion where it is less; where they do more, elements
    #: stay small.
    misfit: float = 0.02
    #: Part of the smallest volume ratio that a new mesh has to keep.
    usable: float = 0.25


@dataclass(frozen=True)
class PathTuning(Sized):
    """Paths through snap-backs (``solver.arc_length``). C is the cut's length."""

    lengths = ("travel", "growth", "first", "leaps", "stride", "turn", "shortest", "nudge", "begun")

    #: Largest step of the travel.
    travel: float = 1 / 7
    #: Largest step of C: an element or two.
    growth: float = 3 / 70
    #: First step of C, where it takes the place of the travel.
    first: float = 1 / 140
    #: Where no equilibrium is near, larger steps of C are tried before the body is let go.
    leaps: tuple[float, ...] = (3 / 70, 6 / 70)
    #: C is given instead of the travel where it grows faster than this, per travel.
    breaks: float = 0.5
    #: Largest growth of damage anywhere in a step: more jumps to another branch.
    damage: float = 0.6
    #: Largest change of the travel in a step.
    stride: float = 3 / 14
    #: Where the blade turns, its first step the other way is at most this: a longer one changes the branch.
    turn: float = 1 / 35
    #: Where no step as long as this finds an equilibrium, something else is given.
    shortest: float = 1 / 7000
    #: A blade that was let go and stays where it was is moved on by this before it is let go again.
    nudge: float = 1 / 70
    #: From a cut so long on it is asked how stable its states are.
    begun: float = 1 / 700
    #: Points at most.
    points: int = 3000


@dataclass(frozen=True)
class MeshTuning:
    """Sizes of the elements of a built-in mesh."""

    #: Growth of the element size with the distance from the cut plane: more changes the onset.
    grading: float = 0.7
    #: The cut surges so far down in each of the paper's materials.
    surge: float = 3.0
    #: So far from the cut plane the top is finer still: it goes over the tip and then folds in beside the
    #: blade.
    rim: float = 4 / 7
    #: By this.
    on_rim: float = 0.8
    #: Elements under the tip, where no size is chosen: this part of h, but not below this part of the blade's
    #: thickness.
    corner: tuple[float, float] = (1 / 16, 1 / 44.8)
    #: And so many of them at least to the radius of the blade's edge, which bends the surface over as short a
    #: way, but not below this part of h.
    edge: tuple[float, float] = (3.0, 0.01)
    #: The finest length at the cut is not chosen below this part of the thickness: the front takes as many
    #: more steps as it is shorter, on as many more elements. A case says where it asks for less.
    least_detail: float = 1 / 8
    #: The finest length at the cut is at most so many radii of the blade's edge, and so many cohesive zones:
    #: under the paper's blade, whose tip is an ellipse, in its materials, it is the thickness. Elements
    #: on the cut plane are then half as large as the edge is round, or a third of the zone. A wire's steady
    #: force is 1 % above its toughness, where it is 25 % with elements as large as the zone; with half the
    #: radii the onset under a wedge of 40 µm moves by 0.7 %, its forces by 0.2 %.
    detail: tuple[float, float] = (6.0, 4.0)
    #: The same where the cut surges.
    shallow: tuple[float, float] = (1 / 4, 1 / 11.2)
    #: Half-thicknesses of the blade over which elements of a section become as wide as tall, away from the
    #: cut plane, and as large as elsewhere, down from the tip. Material that sticks to a blunt tip holds the
    #: cut plane shut for about half of that. Where it opens below, it is squeezed to half its height, and may
    #: fold.
    reach: float = 6 / 7
    #: Over which elements of a block become as wide as tall.
    block_reach: float = 3 / 7
    #: Elements of a block are longer along the blade than tall only up to this part of its length.
    longest: float = 1 / 12


@dataclass(frozen=True)
class SelfContactTuning:
    """The barrier between parts of a surface, d̂ wide and of the stiffness κ (``forms.self_contact``)."""

    #: d̂ at a node, in units of the shorter of its two distances from its neighbours: what is squeezed along
    #: itself to less meets itself. Half of it, or twice, moves the elastomer's onset and peak by less than
    #: 0.3 %; half of it takes a third more iterations.
    part: float = 1 / 4
    #: And at most, in blade thicknesses: surfaces in contact are about half of that apart, which has to be
    #: small against all that folds. Half of it moves the elastomer's onset, peak and drop by less than 1 %.
    reach: float = 1 / 200
    #: κ in G: pressures of G leave about half of d̂, larger ones less. Ten times of it: less than 1 %.
    stiffness: float = 1.0
    #: Part of the way to a touch that a step of Newton's method goes at most.
    room: float = 0.8
    #: Pairs so many d̂ near enter the tangent's pattern together with one that meets: a new pattern costs as
    #: much as two tangents. With 4 there are twice as many new ones.
    ahead: float = 12.0


@dataclass(frozen=True)
class Tuning:
    """All of them."""

    steps: StepTuning = field(default_factory=StepTuning)
    newton: NewtonTuning = field(default_factory=NewtonTuning)
    window: WindowTuning = field(default_factory=WindowTuning)
    remesh: RemeshTuning = field(default_factory=RemeshTuning)
    path: PathTuning = field(default_factory=PathTuning)
    mesh: MeshTuning = field(default_factory=MeshTuning)
    self_contact: SelfContactTuning = field(default_factory=SelfContactTuning)

    @classmethod
    def of(cls, data: Mapping[str, Mapping]) -> Tuning:
        """From what ``dataclasses.asdict`` made of one, and JSON of that."""
        parts = {}
        for name, part in vars(cls()).items():
            numbers = {k: tuple(v) if isinstance(v, list) else v for k, v in data[name].items()}
            parts[name] = replace(part, **numbers)
        return cls(**parts)
