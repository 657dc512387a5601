"""Laws that are wrong in one place: a check says so, or says by its name that it could not tell."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from refusals import refused

from cutbench.mechanisms import registry, use_mechanisms
from cutbench.mechanisms.checks import check_file

DOCS = Path(__file__).resolve().parents[1] / "docs"


def page_law(name: str, page: str) -> str:
    text = (DOCS / page).read_text("utf-8")
    return re.findall(rf"^```python\n# file: my_laws/{name}\.py\n(.*?)^```$", text, re.M | re.S)[0]


LAWS = {
    "finite": page_law("finite", "how-to/extend.md"),
    **{name: page_law(name, "tutorials/own-law.md") for name in ("mooney_rivlin", "trapezoid", "demiray")},
}
OTHER_TANGENT = """
    def tangent(self, F, p, state, at, dim):
        from cutbench.mechanisms import NeoHookean, Points
        other = type("Other", (NeoHookean,), {})()
        at.G = 2.2 * p.C10
        return other.tangent(F, type(p)(**vars(p), G=2.2 * p.C10), state, at, dim)

    def W("""
NO_WORK = "\n    def work(self, jump, p, state, at):\n        return None\n\n    def whole("
WORKS, IS_CUT, GIVES = "traction_is_the_works_derivative", "damage_says_what_is_cut", "damage_is_handed_over"
ENERGY, TANGENT = "stress_is_the_energys_derivative", "tangent_is_the_stress_derivative"


def said(name: str, tmp_path: Path, *edits: tuple[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """What is wrong with a law of the pages after ``edits``, and what is not tested, by check."""
    text = LAWS[name]
    for old, new in edits:
        assert old in text, "an edit that does nothing is no mutant"
        text = text.replace(old, new)
    path = tmp_path / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    findings = list(check_file(path))
    wrong, untested = ({f.check: getattr(f, of) for f in findings} for of in ("wrong", "untested"))
    return {k: v for k, v in wrong.items() if v}, {k: v for k, v in untested.items() if v}


@pytest.mark.parametrize("name", LAWS)
def test_the_laws_themselves_pass(name, tmp_path):
    wrong, untested = said(name, tmp_path)
    assert not wrong
    known = {"finite": {WORKS, "groups_have_no_unit"}, "mooney_rivlin": {"off_is_absent"}}
    assert set(untested) == known.get(name, set())


@pytest.mark.parametrize(
    ("name", "old", "new", "check"),
    [
        # a factor missing
        ("mooney_rivlin", "        return p.C10\n", "        return p.C10 / 2\n", ENERGY),
        ("mooney_rivlin", "        return p.C01\n", "        return p.C01 / 2\n", ENERGY),
        ("mooney_rivlin", "p.C01 * (I2 - 3)", "p.C01 * I2", "is_at_rest_undeformed"),
        ("trapezoid", "/ (self.area(p) * RISE)", "/ RISE", GIVES),
        ("trapezoid", "s**2 / (2 * RISE)", "s**2 / RISE", GIVES),
        ("trapezoid", "p.delta_c**2", "p.delta_c", "traction_has_its_dimension"),
        ("finite", "4 / 3 * p.G_c", "p.G_c", GIVES),
        # a wrong power
        ("trapezoid", "    def whole(", "    def traction(self, jump, p, state, at):\n"
         "        T, new = super().traction(jump, p, state, at)\n"
         "        T[1:] = T[1:] / p.beta\n        return T, new\n\n    def whole(", WORKS),
        ("finite", "p.beta**2 * jump", "p.beta * jump", WORKS),
        # abs, and norms
        ("trapezoid", "end - s, 0)", "np.abs(end - s), 0)", "traction_differentiates"),
        ("demiray", "np.exp(p.k * (I1 - 3))", "np.exp(p.k * np.abs(I1 - 3))", TANGENT),
        ("finite", "s = widest / p.delta_c", "s = widest / np.abs(p.delta_c)", "parameters_differentiate"),
        # healing
        ("finite", "square.real > state[\"widest\"].real ** 2", "square.real > 0", GIVES),
        # the tangent of another law
        ("mooney_rivlin", "\n    def W(", OTHER_TANGENT, TANGENT),
        # no work
        ("trapezoid", "\n    def whole(", NO_WORK, WORKS),
        # another modulus than that which others read
        ("demiray", "        return p.G / 2 * (np.expm1(p.k * (I1 - 3)) / p.k if p.k else I1 - 3)",
         "        return p.G * (np.expm1(p.k * (I1 - 3)) / p.k if p.k else I1 - 3)", ENERGY),
        # damage that does not say what is cut
        ("trapezoid", "return self.left(s, p) / (1 + p.fall)", "return self.keep(s, p)", IS_CUT),
        ("trapezoid", "return self.left(s, p) / (1 + p.fall)", "return np.exp(-s)", IS_CUT),
        ("finite", '"damage": 1 - keep}', '"damage": np.where(s.real < 30, s / 30, 1)}', IS_CUT),
        ("finite", '"damage": 1 - keep}', '"damage": np.where(s.real < 0.5, 2 * s, 1)}', IS_CUT),
    ],
)  # fmt: skip
def test_a_wrong_law_is_caught_or_not_tested_by_name(name, old, new, check, tmp_path):
    wrong, untested = said(name, tmp_path, (old, new))
    assert check in wrong or check in untested


def test_a_law_whose_damage_would_mislead_a_run_is_not_taken_up(tmp_path):
    known = set(registry())
    text = LAWS["trapezoid"].replace("return self.left(s, p) / (1 + p.fall)", "return self.keep(s, p)")
    (tmp_path / "trapezoid.py").write_text(text, encoding="utf-8")
    with refused("trapezoid", file="trapezoid.py"):
        use_mechanisms(tmp_path)
    assert set(registry()) == known


def test_a_modulus_that_others_would_misread_is_caught(tmp_path):
    wrong, _ = said("demiray", tmp_path, ("p.G / 2", "p.G"))
    assert "modulus_is_that_of_small_shear" in wrong


def test_rounding_is_no_failure(tmp_path):
    wrong, _ = said(
        "demiray", tmp_path, ("return p.G / 2 * np.exp", "return p.G * (0.1 + 0.2) / 0.6 * np.exp")
    )
    assert not wrong
