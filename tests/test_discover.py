"""Discovery on made-up campaigns without a mesh: it finds what was hidden, and nothing where nothing was."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from blind_cases import SEED, campaign, found, judged
from typer.testing import CliRunner

from benchmarks.blind_campaigns import LAWS, Planned, make
from cutbench.base.files import write_json
from cutbench.case.case import load_case
from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover
from cutbench.discovery.comparison import FoundCause
from cutbench.discovery.report import report, summary, to_dict, verdict_sentence, write_discovery
from cutbench.discovery.score import tail_probability

STUDIES = Path(__file__).parents[1] / "studies"


@pytest.fixture(scope="module")
def gent():
    return found("gent", "bulk", False, 5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "shows"),
    [
        (effect, shows)
        for shows in ("joint", "sliding")
        for effect in LAWS[shows]
        if effect != "viscous_degraded"
    ],
)
def test_it_names_what_was_hidden(effect, shows):
    truth, d = found(effect, shows)
    said = judged(truth, d)
    assert truth.misfit > 2
    assert d.verdict == "mechanism" and said["right"]
    assert said["measured_gain"] > 0.3


def test_it_finds_stiffening_and_says_what_it_cannot_tell_apart(gent):
    truth, d = gent
    said = judged(truth, d)
    assert d.verdict == "mechanism" and said["right"] and not said["wrong"]
    assert "gent" in d.found[0].group and len(d.found[0].group) > 1
    assert "apart" in d.next_experiment


@pytest.mark.parametrize(
    ("shows", "number"),
    [("joint", 2),
     *(pytest.param(*one, marks=pytest.mark.slow)
       for one in (("bulk", 1), ("bulk", 2), ("joint", 1), ("sliding", 1), ("sliding", 2)))],
)  # fmt: skip
def test_it_names_nothing_where_nothing_is_hidden(shows, number):
    _, d = found("", shows, bool(number % 2), number)
    assert d.verdict == "none" and d.found == () and d.rest == 1.0 and d.noise_free is None


@pytest.mark.parametrize(
    ("effect", "shows"),
    [
        pytest.param("swing", "bulk", marks=pytest.mark.slow),
        pytest.param("jump", "bulk", marks=pytest.mark.slow),
        ("fade", "sliding"),
    ],
)
def test_what_no_candidate_has_stays_unexplained(effect, shows):
    _, d = found(effect, shows, False)
    assert d.verdict == "unexplained"
    assert any(s.wrong for s in d.left)


@pytest.mark.slow  # tests/test_suspects.py asks the same of tests without a mesh
def test_the_order_of_experiments_does_not_matter():
    _, d = found("adhesion_wear", "sliding")
    asked = campaign("adhesion_wear", "sliding")
    other = discover(replace(asked, experiments=asked.experiments[::-1]), workers=0)
    assert other.names == d.names and other.verdict == d.verdict
    assert other.steps[0].scores.chi2 == pytest.approx(d.steps[0].scores.chi2, rel=1e-6)


@pytest.mark.slow
def test_nor_does_the_seed_of_the_draws():
    asked = campaign("compact_cohesion", "joint", False)
    said = {(d.verdict, d.names) for d in (discover(asked, workers=0, seed=seed) for seed in (1, 2))}
    assert said == {("mechanism", ("compact_cohesion",))}


def test_a_cause_that_was_found_is_none_that_another_might_be(gent):
    """Two causes of other classes, each in the other's group: both are there."""
    _, d = gent
    (first, *_), (cause, *more) = d.steps, d.found
    other = renamed(first.compared[0], "force_drift")
    step = replace(first, compared=(cause.compared, other))
    one = replace(d, steps=(step, *d.steps[1:]), found=(replace(cause, step=step), *more))
    assert "force_drift" in verdict_sentence(one)
    both = replace(one, found=(*one.found, FoundCause(other, step)))
    assert verdict_sentence(both) != verdict_sentence(one)


def renamed(compared, name):
    return replace(compared, candidate=replace(compared.candidate, name=name))


WANING = '''\
"""Adhesion that wanes with the distance slid."""
import numpy as np
from cutbench.base.files import write_json
from cutbench.mechanisms.base import Blade
from cutbench.base.units import Parameter


class WaningAdhesion(Blade):
    """Strength lost as the faces are polished."""

    name = "waning_adhesion"
    title = "waning adhesion"
    parameters = (
        Parameter("waning", "1", "q", "part that is lost", low=0, high=1, off=0, default=0, typical=0.3),
        Parameter("waning_length", "mm", "l", "sliding it takes", low=0.01, high=100, default=3, typical=3),
    )
    reads = ("tau_W",)

    def strength(self, t_N, p, state, at):
        return -p.waning * p.tau_W * at.touched * (1 - np.exp(-at.slid / p.waning_length))
'''


