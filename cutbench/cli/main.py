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
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


#: What to begin with, for somebody who types the bare name.
FIRST_STEPS = """\
cutbench computes how a blade cuts a soft solid. To begin:

  cutbench estimate gelatin                  abrupt or smooth? in seconds, without a run
  cutbench run2d gelatin --until transition  one cut: its force, what takes it up, its section
  cutbench examples --out examples           studies and measured curves to start from, then
  cutbench sweep examples/transition.toml    a map of where cutting is abrupt
  cutbench fit CAMPAIGN.toml                 a material from measured curves, as examples/silicone
  cutbench app                               all of it in a browser
"""


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"cutbench {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(FIRST_STEPS)
        typer.echo(context.get_help())


for _command in commands():
    app.command()(with_laws(_command))


def main() -> None:
    """Entry point of the ``cutbench`` command."""
    app()
