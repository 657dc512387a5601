"""A law on trial: typical numbers, lively points and histories, and what it answers there.

It gets exactly the numbers that it declares, beside the laws of the default model that have other roles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from cutbench.base.units import Parameter, ureg
from cutbench.mechanisms.base import Answer, Mechanism, Points, Tool, cut_answers
from cutbench.mechanisms.law_registry import registry
from cutbench.mechanisms.law_validation import declared, typical

HEIGHT, DT, N = 21.0, 0.4, 40
PRESSURE = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, N - 1)])  # MPa
#: Size of the old unit in the new one: lengths, times and masses in units that share no factor.
NEW_UNITS = {"[length]": 1e-3, "[time]": 1 / 60, "[mass]": 7.3}


def rng() -> np.random.Generator:
    return np.random.default_rng(20240611)


def dimension(unit: str) -> dict[str, Any]:
    return {} if unit == "1" else dict(ureg.Unit(unit).dimensionality.items())


def in_new_units(value, unit: str):
    """A value, in mm, N and s, of a quantity that has ``unit``, in the new units."""
    for base, power in dimension(unit).items():
        value = value * NEW_UNITS[base] ** power
    return value


def times(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    return np.einsum("ijn,jkn->ikn", A, B)


def deformations(n: int = N) -> np.ndarray:
    """F (3, 3, n) with 0.3 < J < 3, far from the identity."""
    F = np.eye(3)[:, :, None] + rng().uniform(-0.35, 0.35, (3, 3, 4 * n))
    J = np.linalg.det(np.moveaxis(F, 2, 0))
    return F[:, :, (J > 0.3) & (J < 3)][:, :, :n]


def rotations(n: int = N) -> np.ndarray:
    Q = np.linalg.qr(rng().normal(size=(n, 3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))[:, None, None]
    return np.moveaxis(Q, 0, 2)


def points(n: int = N, **more) -> Points:
    r = rng()
    X = np.stack([r.uniform(0, 15, n), r.uniform(0, HEIGHT, n), r.uniform(0, 15, n)])
    return Points(**({"X": X, "depth": HEIGHT - X[1], "dt": DT, "speed": 0.021} | more))


def sliding(length: float = 1.0, time: float = 1.0) -> Points:
    """Points that slide; ``length`` and ``time`` are the sizes of mm and s in the units to be used."""
    r = rng()
    touched = (np.arange(N) % 2).astype(float)
    slid, rate = r.uniform(0, 5, N) * length, r.uniform(0, 0.05, N) * length / time
    return points(touched=touched, slid=slid, slip_rate=rate)


class Trial:
    """One law among all that are ``known`` (the registered ones, unless given)."""

    def __init__(self, law: Mechanism, known: Mapping[str, Mechanism] | None = None):
        self.law: Any = law  # of one slot or another
        self.known = {**(registry() if known is None else known), law.name: law}
        self.declared = declared(self.known)

    # -- numbers -----------------------------------------------------------------------------------
    @property
    def own(self) -> dict[str, Parameter]:
        """What the law reads and declares."""
        return {n: self.declared[n] for n in self.law.reads} | {q.name: q for q in self.law.parameters}

    def numbers(self, **changes) -> SimpleNamespace:
        """Typical values, internal units, of what the law declares and of nothing else."""
        return SimpleNamespace(**(vars(typical(self.law, self.known)) | changes))

    def switches(self) -> dict[str, float]:
        """Off values of what the law adds to the default law of its role that it generalises, if any."""
        off = {q.name: q.off_value for q in self.law.parameters if q.off is not None}
        known = {q.name for law in self.standard() for q in law.parameters}
        return {k: v for k, v in off.items() if k not in known} or off

    def rewritten(self, p: SimpleNamespace) -> SimpleNamespace:
        """``p`` in the new units."""
        return SimpleNamespace(**{k: in_new_units(v, self.declared[k].unit) for k, v in vars(p).items()})

    # -- other laws --------------------------------------------------------------------------------
    def standard(self) -> list[Mechanism]:
        """The laws of the default model."""
        return [law for law in self.known.values() if law.standard]

    def context(self, without: bool = False) -> list[Any]:
        """The default laws of the slot, with the law in the place of the one that has its role, by rank.

        ``without``: without it, and with that one if the law has a switch of its own.
        """
        law = self.law
        others = [m for m in self.standard() if m.slot == law.slot and m.name != law.name]
        own = not self.switches().keys() <= {q.name for m in self.standard() for q in m.parameters}
        if not (without and own):
            others = [m for m in others if law.role is None or m.role != law.role]
        return sorted([*others, *([] if without else [law])], key=lambda m: (m.rank, m.name))

    def before(self) -> list[Any]:
        """Those that answer before the law."""
        return [other for other in self.context() if other.rank < self.law.rank]

    # -- answers -----------------------------------------------------------------------------------
    def bulk_points(self, n: int = N, dt: float = DT) -> Points:
        return points(n, laws=tuple(self.context()), dt=dt)

    def shaken(self, n: int = N, p=None, dt: float = DT) -> dict:
        """The state of a bulk law in the middle of a history."""
        past, p = rng().permutation(deformations(n), axis=2), p or self.numbers()
        return self.law.stress(past, p, self.law.start(n, p), self.bulk_points(n, dt))[1]

    def stress(self, F: np.ndarray, p=None, dt: float = DT) -> np.ndarray:
        """After a history that the last axis of F does not know."""
        n, p = F.shape[-1], p or self.numbers()
        return self.law.stress(F, p, self.shaken(n, p, dt), self.bulk_points(n, dt))[0]

    def energy(self, F: np.ndarray) -> np.ndarray:
        n, p = F.shape[-1], self.numbers()
        at = self.bulk_points(n)
        return self.law.energy(F, p, self.law.stress(F, p, self.shaken(n, p), at)[1], at)

    def jumps(self, n: int = N, closing: bool = True) -> np.ndarray:
        """Jumps around the cohesive length, some of them closing."""
        jump = rng().uniform(-2, 2, (3, n)) * self.length
        jump[0] = np.where(jump[0] < 0, 0.02 * jump[0], jump[0]) if closing else np.abs(jump[0])
        return jump

    @property
    def length(self) -> float:
        """Opening at the peak of the cohesion, mm: the law's own, or the default one's."""
        laws = [self.law, *(m for m in self.standard() if m.slot == "cut")]
        return next(
            e.opening for e in (m.estimate(typical(m, self.known), 1.0, 1.0) for m in laws) if e.opening
        )

    def cut(self, jump, jump_old, states=None, p=None, dt: float = DT, others=None):
        """Traction, states by law up to it, and the points with what those before it answered."""
        n, new = jump.shape[-1], {}
        seen: dict[str | None, Answer] = {}
        at = points(n, jump_old=jump_old, dt=dt, before=seen)
        for each in [*self.before(), self.law]:
            q = (others or {}).get(each.name) or typical(each, self.known)
            q = p if each is self.law and p is not None else q
            old = each.start(n, q) if states is None else states[each.name]
            T, new[each.name] = each.traction(jump, q, old, at)
            seen[each.role] = Answer(T, new[each.name], old)
        return T, new, at

    def loaded(self) -> tuple[np.ndarray, dict]:
        """Jumps and states in the middle of a history."""
        first = rng().permutation(self.jumps(), axis=1)
        return first, self.cut(first, np.zeros_like(first))[1]

    def strength(self, t_N: np.ndarray, p=None, at=None) -> np.ndarray:
        p = p or self.numbers()
        return self.law.strength(t_N, p, self.law.start(N, p), at or sliding())

    def answer(self, p: SimpleNamespace) -> np.ndarray:
        """The law's flux at fixed, lively kinematics, for parameters ``p``."""
        law = self.law
        if law.slot == "bulk":
            return self.stress(deformations(), p)
        if law.slot == "cut":
            return self.cut(self.jumps(), *self.loaded(), p=p)[0]
        if law.slot == "blade":
            return np.concatenate([self.strength(PRESSURE, p), *_body(law, p)])
        if law.slot == "support":
            return np.array([law.compliance(p)])
        return self.together([law], p) if law.slot == "skin" else recorded([law], p)

    def together(self, laws: list, p: SimpleNamespace) -> np.ndarray:
        """What all ``laws`` of a slot answer together."""
        slot = self.law.slot
        if slot in ("skin", "rig"):
            if slot == "rig":
                return recorded(laws, p)
            return np.concatenate([factors(laws, p).ravel(), of_surfaces(laws, p)])
        if slot == "support":
            return np.array([sum(law.compliance(p) for law in laws)])
        states = {k: v for law in laws for k, v in law.start(N, p).items()}
        if slot == "cut":
            total, old = np.zeros((3, N)), np.zeros((3, N))
            for jump in (rng().permutation(self.jumps(), axis=1), self.jumps()):
                found = cut_answers(laws, jump, p, states, points(jump_old=old))
                total, old = sum((each.traction for each in found), np.zeros((3, N))), jump
                states = {k: v for each in found for k, v in each.new.items()}
            return total
        if slot == "bulk":
            at, F = points(laws=tuple(laws)), deformations()
            past = rng().permutation(F, axis=2)
            states = {k: v for law in laws for k, v in law.stress(past, p, states, at)[1].items()}
            parts = []
            for law in laws:
                P, new = law.stress(F, p, states, at)
                parts.append((P, law.tangent(F, p, states, at, 3), law.energy(F, p, new, at)))
            return np.concatenate([sum(part[i] for part in parts).reshape(-1, N) for i in range(3)])
        flux = sum((law.strength(PRESSURE, p, {}, sliding()) for law in laws), np.zeros(N))
        return np.concatenate([flux, *(each for law in laws for each in _body(law, p))])


