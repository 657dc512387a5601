"""A blade that slides along its edge: sections sheared along z, what it takes, and blocks."""

from __future__ import annotations

import numpy as np
import pytest
from coarse_runs import BRIEF, QUICK, force_at, quick_run
from form_checks import HEIGHT, P, assembled, blade, blade_case, bulk_form, check_tangent, space_of, total
from refusals import refused

from cutbench.case.case import load_case
from cutbench.forms.base import Step
from cutbench.forms.cut import CutForm
from cutbench.forms.prisms import Prisms, Sheared
from cutbench.run.build import build
from cutbench.run.cutting import run3d
from cutbench.run.runner import run_case
from cutbench.run.snap_back import rate_independent_case


def lively(space, seed=0):
    """Displacements (dim, nnode) that open the cut and shear the section along z."""
    X, shaken = space.X, np.random.default_rng(seed).uniform(-0.02, 0.02, (3, space.X.shape[1]))
    shaken[0] += 0.3 * np.clip(X[1] - 1.0, 0, None) ** 0.5 * np.exp(-X[0])
    shaken[2] += 0.2 * X[1] * np.cos(X[0])
    return shaken


@pytest.mark.parametrize("order", [1, 2])
def test_tangents_of_a_sheared_section(order):
    space = Sheared.over(space_of(2, order))
    u, old = (lively(space, seed).T.ravel() for seed in (0, 1))
    step = Step(0.2, old, np.array([0.0, 1.25, 0.3]), np.array([0.0, 1.35, 0.0]))
    cut = CutForm(BRIEF.model.laws("cut"), space.faces("cut", 4), HEIGHT)
    for form in (bulk_form(space), cut):
        check_tangent(space, form, u, form.start(P), step)
    form = blade(space)
    at, state, step = blade_case(space, form)
    step.centre[2] = 0.01
    check_tangent(space, form, at, state, step)


def test_a_sheared_section_is_a_layer_in_which_nothing_depends_on_z():
    flat, thick = space_of(2, 2), 0.4
    section, layer = Sheared.over(flat), Prisms.of(space_of(3, 1).mesh, flat, np.array([0.0, thick]))
    step = Step(0.2, np.zeros(0), np.array([0.0, 1.25, 0.02]), np.array([0.0, 1.35, 0.0]))
    found = []
    for space in (section, layer):
        planes = space.X.shape[1] // flat.X.shape[1]
        u, old = (np.tile(lively(section, seed), planes).T.ravel() for seed in (0, 1))
        step = Step(0.2, old, step.centre, step.centre_old)
        forces = []
        for form in (bulk_form(space), blade(space)):
            state = form.start(P)
            state |= {key: state[key] + 1e-3 for key in state.keys() & {"foreseen", "touched"}}
            local = form.evaluate(u, P, state, step)
            forces.append(total(assembled(space, form), form, local).reshape(planes, -1, 3).sum(axis=0))
        found.append(forces)
    assert np.abs(found[0][1][:, 2]).max() > 0
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, thick * one, rtol=0, atol=1e-12 * np.abs(one).max())


SLICED = QUICK.set(slice_push=1.0, depth="1.1 mm")


@pytest.fixture(scope="module")
def sliced():
    return run_case(SLICED, snapshots_mm=[1.1])


def test_slicing_takes_push_off_and_closes(sliced):
    curve = sliced.curve
    assert sliced.outcome.done and abs(curve["closure"][-1]) < 0.01
    assert force_at(sliced, 1.0) < 0.95 * force_at(quick_run(), 1.0)
    along = curve["force_along_N"]
    assert (along[2:] > 0).all()  # friction's strength follows the last step's pressure
    assert "along" not in sliced.ledger
    d, mean = curve["displacement_mm"], curve["force_N"] + along
    assert sliced.measures["energy_mJ"] == pytest.approx(np.trapezoid(mean, d), rel=1e-9)
    moved = sliced.snapshots[0].point_data["displacement"][:, 2]
    assert moved.max() > 0.01 and moved.min() > -1e-3


def test_a_blade_that_neither_rubs_nor_adheres_drags_nothing_along():
    """So its force is that of pushing: a smooth edge does not know that it slides."""
    smooth = QUICK.set(tau_W="0 kPa", mu=0, depth="0.5 mm")
    pushed, drawn = run_case(smooth), run_case(smooth.set(slice_push=2.0), snapshots_mm=[0.5])
    np.testing.assert_allclose(drawn.force_N, pushed.force_N, rtol=1e-6)
    assert np.abs(drawn.curve["force_along_N"]).max() < 1e-12
    assert np.abs(drawn.snapshots[0].point_data["displacement"][:, 2]).max() < 1e-9


def test_both_halves_are_dragged_alike(sliced):
    whole = run_case(SLICED.set(symmetry="full", depth="0.5 mm"))
    for name in ("force_N", "force_along_N"):
        expected = np.interp(whole.displacement_mm, sliced.displacement_mm, sliced.curve[name])
        np.testing.assert_allclose(whole.curve[name][:-1], expected[:-1], rtol=0, atol=1e-6 * expected.max())


def test_a_block_is_sliced_along_z():
    small = {"width": "8 mm", "length": "3 mm", "height": "4 mm", "depth": "0.3 mm", "layers": 1, "h": 0.95}
    case = load_case("gelatin", {**small, "element": "P1", "slice_push": 1.0, "mu": 0.2}, dim=3)
    result = run3d(case, snapshots_mm=())
    assert result.outcome.done and abs(result.measures["closure"]) < 0.02
    assert result.curve["force_along_N"][-1] > 0
    assert build(case).geometry.multiplicity == 2


def test_what_cannot_slice_is_refused():
    for turned in ({"tilt": "5 deg"}, {"incline": "5 deg"}, {"overhang": "-1 mm"}):
        with refused("slice_push"):
            load_case("gelatin", {**turned, "slice_push": 1.0}, dim=3)
    with refused("symmetry"):
        load_case("gelatin", {"symmetry": "quarter", "slice_push": 1.0}, dim=3)
    with refused("slice_push"):
        rate_independent_case(SLICED)
    with refused("sensitivities", value="slice_push"):
        run_case(SLICED, sensitivities=["slice_push"])
