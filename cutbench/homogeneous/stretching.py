"""Stress of bulk laws in a homogeneous test, with the free faces free of stress.

The free stretch follows from P₃₃ = 0 by Newton's method at each step of the history, with the laws'
states from the step before; laws without state need no history and are solved for all readings at
once. A model without a law for volume change is taken at constant volume: its pressure follows from
P₃₃ = 0 without iteration.

Parameters may be complex, with an imaginary part so small that its square vanishes: the answer's
imaginary part is then the exact derivative. They may also be arrays (m,), for m answers at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from cutbench.base.errors import ComputationFailed, require
from cutbench.case.model import Model
from cutbench.homogeneous.history import LoadingHistory
from cutbench.homogeneous.march import March
from cutbench.mechanisms import Volumetric
from cutbench.mechanisms.base import STEP, Bulk, Points

#: Largest step of ln λ of laws with state, and fewest steps to a reading: their errors are of first order.
MAX_LOG_STRETCH_STEP, MIN_STEPS_TO_READING = 0.02, 4
#: A change of ln of the free stretch below this leaves less than its square.
STRETCH_TOLERANCE = 1e-7


@dataclass(frozen=True)
class Mode:
    """A way to stretch a sheet: F = diag(λ, second, third), with one free stretch whose face has no stress.

    The nominal stress is P₁₁, the force over the undeformed area; at constant volume and for neo-Hooke
    G(λ − λ⁻²), G(λ − λ⁻⁵) and G(λ − λ⁻³) (Treloar 1944, 10.1039/TF9444000059).

    ``second``: power of λ in F₂₂, None where it is free like F₃₃; ``lateral``: power of λ in the free stretch
    at constant volume.
    """

    second: int | None
    lateral: float

    def deformation(self, stretch: np.ndarray, free: np.ndarray) -> np.ndarray:
        """F (3, 3, N) for λ and the free stretch (N,)."""
        none = np.zeros(free.size)
        second = free if self.second is None else stretch**self.second
        # Stacked, so that symbols may stand for numbers.
        parts = [stretch, none, none, none, second, none, none, none, free]
        return np.stack(parts).reshape(3, 3, free.size)


MODES = {"uniaxial": Mode(None, -0.5), "equibiaxial": Mode(1, -2.0), "pure_shear": Mode(0, -1.0)}


def nominal_stress(
    kind: str,
    history: LoadingHistory,
    model: Model,
    p: SimpleNamespace,
    *,
    count: int = 1,
    largest: float = MAX_LOG_STRETCH_STEP,
    fewest: int = MIN_STEPS_TO_READING,
) -> np.ndarray:
    """P₁₁ (n, count) in MPa at each reading of ``history``; ``count`` is the length of array parameters.

    Raises ComputationFailed where no lateral stretch balances, BadInput for a law with a direction that would
    shear the sheet, or leave one free face with stress.
    """
    body = _Body(model, p, MODES[kind])
    x = np.broadcast_to(history.x.reshape(history.x.shape[0], -1), (history.x.shape[0], count))
    body.refuse_directions(kind, np.real(x))
    if not body.start(1):
        # Without memory the order does not matter.
        body = _Body(model, _at_every_reading(p, x.shape), body.mode)
        flat = x.ravel()
        found = body.advance(flat, np.log(flat.real) * body.mode.lateral, {}, 1.0)[0]
        return found.reshape(x.shape)
    steps = list(history.steps(largest, fewest, log=True))
    state = body.start(count)
    march = March.of(_stresses, tuple(body.laws), body.mode, p, state, count)
    found = None
    if march is not None:
        ways = np.array([np.broadcast_to(x, (count,)) for x, _, _ in steps])
        gone = ways, np.array([dt for _, dt, _ in steps], float), np.array([last for *_, last in steps])
        found = march.along(gone, p, state, body.mode.lateral, body.resists_volume, STRETCH_TOLERANCE)
    if march is None or found is None:
        return body.along(steps, state)
    P, failed = found
    if failed >= 0:
        if march.checked:
            raise _no_lateral_balance(ways[failed])
        return body.along(steps, state)
    P = P if body.complex or np.iscomplexobj(ways) else P.real.copy()
    return P if march.checked else march.holds(P, body.along(steps, state))


class _Body:
    """The bulk laws of a model under one mode."""

    def __init__(self, model: Model, p: SimpleNamespace, mode: Mode):
        self.laws, self.p, self.mode = model.laws("bulk"), p, mode
        self.real = SimpleNamespace(**{name: np.real(value) for name, value in vars(p).items()})
        self.resists_volume = any(isinstance(law, Volumetric) for law in self.laws)
        self.complex = any(np.iscomplexobj(value) for value in vars(p).values())

    def start(self, n: int) -> dict[str, np.ndarray]:
        state: dict[str, np.ndarray] = {}
        for law in self.laws:
            state |= law.start(n, self.p)
        return state

    def refuse_directions(self, kind: str, x: np.ndarray) -> None:
        """Raise BadInput where at stretches x (n, count) a law asks for more than one free stretch."""
        stretch, p = x.ravel(), _at_every_reading(self.real, x.shape)
        for law in (law for law in self.laws if law.directed):
            P, _ = law.stress(
                self.mode.deformation(stretch, stretch**self.mode.lateral),
                p,
                law.start(stretch.size, p),
                Points(dt=1.0),
            )
            uneven = P[1, 1] - P[2, 2] if self.mode.second is None else 0 * stretch
            # But for rounding.
            even = np.abs([*P[~np.eye(3, dtype=bool)], uneven]).max() <= 1e-9 * np.abs(P).max()
            require(even, law.name, kind, "a direction along the pull, or with which nothing is sheared")

    def along(self, steps, state: dict[str, np.ndarray]) -> np.ndarray:
        """P₁₁ (n, count), step by step."""
        count = next(iter(state.values())).shape[-1]
        free, before, out = np.zeros(count), 1.0, []
        for stretch, dt, reached in steps:
            guess = free + self.mode.lateral * np.log(np.real(stretch / before))
            stress, free, state = self.advance(np.broadcast_to(stretch, (count,)), guess, state, dt)
            before = stretch
            if reached:
                out.append(stress)
        return np.array(out)

    def _stress(self, stretch, b, p, state, dt):
        return _stresses(self.mode, self.laws, stretch, b, p, state, dt)

    def advance(self, stretch, guess, state, dt):
        """P₁₁ (N,), ln of the free stretch (N,) (real) and the new state after a step of ``dt`` s."""
        if not self.resists_volume:
            b = self.mode.lateral * np.log(stretch)
            P, free, new = self._stress(stretch, b, self.p, state, dt)
            return P - free * np.exp(b) / stretch, b, new
        real = {k: np.real(v) for k, v in state.items()}
        b, slope = self._balanced(np.real(stretch), guess, real, dt)
        if self.complex or np.iscomplexobj(stretch):
            # Imaginary parts are infinitesimal, so one step of Newton's method settles them.
            rest = self._stress(stretch, b, self.p, state, dt)[1]
            moved = b - 1j * np.imag(rest) / slope
        else:
            moved = b
        P, _, new = self._stress(stretch, moved, self.p, state, dt)
        return P, b, new

    def _balanced(self, stretch, b, state, dt):
        """Real b (N,) with P₃₃ = 0 and dP₃₃/db there."""
        b = np.array(b, dtype=float)
        for _ in range(100):
            free = self._stress(stretch, b + 1j * STEP, self.real, state, dt)[1]
            slope = free.imag / STEP
            change = -free.real / slope
            b = b + np.clip(change, -0.2, 0.2)
            if not np.all(np.isfinite(b)):
                break
            if np.all(np.abs(change) < STRETCH_TOLERANCE):
                return b, slope
        raise _no_lateral_balance(stretch)


def _stresses(mode: Mode, laws: Sequence[Bulk], stretch, b, p, state, dt):
    """P₁₁ and P₃₃ (N,) at the free stretch exp(b), and the new state; of numbers or symbols."""
    F = mode.deformation(stretch, np.exp(b))
    n = F.shape[-1]
    at = Points(X=np.zeros((3, n)), depth=np.full(n, np.inf), dt=dt, laws=laws)
    P = np.zeros((3, 3, n))
    new: dict[str, np.ndarray] = {}
    for law in laws:
        part, changed = law.stress(F, p, state, at)
        P = P + part
        new |= changed
    return P[0, 0], P[2, 2], new


def _at_every_reading(p: SimpleNamespace, shape: tuple[int, int]) -> SimpleNamespace:
    """``p`` with its arrays (count,) at every reading (n, count), in a row."""
    return SimpleNamespace(**{
        name: np.broadcast_to(value, shape).ravel() if np.shape(value) == shape[1:] else value
        for name, value in vars(p).items()
    })  # fmt: skip


def _no_lateral_balance(stretch: np.ndarray) -> ComputationFailed:
    most = np.max(np.real(stretch))
    return ComputationFailed(f"no lateral stretch balances a stretch of {most:.3g} with these parameters")
