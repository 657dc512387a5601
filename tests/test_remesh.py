"""Meshes that follow the front: where they are fine, what is carried over, what it changes."""

from dataclasses import replace

import numpy as np
import pytest

from cutbench.case.case import load_case
from cutbench.forms.prisms import Prisms
from cutbench.forms.space import Space
from cutbench.models2d.section import half_block
from cutbench.models3d.extruded import extruded
from cutbench.run.build import build
from cutbench.run.checkpoint import NAME, Checkpoint
from cutbench.run.remeshing import RemeshedMarch, Transfer, follows, lengths
from cutbench.run.result import TRANSFER
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Following

H = 21.0


@pytest.fixture(scope="module")
def case():
    """A thin low block that is cut at once: its front passes several meshes within a second or two."""
    return load_case("gelatin").set(
        h="0.12 mm", shallow=1, corner=0.5, around=1.0, step="0.1 mm", thickness="0.4 mm", delta_c="0.1 mm",
        width="10 mm", height="8 mm", depth="2 mm", G_c="2 J/m^2", eta_v="0.02 mm", energy_step=0.2,
    )  # fmt: skip


def sizes_on_plane(mesh):
    ends = mesh.p[1, mesh.facets[:, mesh.boundaries["cut"]]]
    return ends.mean(axis=0), np.ptp(ends, axis=0)


def test_elements_are_small_where_asked_alone():
    whole = half_block(30, H, 0.125)
    part = half_block(30, H, 0.125, fine=(6.0, 8.0))
    height, size = sizes_on_plane(part)
    within = (H - height > 6) & (H - height < 8)
    assert size[within].max() <= 0.126
    assert size[np.abs(H - height - 7) > 4].min() > 1.0
    assert part.nelements < whole.nelements / 3
    kept = half_block(30, H, 0.125, fine=(6.0, 8.0), kept=np.array([[0.0], [H - 1.0]]))
    height, size = sizes_on_plane(kept)
    assert size[np.abs(H - height - 1) < 0.2].max() <= 0.126
    assert part.nelements < kept.nelements < whole.nelements / 2


def test_points_are_found_in_large_and_small_elements(case):
    space = Space.build(half_block(30, H, 0.25, fine=(6.0, 8.0)), 2)
    rng = np.random.default_rng(0)
    points = np.stack([15 * rng.random(300) ** 3, H * rng.random(300)])
    x, y = space.X
    np.testing.assert_allclose(
        space.probes(points) @ (x**2 - 3 * x * y + y), points[0] ** 2 - 3 * points[0] * points[1] + points[1],
        atol=1e-9,
    )  # fmt: skip
    with pytest.raises(ValueError, match="no element"):
        space.probes(np.array([[-1.0], [3.0]]))


def test_what_one_mesh_serves_is_not_followed(case):
    case = case.set(detail=1.0)
    assert follows(case)
    stride, around = lengths(case)
    assert (stride, around) == (pytest.approx(0.96), pytest.approx(0.96))
    for change in ({"around": 0}, {"h": "0.3 mm"}, {"element": "P2P1"}):
        assert not follows(case.set(**change))


@pytest.fixture(scope="module")
def followed(case):
    return run_case(case)


@pytest.mark.slow
def test_followed_meshes_change_little(case, followed):
    alone = run_case(case.set(around=0))
    assert followed.outcome.done
    assert followed.counts["degrees_of_freedom"] < 0.7 * alone.counts["degrees_of_freedom"]
    assert np.diff(followed.displacement_mm).min() > 0
    at = np.linspace(0.2, 2, 60)
    forces = [np.interp(at, r.displacement_mm, r.force_N) for r in (followed, alone)]
    assert np.abs(forces[0] - forces[1]).max() < 0.03 * forces[1].max()
    for name in ("stiff_cohesion", "neo_hookean"):
        ends = [r.curve[f"work_{name}_mJ"][-1] for r in (followed, alone)]
        assert ends[0] == pytest.approx(ends[1], rel=0.03)
    assert abs(followed.measures["closure"] - alone.measures["closure"]) < 0.01


