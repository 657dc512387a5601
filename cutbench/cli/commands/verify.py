"""``cutbench verify``: reference problems, and whether the product gets them right."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.base.toml import among
from cutbench.cli.options import exits
from cutbench.cli.progress import bar
from cutbench.cli.show import show, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from cutbench.verification.paper import Claim
    from cutbench.verification.paper.judgement import Judged
    from cutbench.verification.reference import Reference, Verified


@exits
def verify(
    quick: Annotated[bool, typer.Option("--quick", help="Only the quick ones, in a minute.")] = False,
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this problem; may be repeated.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write verify.json and verify.md there.")
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="Show what there is, compute nothing.")] = False,
    paper: Annotated[
        bool, typer.Option("--paper", help="Instead: the published model's claims, one by one (needs --out).")
    ] = False,
    workers: Annotated[
        str | None, typer.Option(metavar="N", help="Processes for --paper; default: one a core.")
    ] = None,
) -> None:
    """Compute reference problems and compare with what is known; fails if any check does."""
    if paper or workers is not None:
        _paper(paper, quick, only, out, list_, workers)
        return
    from cutbench.base.files import check_writable
    from cutbench.verification.reference import references, verify
    from cutbench.verification.reference.report import write

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


def _paper(
    paper: bool, quick: bool, only: list[str] | None, out: Path | None, list_: bool, workers: str | None
) -> None:
    """The claims of the paper, from runs that are kept in ``out`` and computed once."""
    from cutbench.base.errors import BadInput
    from cutbench.base.files import check_writable
    from cutbench.cli.options import whole
    from cutbench.verification.paper.investigation import investigate, select

    if not paper:
        raise BadInput("--workers", workers, "--paper with it")
    if quick:
        raise BadInput("--quick", "--paper", "one of the two: claims need whole runs")
    chosen = select(only or ())
    if list_:
        show(_claims(chosen))
        return
    if out is None:
        raise BadInput("--out", "(missing)", "a folder for the runs behind the claims")
    processes = whole("--workers", workers)
    check_writable(out)
    with bar("claims", "runs") as on_progress:
        try:
            found = investigate(out, only=only or (), workers=processes, on_progress=on_progress)
        except KeyboardInterrupt:
            typer.echo(f"interrupted: runs that ended are kept in {out / 'runs'}", err=True)
            raise typer.Exit(130) from None
    show(_verdicts(found.judged))
    typer.echo(f"{len(found.runner.results)} runs, {found.runner.computed} of them computed now")
    for path in found.paths:
        typer.echo(path)


def _claims(chosen: Sequence[Claim]) -> Table:
    rows = [(claim.id, claim.text, ", ".join(claim.asks) or claim.beyond) for claim in chosen]
    return table(("claim", "what was published", "runs"), rows)


def _verdicts(judged: Sequence[Judged]) -> Table:
    from rich.markup import escape

    from cutbench.verification.paper.judgement import BEYOND

    made = table(("claim", "statement", "the paper", "paper's numerics", "converged", "verdict"))
    for one in judged:
        made.add_section()
        id = one.claim.id
        for row in one.rows:
            cells = [row.what, row.findings["paper"].published, *(f.text for f in row.findings.values())]
            made.add_row(id, *map(escape, cells), row.verdict)
            id = ""
        if one.claim.beyond:
            made.add_row(id, escape(one.claim.beyond), "", "", "", BEYOND)
    return made


def _chosen(known: dict[str, Reference], quick: bool, only: list[str] | None) -> list[Reference]:
    from cutbench.base.errors import BadInput

    for name in only or ():
        among("--only", name, known)
        if quick and not known[name].quick:
            raise BadInput("--only", name, f"no --quick with it: {name} takes longer")
    return [r for r in known.values() if (r.quick or not quick) and (not only or r.name in only)]


def _contents(chosen: Sequence[Reference]) -> Table:
    rows = [(r.name, r.title, r.source, "yes" if r.quick else "") for r in chosen]
    return table(("name", "what it checks", "reference", "quick"), rows)


def _checks(done: Sequence[Verified]) -> Table:
    from rich.markup import escape

    from cutbench.verification.reference.report import texts

    numbers = ("reference", "obtained", "error", "tolerance")
    made = table(("problem", "quantity", *numbers, "verdict"), right=numbers)
    for one in done:
        made.add_section()
        name = one.reference.name
        for check in one.checks:
            *cells, verdict = map(escape, texts(check))
            made.add_row(name, *cells, verdict if check.passed else f"[bold red]{verdict}[/]")
            name = ""
        if one.failure is not None:
            made.add_row(name, escape(one.failure), "", "", "", "", "[bold red]FAILED[/]")
    return made
