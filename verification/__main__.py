"""``python -m verification [--quick] [--only NAME] [--out DIR]``: does cutbench get them right?"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.base.report import Table
from cutbench.base.toml import among
from cutbench.cli.options import with_exit_status
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from verification import Reference, Verified


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
@with_exit_status
def main(
    quick: Annotated[bool, typer.Option("--quick", help="Only the quick ones, in a minute.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this problem; may be repeated.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write verify.json and verify.md there.")
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="Show what there is, compute nothing.")] = False,
) -> None:
    """Compute reference problems and compare with what is known; fails if any check does."""
    from cutbench.base.files import check_writable
    from verification import references, verify
    from verification.report import write

    chosen = _chosen(references(), quick, only)
    if list_:
        show(_contents(chosen))
        return
    if out is not None:
        check_writable(out)
    done: list[Verified] = []
    interrupted = True
    with suppress(KeyboardInterrupt), bar("verify", "s") as on_progress:
        for one in verify(chosen, on_progress=on_progress):
            done.append(one)
        interrupted = False
    if done:
        show(_checks(done))
    failed = [one.reference.name for one in done if not one.passed]
    count = sum(len(one.checks) for one in done)
    wrong = sum(not check.passed for one in done for check in one.checks)
    typer.echo(
        f"{count - wrong} of {count} checks passed in {len(done)} of {len(chosen)} problems,"
        f" {sum(one.seconds for one in done):.0f} s" + (f"; failed: {', '.join(failed)}" if failed else "")
    )
    if out is not None:
        for path in write(done, out, complete=len(done) == len(chosen)):
            typer.echo(path)
    if interrupted:
        typer.echo("interrupted: what was computed is kept", err=True)
        raise typer.Exit(130)
    if failed:
        raise typer.Exit(1)


def _chosen(known: dict[str, Reference], quick: bool, only: list[str] | None) -> list[Reference]:
    from cutbench.base.errors import BadInput

    for name in only or ():
        among("--only", name, known)
        if quick and not known[name].quick:
            raise BadInput("--only", name, f"no --quick with it: {name} takes longer")
    return [r for r in known.values() if (r.quick or not quick) and (not only or r.name in only)]


def _contents(chosen: Sequence[Reference]) -> Table:
    rows = [(r.name, r.title, r.source, "yes" if r.quick else "") for r in chosen]
    return Table(("name", "what it checks", "reference", "quick"), rows)


def _checks(done: Sequence[Verified]) -> Table:
    from verification.report import texts

    numbers = ("reference", "obtained", "error", "tolerance")
    rows: list[list[str]] = []
    for one in done:
        cells = [texts(check) for check in one.checks]
        if one.failure is not None:
            cells.append([one.failure, "", "", "", "", "FAILED"])
        names = [one.reference.name, *[""] * len(cells)]
        rows += [[], *([name, *row] for name, row in zip(names, cells, strict=False))]
    return Table(("problem", "quantity", *numbers, "verdict"), rows, right=numbers)


if __name__ == "__main__":
    app(prog_name="python -m verification")
