"""``cutbench plot``: pictures again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.cli.options import with_exit_status

if TYPE_CHECKING:
    from cutbench.maps.map_folder import Map
    from cutbench.run.result import Result


@with_exit_status
def plot(
    sources: Annotated[
        list[Path],
        typer.Argument(metavar="DIR|MAP.nc", help="Folder of a run or a sweep, or a map; of several runs."),
    ],
    against: Annotated[
        Path | None,
        typer.Option(metavar="MAP.nc", help="A grid's map: count where the boundary that was sought agrees."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="One picture, .png, .svg or .pdf; of several runs: curves.png."),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="paper|slide",
            help="Of that picture: one column of a journal, 85 mm with 8 pt; or 16:9 with large type.",
        ),
    ] = None,
) -> None:
    """Draw the pictures of a run or a map again, a map also as a page; or several runs in one picture."""
    from cutbench.maps.map_folder import Map
    from cutbench.run.figures import plot_curve, save
    from cutbench.run.figures.solid import save_solid
    from cutbench.run.paraview import read_fields

    if len(sources) > 1:
        out = out or Path("curves.png")
    if out is not None or size is not None:
        typer.echo(_picture(sources, out, size))
        return
    (source,) = sources
    opened, folder = _opened(source), source if source.is_dir() else source.parent
    if not isinstance(opened, Map):
        paths = [save(plot_curve(opened), folder / "curve.png")[0]]
        if opened.case.dim == 3:
            opened.snapshots = read_fields(folder)
            paths += save_solid(opened, folder).values()
    else:
        paths = _map_again(opened, against)
    for path in paths:
        typer.echo(path)


def _opened(source: Path) -> Result | Map:
    """The run or the map that lies there. Raises BadInput for anything else."""
    from cutbench.base.errors import BadInput
    from cutbench.maps.map_folder import Map
    from cutbench.run.files import read_run

    if source.is_dir() and (source / "run.json").is_file():
        return read_run(source)
    if (source / "map.nc" if source.is_dir() else source).is_file():
        return Map.of(source)
    raise BadInput("DIR|MAP.nc", str(source), "a folder with run.json or map.nc in it, or a map.nc")


def _map_again(map: Map, against: Path | None) -> list[Path]:
    """Draw the files of a map, and say what it has found."""
    from cutbench.base.files import write_text
    from cutbench.maps.atlas_map import under_way
    from cutbench.maps.closed_form_estimates import compare
    from cutbench.maps.collapse import save_collapse
    from cutbench.maps.dataset import store_of
    from cutbench.maps.findings import FILE, boundary_sentences, findings, summary_text
    from cutbench.maps.grid_agreement import agreement
    from cutbench.maps.page import page
    from cutbench.maps.phase import save_phase
    from cutbench.run.store.runs import Store

    data, folder = map.data, map.folder
    if (data["outcome"].values[data["run_id"].values != ""] == 0).any():
        data = under_way(data, None)
    runs = store_of(data, folder)
    more, line = save_collapse(data, folder)
    said = [compare(data).text(), *([line] if line else [])]
    for note in (*findings(data).lines(), *boundary_sentences(data), *said):
        typer.echo(note)
    if against is not None:
        typer.echo(agreement(data, map.of(against).data).text())
    texts = {
        "map.html": page(data, Store(runs) if runs.is_dir() else None),
        FILE: summary_text(data, said),
    }
    written = [write_text(text, folder / name) for name, text in texts.items()]
    return [*save_phase(data, folder), *more, *written]


def _picture(sources: list[Path], out: Path | None, name: str | None) -> Path:
    """One picture in one file: of a run, a map, or the forces of several runs."""
    from cutbench.base.errors import BadInput
    from cutbench.base.figure_style import SIZES, save
    from cutbench.base.toml import among
    from cutbench.maps.map_folder import Map
    from cutbench.maps.markers import FOLDER, RECORD, read_confirmed
    from cutbench.maps.phase import draw_phase
    from cutbench.run.figures import plot_curve, plot_curves
    from cutbench.run.files import read_run

    if out is None or out.suffix not in (".png", ".svg", ".pdf") or not out.parent.is_dir():
        expected = "a file ending in .png, .svg or .pdf, in a folder that is there"
        raise BadInput("--out", "(missing)" if out is None else str(out), expected)
    if name is not None:
        among("--size", name, SIZES)
    size = None if name is None else SIZES[name]
    if len(sources) > 1:
        runs = [read_run(source) for source in sources]
        names = [run.case.name for run in runs]
        if len(set(names)) < len(names):
            names = [f"{name} ({source.name})" for name, source in zip(names, sources, strict=True)]
        figure = plot_curves(dict(zip(names, runs, strict=True)), size)
    elif isinstance(opened := _opened(sources[0]), Map):
        marks = read_confirmed(opened.folder / FOLDER / RECORD, opened.data)
        figure = draw_phase(opened.data, marks, size)
    else:
        figure = plot_curve(opened, size)
    return save(figure, out, size=size)[0]