@pytest.mark.slow
def test_a_new_mechanism_is_a_candidate_without_a_line_changed(law_of, tmp_path):
    """A file in the folder of its slot, found by being there."""
    law_of("blade", "waning_adhesion", WANING)
    how = "sliding", "several conditions"
    asked = load_campaign(make(Planned(4, "homogeneous", ("waning_adhesion",), how), SEED, tmp_path).file)
    assert "waning_adhesion" in asked.candidates
    d = discover(asked, workers=0)
    assert d.names[0] == "waning_adhesion"
    assert "polished" in summary(d)


def test_rubber_stiffens_and_the_other_tests_gain():
    stages = []
    d = discover(load_campaign(STUDIES / "rubber" / "treloar.toml"), workers=0, on_stage=stages.append)
    assert d.verdict == "mechanism" and d.names[0] in ("gent", "yeoh")
    assert not stages[0].fit.done and stages[0].verdict == "undecided" and stages[-1].names == d.names
    assert all("<svg" in report(stage).page() for stage in (stages[0], stages[-1]))
    assert d.held_out.how == "test experiments" and d.held_out.gain > 0.4
    grids = d.first.posterior.predictions.grids
    before, after = (
        {e.id: np.sqrt(np.mean((p.predicted(e).y - grids[e.id].mean) ** 2)) for e in d.campaign.test}
        for p in (d.first, d.final)
    )
    # A modulus too high for small stretches makes up for the missing stiffening in equibiaxial tension.
    assert after["pure shear"] < 0.5 * before["pure shear"]
    assert after["equibiaxial"] < 1.1 * before["equibiaxial"]


def test_a_formula_is_fitted_where_it_is_best():
    """The first step towards Gent's law locks Treloar's rubber before it was torn."""
    d = discover(load_campaign(STUDIES / "rubber" / "treloar.toml"), workers=0)
    (gent,) = (c for c in d.steps[0].compared if c.name == "gent")
    start = {"G": 0.3, "inv_J_m": 0.01}
    posterior = gent.fitted.posterior
    other = posterior.maximum(np.array([u.q(start[u.name]) for u in posterior.parameters]))
    assert gent.fitted.log_posterior > other.log_posterior - 0.5


def test_a_silicone_too():
    d = discover(load_campaign(STUDIES / "silicone" / "meunier.toml"), workers=0)
    assert d.verdict == "mechanism" and d.names[0] in ("gent", "yeoh")
    assert d.held_out.gain > 0.5 and d.held_out.gains_much and d.held_out.gain > d.held_out.gain_se > 0


def test_discovery_json_has_its_keys(gent, tmp_path):
    _, d = gent
    write_discovery(d, tmp_path)
    case = load_case(tmp_path / "case.toml")  # with the rest of the material that the campaign names
    assert set(d.final.case.mechanisms) < set(case.mechanisms)
    assert case.values["inv_J_m"] == pytest.approx(d.final.case.values["inv_J_m"], rel=1e-8)
    data = json.loads((tmp_path / "discovery.json").read_text(encoding="utf-8"))
    for key in ("verdict", "found", "ranking", "confounded", "where_wrong", "gain", "next_experiment"):
        assert key in data
    first = data["ranking"][0]
    assert first["mechanism"] == data["found"][0]
    for value in first["parameters"].values():
        assert value["low"] <= value["value"] <= value["high"] and "unit" in value and "at_bound" in value
    assert first["score_z"] > 3 and first["gain_heldout"] > first["gain_se"] > 0
    for which in ("train", "heldout"):
        g = data["gain"][which]
        assert g["extended_rmse"] < g["baseline_rmse"] and g["unit"] == "MPa" and g["noise_floor"] > 0
    wrong = data["where_wrong"][0]
    assert {"experiment", "from_mm", "to_mm", "bias_N", "z"} <= wrong.keys() and abs(wrong["z"]) > 3


@pytest.mark.parametrize(("p", "significant"), [(0.004, True), (0.007, False), (0.2, False)])
def test_the_page_calls_a_remainder_what_the_report_does(gent, p, significant):
    _, d = gent
    *before, last = d.steps
    left = replace(d, steps=(*before, replace(last, scores=replace(last.scores, p_residual=p))))
    assert ("Nothing beyond" in report(left).page()) != significant
    assert to_dict(left)["residual"]["extended"]["significant"] == significant


def test_the_page_stands_alone(gent):
    _, d = gent
    text = report(d).page()
    assert "__" not in text.replace("__init__", "")
    assert "http://" not in text.replace("http://www.w3.org", "").replace("http://purl", "").replace(
        "http://creativecommons", ""
    )
    assert "<script" not in text and text.count("<svg") == 2
    assert "gent" in text and "Next experiment" in text
    ids = [part.split('"')[0] for part in text.split(' id="')[1:]]
    assert len(ids) == len(set(ids))


