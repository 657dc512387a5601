"""Bulk laws with constants of their own: the shear modulus is what they come to, everywhere."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

import cutbench
from cutbench.data import Experiment, Repetition
from cutbench.homogeneous import predict, slopes
from cutbench.mechanisms.law_registry import folders_in_use, look_in

TWO = '''"""Ψ = (A + B) (Ī₁ − 3): neo-Hooke in two constants of its own."""

from cutbench.mechanisms import Isochoric, Parameter


class Two(Isochoric):
    """Its shear modulus is 2 (A + B)."""

    name, title, role = "two", "two", "isochoric"
    parameters = (
        Parameter.positive("A", "kPa", "A", "first constant", typical=5.0),
        Parameter.effect("B", "kPa", "B", "second constant", low=-100.0, typical=2.0),
    )

    def dW_dI1(self, I1, p, at):
        return p.A + p.B

    def W(self, I1, p, at):
        return (p.A + p.B) * (I1 - 3)
'''
BARE = '''"""A cohesive law with constants of its own."""

import math
from types import SimpleNamespace

from cutbench.mechanisms import Isochoric, Parameter, SmithFerrante


class Bare(SmithFerrante):
    """Nothing else reads what it declares."""

    name, title, reads, settable = "bare", "bare", (), ()
    parameters = (Parameter.positive("peak", "kPa", "p", "strength at 0.1 mm", typical=5.0),)

    def own(self, p):
        return SimpleNamespace(G=10 * p.peak, G_c=0.1 * math.e * p.peak, delta_c=0.1, beta=1.0)

    def groups(self, p):
        return {}

    def estimate(self, p, rate, width):
        return super().estimate(self.own(p), rate, width)

    def traction(self, jump, p, state, at):
        return super().traction(jump, self.own(p), state, at)


class Reader(Isochoric):
    """It reads what it should declare."""

    name, title, role, reads = "reader", "reader", "isochoric", ("G",)

    def dW_dI1(self, I1, p, at):
        return p.G / 2

    def W(self, I1, p, at):
        return p.G / 2 * (I1 - 3)
'''


PAGE = (Path(__file__).resolve().parents[1] / "docs" / "tutorials" / "own-law.md").read_text("utf-8")
MOONEY = re.findall(r"^```python\n# file: my_laws/mooney_rivlin\.py\n(.*?)^```$", PAGE, re.M | re.S)[0]


@pytest.fixture(scope="module", autouse=True)
def laws(tmp_path_factory):
    before, folder = folders_in_use(), tmp_path_factory.mktemp("laws")
    (folder / "two.py").write_text(TWO, encoding="utf-8")
    (folder / "bare.py").write_text(BARE, encoding="utf-8")
    (folder / "mooney_rivlin.py").write_text(MOONEY, encoding="utf-8")
    cutbench.use_mechanisms(folder)
    yield
    look_in(before)


def two(**changes):
    return cutbench.load_case("gelatin", {"with": "two", "A": "2 kPa", "B": "1.75 kPa", **changes})


def test_all_that_is_measured_by_the_modulus_is_as_with_neo_hooke():
    gelatin = cutbench.load_case("gelatin")
    assert two().groups() == pytest.approx(gelatin.groups(), rel=1e-12)
    assert "G" not in two().values
    assert two(cohesion=3.0).groups()["(G_c/delta_c)/G"] == pytest.approx(3.0)
    assert two(A="20 kPa").groups()["(G_c/delta_c)/G"] < gelatin.groups()["(G_c/delta_c)/G"] / 5


def test_a_cut_is_that_of_neo_hooke():
    short = {"depth": "0.3 mm", "h": "1.4 mm"}
    ours, known = cutbench.run_case(two(**short)), cutbench.run2d("gelatin", **short)
    np.testing.assert_allclose(ours.force_N, known.force_N, rtol=1e-8, atol=1e-12)


def test_two_invariants_pull_as_the_formula_says():
    x = np.linspace(1.05, 2.5, 6)
    case = cutbench.load_case(
        "gelatin", {"with": "mooney_rivlin", "C10": "3 kPa", "C01": "2 kPa", "nu": 0.49999}
    )
    for kind, stress in (
        ("uniaxial", 2 * (0.003 + 0.002 / x) * (x - x**-2)),
        ("pure_shear", 2 * (0.003 + 0.002) * (x - x**-3)),
        ("equibiaxial", 2 * (0.003 + 0.002 * x**2) * (x - x**-5)),
    ):
        test = Experiment("pull", kind, (Repetition(x, x),))
        np.testing.assert_allclose(predict(test, case.model, case.p), stress, rtol=1e-3)


@pytest.mark.parametrize("more", [{}, {"with_": ["mooney_rivlin", "mullins"], "softening": 0.3}])
def test_in_plane_strain_both_invariants_are_one(more):
    """At constant volume; a block is cut by the same law."""
    short = {"depth": "0.3 mm", "h": "1.4 mm", "nu": 0.499}
    known = {**short, **{k: ["mullins"] if k == "with_" else v for k, v in more.items()}}
    ours = {"with_": "mooney_rivlin", "C10": "2 kPa", "C01": "1.75 kPa", **short, **more}
    one, other = cutbench.run2d("gelatin", **ours), cutbench.run2d("gelatin", **known)
    np.testing.assert_allclose(one.force_N, other.force_N, rtol=5e-3, atol=1e-5)


def test_derivatives_go_through_the_modulus():
    x = np.linspace(1.02, 1.5, 5)
    test = Experiment("pull", "uniaxial", (Repetition(x, 0.01 * (x - x**-2), 10 * x),))
    # With a branch there is a history, which goes along with all derivatives at once.
    for case in (two(nu=0.4), two(nu=0.4, with_=["two", "maxwell"], g_1=0.5)):

        def read(name, step, case=case):
            moved = {**case.values, name: case.values[name] + step}
            return predict(test, case.model, case.model.namespace(moved))

        _, by = slopes(test, case.model, case.p, ("A", "nu"))
        for k, (name, size) in enumerate({"A": 1e-7, "nu": 1e-5}.items()):
            np.testing.assert_allclose(
                by[:, k], (read(name, size) - read(name, -size)) / (2 * size), rtol=1e-4
            )


def test_a_modulus_that_no_law_has_is_refused_with_the_laws_own_parameters():
    for name in ("A", "B"):
        with refused("G", hint=name):
            two(G="8 kPa")
    with refused("cohesion", hint="A"):
        cutbench.load_case("gelatin", {"with": "two", "cohesion": 3.0})


def test_a_material_without_stiffness_is_refused():
    with refused("two"):
        two(A="1 kPa", B="-1 kPa")


@pytest.mark.parametrize(
    ("law", "reader", "parameter"), [("bare", "viscous_degraded", "G_c"), ("reader", "reader", "G")]
)
def test_what_is_read_and_declared_by_no_law_is_refused_by_the_readers_name(law, reader, parameter):
    with refused(f"{reader} reads", value=parameter, hint=law):
        cutbench.load_case("gelatin", {"with": law})
