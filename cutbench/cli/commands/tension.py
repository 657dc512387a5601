"""``cutbench tension``: a strip pulled until it tears."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from cutbench.cli.options import Element, Out, Sets, Size, Source, With, Without, changes, exits, in_mm, show
from cutbench.cli.progress import bar

if TYPE_CHECKING:
    from cutbench.run.tension import Tension


@exits
def tension(
    material: Source,
    notched: Annotated[bool, typer.Option("--notched", help="Pull a strip with a notch.")] = False,
    notch: Annotated[
        str | None, typer.Option(metavar="MM", help="Length of the notch (2.4 mm); implies --notched.")
    ] = None,
    elongation: Annotated[
        str | None, typer.Option(metavar="MM", help="Largest elongation (30 mm, or until torn).")
    ] = None,
    sets: Sets = None,
    h: Size = None,
    element: Element = None,
    without: Without = None,
    with_: With = None,
    out: Out = None,
) -> None:
    """Pull a strip of 12 × 30 × 3 mm between clamps: the bulk and cut laws of a cutting test, no blade."""
    from pathlib import Path

    from cutbench.base.files import check_writable
    from cutbench.base.units import parse_quantity
    from cutbench.case.case import load_case
    from cutbench.run.figures.tension import save_tension
    from cutbench.run.tension import NOTCH, strip_case

    asked = changes(sets, {"h": in_mm(h), "depth": in_mm(elongation), "element": element}, with_, without)
    model = {key: asked.pop(key) for key in ("with", "without") if key in asked}
    length = 0.0
    if notched or notch is not None:
        raw = f"{NOTCH.default} mm" if notch is None else in_mm(notch)
        length = NOTCH.check(parse_quantity(raw, "mm", key="--notch"), key="--notch")
    case = strip_case(load_case(material, model, dim=3), asked, notch_mm=length)
    name = f"{case.name}-tension" + ("-notched" if length else "")
    folder = check_writable(out if out is not None else Path("runs") / f"{name}-{case.id}")
    test = _pulled(case, length)
    save_tension(test, folder)
    show(_table(test))
    typer.echo(str(test.outcome))
    typer.echo(f"written to {folder}")
    if not test.outcome.done:
        raise typer.Exit(130 if test.outcome.kind == "interrupted" else 1)


def _pulled(case, notch_mm: float) -> Tension:
    from cutbench.run.tension import run_tension

    with bar(case.name, "mm") as on_progress:
        return run_tension(case, notch_mm, on_progress=on_progress)


def _table(test: Tension):
    from rich.table import Table

    from cutbench.run.tension import MEASURES

    notch = f", notch {test.notch_mm:g} mm" if test.notch_mm else ", whole"
    table = Table(title=f"{test.case.name}{notch}", title_justify="left")
    for head in ("number", "value", "unit", "meaning"):
        table.add_column(head)
    for key, (unit, meaning) in MEASURES.items():
        value = test.measures[key]
        table.add_row(key, "-" if value != value else f"{value:.4g}", unit, meaning)
    return table
