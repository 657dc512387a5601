"""The example notebooks: stored without outputs, run from end to end in a kernel of their own, and what a
notebook shows while it waits."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import IPython
import nbformat
import pytest
from nbclient import NotebookClient

import cutbench

STUDIES = Path(__file__).parents[1] / "studies"
NOTEBOOKS = sorted((STUDIES / "notebooks").glob("*.ipynb"))


def read(path: Path):
    found = nbformat.read(path, 4)
    nbformat.validate(found)
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_what_it_shows(path):
    found = read(path)
    assert found.cells[0].cell_type == "markdown" and found.cells[0].source.startswith("# ")
    for cell in found.cells:
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_end_to_end(path, tmp_path, monkeypatch):
    monkeypatch.delenv("MPLBACKEND", raising=False)  # as a person starts it
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(STUDIES.parent), os.environ.get("PYTHONPATH", "")]))
    folder = cutbench.copy_examples(tmp_path / "examples") / "notebooks"
    found = read(folder / path.name)
    NotebookClient(found, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    outputs = [out for cell in found.cells if cell.cell_type == "code" for out in cell.outputs]
    assert not [out for out in outputs if out.get("name") == "stderr"]
    pages = [out.data.get("text/html", "") for out in outputs if "data" in out]
    assert any("<table>" in page and "<svg" in page for page in pages)
    lines = [out for out in outputs if out.output_type == "display_data" and set(out.data) == {"text/plain"}]
    assert lines and not any(line.data["text/plain"] for line in lines), "a line of progress, gone at the end"


class Screen:
    """What a notebook would show: one text after the other."""

    def __init__(self):
        self.shown = []

    def display(self, text, display_id):
        self.update(text)
        return self

    def update(self, text):
        self.shown.append(str(text))


@pytest.fixture
def screen(monkeypatch):
    """A process that looks like a notebook's kernel."""

    class ZMQInteractiveShell:
        pass

    found = Screen()
    monkeypatch.setattr(IPython, "get_ipython", ZMQInteractiveShell)
    monkeypatch.setattr(IPython, "display", SimpleNamespace(display=found.display))
    monkeypatch.setattr("cutbench.base.notebook.EVERY_S", 0.0)
    return found


def test_in_a_notebook_a_run_says_how_far_it_is_and_the_line_goes(screen):
    cutbench.run2d("gelatin", depth="0.2 mm", h="1.4 mm")
    assert any("of 0.2 mm" in text and " N" in text for text in screen.shown)
    assert screen.shown[-1] == ""


def test_a_fit_shows_one_line_and_whoever_asks_for_progress_none(screen):
    rubber = cutbench.load_campaign(STUDIES / "rubber" / "treloar.toml")
    cutbench.fit(rubber, workers=0, on_progress=lambda *_: None)
    assert not screen.shown
    cutbench.fit(rubber, workers=0)
    assert len(screen.shown) > 2 and screen.shown.count("") == 1


def test_outside_a_notebook_nothing_is_shown(capsys, monkeypatch):
    monkeypatch.setattr(IPython, "get_ipython", lambda: None)
    cutbench.run2d("gelatin", depth="0.1 mm", h="1.4 mm")
    assert capsys.readouterr() == ("", "")
