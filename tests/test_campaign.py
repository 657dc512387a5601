"""Campaigns as files and in Python; what repetitions say about the noise."""

from __future__ import annotations

import hashlib
import pickle
from pathlib import Path

import numpy as np
import pytest
from refusals import refused
from typer.testing import CliRunner

from benchmarks.real import CAMPAIGNS
from cutbench.calibration.fitting import with_one_detail
from cutbench.calibration.parameters import free_parameters
from cutbench.case.case import load_case
from cutbench.case.model import DEFAULT, PAPER
from cutbench.cli.main import app
from cutbench.data.campaign import Campaign, FitPlan, cut_case, load_campaign, start_case
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition

STUDIES = Path(__file__).parents[1] / "studies"

CAMPAIGN = """title    = "PDMS, three speeds, two widths"
material = "elastomer"
baseline = ["neo_hookean", "smith_ferrante", "contact", "adhesion"]
candidates = "all"

[[experiment]]
id   = "slow"
kind = "cut"
data = "slow.csv"
columns = { displacement = "u [mm]", force = "F [N]", time = "t [s]", repetition = "rep" }
units   = { displacement = "mm", force = "N", time = "s" }
specimen = { width = "40 mm", length = "30 mm", height = "21 mm" }
blade    = { thickness = "0.5 mm", tip = "0.75 mm" }
speed    = "0.021 mm/s"
role     = "train"
"""


def cutting(repetitions: int = 3, n: int = 60) -> str:
    rng = np.random.default_rng(3)
    rows = ["rep;t [s];u [mm];F [N]"]
    for r in range(repetitions):
        scale = 1 + 0.03 * rng.standard_normal()
        for u in np.linspace(0.1, 12, n):
            force = scale * (2 * min(u, 3) + 0.3 * u) + 0.02 * rng.standard_normal()
            rows.append(f"S{r};{u / 0.021:.3f};{u:.4f};{force:.5f}")
    return "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path) -> Path:
    (tmp_path / "slow.csv").write_text(cutting(), encoding="utf-8")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    return tmp_path


WEDGE = """mechanisms = ["neo_hookean", "volumetric", "stiff_cohesion", "wedge", "coulomb"]
base = "gelatin"
[blade]
angle = "25 deg"
edge_radius = "40 um"
"""


@pytest.fixture
def wedged(folder):
    """Reads the campaign with a material that has a wedge, and other ``lines`` for its baseline and blade."""
    (folder / "mine.toml").write_text(WEDGE, encoding="utf-8")

    def read(baseline="", blade='{ thickness = "0.5 mm" }'):
        text = CAMPAIGN.replace('"elastomer"', '"mine.toml"')
        text = text.replace('baseline = ["neo_hookean", "smith_ferrante", "contact", "adhesion"]', baseline)
        text = text.replace('{ thickness = "0.5 mm", tip = "0.75 mm" }', blade)
        (folder / "campaign.toml").write_text(text, encoding="utf-8")
        return load_campaign(folder / "campaign.toml")

    return read


def test_a_campaign_cuts_with_the_blade_of_its_material(wedged):
    campaign = wedged()
    assert "wedge" in campaign.model.mechanisms and campaign.base.p.edge_radius == pytest.approx(0.04)
    # How it lies is set, and nothing that a fit looks for by itself.
    assert not {"tilt", "incline", "overhang"} & {u.name for u in free_parameters(campaign)}
    blade = '{ thickness = "0.5 mm", angle = "30 deg", edge_radius = "20 um" }'
    p = cut_case(wedged(blade=blade).experiments[0], wedged(blade=blade).base).p
    assert (p.angle, p.edge_radius) == pytest.approx((np.radians(30), 0.02))


def test_all_cuts_of_a_fit_have_elements_of_one_size(wedged):
    campaign = wedged()
    (cut,) = campaign.experiments
    sizes = [cut_case(cut, with_one_detail(campaign).set(cohesion=c)).sizes for c in (5, 40)]
    assert sizes[0] == sizes[1] and sizes[0].detail_mm == pytest.approx(6 * 0.04)


def test_another_blade_than_the_material_has_is_said(wedged):
    campaign = wedged(baseline='baseline = "default"')
    assert any("wedge" in note and "edge_radius" in note for note in campaign.notes)


def test_a_size_that_no_law_of_the_baseline_has_is_refused(wedged):
    with refused("blade.edge_radius", hint="wedge"):
        wedged('baseline = "default"', '{ thickness = "0.5 mm", edge_radius = "40 um" }')


def test_the_stated_format(folder):
    campaign = load_campaign(folder / "campaign.toml")
    assert campaign.base.mechanisms == (
        "neo_hookean", "volumetric", "smith_ferrante", "contact", "adhesion",
    )  # fmt: skip
    (note,) = campaign.notes
    assert "'volumetric'" in note
    assert "coulomb" in campaign.candidates and "adhesion" not in campaign.candidates
    (slow,) = campaign.train
    assert [r.name for r in slow.repetitions] == ["S0", "S1", "S2"] and slow.readings == 180
    case = campaign.case("slow")
    assert case.p.width == 40 and case.p.thickness == 0.5 and case.p.tip == 0.75
    assert case.p.speed == 0.021 and case.p.depth == 12
    assert case.p.G == 0.12


