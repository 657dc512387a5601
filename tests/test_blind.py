"""Blind campaigns: they can be read, hide what they say they do, and an answer is held against that."""

from __future__ import annotations

import ast
import inspect
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import runs_by_formula
from blind_cases import made
from looped import over

from benchmarks import formulas
from benchmarks.blind import Answer, judge, main, page, summary
from benchmarks.blind_campaigns import (
    ANGLES,
    BY_FORMULA,
    DOUBLE,
    FAMILIES,
    LAWS,
    MODES,
    OF_CUTS,
    OTHERWISE,
    SPEEDS,
    UNDIRECTED,
    Curve,
    Gel,
    Planned,
    Truth,
    make,
    missed,
    plan,
    shown,
)
from benchmarks.stand_in import StandIn
from cutbench.case.case import load_case
from cutbench.data.campaign import load_campaign
from cutbench.emulator.atlas import shipped

SEED = 3
STRETCH = np.linspace(1.0, 1.8, 60)[1:]
LAWS_OF_BODIES = [e for e, names in BY_FORMULA.items() if names[0] not in ("machine", "reading")][:7]
GEL = Gel(8.0, 5.0, 1.5, 1.0)


def body(*effects, **values):
    made = formulas.Body(effects, np.random.default_rng(1))
    made.__dict__ |= {"G": 0.1, **values}
    return made


# -- what is planned ----------------------------------------------------------------------------------
@pytest.mark.parametrize("family", [family for family in FAMILIES if family != "fibres"])
def test_a_fifth_hides_nothing_and_all_effects_take_turns(family):
    planned = plan(family, 120, SEED)
    sorts = Counter(p.sort for p in planned)
    assert (sorts["none"], sorts["alien"]) == (24, 8)
    assert sorts["two"] == (20 if family == "homogeneous" else 0)
    one = Counter(p.effects[0] for p in planned if p.sort == "one")
    pool = [*BY_FORMULA, *(e for laws in LAWS.values() for e in laws)] if family == "homogeneous" else OF_CUTS
    assert set(one) == set(pool) and max(one.values()) - min(one.values()) <= 1
    assert plan(family, 120, SEED) == planned != plan(family, 120, SEED + 1)
    assert all(p.classes for p in planned if p.sort in ("one", "two"))


def test_half_of_the_sheets_have_fibres_and_specimens_say_how_they_lie_to_them(tmp_path):
    planned = plan("fibres", 12, SEED)
    hidden = Counter(p.effects for p in planned)
    assert hidden == {**{(e,): 2 for e in formulas.FIBRED}, **{(e,): 1 for e in UNDIRECTED}, (): 3}
    fibred = next(p for p in planned if p.effects == ("Qiu-Pence",))
    campaign = load_campaign(make(fibred, SEED, tmp_path).file)
    assert len(campaign.angles) == 2 and fibred.classes == (("anisotropy",),)
    angles = [round(np.degrees(e.angle)) for e in campaign.experiments]
    assert tuple(angles) in ANGLES and campaign.experiments[2].role == "test"


@pytest.mark.parametrize("effect", formulas.FIBRED)
def test_a_sheet_is_stiffest_along_its_fibres(effect):
    body = formulas.FibredBody((effect,), np.random.default_rng(1))
    body.lie, stress = 0.0, []
    for angle in (0.0, 0.7, np.pi / 2):
        body.angle = angle
        stress.append(body.force("uniaxial", STRETCH, STRETCH)[-1] / body.G)
    isotropic = STRETCH[-1] - STRETCH[-1] ** -2
    assert stress[0] > stress[1] > isotropic - 1e-6 and stress[0] > 1.2 * stress[2]
    body.lie = 0.7
    turned = body.force("uniaxial", STRETCH, STRETCH)
    body.lie, body.angle = 0.0, np.pi / 2 - 0.7
    np.testing.assert_allclose(body.force("uniaxial", STRETCH, STRETCH), turned, rtol=1e-5)


@pytest.mark.parametrize("family", ["cut", "mixed"])
def test_cuts_have_other_blades_and_what_is_beside_them(family):
    planned = plan(family, 60, SEED)
    blades, numerics = ({p.how[k] for p in planned} for k in (1, 0))
    assert blades == {"ellipse", "two thicknesses", "wedge"} and numerics == {*dict(OTHERWISE)}
    beside = {p.how[2:] for p in planned}
    assert beside == ({("tension",), ("hold",), ("pull-off",)} if family == "mixed" else {()})
    assert not [p for p in planned if "wedge" in p.how and "blunt tip" in p.effects]


# -- formulas -----------------------------------------------------------------------------------------
def test_nothing_of_the_package_is_in_the_formulas():
    tree = ast.parse(inspect.getsource(formulas))
    names = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    names += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    assert names and not [n for n in names if n.split(".")[0] in ("cutbench", "benchmarks")]


