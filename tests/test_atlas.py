"""The atlas: estimates that know no units, agree with their runs, and say where they end."""

from __future__ import annotations

import json

import numpy as np
import pytest
from refusals import refusal
from typer.testing import CliRunner

import cutbench
from cutbench.base.errors import BadInput
from cutbench.case.case import Case, load_case
from cutbench.cli.main import app
from cutbench.data import Experiment, FitPlan, Repetition
from cutbench.emulator import estimate
from cutbench.emulator.atlas import NotInAtlas, held_by_friction, shipped
from cutbench.emulator.design_space import BLADES, SIDES
from cutbench.maps.atlas_map import expected_drops
from cutbench.maps.dataset import load_map
from cutbench.maps.study import load_study
from cutbench.run.measures import measures
from cutbench.run.runner import run_case

MATERIALS = "gelatin", "elastomer", "meat"


def test_sides_go_from_end_to_end():
    for side in SIDES:
        assert side.value(0.0) == pytest.approx(side.low, rel=1e-5)
        assert side.value(1.0) == pytest.approx(side.high, rel=1e-5)
        values = [side.value(part) for part in np.linspace((1 + side.off) / 2, 1, 9)]
        steps = np.diff(side.coordinate(np.array(values)))
        np.testing.assert_allclose(steps, steps[0], rtol=0.02)


def test_the_first_half_of_the_points_fills_the_box_too():
    points = BLADES["wedge"].points(64, seed=3)
    np.testing.assert_array_equal(points[:32], BLADES["wedge"].points(32, seed=3))
    for half in (points[:32], points):
        assert np.abs(half.mean(axis=0) - 0.5).max() < 0.03


def test_an_estimate_knows_no_units():
    """Twice as thick a blade in a twice as large and three times as stiff specimen, five times as fast."""
    case = load_case("gelatin")
    v = case.values
    lengths = "thickness", "tip", "delta_c", "surface_length", "length", "height", "width", "depth"
    larger = case.set(
        **{n: f"{2 * v[n]} mm" for n in lengths},
        G=f"{3 * v['G']} MPa", G_c=f"{6e3 * v['G_c']} J/m^2", tau_W=f"{3 * v['tau_W']} MPa",
        eta_reg=f"{v['eta_reg'] * 2 / 5} s", speed=f"{5 * v['speed']} mm/s",
    )  # fmt: skip
    one, other = estimate(case), estimate(larger)
    np.testing.assert_allclose(other.force_N, 12 * one.force_N, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(other.x_mm, 2 * one.x_mm)
    assert other.drop.value == pytest.approx(one.drop.value)
    assert other.chances == pytest.approx(one.chances)


@pytest.mark.parametrize("name", MATERIALS)
def test_an_estimate_is_whole(name):
    found = estimate(name)
    assert sum(found.chances.values()) == pytest.approx(1)
    assert (found.low_N <= found.force_N).all() and (found.force_N <= found.high_N).all()
    assert found.force_N[0] == 0 and found.x_mm[0] == 0
    for measure in (found.onset_mm, found.drop, found.steady_N):
        assert measure.low <= measure.value <= measure.high
    assert sum(share[-1] for share in found.work.values()) == pytest.approx(1)


def test_at_runs_that_it_has_it_says_these():
    """But for what differs from one run to the next however near they are."""
    atlas = shipped()
    begun = np.flatnonzero([np.isfinite(c.onset) and c.x[-1] > c.onset + 12 for c in atlas.courses])
    ends = np.array([atlas.courses[i].end for i in begun])
    m = atlas.measures(atlas.groups[begun], ends)
    true = np.log([atlas.courses[i].onset for i in begun]), np.sqrt(atlas.measured["drop"][begun])
    for said, value in zip((m.onset, m.drop), true, strict=True):
        known = np.isfinite(value)
        off = np.abs(said[:, 0] - value)[known]
        assert np.mean(off < 2 * said[known, 1]) > 0.97
        assert np.median(off) < 0.02


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"cohesion": 60.0}, "G_c"), ({"tip": "5 mm"}, "tip"), ({"with_": "fung"}, "mechanisms"),
        ({"precut": "4 mm"}, "precut"), ({"nu": 0.4}, "nu"), ({"with_": "bevel"}, "mechanisms"),
        ({"without": "contact"}, "mechanisms"),
    ],
)  # fmt: skip
def test_outside_it_gives_no_number(changes, key):
    with pytest.raises(NotInAtlas) as error:
        estimate(load_case("gelatin", changes))
    assert error.value.key == key


