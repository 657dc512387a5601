"""Cuts of which numbers are known and no curve: read, fitted, told."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs_by_formula import Counted, course
from scipy import stats
from typer.testing import CliRunner

from cutbench.base.errors import BadInput
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.fitting import fit
from cutbench.calibration.recorder import Recorder
from cutbench.calibration.report import summary, to_dict
from cutbench.case.model import Model
from cutbench.cli.main import app
from cutbench.data.campaign import load_campaign
from cutbench.data.measures import Measure
from cutbench.run.measures import READ_OFF, ForceCurve
from cutbench.run.pool.pool import TaskPool

HEAD = """
title = "of the literature"
material = "gelatin"
[fit]
free = ["G", "G_c"]
[[experiment]]
id = "block"
kind = "cut"
depth = "8 mm"
speed = "0.021 mm/s"
specimen = { width = "30 mm", length = "30 mm", height = "21 mm" }
blade = { thickness = "0.7 mm", tip = "1.05 mm" }
"""


def campaign(folder, measures, head=HEAD):
    file = folder / "campaign.toml"
    file.write_text(head + measures, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "low", "high", "sd"),
    [
        ("4.19 ± 0.3 mm", 4.19, 4.19, 0.3), ("0.42 +- 0.03 cm", 4.2, 4.2, 0.3),
        ("8 to 10.5 mm", 8, 10.5, 0.525), ("8 to 10 ± 1 mm", 8, 10, 1),
        ("> 3 mm", 3, math.inf, 0.15), ("at most 5 ± 1 mm", -math.inf, 5, 1),
    ],
)  # fmt: skip
def test_what_people_write(text, low, high, sd):
    m = Measure.of("onset", text)
    assert (m.low, m.high, m.sd) == pytest.approx((low, high, sd))


@pytest.mark.parametrize(
    "text", ["4.19 mm", "4.19", "about 4 mm", "5 to 4 mm", "> 3 to 4 mm", "4 ± 0 mm", "", 4.2]
)
def test_what_is_no_measure_is_refused_with_what_would_be(text):
    with pytest.raises(BadInput) as error:
        Measure.of("onset", text)
    assert error.value.key == "measures.onset" and error.value.expected


@given(st.floats(-20, 40), st.floats(0, 5), st.floats(0.1, 10), st.floats(0.05, 3))
def test_deviations_are_those_of_the_likelihood(y, low, width, sd):
    """An interval's likelihood is that of a normal value that lies in it."""
    m = Measure("onset", low, low + width, sd)
    between = stats.norm.cdf((y - low) / sd) - stats.norm.cdf((y - low - width) / sd)
    most = 2 * stats.norm.cdf(width / 2 / sd) - 1
    if between > 1e-9:
        assert -0.5 * m.deviation(y) ** 2 == pytest.approx(math.log(between / most), rel=1e-4, abs=1e-6)
    assert m.deviation(y) * (y - m.value) >= -1e-6


@pytest.mark.parametrize(("text", "within", "far"), [("> 0.3", 0.6, 0.1), ("< 0.3", 0.1, 0.6)])
def test_one_end_counts_only_where_it_is_passed(text, within, far):
    m = Measure.of("drop", text)
    assert abs(m.deviation(within)) < 1e-6
    assert m.deviation(far) * (0.3 - far) < 0 and abs(m.deviation(far)) > 5


def test_an_interval_that_is_hardly_one_is_a_value():
    m = Measure("onset", 4.0, 4.0 + 1e-14, 10.0)
    assert m.deviation(24.0) == pytest.approx(2.0)
    wide = Measure("onset", 4.0, 4.1, 10.0)
    assert wide.deviation(24.0) == pytest.approx(2.0, rel=0.01)


def test_an_end_far_away_is_a_value():
    """Far beyond one end the likelihood falls as that of a value there."""
    m = Measure("drop", 0.3, math.inf, 0.01)
    steep = m.deviation(-0.7) - m.deviation(-0.8)
    assert steep == pytest.approx(0.1 / 0.01, rel=0.02)


def test_curves_are_read_as_a_person_reads_them():
    x = np.linspace(0, 10, 2001)
    peaked = np.where(x < 4, 0.3 * x, 0.6 + 0.05 * (x - 4))
    read = {name: rule[2](ForceCurve(x, peaked, 0.7)) for name, rule in READ_OFF.items()}
    assert read["onset"] == pytest.approx(4, abs=0.1)
    assert read["peak"] == read["firmness"] == pytest.approx(1.2, rel=0.01)
    assert read["drop"] == pytest.approx(0.5, abs=0.06)  # of means over half a thickness
    assert read["slope"] == pytest.approx(0.05, rel=1e-3)
    assert read["plateau"] == pytest.approx(0.6 + 0.05 * (2.8 + 6) / 2, rel=0.01)  # four thicknesses later
    assert read["work"] == pytest.approx(np.trapezoid(peaked, x))