@pytest.mark.slow
def test_a_block_is_followed_as_its_section_is():
    changes = {
        "h": "0.12 mm", "shallow": 1, "corner": 0.5, "around": 1.0, "step": "0.1 mm", "thickness": "0.4 mm",
        "delta_c": "0.1 mm", "width": "10 mm", "height": "8 mm", "length": "4 mm", "depth": "2 mm",
        "G_c": "2 J/m^2", "eta_v": "0.02 mm", "energy_step": 0.2, "layers": 1,
    }  # fmt: skip
    followed, alone = (run_case(load_case("gelatin", {**changes, "around": a}, dim=3)) for a in (1.0, 0))
    assert followed.outcome.done
    assert followed.ledger[-1] == TRANSFER and TRANSFER not in alone.ledger
    at = np.linspace(0.2, 2, 60)
    for column in ("force_N", "middle_force_N", "cut_length_mm"):
        one, other = (np.interp(at, r.displacement_mm, r.curve[column]) for r in (followed, alone))
        assert np.abs(one - other).max() < 0.03 * np.abs(other).max(), column
    assert abs(followed.measures["closure"] - alone.measures["closure"]) < 0.01
    assert followed.measures["front_centre_mm"] == pytest.approx(alone.measures["front_centre_mm"], rel=0.02)


def test_points_of_a_drawn_out_section_are_carried_plane_by_plane():
    flat = [Space.build(half_block(4.0, 4.0, h), 2) for h in (0.5, 0.3)]
    z = np.array([0.0, 1.0, 3.0])
    old, new = (Prisms.of(extruded(space.mesh, z), space, z).faces("cut", degree=6) for space in flat)
    value = 2.0 * old.X[1] - old.X[2]
    found = new.from_others(old, value.ravel())
    inner = np.abs(new.X[1].ravel() - 2.0) < 1.9
    np.testing.assert_allclose(found[inner], (2.0 * new.X[1] - new.X[2]).ravel()[inner], atol=1e-9)


@pytest.mark.slow
def test_what_a_new_mesh_adds_is_what_its_rest_gives_back(case):
    # Without what resists gradients: on larger elements that stores more in balance too.
    case = case.set(with_="smith_ferrante", without="surface_gradient", detail=1.0)
    *_, last = RemeshedMarch(case.set(depth="0.9 mm", around=0))
    old, coarse = (build(case.set(around=0, h=h)) for h in ("0.12 mm", "0.2 mm"))
    begin = Transfer(old, coarse).progress(last.progress)
    added = sum(begin.added.values())
    assert added > 0.01 * last.force * 0.1, "hardly another mesh"
    rest = next(coarse.march.steps(begin))
    assert rest.added == begin.added and rest.between and not rest.progress.added
    assert rest.step.centre[1] == rest.step.centre_old[1], "the blade does no work"
    assert sum(rest.work.values()) == pytest.approx(-added, rel=0.1)


@pytest.mark.slow
def test_what_new_meshes_leave_open_is_in_the_ledger(case, followed):
    assert followed.ledger[-1] == TRANSFER
    rests = [step for step in RemeshedMarch(case) if step.added]
    left = -sum(sum(step.work.values()) + sum(step.added.values()) for step in rests)
    scale = case.p.length * 2
    assert rests and followed.curve["work_transfer_mJ"][-1] == pytest.approx(scale * left, rel=1e-3)


def test_what_a_mechanism_has_taken_up_is_kept_on_new_meshes(followed):
    """What is dissipated never falls, and what new meshes leave open counts as not closed."""
    curve, blade = followed.curve, np.trapezoid(followed.force_N, followed.displacement_mm)
    for name in ("stiff_cohesion", "viscous_degraded", "adhesion"):
        taken = curve[f"work_{name}_mJ"]
        assert np.diff(taken).min() > -2e-3 * taken[-1], name
    taken = sum(curve[f"work_{name}_mJ"][-1] for name in followed.ledger if name != TRANSFER)
    assert followed.measures["closure"] == pytest.approx(1 - taken / blade, abs=1e-4)
    assert abs(followed.measures["closure"]) < 0.01


