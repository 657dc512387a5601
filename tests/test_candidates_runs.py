"""Every candidate in whole runs: off is absent to the bit, on it shows and its energy is accounted for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import form_checks
import numpy as np
import pytest
from form_checks import HEIGHT, P, check_tangent, displacement, space_of, step_between

from cutbench.base.errors import BadInput
from cutbench.case.case import Case, load_case
from cutbench.case.model import DEFAULT, Model
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.forms.mixed import MixedVolumetric
from cutbench.forms.support import SupportForm
from cutbench.mechanisms import registry
from cutbench.run.build import build
from cutbench.run.fields import snapshot
from cutbench.run.runner import run_case

LAW = registry()
CANDIDATES = [
    name
    for name, law in LAW.items()
    if law.off and name not in (*DEFAULT, "viscous") and "cut" in getattr(law, "kinds", ("cut",))
]

#: A small, weak block under a long tip: it is cut from 0.4 mm on. Its elements are larger than the tip
#: is round: pressure along the tool's normal would push them down, not apart.
SMALL = {
    "G_c": "0.3 J/m^2", "mu": 0.1, "eta_reg": "8 s", "tip": "2 mm", "width": "8 mm", "height": "5 mm",
    "depth": "0.8 mm", "h": "0.7 mm", "penalty": "200 1/mm", "stick": "100 1/mm", "multiplier": "none",
    "corner": 0.25, "normal": "material", "shallow": 1.0, "step": "0.1 mm", "tolerance": 1e-9,
}  # fmt: skip


def extended(base: Case, *names: str, on: bool) -> Case:
    model, new = base.model.extended(*names)
    if on:
        new = {k: q.typical * q.factor for k, q in model.parameters().items() if k in new}
    return replace(base, mechanisms=model.mechanisms, values={**base.values, **new})


@cache
def baseline():
    return run_case(baseline_case())


def test_the_baseline_cuts():
    run = baseline()
    assert run.outcome.done and run.measures["onset_mm"] < 0.65
    assert abs(run.measures["closure"]) < 0.03


def together() -> list[tuple[str, ...]]:
    """Candidates that can stand in one model, those of the support apart: every one in one group."""
    groups: list[tuple[str, ...]] = []
    for name in CANDIDATES:
        for k, group in enumerate(groups):
            if (LAW[name].slot == "support") == (LAW[group[0]].slot == "support"):
                try:
                    model, _ = baseline_case().model.extended(*group, name)
                except BadInput:
                    continue
                if {*group, name} <= set(model.mechanisms):
                    groups[k] = (*group, name)
                    break
        else:
            groups.append((name,))
    return groups


@cache
def baseline_case() -> Case:
    return load_case("gelatin", SMALL, dim=2)


@pytest.mark.parametrize("names", together(), ids="+".join)
def test_off_is_absent_to_the_bit(names):
    base, run = baseline(), run_case(extended(baseline().case, *names, on=False))
    for key, column in base.curve.items():
        replaced = key not in run.curve
        assert not replaced or any(m not in run.case.mechanisms and m in key for m in base.case.mechanisms)
        if not replaced and LAW[names[0]].slot == "support":  # one more unknown: the same but for rounding
            np.testing.assert_allclose(run.curve[key], column, rtol=0, atol=1e-6 * np.abs(column).max())
        elif not replaced:
            assert np.array_equal(run.curve[key], column), key


def of_each_class() -> list:
    """All candidates that a run can show, the first of each slot and family at once and the others slowly."""
    seen, found = set(), []
    for name in (name for name in CANDIDATES if LAW[name].role != "softening"):
        kind = LAW[name].slot, LAW[name].family
        found.append(pytest.param(name, marks=pytest.mark.slow if kind in seen else ()))
        seen.add(kind)
    return found


@pytest.mark.parametrize("name", of_each_class())
def test_on_it_shows_and_the_ledger_closes(name):
    base, run = baseline(), run_case(extended(baseline().case, name, on=True))
    assert run.outcome.done, run.outcome
    assert abs(run.measures["closure"]) < 0.03
    assert run.measures["reaction_error"] < 1e-6
    if LAW[name].slot == "rig":
        assert np.array_equal(run.force_N, base.force_N), "the rig does not change what happens"
        shown = [run.curve["recorded_displacement_mm"], run.curve["recorded_force_N"]]
        assert not np.array_equal(shown, [run.displacement_mm, run.force_N])
        assert np.array_equal(shown, run.case.model.record(*shown_arguments(run)))
        return
    force = np.interp(base.displacement_mm, run.displacement_mm, run.force_N)
    assert np.abs(force - base.force_N).max() > 1e-3 * base.force_N.max()
    # The pressure of contact may act to either side: along the material's normal it has no potential.
    if LAW[name].slot != "skin" and LAW[name].role != "contact":
        assert run.curve[f"work_{name}_mJ"][-1] > 0


def shown_arguments(run):
    return run.displacement_mm, run.force_N, run.curve["time_s"], run.case.p


# -- forms with the laws that need more than a stress factor ---------------------------------------
BULKY = ("maxwell2", "mullins", "gent", "stiff_skin")
ON = SimpleNamespace(**{
    **vars(P), "inv_J_m": 0.1, "g_1": 0.5, "tau_1": 0.3, "g_2": 0.4, "tau_2": 2.0, "softening": 0.4,
    "softening_energy": 0.05, "skin_stiffness": 2.0, "skin_toughness": 1.5, "skin_thickness": 0.5,
    "unevenness": 0.5, "wavelength": 0.6, "phase": 0.3, "rate_toughening": 0.5, "rate_reference": 0.01,
    "compactness": 0.4, "tau_v": 2e-3, "adhesion_reference": 0.01, "wear": 1e-3, "blunting": 0.7,
})  # fmt: skip
spaces = pytest.mark.parametrize("dim, order", [(2, 2), (3, 1)])


def bulk(space, names=BULKY, degree=None) -> BulkForm:
    model = Model(DEFAULT).with_(*names)
    degree = 2 * space.order - 1 if degree is None else degree
    return BulkForm(model.laws("bulk"), space.volume(degree), HEIGHT, model.laws("skin"))


@spaces
def test_bulk_tangent_with_states_and_a_skin(dim, order):
    space = space_of(dim, order)
    form, step = bulk(space), step_between(space)
    past = form.evaluate(2.2 * displacement(space, 5, 0.01), ON, form.start(ON), step).state
    u = 2 * displacement(space, size=0.01)
    new = form.evaluate(u, ON, past, step).state
    grew = new["largest_energy"] > past["largest_energy"]
    assert grew.any() and not grew.all()
    check_tangent(space, form, u, past, step, p=ON)


@spaces
def test_bulk_work_is_that_of_the_nodal_forces(dim, order):
    """Small steps along a path of loading and unloading: Σ R·Δu, by the trapezoid."""
    space = space_of(dim, order)
    form, step = bulk(space), step_between(space)
    u1 = 2 * displacement(space, size=0.01)
    state, total, spent = form.start(ON), 0.0, {}
    way = [s * u1 for s in (*np.linspace(0, 1, 90), *np.linspace(1, 0.3, 50)[1:])]
    size = space.ndof

    def forces(local):
        return np.bincount(form.dofs.ravel(), local.vector.ravel(), size)

    R_old = np.zeros(size)
    for old, u in pairwise(way):
        step.u_old = old
        local = form.evaluate(u, ON, state, step)
        R = forces(local)
        total += (R + R_old) / 2 @ (u - old)
        for name, value in form.work(u, ON, state, local.state, step).items():
            spent[name] = spent.get(name, 0.0) + value
        state, R_old = local.state, R
    assert set(spent) == {law.name for law in form.laws}
    assert min(abs(value) for value in spent.values()) > 1e-3 * total
    assert sum(spent.values()) == pytest.approx(total, rel=1e-3)


@spaces
def test_cut_tangent_with_rate_shape_and_skins(dim, order):
    space = space_of(dim, order)
    model = Model(DEFAULT).with_("compact_cohesion", "rate_toughness", "tough_skin", "uneven_toughness")
    form = CutForm(model.laws("cut"), space.faces("cut", 4), HEIGHT, skins=model.laws("skin"))
    step = step_between(space)
    state = form.evaluate(0.8 * displacement(space, 7, 0.05), ON, form.start(ON), step).state
    check_tangent(space, form, displacement(space), state, step, p=ON)


@pytest.mark.parametrize("normal", ["tool", "material"])
def test_blade_tangent_where_strength_depends_on_the_rate(normal):
    space = space_of(2, 2)
    laws = Model(DEFAULT).with_("adhesion_speed", "adhesion_wear", "blunt_tip").laws("blade")
    numerics = ContactNumerics(stiffness=5 * P.G, tangential=20 * P.G, normal=normal)
    form = BladeForm(laws, space.faces("cut", 6), numerics, keep_touched=["cut"], height=HEIGHT)
    u, state, step = form_checks.blade_case(space, form, ON)
    new = form.evaluate(u, ON, state, step).state
    strength = sum(law.strength(state["pressure"], ON, state, SimpleNamespace(
        touched=state["touched"], slid=state["slid"], slip_rate=(new["slid"] - state["slid"]) / step.dt,
    )) for law in laws)  # fmt: skip
    shear = np.sqrt((new["shear"] ** 2).sum(axis=0))
    assert (shear[strength > 0] > 0.999 * strength[strength > 0]).any(), "some points slip"
    check_tangent(space, form, u, state, step, p=ON, rtol=1e-9)


def test_a_skin_scales_the_mixed_element_too():
    """Energy, residual and tangent from one potential, whatever the factor."""
    space = space_of(2, 2)
    model = Model(DEFAULT).with_("stiff_skin")
    law = next(law for law in model.laws("bulk") if law.role == "volumetric")
    form = MixedVolumetric(law, space, 4, HEIGHT, model.laws("skin"))
    rng = np.random.default_rng(2)
    u = np.concatenate(
        [2 * displacement(space, size=0.01), 0.05 * rng.standard_normal(form.ndof - space.ndof)]
    )
    local = form.evaluate(u, ON, {}, None)
    R = np.bincount(form.dofs.ravel(), local.vector.ravel(), form.ndof)
    d, h = rng.standard_normal(form.ndof), 1e-6
    up, down = (form.energies(u + s * h * d, ON, {})[law.name] for s in (1, -1))
    assert R @ d == pytest.approx((up - down) / (2 * h), rel=1e-6)
    moved = form.evaluate(u + 1j * 1e-30 * d, ON, {}, None).vector.imag / 1e-30
    by_matrix = np.einsum("abe,be->ae", local.matrix, d[form.dofs])
    np.testing.assert_allclose(by_matrix, moved, rtol=0, atol=1e-10 * np.abs(moved).max())
    soft = form.evaluate(u, SimpleNamespace(**{**vars(ON), "skin_stiffness": 0.0}), {}, None)
    plain = MixedVolumetric(law, space, 4, HEIGHT).evaluate(u, ON, {}, None)
    assert np.array_equal(soft.vector, plain.vector) and np.array_equal(soft.matrix, plain.matrix)
    assert not np.array_equal(local.matrix, plain.matrix)


# -- support ---------------------------------------------------------------------------------------
@spaces
def test_a_base_that_gives_carries_what_it_moves_by(dim, order):
    """u_t = c λ at every point; force and energy are those of an elastic layer of stiffness 1/c."""
    space = space_of(dim, order)
    form = SupportForm(LAW["imperfect_bond"], space.faces("bottom", 2 * order), space.ndof)
    p = SimpleNamespace(bond_compliance=4.0)
    traction, held = form.pairs
    u = np.zeros(form.ndof)
    u[: space.ndof] = 0.1 * np.random.default_rng(1).standard_normal(space.ndof)
    u[traction] = u[held] / 4.0
    local = form.evaluate(u, p, {}, None)
    R = np.bincount(form.dofs.ravel(), local.vector.ravel(), form.ndof)
    assert np.abs(R[traction]).max() < 1e-15
    sides = [i for i in range(dim) if i != 1]
    f = space.faces("bottom", 2 * order)
    moved = np.einsum("qaf,iaf->iqf", f.N, u[f.nodes[None] * dim + np.array(sides)[:, None, None]])
    forces = R[: space.ndof].reshape(-1, dim)
    np.testing.assert_allclose(forces[:, sides].sum(axis=0), (moved * f.w).sum(axis=(1, 2)) / 4, rtol=1e-12)
    assert not forces[:, 1].any(), "the base does not lift"
    assert form.energy(u, p) == pytest.approx(float((moved**2 * f.w).sum()) / 8, rel=1e-12)
    d = np.random.default_rng(2).standard_normal(form.ndof)
    moved = form.evaluate(u + 1e-30j * d, p, {}, None).vector.imag / 1e-30
    np.testing.assert_allclose(np.einsum("abe,be->ae", local.matrix, d[form.dofs]), moved, atol=1e-14)


@pytest.mark.parametrize("solver", ["superlu", "auto"])
@pytest.mark.parametrize("element", ["P2", "P2P1"])
def test_a_loose_base_softens_the_block_and_a_firm_one_does_not(solver, element):
    changes = {**SMALL, "depth": "0.3 mm", "solver": solver, "element": element}
    base = load_case("gelatin", changes, dim=2)
    forces = [run_case(base).force_N[-1]]
    for c in ("0 mm/kPa", "1e-6 mm/kPa", "1 mm/kPa", "1000 mm/kPa"):
        run = run_case(base.set(with_="imperfect_bond", bond_compliance=c))
        assert run.outcome.done and abs(run.measures["closure"]) < 0.03
        forces.append(run.force_N[-1])
    clamped, off, firm, soft, free = forces
    assert off == pytest.approx(clamped, rel=1e-7)
    assert firm == pytest.approx(clamped, rel=1e-5) and firm != off
    assert free < soft < 0.99 * clamped


# -- other elements and dimensions -----------------------------------------------------------------
def test_states_in_the_mixed_element_and_in_pictures():
    changes = {**SMALL, "element": "P2P1", "corner": 0.125, "depth": "0.3 mm"}
    case = extended(load_case("gelatin", changes, dim=2), "maxwell", "mullins", "stiff_skin", on=True)
    built = build(case)
    *_, last = built.march
    picture = snapshot(built, last)
    assert np.isfinite(picture.point_data["cauchy"]).all()
    plain = run_case(load_case("gelatin", changes, dim=2), snapshots_mm=[0.3]).snapshots[0]
    top = [float(s.point_data["von_mises"].max()) for s in (picture, plain)]
    assert top[0] > 1.5 * top[1], "the skin is three times as stiff, and the branch adds to it"


def test_three_dimensions():
    small = {
        "element": "P1",
        "h": "0.7 mm",
        "depth": "0.3 mm",
        "length": "2 mm",
        "width": "6 mm",
        "height": "4 mm",
        "layers": 1,
    }
    base = load_case("gelatin", small, dim=3)
    names = ("maxwell", "mullins", "gent", "stiff_skin", "rate_toughness", "adhesion_speed", "blunt_tip",
             "imperfect_bond")  # fmt: skip
    runs = [
        run_case(case) for case in (base, extended(base, *names, on=False), extended(base, *names, on=True))
    ]
    assert all(run.outcome.done for run in runs)
    np.testing.assert_allclose(runs[1].force_N, runs[0].force_N, rtol=0, atol=1e-7 * runs[0].force_N.max())
    assert runs[2].force_N[-1] > 1.1 * runs[0].force_N[-1]
    assert abs(runs[2].measures["closure"]) < 0.03
    assert runs[2].curve["work_maxwell_mJ"][-1] > 0
