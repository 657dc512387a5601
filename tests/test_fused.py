"""Laws as compiled loops: what is read of them is what NumPy makes of them, or is left to NumPy."""

from __future__ import annotations

import pickle
from copy import copy
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from cutbench.base.compiled import COMPILED
from cutbench.base.fused import Fused, fused
from cutbench.base.symbols import iterated
from cutbench.forms.bulk import Kinematics
from cutbench.forms.cut import answers
from cutbench.mechanisms import Isotropic
from cutbench.mechanisms.base import STEP, Tool, cut_answers
from cutbench.mechanisms.checks.trial import GAP, PRESSURE, N, Trial, deformations, points, sliding
from cutbench.mechanisms.law_registry import registry

LAWS = registry()
CUT = [law.name for law in LAWS.values() if law.slot == "cut"]
ISOTROPIC = [law.name for law in LAWS.values() if isinstance(law, Isotropic)]
OTHER = [law.name for law in LAWS.values() if law.slot == "bulk" and law.name not in ISOTROPIC]
TOOLS = [law.name for law in LAWS.values() if isinstance(law, Tool)]
BLADE = [law.name for law in LAWS.values() if law.slot == "blade"]


def interpreted(source: str):
    """The loop of a source, as Python runs it."""
    scope = {"np": np}
    exec(source, scope)
    return scope["loop"]


def read(plain) -> Fused:
    return Fused(plain, interpreted)


def flat(answer) -> list[np.ndarray]:
    if isinstance(answer, dict):
        return [x for key in sorted(answer) for x in flat(answer[key])]
    if isinstance(answer, (tuple, list)):
        return [x for part in answer for x in flat(part)]
    return [np.asarray(answer)]


def same(plain, *given, tolerance: float = 1e-12):
    """That ``plain`` is read, and answers as it does in NumPy."""
    reader = read(plain)
    found, wanted = flat(reader(*given)), flat(plain(*given))
    assert reader.left_plain == []
    assert len(found) == len(wanted)
    for a, b in zip(found, wanted, strict=True):
        assert a.shape == b.shape
        most = np.abs(b).max(initial=0.0)
        assert np.abs(a.real - b.real).max(initial=0.0) <= tolerance * most
        assert np.abs(a.imag - b.imag).max(initial=0.0) <= tolerance * np.abs(np.imag(b)).max(initial=0.0)


def law_points(**more):
    return points(**({"jump_old": np.zeros((3, N)), "closing": 5000.0} | more))


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", CUT)
def test_cut_laws_and_their_slopes(name, held):
    trial = Trial(LAWS[name])
    laws = tuple(trial.context())
    p = SimpleNamespace(**{k: v for law in laws for k, v in vars(Trial(law).numbers()).items()})

    first = np.random.default_rng(1).permutation(trial.jumps(), axis=1)
    state = {k: v for law in laws for k, v in law.start(N, p).items()}
    old = cut_answers(laws, first, p, state, law_points())
    state = {k: v for each in old for k, v in each.new.items()}
    state |= {"means": np.stack([each.traction for each in old]), "rate": first}
    for components in (0, 1, 3):
        at = law_points(jump_old=first, held=held)
        same(answers, laws, components, trial.jumps(), p, state, at, 0.4, 0.3)


def factors(law, F, p, at):
    k = Kinematics(F)
    return [x + 0 * k.J for x in (*law.stress_factors(k, p, at), *law.tangent_factors(k, p, at))]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", ISOTROPIC)
def test_factors_of_isotropic_laws(name, dim):
    law = LAWS[name]
    F = np.ascontiguousarray(deformations()[:dim, :dim])
    if dim == 2:
        F = F[:, :, Kinematics(F).J > 0.2]
    same(partial(factors, law), F, Trial(law).numbers(), points())


@pytest.mark.parametrize("name", OTHER)
def test_stress_and_tangent_of_bulk_laws(name):
    trial = Trial(LAWS[name])
    given = deformations(), trial.numbers(), trial.shaken(), trial.bulk_points()
    same(trial.law.stress, *given)
    same(lambda *given: trial.law.tangent(*given, 2), *given)


@pytest.mark.parametrize("name", BLADE)
def test_strength_by_the_slip_rate(name):
    trial, at = Trial(LAWS[name]), sliding()

    def both(t_N, p, at):
        faster = copy(at)
        faster.slip_rate = at.slip_rate + 1j * STEP
        probe = trial.law.strength(t_N, p, {}, faster)
        return trial.law.strength(t_N, p, {}, at), np.imag(probe) / STEP + 0 * t_N

    same(both, PRESSURE, trial.numbers(), at)


@pytest.mark.parametrize("name", TOOLS)
def test_pressure_of_tools(name):
    stiffness = np.full_like(GAP, 3.0)
    same(LAWS[name].pressure, GAP, 0.01 * stiffness, stiffness, Trial(LAWS[name]).numbers())


@pytest.mark.parametrize("kind", ["distance", "number"])
@pytest.mark.parametrize("name", ["contact", "blunt_tip"])
def test_gap_of_elliptic_tips(name, kind):
    law, p = getattr(LAWS[name], kind), Trial(LAWS[name]).numbers()
    x, y = np.random.default_rng(2).uniform(-0.5, 0.5, (2, 60)) * [[1], [3]]
    x[:2], y[:2] = (0.0, -0.0), -0.2
    same(law, x, y, p, tolerance=1e-11)
    if kind == "distance":
        same(lambda x, y, p: np.imag(law(x, y + 1j * STEP, p)[2]) / STEP, x, y, p, tolerance=1e-11)
    p.thickness += 1j * STEP
    same(law, x, y, p, tolerance=1e-11)


