"""``cutbench dic``: measured displacement fields beside a run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import (
    Out,
    Sets,
    Size,
    Source,
    With,
    Without,
    case_and_folder,
    changes,
    exit_by_outcome,
    in_mm,
    with_exit_status,
)
from cutbench.cli.progress import bar
from cutbench.cli.terminal import show


def _named(columns: str | None) -> dict[str, str | int] | None:
    """Columns by role, from x=X,y=Y,u=U,v=V; a number counts from 1."""
    from cutbench.base.errors import BadInput

    if columns is None:
        return None
    found: dict[str, str | int] = {}
    for part in columns.split(","):
        role, sign, name = (text.strip() for text in part.partition("="))
        if not sign or not name or role not in ("x", "y", "u", "v", "u_x", "u_y", "travel"):
            expected = "x, y, u, v and travel with their titles or numbers, such as x=X,y=Y,u=U,v=V"
            raise BadInput("--columns", part.strip(), expected)
        found[role] = int(name) if name.isdigit() else name
    return found


@with_exit_status
def dic(
    material: Source,
    fields: Annotated[
        Path, typer.Argument(metavar="FIELDS.csv", help="Columns x, y, u_x, u_y, or as --columns says.")
    ],
    sets: Sets = None,
    h: Size = None,
    without: Without = None,
    with_: With = None,
    reference: Annotated[
        bool | None,
        typer.Option("--reference/--deformed", help="x and y are positions before deformation, or after it."),
    ] = None,
    y_down: Annotated[bool, typer.Option("--y-down", help="y and u_y count downwards.")] = False,
    shift: Annotated[
        str, typer.Option(metavar="X,Y", help="mm added to x and y: 0, 0 is the blade's plane, the base.")
    ] = "0,0",
    at: Annotated[
        str | None,
        typer.Option("--travel", metavar="MM", help="Blade travel of a file that has no such column."),
    ] = None,
    columns: Annotated[
        str | None, typer.Option(metavar="x=X,y=Y,u=U,v=V", help="Titles or numbers of the columns.")
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(metavar="UNIT", help="Of the columns, where their titles have none, or a wrong one."),
    ] = None,
    valid: Annotated[
        str | None,
        typer.Option(
            metavar="'COLUMN >= NUMBER'",
            help="Points that were measured; default: by sigma or a correlation, if there is one. none: all.",
        ),
    ] = None,
    out: Out = None,
) -> None:
    """Compute a section up to measured displacement fields: relative errors, strains, pictures."""
    from cutbench.base.errors import BadInput
    from cutbench.base.files import csv_text, write_json, write_text
    from cutbench.base.units import parse_quantity
    from cutbench.cli.tables import field_points, field_table
    from cutbench.data.field_comparison import at_travel, compare
    from cutbench.data.fields import CONFIGURATIONS, read_fields
    from cutbench.data.figure import plot_dic
    from cutbench.run.figures import save
    from cutbench.run.runner import run_case

    parts = [in_mm(part.strip()) for part in shift.split(",")]
    if len(parts) != 2:
        raise BadInput("--shift", shift, "two lengths, such as --shift=-15,0")
    right, up = (parse_quantity(part, "mm", key="--shift") for part in parts)
    given = math.nan if at is None else parse_quantity(in_mm(at), "mm", key="--travel")
    measured = read_fields(
        fields, configuration=None if reference is None else CONFIGURATIONS[reference],
        y_down=y_down, shift_mm=(right, up),
        travel_mm=given, columns=_named(columns), valid=valid,
        units=None if unit is None else dict.fromkeys(("x", "y", "u_x", "u_y", "travel"), unit),
    )  # fmt: skip
    for note in dict.fromkeys(note for field in measured for note in (*field.notes, field.doubt) if note):
        typer.echo(f"note: {note}")
    for mm in (field.travel_mm for field in measured if not field.travel_mm > 0):
        value = "(missing)" if math.isnan(mm) else f"{mm:g} mm"
        expected = "blade travels above 0, as a column 'travel [mm]' or by --travel"
        raise BadInput("travel", value, expected, file=str(fields))
    options = {"h": in_mm(h), "depth": f"{measured[-1].travel_mm!r} mm", "until": "depth"}
    case, folder = case_and_folder(material, changes(sets, options, with_, without), out, dim=2)
    # One step before each field too: between the two the displacements are interpolated.
    step = case.sizes.step_mm
    wanted = sorted({max(f.travel_mm - back, 0.0) for f in measured for back in (step, 0.0)})
    with bar(case.name, "mm") as on_progress:
        result = run_case(case, on_progress=on_progress, snapshots_mm=wanted)
    computed = [(f, at_travel(result.snapshots, f.travel_mm)) for f in measured]
    found = [compare(f, s) for f, s in computed if s is not None]
    show(field_table(found, case.name))
    numbers = [{"travel_mm": c.measured.travel_mm, **c.numbers()} for c in found]
    typer.echo(write_text(csv_text(*field_points(found)), folder / "dic.csv"))
    typer.echo(write_json({"fields": numbers}, folder / "dic.json"))
    for c in found:
        typer.echo(save(plot_dic(c, case.name), folder / f"dic_{c.measured.travel_mm:.3f}mm.png")[0])
    if not result.outcome.done:
        typer.echo(str(result.outcome))
        exit_by_outcome(result.outcome)
