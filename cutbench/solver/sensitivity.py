"""Derivatives of an accepted march by parameters, by direct differentiation of its discrete equations.

At each accepted step R(u, u_old, s_old, p) = 0 holds. A complex step in p, and in the derivatives of u_old
and s_old that the last step left, gives dR at fixed u; du = −K⁻¹ dR with one factorization for all
parameters; a second complex evaluation at u + i h du gives the new states' and the force's derivatives and
what the tangent left open, which is then corrected (the tangent omits how friction depends on the slip
rate). Tortorelli & Michaleris, Inverse Problems in Engineering 1 (1994), 10.1080/174159794088027573.

The mesh and the lengths of the steps are held, and what switches stays where it is: contact (Θ), loading or
unloading, sticking or sliding. The force jumps where a point of adhesion switches, and a derivative cannot
know that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from cutbench.forms.base import Form, Step
from cutbench.mechanisms.base import STEP
from cutbench.solver.linear import SingularMatrix, make_solver
from cutbench.solver.linearised_perturbation import LinearisedPerturbation
from cutbench.solver.march import Accepted
from cutbench.solver.problem import Problem

#: What the tangent may leave open, relative to the change of the residual, and corrections at the most.
OPEN = 1e-8
CORRECTIONS = 12
#: States that the ledger alone reads, and those that make up a blade's force.
LEDGER = frozenset({"tractions", "shares", "before"})
FORCE = frozenset({"normal_traction", "shear"})


@dataclass(frozen=True)
class Direction:
    """A complex step ``STEP`` in one parameter, at every place that knows it.

    ``forms`` holds, by name, those forms that keep numbers of their own that depend on it. ``volume``: the
    stateless forms see it. ``viscosity``: the damping's. ``perturbation``: the law whose strength it is,
    where the problem is without that law.
    """

    name: str
    p: Any
    speed: complex
    forms: Mapping[str, Form] = field(default_factory=dict)
    volume: bool = True
    viscosity: complex = 0.0
    perturbation: LinearisedPerturbation | None = None

    def seen(self, form: Form) -> Form:
        """``form`` of the problem as this parameter has it."""
        own = {} if self.perturbation is None else self.perturbation.forms
        return self.forms.get(form.name) or own.get(form.name) or form


@dataclass
class _Rates:
    """Derivatives by one parameter at the end of the last step: displacements, and states by form."""

    u: np.ndarray
    states: dict[str, dict[str, np.ndarray]]


class Sensitivities:
    """Follows a march; ``add`` each accepted step, in order.

    ``lost`` is the travel at which the tangent was singular, if it was: derivatives are nan from there on.
    ``unresolved`` counts steps and parameters whose corrections did not settle.
    """

    def __init__(self, problem: Problem, speed: float, directions: Sequence[Direction]):
        self._speed = speed
        self._take(problem, directions)
        self._rates = [_Rates(np.zeros(problem.ndof), {}) for _ in directions]
        self.lost: float | None = None
        self.unresolved = 0

    def go_on(self, problem: Problem, directions: Sequence[Direction], displacements, states) -> None:
        """On another mesh: ``problem`` and ``directions`` there, and what takes ``displacements`` (ndof,) and
        ``states`` by form from the last one.
        """
        self._take(problem, directions)
        self._rates = [_Rates(displacements(rates.u), states(rates.states)) for rates in self._rates]

    def _take(self, problem: Problem, directions: Sequence[Direction]) -> None:
        self._problem, self._directions = problem, tuple(directions)
        start = problem.start()
        forms = [form for form in problem.forms if form is not problem.damping]
        # A form without a state is a function of u and p: its tangent matrix says all about it.
        self._stateless = [form for form in forms if not start[form.name]]
        self._stateful = [form for form in forms if start[form.name]]
        self._set_up_solver()

    def _set_up_solver(self) -> None:
        problem, pattern = self._problem, self._problem.pattern
        self._solver = make_solver(
            problem.solver.name, pattern.indptr, pattern.indices, problem.free.size, problem.symmetric
        )
        self._solves = pattern
        if problem.metric is not None:
            metric = pattern.csr(problem.metric)
            self._metric = metric + sp.triu(metric, 1).T if problem.symmetric else metric

    def add(self, accepted: Accepted) -> np.ndarray:
        """dF/dθ (n,) of the meshed part at this step, by parameter in internal units."""
        forces = np.full(len(self._directions), np.nan)
        if self.lost is not None:
            return forces
        begun = [self._begun(old.states, accepted.step) for old in self._rates]
        after = self._rates
        try:
            for number, (states, u) in enumerate(accepted.solves):
                if number:  # an augmentation: the multiplier has taken over the pressure
                    begun = [self._augmented(old, new.states) for old, new in zip(begun, after, strict=True)]
                after = self._differentiate(u, states, begun, accepted.step)
        except SingularMatrix:
            self.lost = accepted.travel
            return forces
        self._rates = after
        for perturbation in {
            id(d.perturbation): d.perturbation for d in self._directions if d.perturbation is not None
        }.values():
            perturbation.ended(accepted.u, perturbation.begun(accepted.solves[-1][0]), accepted.step)
        for i, rates in enumerate(after):
            forces[i] = sum(form.force(rates.states[form.name])[1] for form in self._problem.blades)
        return forces

    def displacements(self) -> list[np.ndarray]:
        """du/dθ (ndof,) by parameter at the last step; nan where the tangent was singular on the way."""
        return [rates.u * (1.0 if self.lost is None else np.nan) for rates in self._rates]

    def _begun(self, ended: dict, step: Step) -> dict:
        """Rates of the states that a ``step`` begins from. Θ is a switch: it has no derivative of its own."""
        begun = {name: {k: v for k, v in rates.items() if k != "touched"} for name, rates in ended.items()}
        blades = [form for form in self._problem.blades if "pressure" in begun.get(form.name, ())]
        begun |= {form.name: form.begun(begun[form.name], step) for form in blades}
        damage = ended.get("cohesion", {}).get("damage")
        if damage is not None:
            begun |= {form.name: {"there": form.share.rate(damage)} for form in self._problem.surfaces}
        return begun

    def _augmented(self, begun: dict, found: dict) -> dict:
        parts = {}
        for form in self._problem.blades:
            multiplier = form.augment(found[form.name])["multiplier"]
            parts[form.name] = {**begun.get(form.name, {}), "multiplier": multiplier}
        return {**begun, **parts}

    def _differentiate(self, u, states, begun, step) -> list[_Rates]:
        """Rates at the end of an inner solve that began from ``states`` and found ``u``."""
        problem, free = self._problem, self._problem.free
        volume = self._factorize(u, states, step)
        trials = [
            self._trial(d, u, states, rates, step) for d, rates in zip(self._directions, begun, strict=True)
        ]
        fixed = np.stack([trial.at_rest(free) for trial in trials], axis=1)
        du = np.zeros((problem.ndof, len(trials)))
        du[free] = self._solver.solve(-fixed)
        size = np.linalg.norm(fixed, axis=0)
        states_by: list[dict] = [{} for _ in trials]
        unsettled = list(range(len(trials)))
        for _ in range(CORRECTIONS):
            # The stateless forms are linear in du and known by their matrix; the others are evaluated.
            known, left = volume @ du[free], {}
            for i in unsettled:
                moved, states_by[i] = trials[i].moved(du[:, i])
                rest = (trials[i].rest + moved)[free] + known[:, i]
                if np.linalg.norm(rest) > OPEN * max(size[i], np.linalg.norm(moved[free])):
                    left[i] = rest
            if not (unsettled := list(left)):
                break
            change = self._solver.solve(-np.stack(list(left.values()), axis=1))
            du[np.ix_(free, np.array(unsettled))] += change
        self.unresolved += len(unsettled)
        return [_Rates(du[:, i], found) for i, found in enumerate(states_by)]

    def _factorize(self, u, states, step) -> sp.csr_matrix:
        """Factorize the tangent at the solution; returns the part of the stateless forms and the damping."""
        problem = self._problem
        problem.learn(u)
        if self._solves is not problem.pattern:
            self._set_up_solver()
        pattern = problem.pattern
        data = np.zeros(pattern.indices.size)
        for form in self._stateless:
            local = form.evaluate(u, problem.p, {}, step)
            if local.tangent is not None:
                pattern.add(data, form.name, local.tangent)
        if problem.damping is not None and problem.metric is not None:
            data += problem.damping.factor(step) * problem.metric
        volume = pattern.csr(data.copy())
        for form in self._stateful:
            local = form.evaluate(u, problem.p, states[form.name], step)
            if local.tangent is not None:
                pattern.add(data, form.name, local.tangent)
        self._solver.refactor(data)
        return volume + sp.triu(volume, 1).T if problem.symmetric else volume

    def _trial(self, direction: Direction, u, states, rates, step) -> _Trial:
        old = self._rates[self._directions.index(direction)].u
        ih = 1j * STEP
        dt = step.dt * self._speed / direction.speed if direction.speed.imag else step.dt
        moving = replace(step, dt=dt, u_old=step.u_old + ih * old)
        perturbation = direction.perturbation
        if perturbation is not None:
            states = perturbation.begun(states)
        complex_states = {
            form.name: {
                key: value + ih * rates[form.name][key] if key in rates.get(form.name, ()) else value
                for key, value in states[form.name].items()
            }
            for form in self._stateful
        }
        forms = [direction.seen(form) for form in self._stateful]
        trial = _Trial(self._problem, direction, forms, u, complex_states, moving)
        if direction.volume:
            # What an added law has there is linear in its strength: its histories' rates do not matter.
            for form in (direction.seen(form) for form in self._stateless):
                local = form.evaluate(u, direction.p, states[form.name], moving)
                trial.rest += self._problem.pattern.vector(form.name, local.vector).imag / STEP
        known = {form.name for form in self._problem.forms}
        for form in () if perturbation is None else perturbation.forms.values():
            if form.name not in known:
                local = form.evaluate(u, direction.p, states[form.name], moving)
                np.add.at(trial.rest, form.dofs, np.imag(local.vector) / STEP)
        if (damping := self._problem.damping) is not None:
            trial.rest += self._damped(damping.factor(step), direction, u, old, step, moving)
        return trial

    def _damped(self, factor: float, direction, u, old, step, moving) -> np.ndarray:
        """Derivative of the damping force at fixed u: it is linear, with the metric as its matrix."""
        free = self._problem.free
        slope = (direction.viscosity * step.damping_factor / moving.dt).imag / STEP
        out = np.zeros(self._problem.ndof)
        out[free] = self._metric @ (slope * (u - step.u_old) - factor * old)[free]
        return out


@dataclass
class _Trial:
    """The stateful forms along one direction; ``rest`` (ndof,): dR at fixed u of all others."""

    problem: Problem
    direction: Direction
    forms: list[Form]
    u: np.ndarray
    states: dict[str, dict]
    step: Step

    def __post_init__(self):
        self.rest = np.zeros(self.problem.ndof)

    def at_rest(self, free: np.ndarray) -> np.ndarray:
        """dR at fixed u on the free degrees of freedom."""
        return (self.rest + self._change(self.u)[0])[free]

    def moved(self, du: np.ndarray) -> tuple[np.ndarray, dict]:
        """Change of the stateful forms' residual (ndof,) with u moving by ``du``, and their states'."""
        return self._change(self.u + 1j * STEP * du)

    def _change(self, u):
        residual, rates = np.zeros(self.problem.ndof), {}
        for form in self.forms:
            local = form.evaluate(u, self.direction.p, self.states[form.name], self.step)
            residual += self.problem.pattern.vector(form.name, local.vector).imag / STEP
            rates[form.name] = {
                key: value.imag / STEP
                for key, value in local.state.items()
                if key in FORCE or (key not in LEDGER and np.iscomplexobj(value))
            }
        return residual, rates
