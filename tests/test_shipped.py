"""Every file that comes with cutbench opens through what a person opens it with; no list is kept."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest
from analytic_runs import computed
from refusals import refusal
from typer.testing import CliRunner

import cutbench
from cutbench.cli.main import app
from cutbench.maps.dataset import load_map, other_writer
from cutbench.maps.markers import RECORD, confirmed_handles, read_confirmed
from cutbench.maps.study import load_study
from cutbench.run.convergence import load_plan

HERE = Path(__file__).parents[1]
FILES = sorted(p for p in (HERE / "studies").rglob("*") if p.is_file() and "__pycache__" not in p.parts)
MATERIALS = sorted((Path(cutbench.__file__).parent).rglob("materials/*.toml"))
MAPS = [path for path in FILES if path.suffix == ".nc"]
TOML = [path for path in FILES if path.suffix == ".toml"]
#: Read by people, or by Python.
OTHER = [path for path in FILES if path.suffix in (".md", ".py", ".ipynb") or path.name.startswith("LICENSE")]
#: Points of maps in three dimensions.
RECORDS = [path for path in FILES if path.name == RECORD]
DATA = [path for path in FILES if path not in (*MAPS, *TOML, *OTHER, *RECORDS)]


def name_of(path: Path) -> str:
    return path.relative_to(HERE).as_posix()


def said(*args, code=0) -> str:
    done = CliRunner().invoke(app, [str(arg) for arg in args])
    text = re.sub(r"\s+", " ", done.output)
    assert done.exit_code == code, text or done.exception
    return text


@pytest.fixture
def no_solver(runs_by):
    """Runs by formula: what is opened here is not to be computed."""
    runs_by(lambda case, **options: computed(case))


@pytest.fixture
def copied(request, tmp_path) -> Path:
    """A shipped map in a folder of its own, in which commands may write."""
    folder = tmp_path / request.param.parent.name
    folder.mkdir()
    return Path(shutil.copy(request.param, folder))


every_map = pytest.mark.parametrize("copied", MAPS, indirect=True, ids=name_of)
#: What takes seconds: at once of one map.
FEW = ("transition",)
some_maps = pytest.mark.parametrize(
    "copied",
    [pytest.param(m, marks=() if m.parent.name in FEW else pytest.mark.slow, id=name_of(m)) for m in MAPS],
    indirect=True,
)


def test_there_is_something_to_open():
    assert MAPS and TOML and DATA and MATERIALS and RECORDS


# -- maps ---------------------------------------------------------------------------------------------
@every_map
def test_a_map_guides_the_materials_that_lie_on_it(copied):
    data = load_map(copied)
    told = {}
    for material in ("gelatin", "elastomer", "meat"):
        done = CliRunner().invoke(app, ["guide", str(copied), "--material", material])
        text = re.sub(r"\s+", " ", done.output)
        if done.exit_code != 0:
            refusal(done, "--material")
        else:
            assert re.search(r"\b(abrupt|smooth|undecided)\b", text), text
            told[material] = text
    assert told or copied.parent.name.endswith("-grid")  # a part of a box may hold no material
    assert data.attrs["cutbench"] and data.attrs["computation"]
    assert not any(data.attrs["computation"] in text for text in told.values())


@some_maps
def test_a_map_is_drawn_and_a_boundary_held_against_its_grid(copied):
    grid = HERE / "studies" / "results" / f"{copied.parent.name}-grid"
    text = said("plot", copied.parent, *(("--against", grid) if grid.is_dir() else ()))
    for name in ("phase.png", "map.html"):
        assert (copied.parent / name).stat().st_size > 10_000 and name in text
    assert not grid.is_dir() or re.search(r"\d+ of \d+", text)


@some_maps
@pytest.mark.parametrize("command", [pytest.param("confirm", marks=pytest.mark.slow), "guide"])
def test_more_of_a_map_is_computed_or_what_wrote_it_is_named(copied, command, no_solver):
    data = load_map(copied)
    asks = {"confirm": ["--points", "1", "--no-materials"], "guide": ["--material", "elastomer", "--check"]}
    done = CliRunner().invoke(app, [command, str(copied), *asks[command]])
    text = re.sub(r"\s+", " ", done.output)
    assert done.exit_code in (0, 1, 2) and not isinstance(done.exception, (KeyError, ValueError, TypeError))
    if done.exit_code == 2 and other_writer(data):
        assert other_writer(data) in text or "--material" in text or "change" in text
        assert not (copied.parent / "runs").exists()


@pytest.mark.slow
@pytest.mark.parametrize("path", RECORDS, ids=name_of)
def test_points_in_three_dimensions_lie_on_their_map_and_are_drawn_in_it(path, tmp_path):
    record, folder = json.loads(path.read_text(encoding="utf-8")), path.parents[1]
    points = read_confirmed(path, load_map(folder / "map.nc"))
    assert len(points) == record["compared"] == record["asked"]
    assert not Path(record["map"]).is_absolute()
    shutil.copytree(folder, tmp_path / "map")
    said("plot", tmp_path / "map")
    drawn = (tmp_path / "map" / "phase.svg").read_text(encoding="utf-8")
    assert all(handle.get_label() in drawn for handle in confirmed_handles({p["verdict"] for p in points}))


# -- studies, campaigns, materials -----------------------------------------------------------------------
@pytest.mark.parametrize("path", TOML, ids=name_of)
def test_a_toml_file_is_read_by_its_command(path, tmp_path):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    if "experiment" in table:
        shown = said("data", path, "--out", tmp_path)
        assert all(e["id"] in shown for e in table["experiment"])
    elif "change" in table:
        assert load_plan(path).changes
    elif "axis" in table:
        study = load_study(path)
        assert study.axes and study.base.id
    else:
        assert cutbench.load_case(path).id


@pytest.mark.parametrize("path", MATERIALS, ids=lambda path: path.stem)
def test_a_material_is_shown_and_is_a_case(path):
    assert path.stem in said("materials", path.stem) and path.stem in said("materials")
    assert cutbench.load_case(path.stem).id == cutbench.load_case(path).id


@pytest.mark.parametrize("path", DATA, ids=name_of)
def test_a_data_file_belongs_to_a_campaign(path):
    campaigns = [tomllib.loads(toml.read_text(encoding="utf-8")) for toml in path.parent.glob("*.toml")]
    named = [e["data"] for campaign in campaigns for e in campaign.get("experiment", ())]
    assert path.name in [name for data in named for name in (data if isinstance(data, list) else [data])]