def test_a_blade_that_friction_holds_is_told_what_it_would_do_without():
    held = load_case("gelatin", {"mu": 0.3, "depth": "4.5 mm"})
    shallow = load_case("gelatin", {"mu": 0.3, "depth": "1 mm"})
    assert "without coulomb" in held_by_friction(held)
    assert held_by_friction(shallow) == "" and held_by_friction(load_case("gelatin", {"depth": "1 mm"})) == ""


def test_no_friction_is_a_friction_of_none():
    with_none, without = load_case("gelatin", {"mu": 0.0}), load_case("gelatin", {"without": "coulomb"})
    np.testing.assert_allclose(estimate(with_none).force_N, estimate(without).force_N)


def test_the_command_says_it_and_writes_it(tmp_path):
    done = CliRunner().invoke(app, ["estimate", "gelatin", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    record = json.loads((tmp_path / "estimate.json").read_text())
    assert record["verdict"] in done.output and record["verdict"] in record["chances"]
    assert (tmp_path / "estimate.csv").exists() and (tmp_path / "estimate.png").stat().st_size > 10_000
    assert CliRunner().invoke(app, ["estimate", "gelatin", "--set", "cohesion=60"]).exit_code == 2


def test_a_whole_diagram_at_once(tmp_path):
    """The line is where the estimates of single cases change."""
    study = tmp_path / "study.toml"
    study.write_text(
        'base = "gelatin"\nmode = "boundary"\n[protocol]\ndepth = "9 mm"\nuntil = "transition"\n'
        '[[axis]]\nname = "cohesion"\nfrom = 1.0\nto = 12.0\nscale = "log"\n'
        '[[axis]]\nname = "viscosity"\nfrom = 0.01\nto = 5.0\nscale = "log"\n[plot]\nmark = ["gelatin"]\n'
    )
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["sweep", str(study), "--estimate", "--out", str(out)])
    assert done.exit_code == 0, done.output
    data = load_map(out / "map.nc")
    assert (out / "phase.png").exists()
    sure = 0
    for i, j in ((0, 0), (-1, -1), (32, 32), (0, -1), (-1, 0)):
        at = {axis: float(data[axis][k]) for axis, k in (("cohesion", i), ("viscosity", j))}
        said = estimate(load_case("gelatin", {**at, "depth": "9 mm"}))
        if said.chance > 0.98 and said.verdict != "uncut":
            assert (float(data["margin"][i, j]) >= 0) == (said.verdict == "abrupt")
            sure += 1
    assert sure >= 3


def test_what_is_expected_of_a_study_is_of_its_numerics(tmp_path):
    """A map at the default numerics has estimates before its runs, one at others has none."""
    file = tmp_path / "study.toml"
    text = 'base = "gelatin"\n[[axis]]\nname = "viscosity"\nvalues = [0.1, 1.0]\n'
    file.write_text(text)
    drops = expected_drops(load_study(file))
    assert drops is not None and drops[0] > drops[1]
    file.write_text('numerics = { h = "0.1 mm" }\n' + text)
    assert expected_drops(load_study(file)) is None


def test_a_map_that_is_estimated_takes_no_workers_and_no_surge(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(
        'base = "gelatin"\n[[axis]]\nname = "cohesion"\nvalues = [4.0, 8.0]\n[regime]\nsurge = 2.0\n'
    )
    asked = ["sweep", str(study), "--estimate"]
    for option in ("--workers", "--scheduler"):
        refusal(CliRunner().invoke(app, [*asked, option, "2"]), option, value="2")
    refusal(CliRunner().invoke(app, [*asked, "--out", str(tmp_path / "out")]), "surge", file=study, line=6)


def test_many_points_are_the_single_ones_and_say_what_lies_outside():
    table = estimate("gelatin", speed=([0.01, 0.03, 5.0], "mm/s"), cohesion=[3.0, 8.0, 8.0], at_mm=[1.0, 4.0])
    assert list(table.outside.values) == ["", "", "viscosity"]
    assert np.isnan(table.onset_mm[2]) and np.isnan(table.force_N[2]).all()
    for i, (speed, cohesion) in enumerate([("0.01 mm/s", 3.0), ("0.03 mm/s", 8.0)]):
        one = estimate("gelatin", speed=speed, cohesion=cohesion)
        assert table.verdict[i] == one.verdict
        for name in ("onset_mm", "peak_N", "steady_N", "drop"):
            if np.isfinite(getattr(one, name).value):
                assert table[name][i] == pytest.approx(getattr(one, name).value)
        force = np.interp(table.displacement_mm, one.x_mm, one.force_N)
        np.testing.assert_allclose(table.force_N[i], force, rtol=0.02, atol=1e-3)
    far = estimate("gelatin", speed=([5.0, 6.0], "mm/s"))
    assert np.isnan(far.onset_mm).all() and list(far.verdict.values) == ["", ""]
    several = estimate(["gelatin", "elastomer", "meat"])
    assert several.sizes["point"] == 3 and list(several.to_dataframe().outside) == ["", "", ""]


def test_derivatives_are_those_of_differences():
    by = ["G_c", "eta_reg", "mu"]
    table = estimate("gelatin", mu=[0.1], derivatives_by=by, at_mm=[2.0])
    for name, unit, now in (("G_c", "J/m^2", 5.3), ("eta_reg", "s", 4.0), ("mu", "", 0.1)):
        case = load_case("gelatin", {"mu": 0.1})
        now = float(case.shown()[name].split()[0])
        near = [estimate("gelatin", **{"mu": 0.1, name: f"{now * (1 + e):.12g} {unit}".strip()})
                for e in (1e-3, -1e-3)]  # fmt: skip
        for measure in ("onset_mm", "drop"):
            a, b = (getattr(each, measure).value for each in near)
            assert table[f"{measure}_by_{name}"][0] == pytest.approx((a - b) / (2e-3 * now), rel=2e-3)


def test_what_is_off_has_a_derivative_too():
    table = estimate("gelatin", derivatives_by=["mu"])
    near = estimate("gelatin", mu=1e-4).onset_mm.value - estimate("gelatin").onset_mm.value
    assert table.onset_mm_by_mu[0] == pytest.approx(near / 1e-4, rel=0.05)


def test_the_drawn_curve_has_the_numbers_beside_it():
    for name in MATERIALS:
        said = estimate(name)
        window, onset = said.case.p.thickness, said.onset_mm.value
        cut = np.maximum(said.x_mm - onset + window / 7, 0.0)
        curve = {"displacement_mm": said.x_mm, "force_N": said.force_N, "cut_length_mm": cut}
        drawn = measures(curve, window_mm=window, height_mm=said.case.p.height)
        assert said.steady_N.low <= drawn["steady_N"] <= said.steady_N.high
        assert abs(drawn["drop_rel"] - said.drop.value) < 0.03


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speed": ([1.0, 2.0], "kPa")}, "mm/s"), ({"speed": [1.0, 2.0]}, "unit"),
        ({"sped": [1, 2]}, "speed"), ({"mu": [0.1, 0.2], "nu": [0.49] * 3}, "one length"),
        ({"derivatives_by": ["mass"]}, "G_c"),
    ],
)  # fmt: skip
def test_arrays_that_cannot_be_used_are_refused(changes, words):
    with pytest.raises(BadInput, match=words):
        estimate("gelatin", **changes)