def test_it_survives_a_process(folder):
    campaign = load_campaign(folder / "campaign.toml")
    again = pickle.loads(pickle.dumps(campaign))
    a, b = (c.experiments[0].on_grid(30) for c in (campaign, again))
    np.testing.assert_array_equal(a.curves, b.curves)
    np.testing.assert_array_equal(a.deviation, b.deviation)
    assert again.case("slow").id == campaign.case("slow").id


def test_readings_cannot_be_changed(folder):
    slow = load_campaign(folder / "campaign.toml").experiments[0]
    with pytest.raises(ValueError, match="read-only"):
        slow.repetitions[0].y[0] = 0.0


@pytest.mark.parametrize(
    ("line", "mechanisms"),
    [
        ("", DEFAULT),
        ('baseline = "default"', DEFAULT),
        ('baseline = "paper"', PAPER),
        ("baseline = ['paper']", PAPER),
    ],
)
def test_a_baseline_is_the_model_of_every_run_or_a_set_by_its_name(folder, line, mechanisms):
    text = CAMPAIGN.replace('baseline = ["neo_hookean", "smith_ferrante", "contact", "adhesion"]', line)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    base = load_campaign(folder / "campaign.toml").base
    assert set(base.mechanisms) == set(mechanisms)
    assert (base.model == load_case("gelatin").model) == (mechanisms is DEFAULT)


def test_without_a_cut_it_is_the_part_that_the_tests_see():
    case, _ = start_case(None, kinds=("uniaxial",), parameters={"G": "0.4 MPa"})
    assert case.mechanisms == ("neo_hookean", "volumetric")
    case, _ = start_case("elastomer", kinds=("separation", "uniaxial"))
    assert case.mechanisms == ("neo_hookean", "volumetric", "stiff_cohesion", "viscous_degraded")


def test_several_files_are_repetitions(folder):
    for name, lines in (("a", slice(1, 61)), ("b", slice(61, 121))):
        rows = cutting().splitlines()
        text = "\n".join([rows[0], *rows[lines]])
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    text = CAMPAIGN.replace('"slow.csv"', '["a.csv", "b.csv"]').replace(', repetition = "rep"', "")
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    (slow,) = load_campaign(folder / "campaign.toml").experiments
    assert [r.name for r in slow.repetitions] == ["a", "b"]
    assert Path(slow.repetitions[1].file).name == "b.csv" and slow.repetitions[1].lines[0] == 2


def test_sections_of_their_own(folder):
    text = CAMPAIGN.replace('blade    = { thickness = "0.5 mm", tip = "0.75 mm" }\n', "")
    text += '[experiment.blade]\nthickness = "0.5 mm"\ntip = "0 mm"\n'
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    with refused("blade.tip", value="0 mm", line=17):
        load_campaign(folder / "campaign.toml")


def test_a_speed_stands_for_the_time(folder):
    text = CAMPAIGN.replace(', time = "t [s]"', "").replace(', time = "s"', "")
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    slow = load_campaign(folder / "campaign.toml").experiments[0]
    r = slow.repetitions[0]
    np.testing.assert_allclose(r.time_s, r.x / 0.021, rtol=1e-6)


def test_until_and_factors(folder):
    text = CAMPAIGN.replace('role     = "train"', 'until = "6 mm"\nfactors = { force = 2 }')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    slow = load_campaign(folder / "campaign.toml").experiments[0]
    whole = load_campaign_text(folder, CAMPAIGN)
    assert slow.reach <= 6 < whole.reach
    kept = slow.repetitions[0].y.size
    np.testing.assert_allclose(slow.repetitions[0].y, 2 * whole.repetitions[0].y[:kept])


def load_campaign_text(folder: Path, text: str) -> Experiment:
    (folder / "other.toml").write_text(text, encoding="utf-8")
    return load_campaign(folder / "other.toml").experiments[0]


STRIP = """material = "elastomer"
[[experiment]]
id = "pull"
kind = "uniaxial"
data = "pull.csv"
COLUMNS
specimen = { length = "50 mm", width = "6 mm", thickness = "3 mm" }
"""