def test_a_state_on_the_same_mesh_is_itself(case):
    meshes = RemeshedMarch(case.set(depth="0.9 mm"))
    *_, last = meshes
    old = meshes.built
    new = build(old.case, old.geometry, old.space)
    transfer = Transfer(old, new)
    np.testing.assert_allclose(transfer.displacements(last.u), last.u, atol=1e-6)
    carried = transfer.states(last.states)
    for name in ("damage", "delta_max"):
        np.testing.assert_allclose(carried["cohesion"][name], last.states["cohesion"][name], atol=1e-6)
    for name in ("touched", "pressure", "slid"):
        was = last.states["blade"][name]
        # Points of two faces at one place may differ, and either's value is right.
        assert np.mean(np.abs(carried["blade"][name] - was) > 1e-6 * max(np.abs(was).max(), 1)) < 0.05


@pytest.mark.slow
def test_a_blade_without_friction_is_carried(case):
    """Its laws' shares of the shear are those of none."""
    alone = case.set(without=["adhesion", "coulomb"], depth="1.4 mm")
    meshes = RemeshedMarch(alone)
    *_, last = meshes
    assert meshes.place.strides > 0
    assert last.states["blade"]["shares"].shape[0] == 0


def test_internal_variables_are_carried_on_straight_lines():
    case = load_case("gelatin").set(
        with_="maxwell", g_1=0.5, tau_1="1 s", h="0.5 mm", shallow=1, corner=1, depth="1 mm"
    )  # fmt: skip
    coarse = build(case)
    fine = build(case.set(h="0.3 mm"))
    name = next(name for name in coarse.problem.start()["bulk"])
    old, new = coarse.form("bulk"), fine.form("bulk")

    def field(form):
        x, y = form.volume.X.reshape(2, -1)
        return np.eye(3)[:, :, None] * (1 + 0.1 * x - 0.02 * y)

    found = new.carried(old, {name: field(old)}, fine.problem.p)[name]
    inner = np.abs(new.volume.X.reshape(2, -1)[0] - 7) < 6
    np.testing.assert_allclose(found[..., inner], field(new)[..., inner], atol=0.02)


@pytest.mark.slow
def test_derivatives_go_on_from_mesh_to_mesh(case):
    """dF/dη along marches of the same steps on the same meshes, against a difference."""
    case = case.set(depth="1.5 mm")
    names = ("eta_reg",)
    meshes = RemeshedMarch(case)
    follower = Following(meshes.built, names)
    forces, slopes, given = [], [], [[]]

    def renewed(t):
        follower.renewed(t)
        given.append([])

    for step in meshes.steps(renewed=renewed):
        slopes.append(follower.sensitivities.add(step)[0])
        forces.append(step.force)
        given[-1].append(replace(step.given, u=None))
    assert meshes.place.strides > 0

    def again(eta):
        replay, now, found = RemeshedMarch(case.set(eta_reg=f"{eta:.15g} s")), None, []
        for steps in given:
            now = now and replay.renew(now)[0]
            for step in replay.built.march.steps(now, steps):
                found.append(step.force)
                now = step.progress
        return np.array(found)

    eta = case.values["eta_reg"]
    h = 1e-5 * eta
    difference = (again(eta + h) - forces) / h
    off = np.abs(difference - slopes) / np.abs(slopes).max()
    assert np.median(off) < 1e-4 and np.quantile(off, 0.9) < 0.01


@pytest.mark.slow
def test_a_killed_run_goes_on_on_its_mesh(case, followed, tmp_path):
    def stop(done, total, text):
        if done > 1.7:
            raise KeyboardInterrupt

    path = tmp_path / NAME
    first = run_case(case, on_progress=stop, checkpoint=Checkpoint(path, case.id))
    assert first.outcome.kind == "interrupted"
    second = run_case(case, checkpoint=Checkpoint(path, case.id))
    np.testing.assert_allclose(second.displacement_mm, followed.displacement_mm, rtol=1e-9)
    np.testing.assert_allclose(second.force_N, followed.force_N, rtol=1e-5)