@pytest.mark.parametrize("mode", ["uniaxial", "press", "pure_shear"])
@over("effect", [None, *LAWS_OF_BODIES])
def test_every_law_starts_with_its_modulus(mode, effect):
    """Stress over stretch at the start, fast: 3 G in tension, 4 G in pure shear; no effect lowers that."""
    x = 1 + np.array([1, 2, 3]) * (-1e-5 if mode == "press" else 1e-5)
    slope = body(*[effect] * (effect is not None)).force(mode, np.array([1.0, 2.0, 3.0]) * 1e-6, x)[0] / (
        x[0] - 1
    )
    assert slope == pytest.approx((0.4 if mode == "pure_shear" else 0.3), rel=0.02)


def test_a_held_zener_body_relaxes_to_its_spring():
    t = np.geomspace(1e-3, 400, 200)
    P = body("Zener", part=0.5, tau=5.0).force("pure_shear", t, np.full(t.size, 1.4))
    spring = 0.1 * (1.4 - 1.4**-3)
    assert P[0] == pytest.approx(spring, rel=0.01) and P[-1] == pytest.approx(spring / 2, rel=1e-3)
    small = body("Zener", part=0.5, tau=5.0).force("uniaxial", t, np.full(t.size, 1.001))
    np.testing.assert_allclose(small / small[0], 0.5 + 0.5 * np.exp(-t / 5.0), atol=5e-3)


def test_blatz_and_kos_rubber_has_its_poissons_ratio():
    P = body("volume", nu=0.3).force("uniaxial", np.ones(1), np.array([1 + 1e-6]))
    assert P[0] / 1e-6 == pytest.approx(2 * 0.1 * 1.3, rel=1e-3)
    shear = body("volume", nu=0.3).force("pure_shear", np.ones(1), np.array([1 + 1e-6]))
    assert shear[0] / 1e-6 == pytest.approx(2 * 0.1 / 0.7, rel=1e-3)


# -- campaigns ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("number", range(4))
def test_a_campaign_by_formulas_reads_as_it_was_made(tmp_path, number):
    planned = Planned(number, "homogeneous", DOUBLE[number], ("formula", "several conditions"))
    truth = make(planned, SEED, tmp_path)
    campaign = load_campaign(truth.file)
    assert [e.role for e in campaign.experiments] == ["train", "train", "test", "test"]
    kinds = {e.kind for e in campaign.experiments}
    assert any(kinds == {m.replace("press", "uniaxial") for m in modes} for modes in MODES)
    for e in campaign.experiments:
        t, _, y = truth.clean[e.id]
        grid = e.on_grid()
        part = np.interp(grid.time_s, t, y) / grid.mean
        # The specimens differ from the clean one by a factor.
        assert np.median(part) == pytest.approx(1.0, abs=4 * truth.scatter / truth.specimens**0.5)
        assert len(e.repetitions) == truth.specimens


@pytest.mark.parametrize(("effect", "shows"), [("gent", "bulk"), ("adhesion_speed", "sliding")])
def test_what_is_hidden_shows_and_nothing_else_does(effect, shows):
    truth, plain = made(effect, shows), made("", shows)
    assert truth.misfit > 2 > 1e-6 > plain.misfit
    assert truth.shown > 5 > 1e-6 > plain.shown


def test_a_factor_of_all_curves_is_no_effect():
    """It is what the stiffness can take up."""
    x = np.linspace(0.1, 1, 40)
    one = Curve("a", "train", x, x, x**2, x[:, None] ** 2, [])
    other = replace(one, id="b", y=3 * one.y, columns=3 * one.columns)
    assert shown([one, other], 3, 0.03, 0.01) < 1e-6
    assert shown([replace(c, y=1.1 * c.y) for c in (one, other)], 3, 0.03, 0.01) < 1e-6
    # Where one alone has it, it counts by how far specimens differ.
    apart = [one, replace(other, y=1.5 * other.y)]
    sure, unsure = (shown(apart, 3, scatter, 0.01) for scatter in (0.03, 0.3))
    assert sure == pytest.approx(10 * unsure, rel=0.05) and missed(apart) > 0.05


def test_toughness_is_a_power_of_the_speed_and_the_law_is_not_told():
    gel = replace(GEL, effects=("toughness by speed",))
    cases = [gel.case(v, 0.7, "ellipse", OTHERWISE[0][1]) for v in SPEEDS.values()]
    growth = np.log([c.values["G_c"] / cases[0].values["G_c"] for c in cases])
    relative = np.log([v / SPEEDS["slow"] for v in SPEEDS.values()])
    np.testing.assert_allclose(growth, 0.25 * relative, atol=1e-12)
    assert all("rate_toughness" not in c.mechanisms for c in cases)