def cuts_of_its_own(late_mm: float = 0.0) -> tuple[Case, tuple[Experiment, ...]]:
    """Noisy curves that it gives itself, of a gel other than the one that a search begins with, recorded from
    where the blade is that deep."""
    rng, cuts = np.random.default_rng(11), []
    base = load_case("gelatin", {"depth": "6 mm"})
    for name, speed in (("slow", 0.021), ("fast", 0.05)):
        said = estimate(base.set(G="9 kPa", G_c="6.5 J/m^2", speed=f"{speed} mm/s"))
        x, force = said.x_mm[said.x_mm >= late_mm][::4], said.force_N[said.x_mm >= late_mm][::4]
        repetitions = tuple(
            Repetition(x - late_mm, force + 0.01 * force.max() * rng.standard_normal(force.size))
            for _ in range(3)
        )
        cuts.append(Experiment(name, "cut", repetitions, speed=speed))
    return base, tuple(cuts)


@pytest.mark.parametrize("start", [{}, {"G_c": "12 J/m^2"}])
def test_a_fit_takes_cuts_from_it_and_computes_none(start):
    """Also where no cut begins with the values that it starts from."""
    base, cuts = cuts_of_its_own()
    plan = FitPlan(free=("G", "G_c"))
    campaign = cutbench.Campaign("Gel", base.set(**start), cuts, plan=plan)
    found = cutbench.fit(campaign, workers=0, by_atlas=True)
    assert found.done and found.runs == 0
    for name, true in (("G", 0.009), ("G_c", 0.0065)):
        assert found.estimate(name).low <= true <= found.estimate(name).high
        assert found.estimate(name).value == pytest.approx(true, rel=0.1)


