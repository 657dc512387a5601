"""A discrete problem: forms on one space, assembled into a residual and a tangent. Free of dimension."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from cutbench.forms.assembly import Pattern
from cutbench.forms.base import Form, Step
from cutbench.solve.linear import make_solver


@dataclass
class Timer:
    """Where the time of a run goes, in seconds, and how often."""

    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, name: str, since: float) -> None:
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - since
        self.counts[name] = self.counts.get(name, 0) + 1


@dataclass
class Evaluation:
    """Residual (ndof,), CSR values or None, states by form, and the size of the forces in balance."""

    residual: np.ndarray
    data: np.ndarray | None
    states: dict[str, dict]
    scale: float


class Problem:
    """Forms, their common pattern and the linear solver."""

    def __init__(self, forms: list[Form], ndof: int, fixed: np.ndarray, p, *, solver: str = "auto"):
        self.forms, self.ndof, self.fixed, self.p = list(forms), ndof, fixed, p
        self.symmetric = all(form.symmetric for form in forms)
        self.timer = Timer()
        start = time.perf_counter()
        self.pattern = Pattern(ndof, fixed, {form.name: form.dofs for form in forms}, self.symmetric)
        self.free = self.pattern.free
        self.solver = make_solver(
            solver, self.pattern.indptr, self.pattern.indices, self.free.size, self.symmetric
        )
        self.bulk = next(form for form in forms if form.name == "bulk")
        damping = next((form for form in forms if form.name == "damping"), None)
        #: Stiffness of the damping form at unit viscosity over unit time: the metric of regularised steps.
        self.metric = None
        if damping is not None:
            self.metric = np.zeros(self.pattern.indices.size)
            self.pattern.add(self.metric, "damping", damping.unit_matrix)
        #: Lengths among the unknowns; pressures of a mixed element stand behind them.
        self.displacements = slice(0, int(self.bulk.dofs.max()) + 1)
        self.timer.add("setup", start)

    def start(self) -> dict[str, dict]:
        return {form.name: form.start(self.p) for form in self.forms}

    def evaluate(
        self, u: np.ndarray, states: dict[str, dict], step: Step, tangent: bool = True, p=None
    ) -> Evaluation:
        begin = time.perf_counter()
        p = self.p if p is None else p
        data = np.zeros(self.pattern.indices.size) if tangent else None
        residual, scale = 0.0, 0.0
        new = {}
        for form in self.forms:
            # Damping's matrix is a multiple of the metric, which stands assembled already.
            constant = form.name == "damping"
            # A trial state may have inverted elements; the caller sees that it is not finite.
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                local = form.evaluate(u, p, states[form.name], step, tangent and not constant)
            vector = self.pattern.vector(form.name, local.vector)
            if tangent and constant:
                data += form.factor(step) * self.metric
            elif tangent and local.matrix is not None:
                self.pattern.add(data, form.name, local.matrix)
            residual = residual + vector
            scale += float(np.linalg.norm(np.take(vector, self.free).real))
            new[form.name] = local.state
        self.timer.add("assembly" if tangent else "residual", begin)
        return Evaluation(residual, data, new, scale)

    def factorize(self, data: np.ndarray) -> None:
        begin = time.perf_counter()
        self.solver.refactor(data)
        self.timer.add("factorization", begin)

    def back_substitute(self, residual: np.ndarray) -> np.ndarray:
        """Solve K du = −residual on the free degrees of freedom; (ndof,) with zeros elsewhere."""
        begin = time.perf_counter()
        du = np.zeros(self.ndof)
        du[self.free] = self.solver.solve(-residual[self.free])
        self.timer.add("solve", begin)
        return du