def test_the_truth_of_a_cut_has_other_numerics_than_a_fit():
    cases = [GEL.case(0.02, 0.7, "ellipse", choices) for choices in ({}, *dict(OTHERWISE).values())]
    assert len({c.id for c in cases}) == len(OTHERWISE) + 1


def test_a_record_has_its_error_and_no_other():
    x, F = np.linspace(0.1, 5, 50), np.linspace(0, 1, 50)

    def recorded(*effects, x=x, F=F, speed=0.01):
        return replace(GEL, effects=effects).recorded(x, F, speed)

    np.testing.assert_array_equal(recorded("toughness by speed"), (x, F))
    gives = recorded("compliance")[0] - x
    # The same machine in a cut that bears less, and no spring: at twice the force it gives less than twice.
    np.testing.assert_allclose(recorded("compliance", x=x[:25], F=F[:25])[0] - x[:25], gives[:25])
    assert 1.5 < gives[48] / gives[24] < 1.9
    late, kept = recorded("late zero")
    assert late.min() > 0 and late.max() == x.max() - 0.5 and kept.size == late.size
    slow, fast = (recorded("drift", speed=v)[1] - F for v in (0.005, 0.05))
    np.testing.assert_allclose(slow, 10 * fast)


def test_a_compliant_machine_stands_still_where_the_specimen_snaps():
    x = np.linspace(0.05, 5, 100)
    F = np.where(x < 3, 0.4 * x, 0.3)
    at, force = replace(GEL, effects=("compliance",)).recorded(x, F, 0.01)
    assert np.all(np.diff(at) > 0) and at.size == force.size < x.size
    # Nothing but what was read at the stand is lost.
    assert force[0] == F[0] and force[-1] == F[-1]


@pytest.mark.parametrize("beside", ["tension", "hold", "pull-off"])
def test_what_is_beside_cuts_is_of_the_same_gel(tmp_path, beside):
    planned = Planned(2, "mixed", ("relaxing modulus",), ("finer", "two thicknesses", beside))
    truth = make(planned, SEED, tmp_path, run=runs_by_formula.run_case, specimens=1)
    campaign = load_campaign(truth.file)
    cuts = [e for e in campaign.experiments if e.kind == "cut"]
    assert [e.id for e in cuts] == [*SPEEDS] and {e.blade["thickness"] for e in cuts} == {0.7, 1.0}
    assert [e.role for e in cuts] == ["train", "train", "train", "test"]
    assert campaign.experiments[0].kind == ("separation" if beside == "pull-off" else "uniaxial")
    if beside == "hold":
        _, _, stress = truth.clean["hold"]
        assert stress[-1] < 0.8 * stress.max()


# -- answers ------------------------------------------------------------------------------------------
NOTHING = Answer("none", (), (), None, {}, {}, {})


def truth_of(*effects, family="cut", clean=None):
    planned = Planned(0, family, effects, ("coarse", "ellipse"))
    return Truth(planned, Path(), clean or {}, 3, 0.02, 0.01, 10.0, 50.0)


@pytest.mark.parametrize(
    ("effects", "verdict", "found", "group", "right", "wrong"),
    [
        (("toughness by speed",), "mechanism", ("rate_toughness",), ("rate_toughness",), True, False),
        (("toughness by speed",), "mechanism", ("fung",), ("fung", "rate_toughness"), True, False),
        (("toughness by speed",), "mechanism", ("fung",), ("fung", "gent"), False, True),
        (("toughness by speed",), "none", (), (), False, False),
        ((), "none", (), (), True, False),
        ((), "mechanism", ("nu",), ("nu",), True, False),
        ((), "mechanism", ("fung",), ("fung",), False, True),
        (("swing",), "unexplained", (), (), True, False),
        (("swing",), "mechanism", ("fung",), ("fung",), False, True),
        (("swing",), "none", (), (), False, False),
    ],
)
def test_an_answer_is_right_by_its_class(effects, verdict, found, group, right, wrong):
    answer = replace(NOTHING, verdict=verdict, found=found, groups=(group,) if group else ())
    said = judge(truth_of(*effects), answer)
    assert (said["right"], bool(said["wrong"])) == (right, wrong)


def test_a_fixed_value_is_a_wrong_answer_where_no_numerics_excuse_it():
    answer = replace(NOTHING, verdict="mechanism", found=("nu",), groups=(("nu",),))
    assert judge(truth_of(family="homogeneous"), answer)["wrong"] == ["nu"]


