"""The command line: every command of ``cutbench.cli.commands`` under one name."""

from __future__ import annotations

from typing import Annotated

import typer

from cutbench import __version__
from cutbench.cli.commands import commands
from cutbench.cli.options import with_laws

app = typer.Typer(
    name="cutbench",
    help="A workbench for cutting soft solids with a blade.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"cutbench {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    pass


for _command in commands():
    app.command()(with_laws(_command))


def main() -> None:
    """Entry point of the ``cutbench`` command."""
    app()