def test_a_complex_step_in_parameters_goes_through():
    law, jump = LAWS["stiff_cohesion"], Trial(LAWS["stiff_cohesion"]).jumps()
    p, state = Trial(law).numbers(), law.start(N, Trial(law).numbers())
    p.delta_c += 1j * STEP
    same(law.traction, jump, p, state, law_points())
    p.delta_c = p.delta_c.real
    reader = read(law.traction)
    assert not np.iscomplexobj(reader(jump, p, state, law_points())[0])
    assert np.iscomplexobj(reader(jump + 0j, p, state, law_points())[0])


def test_numbers_are_inputs_and_flags_are_not():
    def plain(x, p, flag):
        return {"y": p.a * x if flag else -x, "flag": flag}

    reader, x = read(plain), np.linspace(0, 1, 5)
    for a, flag, size in ((2.0, True, 5), (3.0, True, 3), (3.0, False, 5), (0.0, True, 1)):
        found = reader(x[:size], SimpleNamespace(a=a), flag)
        assert found["flag"] is flag and np.array_equal(
            found["y"], plain(x[:size], SimpleNamespace(a=a), flag)["y"]
        )
    assert reader.left_plain == []


def test_rows_of_points_and_parts_of_arrays():
    def plain(F, w):
        return np.einsum("ij...,kj...->ik...", F, F) * w, np.stack([w, 0 * w])

    F, w = np.random.default_rng(0).normal(size=(2, 2, 12)), np.arange(12.0)
    same(plain, F, w)
    same(plain, F[..., ::2], w[::2])


def test_slopes_of_functions():
    def plain(x, p):
        y = np.exp(x) ** p.n + x**p.n * x**3 / np.sqrt(x) - np.tanh(x**0.5) + p.n**x - (-x)
        y = y + np.sin(x) * np.cos(x) + np.sinh(x) / np.cosh(x) + np.log(x) * np.log1p(x) + np.expm1(x)
        y = y + np.arctan(x) + np.square(x) + np.reciprocal(x) + np.minimum(x, 0.5) * np.maximum(x, p.n)
        return y + np.clip(x, 0.2, 0.8) + np.where((x > 0.3) & ~(x >= 0.6), x**2, (x < 0.1) | (x != x))

    def slope(x, p):
        return np.imag(plain(x + 1j * STEP, p)) / STEP, np.imag(plain(x * (1 + 0j), p)) + x

    x, p = np.linspace(0.053, 0.99, 20), SimpleNamespace(n=0.7)
    with np.errstate(all="raise"):
        same(slope, x, p)
    same(plain, x, p)
    same(plain, x + 1j * STEP, p)


def test_a_root_by_iteration_and_its_slope():
    def root(x):
        def advance(t):
            new = (t + np.real(x) / t) / 2
            return new, np.abs(new - t) < 1e-9 * t

        t = iterated(advance, np.real(x), 60)
        return t - (t * t - x) / (2 * t)

    def both(x):
        return root(x), np.imag(root(x + 1j * STEP)) / STEP

    same(both, np.geomspace(1e-3, 1e3, 30))
    assert np.allclose(read(both)(np.array([4.0, 9.0])), [[2, 3], [1 / 4, 1 / 6]])


@pytest.mark.parametrize(
    "plain",
    [
        lambda x, p: x if p.a == 0 else 2 * x,
        lambda x, p: x * p.a if (x > 0.5).any() else x,
        lambda x, p: x[x > 0.5],
        lambda x, p: x - x.mean(),
        lambda x, p: np.sort(x * p.a),
        lambda x, p: np.imag(np.abs(x - 0.5 + 1j * STEP)) + x,
        lambda x, p: np.interp(x, [0, 1], [0, p.a]),
        lambda x, p: x > 0.5,
        lambda x, p: x + 1j,
        lambda x, p: p.a,
    ],
)  # fmt: skip
def test_what_is_no_formula_of_a_point_stays_numpy(plain):
    reader, x = read(plain), np.linspace(1, 0, 7)
    for a in (0.0, 2.0, 0.0):
        p = SimpleNamespace(a=a)
        for _ in range(2):
            assert np.array_equal(reader(x, p), plain(x, p))
    assert reader.left_plain


def test_a_function_of_fused_functions_is_one_formula():
    inner = read(lambda x: np.exp(-x))
    same(lambda x: inner(x) * x + np.imag(inner(x + 1j * STEP)) / STEP, np.linspace(0, 1, 5))


def test_what_differs_from_numpy_later_on_is_noticed():
    asked = []

    def plain(x):
        asked.append(x)
        return x if len(asked) < 4 else 2 * x

    reader, x = read(plain), np.ones(3)
    assert [reader(x)[0] for _ in range(5)] == [1, 1, 1, 2, 2]
    assert len(reader.left_plain) == 1


def test_none_of_a_failing_law_is_hidden():
    with pytest.raises(ZeroDivisionError):
        read(lambda x: x / (1 // 0))(np.ones(3))


@pytest.mark.skipif(not COMPILED, reason="numba is not installed")
def test_compiled_loops_are_kept_and_answer_alike(tmp_path, monkeypatch):
    monkeypatch.setenv("CUTBENCH_FUSED", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    law = LAWS["coulomb_saturating"]
    strong = fused(lambda *given: law.strength(*given))  # one that no other test has asked
    found = strong(PRESSURE, Trial(law).numbers(), {}, sliding())
    assert np.allclose(found, law.strength(PRESSURE, Trial(law).numbers(), {}, sliding()), rtol=1e-14)
    assert strong.left_plain == [] and len(list(tmp_path.rglob("*.py"))) == 1
    assert pickle.loads(pickle.dumps(fused(np.exp)))(np.zeros(2)).tolist() == [1, 1]
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/no such folder")
    assert np.array_equal(fused(np.cos)(np.zeros(3)), np.ones(3))
