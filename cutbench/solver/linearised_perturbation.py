"""A law that is switched off, beside a march without it: the linearised perturbation by its strength.

Where a law is switched off, the model with it has the same displacements, tangent and states as the model
without. So nothing has to be solved anew: the law's own forms are evaluated at what was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cutbench.forms.base import Form, Step
from cutbench.forms.surface import SurfaceForm


class LinearisedPerturbation:
    """``forms`` by name: those that the law takes part in, in the model with it. ``p``: that model's
    parameters, the law's strengths at "off"."""

    def __init__(self, forms: Mapping[str, Form], p: Any, states: Mapping[str, dict] | None = None):
        """``states``: where another perturbation has come to, at the same points; virgin ones without."""
        self.forms, self.p = dict(forms), p
        given = states or {}
        self.states = {name: given[name] if name in given else form.start(p) for name, form in forms.items()}

    def on(self, forms: Mapping[str, Form]) -> LinearisedPerturbation:
        """The same on another mesh, with the states that this one has come to."""
        carried = {n: form.carried(self.forms[n], self.states[n], self.p) for n, form in forms.items()}
        return LinearisedPerturbation(forms, self.p, carried)

    def begun(self, states: Mapping[str, dict]) -> dict[str, dict]:
        """Its forms' states, and those of all others, where a solve begins from ``states`` of the march."""
        found = {**states}
        for name, form in self.forms.items():
            mine = self.states[name]
            if isinstance(form, SurfaceForm) and "cohesion" in states:
                mine = form.begun(mine, np.real(states["cohesion"]["damage"]))
            # What only the law has is its own, and what has a row a law.
            there = states.get(name, {})
            shared = {k for k in mine.keys() & there.keys() if np.shape(mine[k]) == np.shape(there[k])}
            found[name] = {k: there[k] if k in shared else v for k, v in mine.items()}
        return found

    def ended(self, u: np.ndarray, states: Mapping[str, dict], step: Step) -> None:
        """The step is accepted that found ``u`` from ``states``, as ``begun`` gave them."""
        for name, form in self.forms.items():
            self.states[name] = form.evaluate(u, self.p, states[name], step).state