def test_both_of_two_causes_count_only_with_both():
    truth = truth_of("eight chains", "Zener", family="homogeneous")
    one = replace(NOTHING, verdict="mechanism", found=("gent",), groups=(("gent",),))
    two = replace(one, found=("gent", "maxwell"), groups=(("gent",), ("maxwell",)))
    assert [judge(truth, a)["both"] for a in (one, two)] == [False, True]
    assert all(judge(truth, a)["right"] and not judge(truth, a)["wrong"] for a in (one, two))


def test_the_gain_is_against_clean_curves(tmp_path):
    e = load_campaign(made("gent", "bulk").file).test[0]
    grid = e.on_grid()
    true = np.interp(grid.time_s, *(made("gent", "bulk").clean[e.id][k] for k in (0, 2)))
    answer = replace(NOTHING, verdict="mechanism", found=("gent",), groups=(("gent",),), grids={e.id: grid},
                     before={e.id: 1.2 * true}, after={e.id: 1.05 * true})  # fmt: skip
    assert judge(made("gent", "bulk"), answer)["measured_gain"] == pytest.approx(0.75, abs=1e-9)


def test_true_values_are_asked_where_nothing_is_hidden():
    intervals = {"G": (0.9, 1.1), "nu": (0.4, 0.5)}
    for effects, asked in (((), {"G": [1.0, 0.9, 1.1]}), (("Zener",), {})):
        truth = replace(truth_of(*effects, family="homogeneous"), values={"G": 1.0, "mu": 0.3})
        assert judge(truth, replace(NOTHING, intervals=intervals))["values"] == asked


def test_the_table_counts_what_could_be_seen():
    row = {"sort": "one", "misfit": 9.0, "shown": 50.0, "missed": True, "right": True, "wrong": [],
           "found": ["gent"], "both": False, "stated_gain": 0.5, "stated_between": [0.3, 0.6],
           "measured_gain": 0.7, "ended": "", "runs": 0, "seconds": 1.0, "cpu_s": 1.0,
           "values": {}}  # fmt: skip
    rows = [row, {**row, "right": False, "wrong": ["machine"]}, {**row, "misfit": 0.5, "right": False},
            {**row, "shown": 1.0, "found": [], "right": False}, {**row, "sort": "two", "both": True},
            {**row, "sort": "none", "ended": "out of time",
             "values": {"G": [1.0, 0.9, 1.1], "mu": [2.0, 0.9, 1.1]}}]  # fmt: skip
    seen = "1 of 3", "1 of 2", "1 of 3", "1 of 2", "1 of 6", "1 of 1", "0 of 0", "1 of 1", "1 of 1", "0 of 6"
    assert (*summary(rows).values(),)[:12] == (*seen, "1 of 2", "1 of 6")


@pytest.mark.slow
def test_the_command_goes_on_and_writes_the_table(tmp_path, capsys):
    asked = ["homogeneous", "--cases", "8", "--seed", "1", "--out", str(tmp_path), "--limit", "1 s"]
    assert main([*asked, "--case", "0"]) == 0 and main([*asked, "--case", "1"]) == 0
    text = (tmp_path / "homogeneous-1.md").read_text(encoding="utf-8")
    assert "for development" in text and text.count("\n| 0 |") == text.count("\n| 1 |") == 1
    capsys.readouterr()
    assert main([*asked, "--case", "1"]) == 0
    assert "seconds a campaign" in capsys.readouterr().out
    for wrong in (["--limit", "2 mm"], ["--limit", "2 s"]):
        with pytest.raises(SystemExit) as refused:
            main([*asked, *wrong])
        assert refused.value.code == 2


def test_a_page_says_its_commit(tmp_path):
    kept = {"at": {"commit": "abc", "changed": True}, "rows": [], "family": "cut", "cases": 3, "seed": 9,
            "machine": {"cpu": "a"}, "workers": 0, "limit_s": 60.0}  # fmt: skip
    assert "`abc` with changes" in page(kept) and "development" not in page(kept)


def test_what_stands_in_for_runs_is_the_atlas_off_by_an_error_of_its_own_size():
    case = load_case("gelatin", {"depth": "6 mm"})
    found = shipped().estimate(case)
    off = []
    for seed in range(8):
        made, again = (StandIn(seed)(case, ["G"], (), None) for _ in range(2))
        assert np.array_equal(made.course, again.course)
        off.append(made.onset_mm / found.onset_mm.value - 1)
        stiffer = StandIn(seed)(
            replace(case, values={**case.values, "G": 1.05 * case.values["G"]}), [], (), None
        )
        changed = (stiffer.course[1] - made.course[1]) / (0.05 * case.values["G"])
        rising = made.course[0] < 0.5 * made.onset_mm
        assert np.mean(made.slopes["G"][rising] / np.maximum(changed[rising], 1e-9)) == pytest.approx(
            1, rel=0.6
        )
    assert 0.01 < np.std(off) < 0.12
