"""Laws that do nothing, evaluated beside a run that is without them: what their own run would say."""

from __future__ import annotations

import numpy as np
import pytest

from cutbench.case.case import Case, load_case
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Added, extended

#: With a layer, so that its law stands beside another, and friction, that saturating friction needs.
CHOICES = {"numerics": "fast", "depth": "0.9 mm", "mu": 0.2, "precut": "0.3 mm"}


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case("gelatin", CHOICES)


def added(case: Case, name: str, *strengths: str) -> Added:
    return Added(extended(case, [name]), strengths)


LAWS = {
    "maxwell2": ("g_1", "g_2"), "mullins": ("softening",), "yeoh": ("c2", "c3"),
    "compressible": ("compressibility",), "rate_toughness": ("rate_toughening",),
    "compact_cohesion": ("compactness",), "blunt_tip": ("blunting",), "adhesion_speed": ("tau_v",),
    "coulomb_saturating": ("inv_p_s",), "surface_tension": ("gamma_s",), "stiff_skin": ("skin_stiffness",),
    "uneven_toughness": ("unevenness",),
}  # fmt: skip


@pytest.fixture(scope="module")
def beside(case):
    asked = [added(case, name, *strengths) for name, strengths in LAWS.items()]
    return run_case(case, sensitivities=("G", "G_c"), added=asked)


@pytest.mark.parametrize("name", LAWS)
def test_beside_a_run_is_what_a_run_with_the_law_says(case, beside, name):
    by = beside.by_added[list(LAWS).index(name)]
    own = run_case(extended(case, [name]), sensitivities=LAWS[name])
    np.testing.assert_allclose(own.force_N, beside.force_N, rtol=1e-9)
    for strength in LAWS[name]:
        expected = own.sensitivities[strength]
        assert np.abs(expected).max() > 0
        np.testing.assert_allclose(by[strength], expected, rtol=1e-7, atol=1e-8 * np.abs(expected).max())


def test_the_runs_own_derivatives_stay(case, beside):
    alone = run_case(case, sensitivities=("G", "G_c"))
    for name in ("G", "G_c"):
        np.testing.assert_allclose(beside.sensitivities[name], alone.sensitivities[name], rtol=1e-9)
    assert alone.by_added == []


def test_from_mesh_to_mesh():
    case = load_case("gelatin", {"depth": "2.2 mm", "h": "0.2 mm", "precut": "1 mm", "eta_reg": "1 s"})
    laws = [added(case, "maxwell", "g_1"), added(case, "mullins", "softening")]
    found = run_case(case, added=laws)
    for law, by in zip(laws, found.by_added, strict=True):
        (name,) = law.names
        expected = run_case(law.case, sensitivities=law.names).sensitivities[name]
        np.testing.assert_allclose(by[name], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_what_changes_the_unknowns_needs_a_run_of_its_own(case):
    assert not added(case, "imperfect_bond", "bond_compliance").beside(case)
    assert added(case, "maxwell", "g_1").beside(case)
    mixed = load_case("gelatin", {**CHOICES, "element": "P2P1"})
    assert not added(mixed, "maxwell", "g_1").beside(mixed)
