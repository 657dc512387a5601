"""``cutbench runs``: what a store holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.base.report import Table
from cutbench.cli.options import with_exit_status
from cutbench.cli.terminal import show


@with_exit_status
def runs(
    source: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a sweep, or its runs.")],
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CONDITION", help="Only these: 'drop_rel > 0.1', 'G >= 10 kPa'; repeat for more."
        ),
    ] = None,
    columns: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="What to show of each; default: the main ones.")
    ] = None,
    sort: Annotated[str | None, typer.Option(metavar="COLUMN", help="Order; default: by id.")] = None,
    csv: Annotated[Path | None, typer.Option(metavar="FILE", help="Write them as CSV, all columns.")] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write them as JSON, all columns.")
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write each one's run.json, curve.csv and curve.png to DIR/ID."),
    ] = None,
) -> None:
    """List the runs that sweeps have kept; choose some; export them."""
    from cutbench.base.errors import BadInput
    from cutbench.base.files import check_writable, csv_text, write_json, write_text
    from cutbench.run.files import write_run
    from cutbench.run.store import listing
    from cutbench.run.store.runs import Store

    root = source / "runs" if (source / "runs").is_dir() else source
    if not root.is_dir():
        raise BadInput("DIR", str(source), "the folder of a sweep, or of its runs")
    store = Store(root)
    heads = store.heads()
    chosen = [name.strip() for name in columns.split(",")] if columns else None
    wanted = chosen or list(listing.DEFAULT)
    names, rows = listing.table_of(heads, where or [], ["id", *wanted], sort)
    ids, names, rows = [str(row[0]) for row in rows], names[1:], [row[1:] for row in rows]
    if csv is not None or json is not None:
        whole = listing.table_of({id: heads[id] for id in ids}, [], chosen, sort)
        for path in filter(None, (csv, json)):
            check_writable(path.parent)
            if path is csv:
                write_text(csv_text(*whole), path)
            else:
                write_json([dict(zip(whole[0], row, strict=True)) for row in whole[1]], path)
            typer.echo(path)
    if export is not None:
        check_writable(export)
        for id in ids:
            try:
                write_run(store.read(id), export / id)
                typer.echo(export / id)
            except BadInput as error:  # of a version whose cases this one cannot read
                typer.echo(f"not exported: {error}", err=True)
    if csv is None and json is None and export is None:
        texts = [
            ["" if v is None or v != v else f"{v:.4g}" if isinstance(v, float) else str(v) for v in row]
            for row in rows
        ]
        show(Table(names, texts, whole=("id",)))
    typer.echo(f"{len(ids)} of {len(heads)} runs")
    for writer, count in listing.other_computations(heads[id] for id in ids).items():
        typer.echo(f"{count} of {len(ids)} are by {writer}: sweeps compute these anew", err=True)
    for id, reason in store.unreadable().items():
        typer.echo(f"{id}: {reason}", err=True)
