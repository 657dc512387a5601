"""What tests of laws share: numbers and points to evaluate a law at, and what each slot makes of them.

A law is evaluated with exactly the numbers it declares (its parameters and what it reads), beside the laws of
the default model that have other roles.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.base.units import Parameter, ureg
from cutbench.case.model import DEFAULT, Model
from cutbench.mechanisms import registry
from cutbench.mechanisms.base import Answer, Mechanism, Points
from cutbench.mechanisms.given import PROTOCOL, SPECIMEN

LAWS = registry()
DECLARED: dict[str, Parameter] = {q.name: q for q in SPECIMEN + PROTOCOL} | {
    q.name: q for law in LAWS.values() for q in law.parameters
}
HEIGHT, DT, N = 21.0, 0.4, 40


def of_slot(slot: str, accept=lambda law: True):
    """Parametrize over the laws of a slot."""
    return pytest.mark.parametrize(
        "law", [pytest.param(law, id=name) for name, law in LAWS.items() if law.slot == slot and accept(law)]
    )


every_law = pytest.mark.parametrize("law", [pytest.param(law, id=name) for name, law in LAWS.items()])


def own(law: Mechanism) -> dict[str, Parameter]:
    return {name: DECLARED[name] for name in law.reads} | {q.name: q for q in law.parameters}


def numbers(law: Mechanism, **changes) -> SimpleNamespace:
    """Typical values, internal units, of what the law declares and of nothing else."""
    values = {name: q.typical * q.factor for name, q in own(law).items()}
    return SimpleNamespace(**(values | changes))


def switched_off(law: Mechanism) -> SimpleNamespace:
    return numbers(law, **{q.name: q.off * q.factor for q in law.parameters if q.off is not None})


def context(law: Mechanism) -> tuple[Mechanism, ...]:
    """The default model's laws of the slot with ``law`` among them, in the order of evaluation."""
    return Model(DEFAULT).with_(law.name).laws(law.slot)


def before(law: Mechanism) -> list[Mechanism]:
    """Those that run before ``law`` and may share something with it."""
    return [other for other in context(law) if other.rank < law.rank]


def rng() -> np.random.Generator:
    return np.random.default_rng(20240611)


def points(n: int, **more) -> Points:
    r = rng()
    X = np.stack([r.uniform(0, 15, n), r.uniform(0, HEIGHT, n), r.uniform(0, 15, n)])
    return Points(X=X, depth=HEIGHT - X[1], dt=DT, speed=0.021, **more)


def deformations(n: int = N) -> np.ndarray:
    """F (3, 3, n) with 0.3 < J < 3, far from the identity."""
    F = np.eye(3)[:, :, None] + rng().uniform(-0.35, 0.35, (3, 3, 4 * n))
    J = np.linalg.det(np.moveaxis(F, 2, 0))
    return F[:, :, (J > 0.3) & (J < 3)][:, :, :n]


def rotations(n: int = N) -> np.ndarray:
    Q = np.linalg.qr(rng().normal(size=(n, 3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))[:, None, None]
    return np.moveaxis(Q, 0, 2)


def times(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    return np.einsum("ijn,jkn->ikn", A, B)


def close(a, b, rtol: float, atol: float = 0.0) -> None:
    """Equality relative to the largest entry: components that vanish have no relative error."""
    scale = max(float(np.max(np.abs(a), initial=0)), float(np.max(np.abs(b), initial=0)))
    np.testing.assert_allclose(a, b, rtol=0, atol=rtol * scale + atol)


# -- units ---------------------------------------------------------------------------------------
#: Size of the old unit in the new one: lengths, times and masses in units that share no factor.
NEW_UNITS = {"[length]": 1e-3, "[time]": 1 / 60, "[mass]": 7.3}


def in_new_units(value, dimension: dict):
    for base, power in dimension.items():
        value = value * NEW_UNITS[base] ** power
    return value


def dimension(unit: str) -> dict:
    return {} if unit == "1" else dict(ureg.Unit(unit).dimensionality)


def rewritten(law: Mechanism, p: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(**{k: in_new_units(v, dimension(own(law)[k].unit)) for k, v in vars(p).items()})


# -- bulk ----------------------------------------------------------------------------------------
def bulk_points(law, n: int, dt: float = DT) -> Points:
    at = points(n, laws=context(law))
    at.dt = dt
    return at


def shaken(law, n: int, p, dt: float = DT) -> dict:
    """The law's state in the middle of a history."""
    past = rng().permutation(deformations(n), axis=2)
    return law.stress(past, p, law.start(n, p), bulk_points(law, n, dt))[1]


def stress(law, F, p=None, dt: float = DT):
    """After a history that the last axis of F does not know."""
    n, p = F.shape[-1], p or numbers(law)
    return law.stress(F, p, shaken(law, n, p, dt), bulk_points(law, n, dt))[0]


def energy(law, F, p=None):
    n, p = F.shape[-1], p or numbers(law)
    at = bulk_points(law, n)
    new = law.stress(F, p, shaken(law, n, p), at)[1]
    return law.energy(F, p, new, at)


# -- cut -----------------------------------------------------------------------------------------
def jumps(n: int = N, closing: bool = True) -> np.ndarray:
    """Jumps around the cohesive length, some of them closing."""
    size = DECLARED["delta_c"].typical if "delta_c" in DECLARED else 0.1
    jump = rng().uniform(-2, 2, (3, n)) * size
    jump[0] = np.where(jump[0] < 0, 0.02 * jump[0], jump[0]) if closing else np.abs(jump[0])
    return jump


def cut(law, jump, jump_old, states=None, p=None, dt=DT, others=None):
    """Traction of ``law``, states by law up to it, and the points with what those before it answered."""
    n = jump.shape[-1]
    at = points(n, jump_old=jump_old)
    at.dt, at.before = dt, {}
    new = {}
    for each in [*before(law), law]:
        q = p if each is law and p is not None else (others or {}).get(each.name, numbers(each))
        old = each.start(n, q) if states is None else states[each.name]
        T, new[each.name] = each.traction(jump, q, old, at)
        at.before[each.role] = Answer(T, new[each.name], old)
    return T, new, at


def loaded(law, n: int = N):
    """Jumps and states in the middle of a history."""
    first = rng().permutation(jumps(n), axis=1)
    return first, cut(law, first, np.zeros_like(first))[1]


# -- blade ---------------------------------------------------------------------------------------
PRESSURE = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, N - 1)])  # MPa


def sliding(length: float = 1.0, time: float = 1.0) -> Points:
    """Points that slide; ``length`` and ``time`` are the sizes of mm and s in the units to be used."""
    r = rng()
    touched = (np.arange(N) % 2).astype(float)
    slid, rate = r.uniform(0, 5, N) * length, r.uniform(0, 0.05, N) * length / time
    return points(N, touched=touched, slid=slid, slip_rate=rate)


def strength(law, t_N, p=None, at=None):
    return law.strength(t_N, p or numbers(law), law.start(N, p or numbers(law)), at or sliding())


# -- skin and rig --------------------------------------------------------------------------------
def factors(law, p) -> np.ndarray:
    """What the law makes of stiffness and toughness (2, N)."""
    at = points(N)
    return np.stack([np.broadcast_to(f(p, at), N) for f in (law.stiffness, law.toughness)])


def recorded(law, p, length: float = 1.0, time: float = 1.0, force: float = 1.0) -> np.ndarray:
    x = np.linspace(0, 21, N)
    return np.stack(law.record(x * length, np.sin(x) * force, x / 0.021 * time, p))