GAP = np.linspace(-0.1, 0.1, N) + 1e-5


def _body(law: Mechanism, p) -> list[np.ndarray]:
    """What a blade's own law says beside its strength."""
    if not isinstance(law, Tool):
        return []
    return [law.pressure(GAP, 0.0, 3.0, p)[0], law.distance(BESIDE[0], BESIDE[1], p)[0]]


#: Places (2, N) below a tool of usual size and beside it, mm.
BESIDE = np.stack([x := np.linspace(-1, 1, N), 2 * (np.sqrt(x**2) - 0.4)])


def factors(laws: list, p, at: Points | None = None) -> np.ndarray:
    """What skins make of stiffness and toughness (2, N)."""
    at = at or points()
    each = [np.stack([np.broadcast_to(f(p, at), N) for f in (m.stiffness, m.toughness)]) for m in laws]
    return math.prod(each, start=np.ones((2, N)))


def of_surfaces(laws: list, p) -> np.ndarray:
    """Tension and stiffnesses (3,) that skins give the surfaces."""
    return np.array(
        [sum(getattr(law, name)(p) for law in laws) for name in ("tension", "bending", "gradient")]
    )


#: Displacements (N,) of a testing machine, mm.
WAY = np.linspace(-10, 21, N)


def recorded(laws: list, p, length: float = 1.0, time: float = 1.0, force: float = 1.0) -> np.ndarray:
    """What rigs record of a curve (2, N), of a cylinder that is pressed and pulled."""
    curve, t = (WAY * length, np.sin(WAY) * force), np.linspace(0, 1000, N) * time
    known = SimpleNamespace(**vars(p), shape_factor=0.5, specimen_length=50.0 * length)
    for law in laws:
        curve = law.record(*curve, t, known)
    return np.stack(curve)