def test_a_curve_that_only_rises_has_no_end_of_indentation():
    x = np.linspace(0, 5, 500)
    steady = ForceCurve(x, 0.1 * x**1.4, 0.7)
    assert math.isnan(steady.onset)
    assert steady.fall == 0


def truth(G, G_c, depth):
    """The measures of the formula with these values, in the units of ``READ_OFF``."""
    case = load_campaign_case(G, G_c, depth)
    (x, force, _), _ = course(case)
    return {name: rule[2](ForceCurve(x, force, 0.7)) for name, rule in READ_OFF.items()}


def load_campaign_case(G, G_c, depth):
    from cutbench.case.case import load_case

    return load_case("gelatin").set(G=f"{G} kPa", G_c=f"{G_c} J/m^2", depth=f"{depth} mm", mu=0)


def test_a_fit_of_measures_finds_what_made_them(tmp_path):
    m = truth(9, 7, 8)
    assert 1 < m["onset"] < 6
    values = f'onset = "{m["onset"]:.4f} ± 0.1 mm", peak = "{m["peak"]:.5f} ± 0.03 N", drop = "< 0.9"'
    text = f"measures = {{ {values} }}"
    runs = Counted()
    found = fit(load_campaign(campaign(tmp_path, text)), runs=CutRuns(TaskPool(0), None, compute=runs))
    for name, value in (("G", 9e-3), ("G_c", 7e-3)):
        e = found.estimate(name)
        assert e.low < value < e.high, (name, e.value, e.low, e.high)
        assert e.value == pytest.approx(value, rel=0.15)
    assert found.status == "converged"
    (rows,) = [e["measures"] for e in to_dict(found)["experiments"].values()]
    assert [r["measure"] for r in rows] == ["onset", "peak", "drop"]
    assert rows[0]["computed"] == pytest.approx(m["onset"], abs=0.15) and rows[2]["low"] is None
    assert {"measured", "computed"} <= set(summary(found).split()) and json.dumps(to_dict(found))


def test_a_table_of_specimens_gives_means_and_how_well_they_are_known(tmp_path):
    rng = np.random.default_rng(3)
    values = rng.normal((1.3, 4.8), (0.1, 0.4), (9, 2))
    rows = "\n".join(f"{k + 1};{1e3 * a:.3f};{b:.4f}" for k, (a, b) in enumerate(values))
    (tmp_path / "specimens.csv").write_text(
        f"no;Firmness [mN];Work of shear [mJ]\n{rows}\n", encoding="utf-8"
    )
    text = """measures = ["firmness", "work_of_shear"]
data = "specimens.csv"
columns = { firmness = "Firmness", work_of_shear = "Work of shear" }
"""
    (e,) = load_campaign(campaign(tmp_path, text)).experiments
    for k, m in enumerate(e.measures):
        assert m.value == pytest.approx(values[:, k].mean(), rel=1e-3)
        # Student's t with 8 degrees of freedom has a standard deviation of sqrt(8/6).
        assert m.sd == pytest.approx(values[:, k].std(ddof=1) / 3 * math.sqrt(8 / 6), rel=1e-2)


@pytest.mark.parametrize(
    ("measures", "key"),
    [
        ('measures = { onset = "4 ± 1 N" }', "onset"), ('measures = { sharpness = "4 ± 1 N" }', "sharpness"),
        ("measures = {}", "measures"), ('measures = ["firmness"]', "data"),
        ('measures = ["hardness"]\ndata = "x.csv"', "measures"),
        ('measures = { onset = "4 ± 1 mm" }\nuntil = "return"', "until"),
    ],
)  # fmt: skip
def test_faults_are_told_with_their_key(measures, key, tmp_path):
    file = campaign(tmp_path, measures)
    result = CliRunner().invoke(app, ["fit", str(file), "--out", str(tmp_path / "out")])
    assert result.exit_code == 2 and key in result.output and "campaign.toml" in result.output


def test_measures_need_a_depth(tmp_path):
    file = campaign(tmp_path, 'measures = { onset = "4 ± 1 mm" }', HEAD.replace('depth = "8 mm"\n', ""))
    with pytest.raises(BadInput, match="depth"):
        load_campaign(file)


def test_measures_change_with_the_machine_as_differences_say(tmp_path):
    """Of a machine that gives way the force falls later, by the force over its stiffness."""
    text = 'measures = { onset = "2 ± 0.1 mm", peak = "0.2 ± 0.01 N" }'
    e = load_campaign(campaign(tmp_path, text)).experiments[0]
    case = load_campaign_case(9, 7, 8)
    (x, force, t), _ = course(case)
    model = Model((*case.mechanisms, "machine_compliance"))
    recorder = Recorder.of(e, e.on_grid(), model)

    def read(compliance):
        return recorder.read(
            np.stack([x, force, t]), {**case.values, "compliance": compliance}, {}, ["compliance"]
        )

    for at in (0.0, 0.5):
        by = read(at)[1][:, 0]
        (before, _), (after, _) = read(at), read(at + 0.02)
        assert by[0] > 0
        np.testing.assert_allclose(by, (after - before) / 0.02, rtol=0.1, atol=0.05)
