"""Laws that do nothing, evaluated beside a run that is without them: what their own run would say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cutbench.case.case import Case, load_case
from cutbench.run.remeshing import RemeshedMarch
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Added, Following, extended

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
    "uneven_toughness": ("unevenness",), "fibres": ("g_f",), "fibre_toughness": ("fibre_toughening",),
}  # fmt: skip


@pytest.fixture(scope="module")
def beside(case):
    asked = [added(case, name, *strengths) for name, strengths in LAWS.items()]
    return run_case(case, sensitivities=("G", "G_c"), added=asked)


#: One for each place that a law has; the others are of the same places.
FIRST = ("maxwell2", "mullins", "rate_toughness", "blunt_tip", "coulomb_saturating", "stiff_skin")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in FIRST else pytest.mark.slow) for n in LAWS]
)
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


@pytest.mark.slow  # tests/test_remesh.py has the derivatives of a run by its own laws
def test_from_mesh_to_mesh():
    case = load_case("gelatin").set(
        h="0.12 mm", shallow=1, corner=0.5, around=1.0, step="0.1 mm", thickness="0.4 mm", delta_c="0.1 mm",
        width="10 mm", height="8 mm", depth="1.5 mm", G_c="2 J/m^2", eta_v="0.02 mm", energy_step=0.2,
    )  # fmt: skip
    law, marched = added(case, "mullins", "softening"), RemeshedMarch(case)
    following, found = Following(marched.built, (), [law]), []
    for step in marched.steps(renewed=following.renewed):
        slope = following.sensitivities.add(step)
        found += [] if step.between else [slope[0]]
    assert marched.place.strides > 0
    expected = run_case(law.case, sensitivities=law.names).sensitivities["softening"]
    by = np.array([0.0, *found]) * marched.built.geometry.multiplicity
    np.testing.assert_allclose(by, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


def test_what_changes_the_unknowns_needs_a_run_of_its_own(case):
    assert not added(case, "imperfect_bond", "bond_compliance").shares_unknowns_with(case)
    assert added(case, "maxwell", "g_1").shares_unknowns_with(case)
    for angle, shares in ((0, True), (90, True), (30, False)):
        law = added(case, "fibres", "g_f")
        turned = {**law.case.values, **law.case.model.turned(np.radians(angle))}
        assert Added(replace(law.case, values=turned), law.names).shares_unknowns_with(case) == shares
    mixed = load_case("gelatin", {**CHOICES, "element": "P2P1"})
    assert not added(mixed, "maxwell", "g_1").shares_unknowns_with(mixed)
