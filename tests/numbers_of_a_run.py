"""Numbers of evaluations and of a short run, kept in a file: ``python numbers_of_a_run.py FILE``."""

from __future__ import annotations

import sys

import numpy as np
from coarse_runs import BRIEF, QUICK
from test_self_contact import P, form_on, pocket

from cutbench.case.case import load_case
from cutbench.forms.base import Step
from cutbench.run.build import build
from cutbench.run.runner import run_case


def evaluations() -> dict[str, np.ndarray]:
    """Of problems at places that mean nothing."""
    found: dict[str, np.ndarray] = {}
    block = {"h": "2 mm", "element": "P1"}
    solid = load_case("gelatin", {**block, "numerics": "tetrahedra"}, dim=3)
    drawn = load_case("gelatin", {**block, "layers": 1}, dim=3)
    cases = {"section": BRIEF, "whole": BRIEF.set(symmetry="full"), "mixed": BRIEF.set(element="P2P1")}
    cases["sliced"] = BRIEF.set(slice_push=1.0)
    for name, case in (cases | {"solid": solid, "drawn": drawn}).items():
        built, rng = build(case), np.random.default_rng(4)
        problem, probed = built.problem, built.space.inside[:, :200] * 0.9
        found[f"{name} probes"] = built.space.probes(probed).toarray()
        u, old = (1e-3 * rng.normal(size=problem.ndof) for _ in range(2))
        apex = np.array([0.0, case.p.height - 0.2, 0.0])
        states = problem.touched(problem.start())
        step = Step(0.5, old, apex, apex + 0.1)
        at = problem.evaluate(u, states, step)
        assert at.data is not None
        found |= {f"{name} residual": at.residual, f"{name} data": at.data, f"{name} scale": at.scale}
        found[f"{name} volume"] = problem.bulk.smallest_volume_ratio(u)
        for form in problem.forms:
            local = form.evaluate(u, problem.p, states[form.name], step)
            found[f"{name} {form.name} vector"] = local.vector
            if local.matrix is not None:
                found[f"{name} {form.name} matrix"] = local.matrix
            state = at.states[form.name]
            found |= {f"{name} {form.name} {key}": value for key, value in state.items()}
    for seed in range(4):
        X, u = pocket(seed)
        form, du = form_on(X), np.random.default_rng(seed).normal(size=u.size)
        form.learn(u)
        local = form.evaluate(u, P, {}, None)
        found |= {
            f"{seed} force": local.vector,
            f"{seed} matrix": local.matrix,
            f"{seed} pairs": form.couples,
        }
        found |= {f"{seed} room": form.room(u, du), f"{seed} crosses": form.crosses(u + du)}
    return found


if __name__ == "__main__":
    run = run_case(QUICK)
    curves = {f"curve {name}": column for name, column in run.curve.items()}
    np.savez(sys.argv[1], **evaluations(), **curves)
