"""``cutbench app``: the workbench in a browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import with_exit_status


@with_exit_status
def app(
    folder: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="All that is written goes there; its maps can be opened.")
    ] = Path("workbench"),
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any that is free.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page.")] = True,
) -> None:
    """Serve the workbench as a page for this machine alone, until Ctrl-C; needs the extra 'app'."""
    from cutbench.base.errors import BadInput

    try:
        from cutbench.app.server import serve
    except ImportError as error:
        raise BadInput("app", error.name or "", "the extra 'app': pip install 'cutbench[app]'") from error

    def ready(address: str) -> None:
        typer.echo(f"cutbench is at {address}\nWho has this address can use it. Ctrl-C ends it.")
        if browser:
            webbrowser.open(address)

    serve(folder, port, ready)
