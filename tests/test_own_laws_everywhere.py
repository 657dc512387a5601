"""Two laws of one's own, from the pages alone: they cut, are mapped and fitted, and named where hidden."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cutbench
from cutbench.case.model import Model
from cutbench.data import Experiment, FitPlan, Repetition, start_case
from cutbench.homogeneous import LoadingHistory, respond
from cutbench.mechanisms.law_registry import folders_in_use, look_in

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "tutorials" / "own-law.md").read_text("utf-8")
OURS = ("mooney_rivlin", "trapezoid")
STUDY = """title = "own"
base = "gelatin"
mechanisms = ["mooney_rivlin", "volumetric", "trapezoid", "viscous_degraded", "contact"]

[parameters]
C01 = "0.75 kPa"

[protocol]
depth = "0.2 mm"

[numerics]
h = "1.4 mm"

[[axis]]
name = "C10"
values = ["2 kPa", "3 kPa"]
"""


@pytest.fixture(scope="module", autouse=True)
def laws(tmp_path_factory):
    before, folder = folders_in_use(), tmp_path_factory.mktemp("laws")
    for name in OURS:
        (text,) = re.findall(rf"^```python\n# file: my_laws/{name}\.py\n(.*?)^```$", PAGE, re.M | re.S)
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    cutbench.use_mechanisms(folder)
    yield
    look_in(before)


def test_they_cut():
    case = {"with_": OURS, "C10": "3 kPa", "C01": "0.75 kPa", "cohesion": 1.0, "depth": "2 mm", "h": "1.4 mm"}
    run = cutbench.run2d("gelatin", **case)
    assert run.outcome.kind == "done"
    assert run.curve["cut_length_mm"][-1] > 0.5 and run.curve["work_trapezoid_mJ"][-1] > 0
    assert run.case.groups()["(G_c/delta_c)/G"] == pytest.approx(1.0)


def test_they_are_mapped(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    done = cutbench.run_study(cutbench.load_study(tmp_path / "study.toml"), tmp_path / "out", workers=0)
    assert done.status.finished == 2


def campaign(
    kind: str, laws: list[str], truth: dict, given: tuple[str, ...], x: np.ndarray
) -> cutbench.Campaign:
    """Three invented specimens, and a model that has what is ``given`` and fits the first of it."""
    model = Model(tuple(laws))
    values = {n: q.typical * q.factor for n, q in model.parameters().items()} | truth
    ideal = respond(
        kind, LoadingHistory.along(x, None, 1.0 if x[0] > 0.9 else 0.0), model, model.namespace(values)
    )
    noise = np.random.default_rng(1).normal(scale=0.005 * np.abs(ideal).max(), size=(3, x.size))
    measured = Experiment("test", kind, tuple(Repetition(x, ideal.real + each) for each in noise))
    known = model.parameters()
    start = {n: known[n].show(v) for n, v in truth.items() if n in given}
    base, _ = start_case(None, baseline=laws, kinds=[kind], parameters=start)
    return cutbench.Campaign(
        "invented", base, (measured,), plan=FitPlan(free=given[:1]), candidates=("maxwell",)
    )


def rubber(stiffer: float = 1.0) -> cutbench.Campaign:
    truth, x = {"C10": 0.003 * stiffer, "C01": 0.002 * stiffer, "nu": 0.49}, np.linspace(1.05, 2.5, 25)
    return campaign("uniaxial", ["mooney_rivlin", "volumetric"], truth, ("C10",), x)


@pytest.mark.parametrize("stiffer", [1, 100])
def test_they_are_fitted_from_no_effect_at_all(stiffer):
    """However much more than what is typical the constant is that begins at 0."""
    both = replace(rubber(stiffer), plan=FitPlan(free=("C10", "C01")))
    found = cutbench.fit(both, workers=0)
    assert found.status == "converged" and both.base.p.C01 == 0
    assert found.values["C10"] == pytest.approx(0.003 * stiffer, rel=0.1)
    assert found.values["C01"] == pytest.approx(0.002 * stiffer, rel=0.15)


def test_what_is_hidden_of_them_is_named():
    found = cutbench.discover(rubber(), workers=0)
    assert found.names == ("C01",)
    laws = ["neo_hookean", "volumetric", "trapezoid"]
    truth = {"G": 0.0075, "G_c": 0.01, "fall": 3.0, "delta_c": 0.07, "beta": 1.0}
    peeled = campaign("separation", laws, truth, ("G_c", "G", "delta_c"), np.linspace(0.002, 0.3, 40))
    assert cutbench.discover(peeled, workers=0).names == ("fall",)
