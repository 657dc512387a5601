"""The checks of a law's file find what is wrong with it, and the command says so."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cutbench
from cutbench.cli.main import app
from cutbench.mechanisms.checks import CHECKS, check_file

ROOT = Path(__file__).resolve().parents[1]


def page_law(name: str, page: str) -> str:
    (text,) = re.findall(
        rf"^```python\n# file: my_laws/{name}\.py\n(.*?)^```$", (ROOT / page).read_text("utf-8"), re.M | re.S
    )
    return text


FINITE = page_law("finite", "docs/how-to/extend.md")
DEMIRAY = page_law("demiray", "docs/tutorials/own-law.md")
HOOKE = '''"""Ψ = G/2 |F − 1|²: small strain, taken at its word at any rotation."""

import numpy as np

from cutbench.mechanisms import Bulk, NeoHookean


class Hooke(Bulk):
    """No material."""

    name = "hooke"
    title = "Hooke"
    role = "isochoric"
    parameters = NeoHookean.parameters

    def stress(self, F, p, state, at):
        return p.G * (F - np.eye(3)[:, :, None]), {}

    def energy(self, F, p, state, at):
        return p.G / 2 * ((F - np.eye(3)[:, :, None]) ** 2).sum(axis=(0, 1))
'''
SAME = '''"""Neo-Hooke written out: Ψ = G/2 (Ī₁ − 3)."""

from cutbench.mechanisms import Isochoric, NeoHookean


class Same(Isochoric):
    """A Gaussian network."""

    name = "same"
    title = "same"
    role = "isochoric"
    parameters = NeoHookean.parameters

    def dW_dI1(self, I1, p, at):
        return p.G / 2

    def W(self, I1, p, at):
        return p.G / 2 * (I1 - 3)
'''
PUSH = '''"""T = −c G_c/δ_c² d⟦u⟧: an interface that helps what opens it."""

from cutbench.mechanisms import Cut, Parameter


class Push(Cut):
    """No material either."""

    name = "push"
    title = "push"
    role = "push"
    reads = ("G_c", "delta_c")
    parameters = (Parameter("push_factor", "1", "c", "push", low=0.0, off=0.0, default=0.0, typical=1.0),)

    def groups(self, p):
        return {"push": p.push_factor}

    def traction(self, jump, p, state, at):
        return -p.push_factor * p.G_c / p.delta_c**2 * (jump - at.jump_old), {}
'''


UNIT = "    def groups(self, p):\n        return {'G': p.G}\n\n"
KEPT = "    def start(self, n, p):\n        self.n = n\n        return {}\n\n"


def failed(text: str, tmp_path: Path) -> dict[str, str]:
    name = re.search(r'^    name = "(\w+)"', text, re.M)[1]
    path = tmp_path / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    return {each.check: each.wrong for each in check_file(path) if each.wrong}


@pytest.mark.parametrize("text", [FINITE, DEMIRAY], ids=["finite", "demiray"])
def test_the_laws_of_the_pages_pass(text, tmp_path):
    assert failed(text, tmp_path) == {}


@pytest.mark.parametrize(
    ("text", "old", "new", "check"),
    [
        (DEMIRAY, "return p.G / 2 * np.exp", "return p.G * np.exp", "stress_is_the_energys_derivative"),
        (DEMIRAY, "np.exp(p.k * (I1 - 3))", "np.abs(p.k * (I1 - 3)) + 1", "tangent_is_the_stress_derivative"),
        (DEMIRAY, "    def W(", UNIT + "    def W(", "groups_have_no_unit"),
        (DEMIRAY, "np.exp(p.k * (I1", "np.exp((p.k + 0.1) * (I1", "off_is_absent"),
        (DEMIRAY, "    def W(", KEPT + "    def W(", "stores_nothing"),
        (DEMIRAY, "strain stiffening", " ", "declares_its_parameters"),
        (HOOKE, "", "", "is_frame_indifferent"),
        (PUSH, "", "", "cycles_give_no_energy"),
        (FINITE, "square.real > state[\"widest\"].real ** 2", "square.real > 0", "damage_is_handed_over"),
        (FINITE, "4 / 3 * p.G_c", "p.G_c", "damage_is_handed_over"),
        (FINITE, ', "damage": 1 - keep', "", "is_complete"),
        (FINITE, "p.G_c / p.delta_c**2\n", "p.G_c / p.delta_c\n", "traction_has_its_dimension"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_law_is_found(text, old, new, check, tmp_path):
    assert old in text
    assert check in failed(text.replace(old, new) if old else text, tmp_path)


def test_every_check_says_what_it_requires():
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert all(len(check.says) > 15 for check in CHECKS)


@pytest.mark.parametrize(
    ("text", "status"), [(FINITE, 0), (HOOKE, 1), ("x = 1\n", 2), ("import nowhere_\n", 2)]
)
def test_the_command_says_it_by_its_exit_status(text, status, tmp_path):
    path = tmp_path / ("finite.py" if text == FINITE else "hooke.py")
    path.write_text(text, encoding="utf-8")
    out = CliRunner().invoke(app, ["mechanisms", "--check", str(path)])
    assert out.exit_code == status, out.output
    if status < 2:
        assert ("FAILED" in out.output) == bool(status)


def test_a_law_that_is_equal_to_neo_hooke_passes(tmp_path):
    (tmp_path / "same.py").write_text(SAME, encoding="utf-8")
    assert not [found for found in check_file(tmp_path / "same.py") if found.wrong]


def test_a_blade_that_fails_its_checks_is_not_taken_up(tmp_path):
    (tmp_path / "off.py").write_text(
        "from cutbench.mechanisms import Contact\n\n\nclass Off(Contact):\n    name = 'off'\n"
        "    def edge_radius(self, p):\n        return 2 * super().edge_radius(p)\n"
    )
    done = CliRunner().invoke(app, ["run2d", "gelatin", "--with", "off", "--mechanisms", str(tmp_path)])
    assert done.exit_code == 2 and "off.py" in done.output and "edge_radius()" in done.output
    assert "off" not in cutbench.known_mechanisms()
