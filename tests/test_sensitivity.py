"""Derivatives of runs: against central differences at the same steps, and what they may not change."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from refusals import refused

from benchmarks.sensitivities import Marched, extrapolated, moved
from cutbench.base.errors import BadInput
from cutbench.case.case import Case, load_case
from cutbench.mechanisms import registry
from cutbench.run.files import write_run
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import differentiable, extended

#: A weak cut plane and a slender tip: contact, friction, adhesion and damage from the first tenths on.
CUTTING = load_case("gelatin").set(
    h="0.6 mm",
    corner=0.125,
    shallow=1.0,
    step="0.1 mm",
    cohesion=0.3,
    normal="material",  # elements larger than the tip is round
    tip="3.5 mm",
    mu=0.2,
    depth="0.6 mm",
    penalty="100 1/mm",
    detail=1.0,
    stick="40 1/mm",
    multiplier="none",
    tolerance=1e-11,
    solver="superlu",  # of the whole tangent: Newton's last iteration then leaves rounding alone
)
#: Coarser than any run that is meant, for what holds on any mesh.
QUICK = CUTTING.set(element="P1", depth="0.3 mm")
#: Length of the steps of runs that are compared, mm: given, so that no processor chooses others.
LENGTH = 0.05
#: Largest error of a derivative, relative to it, or to a hundredth of its largest where it is smaller.
ERROR, FLOOR = 1e-4, 1e-2


def check(case: Case, names, steps=None, settled=1.0):
    """``settled``: the part of the readings at which differences themselves have digits to compare."""
    middle = Marched(case, names, steps=steps)
    assert middle.stopped is None and middle.lost is None and middle.unresolved == 0
    assert sum(step.advance for step in middle.steps) == pytest.approx(case.values["depth"])
    for i, name in enumerate(names):
        expected, apart = extrapolated(case, name, middle, i)
        largest = np.abs(expected).max()
        assert largest * abs(case.values[name]) > 1e-4 * middle.forces.max(), f"{name} moves nothing"
        scale = np.maximum(np.abs(expected), FLOOR * largest)
        known = apart < ERROR * scale
        assert known.mean() >= settled, f"{name}: differences have no such digits"
        assert (np.abs(middle.slopes[:, i] - expected) / scale)[known].max() < ERROR, name


NAMES = ("G", "nu", "G_c", "delta_c", "eta_reg", "thickness", "tip", "tau_W", "mu", "speed", "surface_length")


def test_derivatives_are_those_of_central_differences():
    check(CUTTING, NAMES, 12 * [LENGTH])


@pytest.mark.parametrize(
    ("changes", "names", "steps"),
    [
        # With the tool's normal the mixed element's neighbours take other steps.
        pytest.param(
            {"element": "P2P1", "augmentations": 1, "normal": "material", "h": "0.7 mm", "depth": "0.35 mm"},
            ("nu", "tip", "tau_W"),
            7 * [LENGTH],
            marks=pytest.mark.slow,
        ),
        pytest.param(  # The cut opens in the last tenth.
            {"normal": "tool", "gap": "ellipse", "depth": "1.1 mm"},
            ("G", "nu", "G_c", "tip", "mu"),
            9 * [2 * LENGTH] + 8 * [LENGTH / 2],
            marks=pytest.mark.slow,
        ),
        ({"multiplier": "carried", "depth": "0.5 mm"}, ("G", "tip", "tau_W"), 5 * [2 * LENGTH]),
        (
            {"damping_mm": 0.0, "without": "adhesion", "depth": "0.3 mm"},
            ("G", "G_c", "tip", "mu"),
            6 * [LENGTH],
        ),
        pytest.param(
            {
                "with_": ["surface_tension", "bending_skin", "film"],
                "gamma_s": "200 mN/m",
                "bent_thickness": "0.2 mm",
                "film_thickness": "0.1 mm",
                "depth": "0.5 mm",
            },
            ("gamma_s", "skin_bending", "film_bending"),
            10 * [LENGTH],
            marks=pytest.mark.slow,
        ),
    ],
    ids=["mixed, augmented", "tool's normal", "carried", "no damping", "surfaces"],
)
def test_they_are_for_other_numerics(changes, names, steps):
    check(CUTTING.set(**changes), names, steps)


@pytest.mark.slow
@pytest.mark.parametrize("material, cohesion", [("gelatin", 2), ("elastomer", None)])
def test_over_a_whole_transition(material, cohesion):
    soft = {"penalty": "100 1/mm", "stick": "40 1/mm", "multiplier": "none"}
    case = load_case(material).set(h="0.6 mm", depth="3 mm", tolerance=1e-11, solver="superlu", **soft)
    if cohesion is not None:  # elements as large as these do not cut gelatin's own in so short a way
        case = case.set(cohesion=cohesion, depth="2 mm")
    assert run_case(case).measures["drop_rel"] > 0.05
    names = [n for n in NAMES if case.values[n] > 0 and n != "thickness"]
    # Within a snap forces bend over shorter distances than differences resolve.
    check(case, names, settled=0.8)
    # How near a surface sees itself goes with the thickness, as the mesh does, and is held as that is.
    check(case.set(self_contact="off"), ["thickness"], settled=0.8)


def test_a_run_does_not_notice_that_it_is_differentiated():
    plain, with_slopes = run_case(QUICK), run_case(QUICK, sensitivities=["G", "G_c"])
    for name, values in plain.curve.items():
        np.testing.assert_array_equal(values, with_slopes.curve[name], err_msg=name)
    assert set(with_slopes.sensitivities) == {"G", "G_c"}
    assert plain.sensitivities == {}
    for slope in with_slopes.sensitivities.values():
        assert slope.shape == plain.force_N.shape
        assert slope[0] == 0 and np.isfinite(slope).all()


def test_the_force_of_scaled_stresses_is_scaled():
    # G, G_c and tau_W times a factor is the force times that factor: Euler's theorem.
    result = run_case(QUICK, sensitivities=["G", "G_c", "tau_W"])
    p = QUICK.p
    total = sum(getattr(p, name) * slope for name, slope in result.sensitivities.items())
    np.testing.assert_allclose(total, result.force_N, rtol=1e-6, atol=1e-9)


def switchable() -> list[str]:
    """Mechanisms that a value switches off and that can stand beside the whole of the default model."""
    roles = {(m.slot, m.role) for m in QUICK.model.all if m.role}
    return [
        name
        for name, m in registry().items()
        if m.off and name not in QUICK.mechanisms and (m.role is None or (m.slot, m.role) not in roles)
    ]


def together() -> list[list[str]]:
    """The same, as many in one model as it takes."""
    groups: list[list[str]] = []
    for name in switchable():
        for group in groups:
            try:
                extended(QUICK, [*group, name])
            except BadInput:
                continue
            group.append(name)
            break
        else:
            groups.append([name])
    return groups


@pytest.mark.parametrize("laws", together(), ids="+".join)
def test_mechanisms_that_are_off_change_nothing_and_have_derivatives(laws):
    case = QUICK.set(depth="0.12 mm", tolerance=1e-9)
    plain = run_case(case)
    wider = extended(case, laws)
    names = [q for name in laws for q in registry()[name].off if q in differentiable(wider.model)]
    result = run_case(wider, sensitivities=names)
    np.testing.assert_allclose(result.force_N, plain.force_N, rtol=1e-9)
    assert set(result.sensitivities) == set(names)
    for slope in result.sensitivities.values():
        assert np.isfinite(slope).all()


def test_the_derivative_at_off_is_that_of_switching_on():
    off = CUTTING.set(tau_W="0 kPa", mu=0.0, depth="0.3 mm")
    middle = Marched(off, ["tau_W", "mu"])
    for i, (name, by) in enumerate({"tau_W": 1e-8, "mu": 1e-5}.items()):
        on = Marched(moved(off, name, by), beside=middle)
        slope = (on.forces - middle.forces) / by
        np.testing.assert_allclose(middle.slopes[:, i], slope, rtol=2e-3, atol=1e-4 * np.abs(slope).max())


def test_names_that_are_refused():
    with refused("sensitivities", value="height"):
        run_case(QUICK, sensitivities=["height"])
    with refused("sensitivities", value="G_k", hint="G_c"):
        run_case(QUICK, sensitivities=["G_k"])
    with refused("with", value="viscous"):
        extended(QUICK, ["viscous"])
    bare = QUICK.set(without=["stiff_cohesion", "viscous_degraded", "adhesion"])
    with refused("with", value="stiff_cohesion"):
        extended(bare, ["stiff_cohesion"])


def test_they_are_written_in_units_a_person_uses(tmp_path):
    result = run_case(QUICK, sensitivities=["G_c", "mu"])
    paths = write_run(result, tmp_path)
    rows = list(csv.reader(paths["sensitivities"].open(encoding="utf-8")))
    assert rows[0] == ["displacement_mm", "dF_dG_c_N_per_J_per_m2", "dF_dmu_N"]
    table = np.array(rows[1:], dtype=float)
    np.testing.assert_allclose(table[:, 1], 1e-3 * result.sensitivities["G_c"], rtol=1e-12)
    write_run(run_case(QUICK), tmp_path)
    assert not paths["sensitivities"].exists()


def test_differences_are_read_where_they_agree():
    """Far ones have left a snap's branch, near ones have no digits, and one may have ended early."""
    from benchmarks.sensitivities import settled

    true, same = np.array([2.0, 3.0, 5.0]), np.ones(3, dtype=bool)
    tried = {
        1e-5: (true[:2] * [1.0, 1.5], same[:2]),
        1e-6: (true * (1 + 1e-6), same),
        1e-7: (true * [1.2, 1 + 2e-6, 1 + 3e-6], np.array([True, False, True])),
    }
    found, kept, doubt = settled(tried)
    np.testing.assert_allclose(found, true, rtol=4e-6)
    assert kept.tolist() == [True, False, True] and doubt.max() < 2e-6
    del tried[1e-7]
    assert settled(tried)[0].size == 2, "of the last reading there is only one difference left"
