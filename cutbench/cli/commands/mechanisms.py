"""``cutbench mechanisms``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import print_written, with_exit_status
from cutbench.cli.terminal import show


@with_exit_status
def mechanisms(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Show all about one.")] = None,
    check: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.py|DIR",
            help="Test the laws in a file, or in all of a folder, as those of the package are tested.",
        ),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw what kind of law it is.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The picture (NAME.png), in the format of its suffix.")
    ] = None,
) -> None:
    """List the known mechanisms with parameters and groups, show or draw one, or check a file."""
    from cutbench.cli.tables import findings_table, mechanism, mechanism_table

    if plot:
        from cutbench.base.figure_style import save
        from cutbench.homogeneous.law_figure import plot_law

        print_written(save(plot_law(name or ""), out or Path(f"{name}.png")))
        return
    if check is None:
        show(*(mechanism_table() if name is None else mechanism(name)))
        return
    from cutbench.base.errors import BadInput
    from cutbench.mechanisms.checks import check_file
    from cutbench.mechanisms.law_registry import files_of_laws

    files = files_of_laws(check.resolve()) if check.is_dir() else [check]
    if not files:
        raise BadInput("--check", str(check), "a file of Python with laws, or a folder of such")
    found = [each for file in files for each in check_file(file)]
    show(findings_table(found))
    wrong, untested = (sum(bool(getattr(each, of)) for each in found) for of in ("wrong", "untested"))
    typer.echo(f"{len(found)} checks, {wrong} failed" + (f", {untested} not tested" if untested else ""))
    if wrong:
        raise typer.Exit(1)