@pytest.mark.parametrize(
    ("head", "columns", "unload"),
    [
        (
            "u [mm],F [N]",
            'columns = { displacement = "u", force = "F" }',
            lambda x, P: (50 * (x - 1), 18 * P),
        ),
        ("strain,S [kPa]", 'columns = { strain = "strain", stress = "S" }', lambda x, P: (x - 1, 1e3 * P)),
        ("e [%],S [MPa]", 'columns = { strain = "e", stress = "S" }', lambda x, P: (100 * (x - 1), P)),
        ("stretch,S [MPa]", 'columns = { stretch = "stretch", stress = "S" }\nstress = "cauchy"',
         lambda x, P: (x, x * P)),
    ],
)  # fmt: skip
def test_stretch_and_nominal_stress_however_they_are_given(tmp_path, head, columns, unload):
    stretch = np.linspace(1.05, 2, 20)
    P = 0.12 * (stretch - stretch**-2)
    rows = [f"{a:.10g},{b:.10g}" for a, b in zip(*unload(stretch, P), strict=True)]
    (tmp_path / "pull.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    (tmp_path / "c.toml").write_text(STRIP.replace("COLUMNS", columns), encoding="utf-8")
    (r,) = load_campaign(tmp_path / "c.toml").experiments[0].repetitions
    np.testing.assert_allclose(r.x, stretch, rtol=1e-8)
    np.testing.assert_allclose(r.y, P, rtol=1e-7)


def test_sliding_by_area_and_speed(tmp_path):
    rows = [f"{t},{0.3 + 0.001 * t}" for t in range(1, 20)]
    (tmp_path / "s.csv").write_text("\n".join(["t [s],F [N]", *rows]), encoding="utf-8")
    (tmp_path / "c.toml").write_text(
        'material = "elastomer"\n[[experiment]]\nid = "rub"\nkind = "sliding"\ndata = "s.csv"\n'
        'columns = { time = "t", force = "F" }\nspecimen = { area = "10 mm^2" }\nspeed = "0.5 mm/s"\n'
        'normal_force = "0.2 N"\n',
        encoding="utf-8",
    )
    (rub,) = load_campaign(tmp_path / "c.toml").experiments
    np.testing.assert_allclose(rub.repetitions[0].x, 0.5 * np.arange(19), atol=1e-12)
    np.testing.assert_allclose(rub.repetitions[0].y[0], 0.0301)
    assert rub.pressure_MPa == pytest.approx(0.02)


def test_a_campaign_in_python():
    x = np.linspace(1.05, 2, 20)
    strip = Experiment("pull", "uniaxial", (Repetition(x, 0.12 * (x - x**-2)),))
    base, _ = start_case("elastomer", kinds=("uniaxial",))
    campaign = Campaign("built", base, (strip,), plan=FitPlan(free=("G",)))
    assert campaign.train == (strip,) and campaign.test == ()
    with refused("id", value="pull"):
        Campaign("built", base, (strip, strip))
    with refused("fixed", value="G"):
        FitPlan(free=("G",), fixed=("G",))
    with refused("stress, reading 3", value="nan"):
        Experiment("pull", "uniaxial", (Repetition(x, np.where(np.arange(20) == 2, np.nan, x)),))
    with refused("stress, reading 20"):
        Campaign("built", base, (Experiment("kPa", "uniaxial", (Repetition(x, 120 * (x - x**-2)),)),))


# -- the shipped measurements ------------------------------------------------------------------------
#: SHA-256 of the measured files as their sources publish them, first 16 digits.
MEASURED = {
    "rubber/treloar_1944_uniaxial.txt": "db4ed08046a06baa",
    "rubber/treloar_1944_pure_shear.txt": "f250f2bc20d9ca47",
    "rubber/treloar_1944_equibiaxial.txt": "ff959fda9dfecac8",
    "rubber/kawabata_1981_uniaxial.txt": "c36e9188edbde74a",
    "rubber/kawabata_1981_pure_shear.txt": "c8b3df70fa4b80e5",
    "rubber/kawabata_1981_equibiaxial.txt": "374d5a9a37ea54d3",
    "silicone/ecoflex_00_30.csv": "34c00bcc55c401e2",
    "silicone/ecoflex_00_50.csv": "6e902c87b804fa69",
    "silicone/dragon_skin_20.csv": "5921554fe92a14ee",
    "silicone/rtv615.csv": "f6c927618c3c3520",
    "silicone/meunier_2008_uniaxial.txt": "06dc7d0c8901dbee",
    "silicone/meunier_2008_pure_shear.txt": "7e5bddcc61b3ede8",
    "silicone/meunier_2008_equibiaxial.txt": "283b2b6a8130c8de",
}


@pytest.mark.parametrize("name", MEASURED)
def test_measured_files_are_as_published(name):
    raw = (STUDIES / name).read_bytes().replace(b"\r\n", b"\n")
    assert hashlib.sha256(raw).hexdigest()[:16] == MEASURED[name]


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_studies_load_and_are_drawn(name, tmp_path):
    done = CliRunner().invoke(app, ["data", str(STUDIES / f"{name}.toml"), "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "estimated" in done.output
    assert (tmp_path / "data.png").stat().st_size > 10_000
    rows = (tmp_path / "data.csv").read_text(encoding="utf-8").splitlines()
    campaign = load_campaign(STUDIES / f"{name}.toml")
    assert len(rows) == 1 + sum(e.on_grid().x.size for e in campaign.experiments)
    for e in campaign.experiments:
        assert any("source" in note for note in e.notes)


def test_rtv615_as_its_header_says():
    (pull,) = load_campaign(STUDIES / "silicone" / "rtv615.toml").experiments
    # 450 mm/min over 33 mm.
    assert pull.travel_speed == pytest.approx(450 / 60 / 33, rel=1e-2)
    assert pull.reach == pytest.approx(2.93182) and pull.repetitions[0].y[-1] == pytest.approx(2.50748)
