"""A discrete problem: forms on one space, assembled into a residual and a tangent. Free of dimension."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from cutbench.forms.assembly import Pattern
from cutbench.forms.base import AT_REST, Form, Local, Step, same
from cutbench.forms.blade import BladeForm
from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.self_contact import SelfContactForm
from cutbench.forms.surface import SurfaceForm
from cutbench.solver.iterative import Kept, solver_for

#: Of numbers that are not finite nothing is said.
QUIET = partial(np.errstate, invalid="ignore", divide="ignore", over="ignore")


@dataclass
class Timer:
    """Where the time of a run goes, in seconds, and how often."""

    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    prefix: str = ""

    def within(self, part: str) -> Timer:
        """One that counts here, too, under names that begin with ``part``: its time is within that part's."""
        return Timer(self.seconds, self.counts, f"{part}_")

    def add(self, name: str, since: float) -> None:
        name = self.prefix + name
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - since
        self.counts[name] = self.counts.get(name, 0) + 1


@dataclass
class Evaluation:
    """Residual (ndof,), the size of the forces in balance, and the forms' answers; what finds the tangent."""

    residual: np.ndarray
    scale: float
    answers: dict[str, Local]
    slopes: Callable[[dict[str, Local]], np.ndarray]

    @cached_property
    def data(self) -> np.ndarray:
        """CSR values of the tangent, of the problem's pattern as it is when they are first asked for."""
        return self.slopes(self.answers)

    @cached_property
    def states(self) -> dict[str, dict]:
        """The new ones, by form."""
        return {name: local.state for name, local in self.answers.items()}


@dataclass(frozen=True)
class Asked:
    """What was asked for last, with each form's state and answer."""

    u: np.ndarray
    p: Any
    step: Step | None
    answers: dict[Form, tuple[dict, Local]] = field(default_factory=dict)

    def again(self, u: np.ndarray, p, step: Step) -> bool:
        """Steps and parameters are never changed in place."""
        return self.p is p and self.step is step and self.u.dtype == u.dtype and bool(same(self.u, u))


