"""Files to start from run as they stand; how much a command says; what a person of the field may write."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

import cutbench
from cutbench.cli.main import app
from cutbench.cli.terminal import loudness

KINDS = ("run", "material", "study", "campaign")


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield
    loudness(False, False)


def call(*words: str):
    return CliRunner().invoke(app, words, catch_exceptions=False)


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_written_is_never_written_over(kind, tmp_path):
    assert call("new", kind, "mine.toml").exit_code == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    again = call("new", kind, "mine.toml")
    assert again.exit_code == 2 and "mine.toml" in again.output
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["mine.txt", "nowhere/mine.toml"])
def test_a_file_that_cannot_be_is_refused(name):
    assert call("new", "run", name).exit_code == 2


def test_a_run_to_start_from_runs():
    assert call("new", "run").exit_code == 0
    case = cutbench.load("run.toml")
    assert case.name == "my gel" and not case.doubts
    done = call("run2d", "run.toml", "--depth", "0.3", "--h", "0.7", "--out", "out")
    assert done.exit_code == 0 and "0.3 mm" in done.output


def test_a_material_to_start_from_is_gelatin_under_its_own_name():
    assert call("materials", "--new", 'Agar "2 %"', "agar.toml").exit_code == 0
    case = cutbench.load("agar.toml")
    assert case.name == 'Agar "2 %"'
    assert case.values == pytest.approx(cutbench.load_case("gelatin").values, rel=5e-3)
    for words in (
        ("materials", "--new", "gelatin"),
        ("materials", "--new", " "),
        ("materials", "--new", "a\nb"),
    ):
        assert call(*words).exit_code == 2


def test_a_material_is_begun_by_numbers_that_hold_for_any_stiffness_and_speed(tmp_path):
    assert call("materials", "--new", "cheese.toml").exit_code == 0
    path = tmp_path / "cheese.toml"
    gelatin, text = cutbench.load_case("gelatin").groups(), path.read_text("utf-8")
    for own in ('"7.5 kPa"', '"80 kPa"'), ('"0.021 mm/s"', '"1 mm/s"'), ('"0.7 mm"', '"0.5 mm"'):
        text = text.replace(*own)
        path.write_text(text, "utf-8")
        case = cutbench.load(path)
        for group in ("(G_c/delta_c)/G", "eta_reg v/delta_c", "tau_W/(G_c/delta_c)"):
            assert case.groups()[group] == pytest.approx(gelatin[group], rel=5e-3)
        assert not case.far


def test_a_time_of_another_speed_is_said_from_a_factor_of_three_on():
    # 2.38 s belong to 0.021 mm/s; the largest of the materials' groups is meat's, 2.85.
    group = "eta_reg v/delta_c"
    for speed, said in ("0.2 mm/s", []), ("0.3 mm/s", [group]), ("1 mm/s", [group]):
        case = cutbench.load_case("gelatin", {"speed": speed})
        assert [one.group for one in case.far] == said


def test_a_material_of_ones_own_is_taken_where_a_name_is(tmp_path):
    from page_maps import ONE_AXIS, swept

    assert call("materials", "--new", "my gel", "gel.toml").exit_code == 0
    assert "my gel" in call("materials", "gel.toml").output
    folder = swept(tmp_path, ONE_AXIS.replace("0.2,", "0.1, 0.5, 1.0,").replace('"gelatin"]', '"gel.toml"]'))
    assert "my gel" in call("guide", str(folder), "--material", "gel.toml").output
    assert '"my gel"' in (folder / "map.html").read_text("utf-8")
    (tmp_path / "mine.toml").write_text('base = "gel.toml"\n[parameters]\nG = "9 kPa"\n', "utf-8")
    assert cutbench.load("mine.toml").values["G_c"] == pytest.approx(5.3e-3, rel=1e-3)


def test_a_study_to_start_from_is_one():
    assert call("new", "study", "mine.toml").exit_code == 0
    study = cutbench.load("mine.toml")
    assert [a.name for a in study.axes] == ["speed", "G"] and study.plot.mark == ("gelatin",)
    assert call("sweep", "mine.toml", "--dry-run").exit_code == 0


def test_a_campaign_to_start_from_is_fitted():
    assert call("new", "campaign", "mine.toml").exit_code == 0
    done = call("fit", "mine.toml", "--out", "fit", "--workers", "0")
    assert done.exit_code == 0 and "converged" in done.output


@pytest.mark.slow
def test_quiet_says_what_was_found_and_loud_the_counters():
    words = ("run2d", "gelatin", "--depth", "0.2", "--h", "0.7", "--out", "out")
    plain, quiet, loud = call(*words), call(*words, "-q"), call(*words, "-v")
    assert all("0.2 mm" in said.output for said in (plain, quiet, loud))
    assert len(quiet.output.splitlines()) < 5 < len(plain.output.splitlines()) < len(loud.output.splitlines())
    assert "iterations" in loud.output and "iterations" not in plain.output


@pytest.mark.parametrize(
    ("said", "meant"),
    [("E=20 kPa", "G = E/(2 (1 + nu))"), ("toughness=5", "G_c"), ("friction_coefficient=0.1", "mu")],
)
def test_the_fields_own_words_are_led_to_the_names(said, meant):
    done = call("run2d", "gelatin", "--set", said)
    assert done.exit_code == 2 and meant in done.output
