"""Stress of bulk laws in a homogeneous test, with the free faces free of stress.

The free stretch follows from P₃₃ = 0 by Newton's method at each step of the history, with the laws'
states from the step before; laws without state need no history and are solved for all readings at
once. A model without a law for volume change is taken at constant volume: its pressure follows from
P₃₃ = 0 without iteration. Where a law has a direction the sheet is sheared as well, until its free
faces carry no shear.

Parameters may be complex, with an imaginary part so small that its square vanishes: the answer's
imaginary part is then the exact derivative. They may also be arrays (m,), for m answers at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from cutbench.base.errors import ComputationFailed
from cutbench.case.model import Model
from cutbench.homogeneous.history import LoadingHistory
from cutbench.homogeneous.march import March
from cutbench.mechanisms import Volumetric
from cutbench.mechanisms.base import STEP, Bulk, Points

#: Largest step of ln λ of laws with state, and fewest steps to a reading: their errors are of first order.
MAX_LOG_STRETCH_STEP, MIN_STEPS_TO_READING = 0.02, 4
#: The same of what a law with a direction shears, without state.
MAX_SHEARING_STEP = 0.25
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

    @property
    def free(self) -> tuple[tuple[int, int], ...]:
        """Components of F that a law with a direction changes until their nominal stress is 0.

        What is pulled stays in line, F₂₁ = F₃₁ = 0, and does not turn about the pull, F₃₂ = 0. The third face
        is free; the second is, too, where ``second`` is None, else it is held without shear.
        """
        faces = ((0, 2), (1, 2), (2, 2))
        return faces if self.second is not None else ((0, 1), (1, 1), *faces)


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

    Raises ComputationFailed where no lateral stretch balances.
    """
    directed = any(law.directed for law in model.laws("bulk"))
    body = (_ShearedBody if directed else _Body)(model, p, MODES[kind])
    x = np.broadcast_to(history.x.reshape(history.x.shape[0], -1), (history.x.shape[0], count))
    if not body.start(1):
        # Without memory the order does not matter.
        body = type(body)(model, _at_every_reading(p, x.shape), body.mode)
        flat, way = x.ravel(), np.log(x.real.ravel())
        # What is sheared far is reached on the way there.
        parts = 1 + int(directed and np.abs(way).max() / MAX_SHEARING_STEP)
        b = 0 * way * body.lateral
        for part in range(1, parts + 1):
            stress, b, _ = body.advance(flat ** (part / parts), b + way / parts * body.lateral, {}, 1.0)
        return stress.reshape(x.shape)
    steps = list(history.steps(largest, fewest, log=True))
    state = body.start(count)
    march = None if directed else March.of(_stresses, tuple(body.laws), body.mode, p, state, count)
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
    """The bulk laws of a model under one mode.

    ``lateral``: powers of λ that the unknowns ``b`` begin with, each the logarithm of a stretch, or a shear.
    """

    def __init__(self, model: Model, p: SimpleNamespace, mode: Mode):
        self.laws, self.p, self.mode = model.laws("bulk"), p, mode
        self.real = SimpleNamespace(**{name: np.real(value) for name, value in vars(p).items()})
        self.resists_volume = any(isinstance(law, Volumetric) for law in self.laws)
        self.complex = any(np.iscomplexobj(value) for value in vars(p).values())
        self.lateral: Any = mode.lateral
        self.solved = not self.resists_volume

    def start(self, n: int) -> dict[str, np.ndarray]:
        state: dict[str, np.ndarray] = {}
        for law in self.laws:
            state |= law.start(n, self.p)
        return state

    def along(self, steps, state: dict[str, np.ndarray]) -> np.ndarray:
        """P₁₁ (n, count), step by step."""
        count = next(iter(state.values())).shape[-1]
        free, before, out = np.zeros(count) * self.lateral, 1.0, []
        for stretch, dt, reached in steps:
            guess = free + self.lateral * np.log(np.real(stretch / before))
            stress, free, state = self.advance(np.broadcast_to(stretch, (count,)), guess, state, dt)
            before = stretch
            if reached:
                out.append(stress)
        return np.array(out)

    def _stress(self, stretch, b, p, state, dt):
        return _stresses(self.mode, self.laws, stretch, b, p, state, dt)

    def _linearised(self, stretch, b, state, dt):
        """What the free face carries at a real ``b``, and its derivative."""
        free = self._stress(stretch, b + 1j * STEP, self.real, state, dt)[1]
        return free.real, free.imag / STEP

    def advance(self, stretch, guess, state, dt):
        """P₁₁ (N,), ln of the free stretch (N,) (real) and the new state after a step of ``dt`` s."""
        if self.solved:
            b = self.mode.lateral * np.log(stretch)
            P, free, new = self._stress(stretch, b, self.p, state, dt)
            return P - free * np.exp(b) / stretch, b, new
        real = {k: np.real(v) for k, v in state.items()}
        b, slope = self._balanced(np.real(stretch), guess, real, dt)
        if self.complex or np.iscomplexobj(stretch):
            # Imaginary parts are infinitesimal, so one step of Newton's method settles them.
            rest = self._stress(stretch, b, self.p, state, dt)[1]
            moved = b - 1j * _solution(slope, np.imag(rest))
        else:
            moved = b
        P, _, new = self._stress(stretch, moved, self.p, state, dt)
        return P, b, new

    def _balanced(self, stretch, b, state, dt):
        """Real b (N,) where the free face carries nothing, and the derivative of what it carries there."""
        b = np.array(b, dtype=float)
        for trial in range(100):
            free, slope = self._linearised(stretch, b, state, dt)
            change = -_solution(slope, free)
            # Fibres that slacken have a kink, to both sides of which full steps may lead by turns.
            b = b + np.clip(change, -0.2, 0.2) / 2 ** (trial // 20)
            if not np.all(np.isfinite(b)):
                break
            if np.all(np.abs(change) < STRETCH_TOLERANCE):
                return b, slope
        raise _no_lateral_balance(stretch)


class _ShearedBody(_Body):
    """The same with a direction: b (k, N) is all that the faces leave free of F."""

    def __init__(self, model: Model, p: SimpleNamespace, mode: Mode):
        super().__init__(model, p, mode)
        # At constant volume the third stretch follows from the others, and its stress is the pressure. Else a
        # sheet whose sides are alike is not sheared out of its plane.
        self.places = mode.free[:-1]
        if self.resists_volume:
            flat = model.mirrored(self.real)[2]
            self.places = tuple((i, j) for i, j in mode.free if not (flat and i < j == 2))
        self.lateral = np.array([[mode.lateral * (i == j)] for i, j in self.places])
        self.solved = False

    def _stress(self, stretch, b, p, state, dt):
        F = self.mode.deformation(stretch, np.exp(b[0]))
        for (i, j), value in zip(self.places, b, strict=True):
            F[i, j] = np.exp(value) if i == j else value
        if not self.resists_volume:
            F[2, 2] = 1 / (F[0, 0] * F[1, 1])
        P, new = _nominal(self.laws, F, p, state, dt)
        if not self.resists_volume:
            # Below its diagonal alone the inverse of F, transposed, has entries beside it.
            P = P - np.eye(3)[:, :, None] * (P[2, 2] * F[2, 2]) / (F + (F == 0))
        return P[0, 0], np.stack([P[place] for place in self.places]), new

    def _linearised(self, stretch, b, state, dt):
        # All directions at once: a law's calls cost more than its points.
        k, n = b.shape
        probes = np.tile(b, k) + 1j * STEP * np.repeat(np.eye(k), n, axis=1)
        p = {name: np.tile(v, k) if np.shape(v) == (n,) else v for name, v in vars(self.real).items()}
        state = {name: np.tile(value, k) for name, value in state.items()}
        P = self._stress(np.tile(stretch, k), probes, SimpleNamespace(**p), state, dt)[1].reshape(k, k, n)
        return P[:, 0].real, P.imag / STEP


def _solution(slope: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """What ``slope``, (N,) or (k, k, N), makes ``rest``, (N,) or (k, N), of."""
    if slope.ndim == 1:
        return rest / slope
    return np.linalg.solve(slope.transpose(2, 0, 1), rest.T[:, :, None])[:, :, 0].T


def _stresses(mode: Mode, laws: Sequence[Bulk], stretch, b, p, state, dt):
    """P₁₁ and P₃₃ (N,) at the free stretch exp(b), and the new state; of numbers or symbols."""
    P, new = _nominal(laws, mode.deformation(stretch, np.exp(b)), p, state, dt)
    return P[0, 0], P[2, 2], new


def _nominal(laws: Sequence[Bulk], F, p, state, dt):
    """P (3, 3, N) of all laws, and the new state."""
    n = F.shape[-1]
    at = Points(X=np.zeros((3, n)), depth=np.full(n, np.inf), dt=dt, laws=laws)
    P = np.zeros((3, 3, n))
    new: dict[str, np.ndarray] = {}
    for law in laws:
        part, changed = law.stress(F, p, state, at)
        P = P + part
        new |= changed
    return P, new


def _at_every_reading(p: SimpleNamespace, shape: tuple[int, int]) -> SimpleNamespace:
    """``p`` with its arrays (count,) at every reading (n, count), in a row."""
    return SimpleNamespace(**{
        name: np.broadcast_to(value, shape).ravel() if np.shape(value) == shape[1:] else value
        for name, value in vars(p).items()
    })  # fmt: skip


def _no_lateral_balance(stretch: np.ndarray) -> ComputationFailed:
    most = np.max(np.real(stretch))
    return ComputationFailed(f"no lateral stretch balances a stretch of {most:.3g} with these parameters")