def test_the_command_writes_both_and_refuses_nonsense(tmp_path):
    from cutbench.cli.main import app

    runner = CliRunner()
    done = runner.invoke(
        app, ["discover", str(STUDIES / "silicone" / "rtv615.toml"), "--out", str(tmp_path / "d")]
    )
    assert done.exit_code == 0, done.output
    assert "verdict: mechanism" in done.output
    assert {p.name for p in (tmp_path / "d").iterdir()} == {"discovery.json", "discovery.html", "case.toml"}
    extended = load_case(tmp_path / "d" / "case.toml")
    found = json.loads((tmp_path / "d" / "discovery.json").read_text(encoding="utf-8"))["found"]
    assert found and set(found) < set(extended.mechanisms)
    done = runner.invoke(app, ["discover", str(tmp_path / "none.toml")])
    assert done.exit_code == 2


def test_the_tail_of_draws_is_that_of_an_f_distribution():
    rng = np.random.default_rng(0)
    draws = rng.chisquare(1, 2000)
    assert tail_probability(draws, 3.84) == pytest.approx(0.05, abs=0.015)
    assert tail_probability(draws, 25.0) < 1e-4
    heavy = rng.f(1, 2, 2000)
    assert tail_probability(heavy, 100.0) == pytest.approx(0.01, abs=0.006)
    assert 1e-4 < tail_probability(heavy, 400.0) < 8e-3


def test_json_has_no_nan(tmp_path):
    write_json({"a": [float("nan"), np.float64(1.0)], "b": float("inf")}, tmp_path / "x.json")
    assert json.loads((tmp_path / "x.json").read_text()) == {"a": [None, 1.0], "b": None}


def test_data_are_plain(gent, tmp_path):
    write_json(to_dict(gent[1]), tmp_path / "d.json")


@pytest.mark.slow
def test_units_of_the_columns_do_not_matter(tmp_path):
    rows = np.loadtxt(STUDIES / "rubber" / "treloar_1944_uniaxial.txt")
    others = np.loadtxt(STUDIES / "rubber" / "treloar_1944_pure_shear.txt")
    found = []
    for name, factor in (("MPa", 1.0), ("kPa", 1e3)):
        for file, table in (("a.csv", rows), ("b.csv", others)):
            text = "\n".join(f"{x!r},{y * factor!r}" for y, x in table[:, :2].tolist())
            (tmp_path / file).write_text("stretch,stress\n" + text + "\n")
        parts = [
            f'''[[experiment]]
id = "{id}"
kind = "{kind}"
data = "{file}"
role = "{role}"
columns = {{ stretch = "stretch", stress = "stress" }}
units = {{ stretch = "1", stress = "{name}" }}
'''
            for id, kind, file, role in (
                ("t", "uniaxial", "a.csv", "train"),
                ("s", "pure_shear", "b.csv", "test"),
            )
        ]
        head = """baseline = ["neo_hookean", "volumetric"]
candidates = ["gent", "yeoh"]
[parameters]
G = "0.4 MPa"
nu = 0.4999
[fit]
free = ["G"]
"""
        path = tmp_path / f"{name}.toml"
        path.write_text(head + "".join(parts))
        found.append(discover(load_campaign(path), workers=0))
    one, other = found
    assert one.names == other.names and one.verdict == other.verdict == "mechanism"
    assert one.held_out.gain == pytest.approx(other.held_out.gain, rel=1e-3)


def test_without_candidates_a_failing_baseline_is_undecided(gent, tmp_path):
    d = discover(replace(gent[1].campaign, candidates=()), workers=0)
    assert d.verdict == "undecided" and not d.found
    assert "undecided" in summary(d)
    write_json(to_dict(d), tmp_path / "d.json")
    assert report(d).page().count("<svg") == 1


@pytest.mark.slow
def test_what_depends_on_time_is_not_asked_of_tests_without_a_clock(tmp_path):
    stretch = np.linspace(1.02, 1.5, 30)
    stress = 0.08 * (stretch - stretch**-2) * (1 + (stretch**2 + 2 / stretch - 3))
    rows = [f"{x:.4f},{y:.6f}" for x, y in zip(stretch, stress, strict=True)]
    for head, clock in ('columns = { stretch = "x", stress = "y [MPa]" }', False), (
        'columns = { stretch = "x", stress = "y [MPa]" }\nspeed = "0.01 1/s"', True
    ):  # fmt: skip
        (tmp_path / "pull.csv").write_text("\n".join(["x,y [MPa]", *rows]))
        path = tmp_path / "campaign.toml"
        path.write_text(
            'baseline = ["neo_hookean", "volumetric"]\ncandidates = ["fung", "maxwell", "power_law"]\n'
            '[parameters]\nG = "80 kPa"\nnu = 0.4999\n[fit]\nfree = ["G"]\n'
            f'[[experiment]]\nid = "pull"\nkind = "uniaxial"\ndata = "pull.csv"\n{head}\n'
        )
        found = discover(load_campaign(path), workers=0)
        timed = {"maxwell", "power_law"}
        assert (timed <= set(found.steps[0].left_out)) == (not clock)
        assert any("maxwell" in note for note in found.notes) == (not clock)
        assert "fung" not in found.steps[0].left_out
