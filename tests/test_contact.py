"""Travel before contact, the zero of the force, and returns: given or found, of what instruments write."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import instrument
import numpy as np
import pytest
from refusals import refused

from cutbench.calibration.fitting import fit
from cutbench.data.campaign import load_campaign, start_case
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition
from cutbench.homogeneous import predict

RISES = {
    "straight": lambda h: h,
    "a ball": lambda h: h**1.5,
    "a cone": lambda h: h**2,
    "softening": lambda h: 1 - np.exp(-h / 4),
    "with a break": lambda h: np.where(h < 3, h, 3 - 0.3 * (h - 3)),
}


def cut(folder: Path, u: np.ndarray, F: np.ndarray, more: str) -> Path:
    rows = "".join(f"{a:.5f},{b:.6f}\n" for a, b in zip(u, F, strict=True))
    (folder / "cut.csv").write_text("u [mm],F [N]\n" + rows, encoding="utf-8")
    path = folder / "campaign.toml"
    path.write_text(
        f"""material = "elastomer"
[[experiment]]
id = "cut"
kind = "cut"
data = "cut.csv"
columns = {{ displacement = "u", force = "F" }}
specimen = {{ width = "30 mm", length = "30 mm", height = "21 mm" }}
blade = {{ thickness = "0.7 mm" }}
speed = "0.1 mm/s"
{more}
""",
        encoding="utf-8",
    )
    return path


@pytest.mark.parametrize("rise", RISES)
def test_the_contact_is_found_to_its_standard_deviation(rise, tmp_path):
    rng = np.random.default_rng(5)
    far = []
    for noise in (0.003, 0.02):
        at, u = rng.uniform(1.5, 2.5), np.linspace(0, 10, 400)
        y = RISES[rise](np.maximum(u - at, 0))
        F = 0.07 + 5 * (y / y.max() + noise * rng.standard_normal(u.size))
        path = cut(tmp_path, u, F, 'zero = "auto"\nforce_zero = "auto"')
        (r,) = load_campaign(path).experiment("cut").repetitions
        far.append((r.contact.at - at) / r.contact.sd)
        assert r.contact.sd < (0.2 if noise < 0.01 else 0.6)
        assert abs(r.contact.force - 0.07) < 5 * r.contact.force_sd + 2e-3
        assert r.x[0] >= 0 and r.x[-1] == pytest.approx(10 - r.contact.at, abs=1e-4)
        assert r.y[0] == pytest.approx(F[u >= r.contact.at][0] - r.contact.force, abs=1e-5)
    assert np.sqrt(np.mean(np.square(far))) < 2


def test_a_contact_that_is_given_is_taken_and_the_rest_is_said(tmp_path):
    u = np.linspace(0, 10, 201)
    F = 0.3 + 2 * np.maximum(u - 2, 0)
    campaign = load_campaign(cut(tmp_path, u, F, 'zero = "2 mm"'))
    (r,) = campaign.experiment("cut").repetitions
    np.testing.assert_allclose(r.x, u[40:] - 2, atol=1e-9)
    np.testing.assert_allclose(r.y, F[40:], atol=1e-9)
    assert any("0.3" in note and "force_zero" in note for note in campaign.all_notes())
    (r,) = load_campaign(cut(tmp_path, u, F, 'force_zero = "30.59 g"')).experiment("cut").repetitions
    np.testing.assert_allclose(r.y, F - 0.3, atol=1e-4)
    np.testing.assert_allclose(r.x, u, atol=1e-9)


@pytest.mark.parametrize("rise", ["straight", "a ball"])
def test_a_machine_that_began_at_a_trigger_force(rise, tmp_path):
    rng, h = np.random.default_rng(4), np.linspace(0, 8, 8001)
    y = RISES[rise](h) / RISES[rise](h).max()
    missed = h[np.argmax(y > 0.02)]
    u = np.linspace(0, 8 - missed, 400)
    F = 5 * np.interp(u + missed, h, y) + 0.01 * rng.standard_normal(u.size)
    (r,) = (
        load_campaign(cut(tmp_path, u, F, 'zero = "auto"\nforce_zero = "0 g"')).experiment("cut").repetitions
    )
    assert abs(r.contact.at + missed) < 2 * r.contact.sd < missed
    assert r.x[0] == pytest.approx(-r.contact.at) and r.x.size == u.size


def test_travel_before_contact_is_noticed(tmp_path):
    u = np.linspace(0, 10, 201)
    F = 2 * np.maximum(u - 2, 0) + 0.01 * np.random.default_rng(0).standard_normal(u.size)
    notes = load_campaign(cut(tmp_path, u, F, "")).all_notes()
    assert any("zero = 'auto'" in note for note in notes)
    for more, at in (('zero = "auto"', 2), ('zero = "0 mm"', 2), ("", 0)):
        F = 2 * np.maximum(u - at, 0) ** 1.5
        notes = load_campaign(cut(tmp_path, u, F, more)).all_notes()
        assert not any("zero = 'auto'" in note for note in notes)


def test_before_contact_a_model_feels_nothing():
    x, t = np.linspace(1.0, 1.5, 51), np.linspace(0, 50, 51)
    strip = Experiment(
        "pull", "uniaxial", (Repetition(x, x - 1 + 1e-3, t),), specimen={"length": 10, "area": 5}
    )
    laws = ["neo_hookean", "volumetric", "maxwell", "contact_offset"]
    values = {"G": "30 kPa", "nu": 0.499, "g_1": 0.5, "tau_1": "5 s", "offset": "1 mm"}
    case, _ = start_case(None, baseline=laws, kinds=("uniaxial",), parameters=values)
    late = predict(strip, case.model, case.p, strip.on_grid())
    np.testing.assert_allclose(late[:11], 0, atol=1e-9)
    met = replace(case, values={**case.values, "offset": 0.0})
    np.testing.assert_allclose(
        late[10:], predict(strip, met.model, met.p, strip.on_grid())[:-10], rtol=1e-6, atol=1e-9
    )


def test_an_approach_may_be_longer_than_the_rest(tmp_path):
    u = np.linspace(0, 4, 201)
    F = 0.01 + 2 * np.maximum(u - 2.5, 0)
    (r,) = (
        load_campaign(cut(tmp_path, u, F, 'zero = "auto"\nforce_zero = "auto"')).experiment("cut").repetitions
    )
    assert r.contact.at == pytest.approx(2.5, abs=0.02)
    assert 0 <= r.x[0] < 0.03 and r.x[-1] == pytest.approx(1.5, abs=0.02)


def test_a_contact_for_each_specimen(tmp_path):
    zeros = '{ "gelatin 1" = "1.9 mm", "gelatin 2" = "auto", "gelatin 3" = "2.2 mm" }'
    more = f'force_zero = "auto"\nzero = {zeros}\n'
    path = instrument.write_campaign(tmp_path, more=more)
    one, two, three = (r.contact for r in load_campaign(path).experiment("press").repetitions)
    assert (one.at, three.at) == pytest.approx((1.9, 2.2)) and one.sd == three.sd == 0
    assert two.at == pytest.approx(2, abs=0.1) and two.sd > 0
    text = path.read_text(encoding="utf-8")
    for old, new, key, hint in (
        ('"gelatin 3"', '"gelatin 4"', "zero", "'gelatin 3'"),
        (" }\n", ', "x" = "1 mm" }\n', "zero.x", "gelatin 1"),
    ):
        path.write_text(new.join(text.rsplit(old, 1)), encoding="utf-8")
        with refused(key, hint=hint):
            load_campaign(path)


def test_from_and_until_count_from_contact(tmp_path):
    u = np.append(np.linspace(0, 10, 101), np.linspace(9.9, 0, 100))
    F = 2 * np.maximum(u - 2, 0) * np.append(np.ones(101), np.full(100, 0.4))
    more = 'zero = "2 mm"\nfrom = "0.95 mm"\nuntil = '
    (r,) = load_campaign(cut(tmp_path, u, F, more + '"return"')).experiment("cut").repetitions
    np.testing.assert_allclose(r.x, u[30:101] - 2, atol=1e-9)
    assert r.time_s[0] == pytest.approx(10) and np.ptp(r.time_s) == pytest.approx(70)
    (r,) = load_campaign(cut(tmp_path, u, F, more + '"5.05 mm"')).experiment("cut").repetitions
    np.testing.assert_allclose(r.x, u[30:71] - 2, atol=1e-9)


def test_the_way_back_ends_at_contact(tmp_path):
    path = instrument.write_campaign(tmp_path, returned=True, more='zero = "auto"\nforce_zero = "auto"\n')
    for r in load_campaign(path).experiment("press").repetitions:
        assert 0.98 < r.x.max() <= 1 and r.x.min() == pytest.approx(0.7, abs=0.01)
        assert r.x[0] > 0.99 and r.x[-1] > 0.99


def test_contact_found_in_the_readings_and_in_the_fit_are_one(tmp_path):
    sought = 'baseline = ["neo_hookean", "volumetric", "contact_offset"]\n'
    asked = '[fit]\nfree = ["G", "offset"]\n'
    path = instrument.write_campaign(
        tmp_path, head=sought + asked, more='zero = "auto"\nforce_zero = "auto"\n'
    )
    found = fit(load_campaign(path))
    # u is what the machine counts downwards, and the displacement in the model is -u.
    offset = found.estimate("offset")
    assert offset.low < 0 < offset.high and abs(offset.value) < 0.05
    text = path.read_text(encoding="utf-8").replace('zero = "auto"\n', 'zero = "1.7 mm"\n', 1)
    path.write_text(text.replace('zero = "1.7', 'from = "0.96"\nzero = "1.7'), encoding="utf-8")
    wrong = fit(load_campaign(path)).estimate("offset")
    assert wrong.low < -instrument.AIR_MM + 1.7 < wrong.high
    assert wrong.value == pytest.approx(-instrument.AIR_MM + 1.7, abs=0.06)


def test_a_pressed_cylinder_is_given_by_its_diameter_and_called_what_it_is_here(tmp_path):
    path = instrument.write_campaign(tmp_path)
    by_area = load_campaign(path).experiment("press").repetitions[0]
    text = path.read_text("utf-8")
    area = f'area = "{instrument.AREA_MM2:.6g} mm^2"'
    diameter = f'diameter = "{instrument.DIAMETER_MM:g} mm"'
    path.write_text(text.replace(area, diameter), encoding="utf-8")
    np.testing.assert_allclose(load_campaign(path).experiment("press").repetitions[0].y, by_area.y, rtol=1e-5)
    path.write_text(text.replace(area, f"{area}, {diameter}"), encoding="utf-8")
    with refused("specimen.diameter", value="20 mm", line=11):
        load_campaign(path)
    path.write_text(text.replace('"uniaxial"', '"compression"'), encoding="utf-8")
    with refused("kind", value="compression", line=7, hint="uniaxial") as error:
        load_campaign(path)
    assert "factors" in error.value.expected
