"""``cutbench plot``: pictures again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.cli.options import with_exit_status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cutbench.base.figure_style import Size

#: What can be drawn.
_SOURCE = "a folder with run.json or map.nc in it, or a map.nc"


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
    from cutbench.base.errors import BadInput

    if len(sources) > 1:
        out = out or Path("curves.png")
    if out is not None or size is not None:
        typer.echo(_picture(sources, out, size))
        return
    (source,) = sources
    grid = source / "map.nc" if source.is_dir() else source
    if source.is_dir() and (source / "run.json").is_file():
        from cutbench.run.figures import plot_curve, save
        from cutbench.run.files import read_run
        from cutbench.run.paraview import read_fields

        result = read_run(source)
        paths = save(plot_curve(result), source / "curve.png")
        if result.case.dim == 3:
            from cutbench.run.figures.solid import save_solid

            result.snapshots = read_fields(source)
            paths += save_solid(result, source).values()
    elif grid.is_file():
        from cutbench.maps.atlas_map import under_way
        from cutbench.maps.closed_form_estimates import compare
        from cutbench.maps.collapse import save_collapse
        from cutbench.maps.dataset import load_map, store_of
        from cutbench.maps.findings import boundary_sentences, findings, save_findings
        from cutbench.maps.page import save_page
        from cutbench.maps.phase import save_phase
        from cutbench.run.store.runs import Store

        data = load_map(grid)
        if (data["outcome"].values[data["run_id"].values != ""] == 0).any():
            data = under_way(data, None)
        runs = store_of(data, grid.parent)
        more, line = save_collapse(data, grid.parent)
        said = [compare(data).text(), *([line] if line else [])]
        page = save_page(data, Store(runs) if runs.is_dir() else None, grid.parent)
        paths = [*save_phase(data, grid.parent), *more, page]
        paths.append(save_findings(data, grid.parent, said))
        for note in (*findings(data).lines(), *boundary_sentences(data), *said):
            typer.echo(note)
        if against is not None:
            from cutbench.maps.grid_agreement import agreement

            other = against / "map.nc" if against.is_dir() else against
            typer.echo(agreement(data, load_map(other)).text())
    else:
        raise BadInput("DIR|MAP.nc", str(source), _SOURCE)
    for path in paths:
        typer.echo(path)


def _picture(sources: list[Path], out: Path | None, name: str | None) -> Path:
    """One picture in one file: of a run, a map, or the forces of several runs."""
    from cutbench.base.errors import BadInput
    from cutbench.base.figure_style import SIZES, save
    from cutbench.base.toml import among

    if out is None or out.suffix not in (".png", ".svg", ".pdf") or not out.parent.is_dir():
        expected = "a file ending in .png, .svg or .pdf, in a folder that is there"
        raise BadInput("--out", "(missing)" if out is None else str(out), expected)
    if name is not None:
        among("--size", name, SIZES)
    size = None if name is None else SIZES[name]
    source = sources[0]
    grid = source / "map.nc" if source.is_dir() else source
    if len(sources) > 1:
        figure = _together(sources, size)
    elif (source / "run.json").is_file():
        from cutbench.run.figures import plot_curve
        from cutbench.run.files import read_run

        figure = plot_curve(read_run(source), size)
    elif grid.is_file():
        from cutbench.maps.dataset import load_map
        from cutbench.maps.markers import FOLDER, RECORD, read_confirmed
        from cutbench.maps.phase import draw_phase

        data = load_map(grid)
        figure = draw_phase(data, read_confirmed(grid.parent / FOLDER / RECORD, data), size)
    else:
        raise BadInput("DIR|MAP.nc", str(source), _SOURCE)
    return save(figure, out, size=size)[0]


def _together(sources: list[Path], size: Size | None) -> Figure:
    """The forces of several runs in one picture."""
    from cutbench.run.figures import plot_curves
    from cutbench.run.files import read_run

    runs = {source: read_run(source) for source in sources}
    names = [run.case.name for run in runs.values()]
    alike = len(set(names)) < len(names)
    shown = {
        f"{run.case.name} ({source.name})" if alike else run.case.name: run for source, run in runs.items()
    }
    return plot_curves(shown, size)