class Problem:
    """Forms, their common pattern and the linear solver."""

    def __init__(
        self,
        forms: list[Form],
        ndof: int,
        fixed: np.ndarray,
        p,
        *,
        solver: str = "auto",
        modes: np.ndarray | None = None,
        pulled: bool = False,
        timer: Timer | None = None,
    ):
        """``modes`` (ndof, 6): rigid motions of a solid, for solvers that iterate. ``pulled``: its largest
        forces are where it is held. ``timer``: where its time counts."""
        self.forms, self.ndof, self.fixed, self.p = list(forms), ndof, fixed, p
        self.bulk = next(form for form in forms if isinstance(form, BulkForm))
        self.cut = next((form for form in forms if isinstance(form, CutForm)), None)
        self.blades = [form for form in forms if isinstance(form, BladeForm)]
        self.damping = next((form for form in forms if isinstance(form, DampingForm)), None)
        self.surfaces = [form for form in forms if isinstance(form, SurfaceForm)]
        self.symmetric = all(form.symmetric for form in forms)
        self.timer = timer or Timer()
        start = time.perf_counter()
        self.self_contact = next((form for form in forms if isinstance(form, SelfContactForm)), None)
        self._asked = solver, modes
        self._last = Asked(np.zeros(0), None, None)
        self._arrange()
        self.free = self.pattern.free
        #: The same as a mask (ndof,).
        self.is_free = np.zeros(ndof, bool)
        self.is_free[self.free] = True
        #: Where forces do not count as in balance.
        self.apart = np.flatnonzero(~self.is_free & (not pulled))
        self._set_up_solver()
        #: Lengths among the unknowns; pressures of a mixed element stand behind them.
        self.displacements = slice(0, int(self.bulk.dofs.max()) + 1)
        self.timer.add("setup", start)

    def _arrange(self) -> None:
        tables = {form.name: form.dofs for form in self.forms}
        idle = {form.name for form in self.forms if form.idle(self.p)}
        met, couples = self.self_contact, {}
        if met is not None and met.name not in idle:
            couples[met.name] = met.couples
        self.pattern = Pattern(self.ndof, self.fixed, tables, self.symmetric, idle, couples)
        #: Stiffness of the damping form at unit viscosity over unit time: the metric of regularised steps.
        self.metric: np.ndarray | None = None
        if self.damping is not None:
            self.metric = np.zeros(self.pattern.indices.size)
            self.pattern.add(self.metric, "damping", self.damping.unit_matrix)

    def _set_up_solver(self) -> None:
        (name, modes), pattern, size = self._asked, self.pattern, self.free.size
        modes = None if modes is None else modes[self.free]
        self.solver = solver_for(name, pattern.indptr, pattern.indices, size, self.symmetric, modes)
        self._solves, self.factorized = pattern, False

    def renewed_around(self, part: Problem) -> None:
        """``part``, some of this problem, may have a newer factorization of its own."""
        if part.factorized and self.factorized and isinstance(self.solver, Kept):
            self.solver.renewed_at(np.searchsorted(self.free, part.free), part.solver.back)

    def learn(self, u: np.ndarray) -> None:
        """Make ``pattern`` anew where parts of the surface meet at ``u`` that it does not know. The solver
        keeps its factorization until the next."""
        begin, met = time.perf_counter(), self.self_contact
        if met is not None and met.learn(u):
            self.pattern, moved = self.pattern.grown(met.name, met.couples)
            if self.metric is not None:
                metric = np.zeros(self.pattern.indices.size)
                metric[moved] = self.metric
                self.metric = metric
            self.timer.add("setup", begin)

    def room(self, u: np.ndarray, du: np.ndarray) -> float:
        """The part of ``du`` that ends before the surface touches itself; infinite where it does not."""
        return np.inf if self.self_contact is None else self.self_contact.room(u, du)

    def sound(self, u: np.ndarray, floor: float) -> bool:
        """Whether at ``u`` all volume ratios are above ``floor``, and the surface does not cross itself."""
        return self.bulk.smallest_volume_ratio(u) > floor and not (
            self.self_contact and self.self_contact.crosses(u)
        )

    @property
    def shear_modulus(self) -> float:
        """Of the body at small strain, MPa: the size of what is added to tangents."""
        return sum(law.shear_modulus(self.p) for law in self.bulk.laws)

    def start(self) -> dict[str, dict]:
        states = {form.name: form.start(self.p) for form in self.forms}
        # What is cut from the start on has never been whole: there is no step in which it was.
        return self.touched(self.touched(states))

    def touched(self, states: dict[str, dict], step: Step = AT_REST) -> dict[str, dict]:
        """``states`` as ``step`` begins with them: faces look for contact anew, surfaces for what is cut."""
        begun = states | {form.name: form.touch(states[form.name], step) for form in self.blades}
        if self.cut is not None:
            damage = states["cohesion"]["damage"]
            begun |= {form.name: form.begun(states[form.name], damage) for form in self.surfaces}
        return begun

    def force(self, states: dict[str, dict]) -> float:
        """Force of the blade against its way, of the meshed part."""
        return sum(form.force(states[form.name])[1] for form in self.blades)

    def force_along(self, states: dict[str, dict]) -> float:
        """The same against its way along its edge, which is the third axis."""
        return 0.0 - sum(form.force(states[form.name])[2] for form in self.blades)

    def work(self, u: np.ndarray, old: dict[str, dict], new: dict[str, dict], step: Step) -> dict[str, float]:
        """Work taken up by each mechanism over the step; faces add up under one name."""
        total: dict[str, float] = {}
        for form in self.forms:
            for name, value in form.work(u, self.p, old[form.name], new[form.name], step).items():
                total[name] = total.get(name, 0.0) + value
        return total

    def evaluate(self, u: np.ndarray, states: dict[str, dict], step: Step, p=None) -> Evaluation:
        begin = time.perf_counter()
        p = self.p if p is None else p
        # A trial state may have inverted elements; the caller sees that it is not finite.
        with QUIET():
            last = self._last if self._last.again(u, p, step) else Asked(u, p, step)
            for form in self.forms:
                # Where damage and multipliers are taken anew, no other form's answer changes.
                state, known = states[form.name], last.answers.get(form)
                if known is None or known[0] is not state:
                    last.answers[form] = state, form.evaluate(u, p, state, step)
            self._last = last
            answers = {form.name: last.answers[form][1] for form in self.forms}
            vectors = {name: local.vector for name, local in answers.items()}
            residual, scale = self.pattern.balance(vectors, self.apart)
        self.timer.add("residual", begin)
        return Evaluation(residual, scale, answers, partial(self._assembled, u, step))

    def _assembled(self, u: np.ndarray, step: Step, answers: dict[str, Local]) -> np.ndarray:
        begin = time.perf_counter()
        self.learn(u)
        # Damping's matrix is a multiple of the metric, which stands assembled already.
        factor = 0.0 if self.damping is None else self.damping.factor(step)
        with QUIET():
            found = {name: a.tangent for name, a in answers.items() if name != "damping"}
            some = {name: each for name, each in found.items() if each is not None}
            data = self.pattern.matrices(some, factor, self.metric)
        self.timer.add("assembly", begin)
        return data

    def out_of_balance(self, found: Evaluation) -> float:
        """Length of the residual on the free degrees of freedom, N; infinite where it is not finite."""
        size = float(np.linalg.norm(found.residual[self.free]))
        return size if np.isfinite(size) else np.inf

    def relative_residual(self, found: Evaluation) -> float:
        """The same over the forces in balance."""
        return self.out_of_balance(found) / max(found.scale, np.finfo(float).tiny)

    def left(self, u: np.ndarray, states: dict[str, dict], step: Step, floor: float) -> float:
        """The same at ``u``; infinite where that is not ``sound``."""
        if not self.sound(u, floor):
            return np.inf
        return self.relative_residual(self.evaluate(u, states, step))

    def factorize(self, data: np.ndarray) -> None:
        begin = time.perf_counter()
        if self._solves is not self.pattern:
            self._set_up_solver()
        self.solver.refactor(data)
        self.factorized = True
        self.timer.add("factorization", begin)

    def back_substitute(self, residual: np.ndarray, *, how: str = "solve") -> np.ndarray:
        """Solve K du = −residual on the free degrees of freedom; (ndof,) with zeros elsewhere.

        ``how`` exactly matters to solvers that iterate: "solve", less exactly a Newton "direction", or a
        "correction" with an old tangent.
        """
        begin = time.perf_counter()
        solve = getattr(self.solver, how, self.solver.solve)
        du = np.zeros(self.ndof)
        du[self.free] = solve(-residual[self.free])
        self.timer.add("solve", begin)
        return du


def damage_growth(old: dict[str, dict], new: dict[str, dict], where: np.ndarray | None = None) -> float:
    """Largest growth of damage on the cut plane, or on ``where`` (points,) of it, between two states; 0
    without a cut."""
    if "cohesion" not in old:
        return 0.0
    grown = new["cohesion"]["damage"] - old["cohesion"]["damage"]
    return float((grown if where is None else grown[where]).max(initial=0.0))