def test_a_search_for_causes_takes_cuts_from_it_and_computes_none():
    """A record that began late is named where there is one; a law that needs runs says so."""
    base, late = cuts_of_its_own(late_mm=0.5)
    held = tuple(n for n in base.model.parameters() if n not in ("G", "G_c"))
    campaign = cutbench.Campaign(
        "Gel", base, late, candidates=("contact_offset", "gent"), plan=FitPlan(("G", "G_c"), held)
    )
    found = cutbench.discover(campaign, workers=0, by_atlas=True)
    assert found.names == ("contact_offset",) and found.fit.runs == 0
    assert abs(found.final.values()["offset"]) == pytest.approx(0.5, abs=0.1)
    assert "gent" in found.steps[0].failed
    # Without it nothing is found, and nothing is sure.
    base, cuts = cuts_of_its_own()
    campaign = cutbench.Campaign(
        "Gel", base, cuts, candidates=("contact_offset",), plan=FitPlan(("G", "G_c"), held)
    )
    found = cutbench.discover(campaign, workers=0, by_atlas=True)
    assert (found.verdict, found.names) == ("undecided", ())


@pytest.mark.parametrize("search", [cutbench.fit, cutbench.discover])
def test_a_campaign_with_a_blade_that_it_lacks_is_refused(search):
    base, cuts = cuts_of_its_own()
    bevelled = base.set(**{"with": "bevel"})
    with pytest.raises(BadInput, match="bevel"):
        search(cutbench.Campaign("Gel", bevelled, cuts), workers=0, by_atlas=True)


@pytest.mark.slow
def test_runs_lie_where_it_says():
    """Four points that nobody ran before: nine in ten values lie within, so that most of these do."""
    inside = []
    for parts in BLADES["wedge"].points(4, seed=11):
        case = BLADES["wedge"].case(parts)
        said, run = estimate(case), run_case(case)
        for name in ("onset_mm", "peak_N", "steady_N"):
            interval, true = getattr(said, name), run.measures[name]
            if np.isfinite(true) and np.isfinite(interval.value):
                inside.append(interval.low <= true <= interval.high)
    assert len(inside) >= 5 and np.mean(inside) >= 0.6
