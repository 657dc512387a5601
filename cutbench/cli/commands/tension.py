"""``cutbench tension``: a strip pulled until it tears."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cutbench.base.report import Table, number
from cutbench.cli.options import (
    Element,
    Out,
    Sets,
    Size,
    Source,
    With,
    Without,
    changes,
    exit_by_outcome,
    in_mm,
    locked_folder,
    with_exit_status,
)
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show


@with_exit_status
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
    from cutbench.case.case import load_case
    from cutbench.case.model import owners
    from cutbench.case.values import parameter_of
    from cutbench.run.figures.tension import save_tension
    from cutbench.run.tension import MEASURES, NOTCH, run_tension, strip_case

    asked = changes(sets, {"h": in_mm(h), "depth": in_mm(elongation), "element": element}, with_, without)
    model = {key: asked.pop(key) for key in ("with", "without") if key in asked}
    length = 0.0
    if notched or notch is not None:
        raw = f"{NOTCH.default} mm" if notch is None else in_mm(notch)
        length = NOTCH.parse(raw, key="--notch")
    # What a law of ``with`` needs and the material does not have is given beside it.
    own = {key: value for key, value in asked.items() if owners(parameter_of(key))}
    case = strip_case(load_case(material, model | own, dim=3), asked, notch_mm=length)
    name = f"{case.name}-tension" + ("-notched" if length else "")
    folder = locked_folder(out if out is not None else Path("runs") / f"{name}-{case.id}")
    with bar(case.name, "mm") as on_progress:
        test = run_tension(case, length, on_progress=on_progress)
    save_tension(test, folder)
    rows = [(key, number(test.measures[key], ".4g"), *about) for key, about in MEASURES.items()]
    said = f"{case.name}{f', notch {length:g} mm' if length else ', whole'}"
    show(Table(("number", "value", "unit", "meaning"), rows, said))
    typer.echo(str(test.outcome))
    typer.echo(f"written to {folder}")
    exit_by_outcome(test.outcome)
