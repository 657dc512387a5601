"""The command line: parse, call, show, exit code; no physics.

Exit status: 0 done, 1 the computation fell short (what it reached is kept), 2 bad input, 130
interrupted (what was reached is kept).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cutbench import __version__

if TYPE_CHECKING:
    from cutbench.case import Case
    from cutbench.result import Result

app = typer.Typer(
    name="cutbench",
    help="A workbench for cutting soft solids with a blade.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

#: Blade travel of the pictures of the section, in parts of the whole.
_SNAPSHOTS = (0.25, 0.5, 0.75, 1.0)
#: More of them in a block: the front runs sideways within a short travel.
_SNAPSHOTS_3D = tuple(i / 12 for i in range(1, 13))


def _exits(command: Callable) -> Callable:
    """Turn what the code raises on purpose into one message and an exit status."""

    @functools.wraps(command)
    def wrapped(*args: object, **kwargs: object) -> object:
        from cutbench.errors import CutbenchError

        try:
            return command(*args, **kwargs)
        except CutbenchError as error:
            typer.echo(f"cutbench: {error}", err=True)
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt as error:
            typer.echo("cutbench: interrupted", err=True)
            raise typer.Exit(130) from error

    return wrapped


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


# The options of a run, the same for a section and for a block.
_Source = Annotated[str, typer.Argument(metavar="MATERIAL|FILE.toml", help="A material or a case file.")]
_Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a value: --set eta_reg='0.5 s'."),
]
_Size = Annotated[str | None, typer.Option("--h", metavar="MM", help="Element size at the cut plane.")]
_Depth = Annotated[str | None, typer.Option(metavar="MM", help="Blade travel.")]
_Element = Annotated[str | None, typer.Option(metavar="P1|P2|P2P1", help="Finite element.")]
_Normal = Annotated[
    str | None, typer.Option(metavar="tool|material", help="Direction of the contact pressure.")
]
_Without = Annotated[
    list[str] | None, typer.Option(metavar="NAME", help="Leave a mechanism out; may be repeated.")
]
_With = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="NAME", help="Add a mechanism, or put it in place of its kind."),
]
_Out = Annotated[Path | None, typer.Option(metavar="DIR", help="Where to write; default: runs/NAME-ID.")]


@app.command()
@_exits
def run2d(
    material: _Source,
    sets: _Sets = None,
    h: _Size = None,
    depth: _Depth = None,
    element: _Element = None,
    normal: _Normal = None,
    without: _Without = None,
    with_: _With = None,
    out: _Out = None,
) -> None:
    """Cut a block in plane strain: force curve, energy by mechanism, fields, pictures."""
    options = {"h": _in_mm(h), "depth": _in_mm(depth), "element": element, "normal": normal}
    case, folder = _asked(material, _changes(sets, options, with_, without), out, dim=2)
    result = _computed(case, _SNAPSHOTS)
    _finish(result, folder)


@app.command()
@_exits
def run3d(
    material: _Source,
    sets: _Sets = None,
    h: _Size = None,
    depth: _Depth = None,
    element: _Element = None,
    normal: _Normal = None,
    without: _Without = None,
    with_: _With = None,
    out: _Out = None,
    plane_strain: Annotated[
        bool, typer.Option(help="Compute the same case in plane strain too, for the end effect.")
    ] = True,
) -> None:
    """Cut a block in three dimensions: as run2d, with the front of the cut along the blade."""
    options = {"h": _in_mm(h), "depth": _in_mm(depth), "element": element, "normal": normal}
    case, folder = _asked(material, _changes(sets, options, with_, without), out, dim=3)
    result = _computed(case, _SNAPSHOTS_3D)
    plane = None
    if plane_strain and result.outcome.kind != "interrupted":
        from cutbench.front import end_effect

        plane = _computed(_flat(case, result.outcome.reached_mm))
        result.measures |= end_effect(result.measures, plane.measures)
    from cutbench.plots.solid import save_solid

    save_solid(result, folder, plane)
    _finish(result, folder)


@app.command()
@_exits
def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="The axes and the base of the map.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where the map and its runs are written.")],
    workers: Annotated[
        str | None, typer.Option(metavar="N", help="Processes; default: one a core.", show_default=False)
    ] = None,
    retry_failed: Annotated[bool, typer.Option(help="Compute again what fell short before.")] = False,
) -> None:
    """Compute a map; what is finished is never computed twice, so start it again to go on."""
    from cutbench.output import check_writable
    from cutbench.study import load_study
    from cutbench.sweep import run_study

    plan, processes = load_study(study), _whole("--workers", workers)
    check_writable(out)
    done = run_study(plan, out, workers=processes, progress=True, retry_failed=retry_failed)
    status = done.status
    typer.echo(f"{status.finished} of {status.total} runs, {status.failed} not to the end; map in {done.out}")
    if done.interrupted:
        typer.echo("interrupted: start the same command again to go on", err=True)
        raise typer.Exit(130)


@app.command()
@_exits
def plot(
    source: Annotated[
        Path, typer.Argument(metavar="DIR|MAP.nc", help="Folder of a run or a sweep, or a map.")
    ],
) -> None:
    """Draw the pictures of a run or a map again."""
    from cutbench.errors import BadInput

    grid = source / "map.nc" if source.is_dir() else source
    if source.is_dir() and (source / "run.json").is_file():
        from cutbench.output import read_run
        from cutbench.plots import plot_curve, save

        paths = save(plot_curve(read_run(source)), source / "curve.png")
    elif grid.is_file():
        from cutbench.maps import load_map
        from cutbench.phase import save_phase

        paths = save_phase(load_map(grid), grid.parent)
    else:
        raise BadInput(
            key="DIR|MAP.nc",
            value=str(source),
            expected="a folder with run.json or map.nc in it, or a map.nc",
        )
    for path in paths:
        typer.echo(path)


@app.command()
@_exits
def materials(
    name: Annotated[str | None, typer.Argument(metavar="[NAME|FILE.toml]", help="Show one in full.")] = None,
) -> None:
    """List the known materials with their dimensionless groups, or show one with its sources."""
    from cutbench.show import material, material_table

    _print(material_table() if name is None else material(name))


@app.command()
@_exits
def mechanisms(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Show all about one.")] = None,
) -> None:
    """List the known mechanisms with parameters, units and groups, or show one with its source."""
    from cutbench.show import mechanism, mechanism_table

    _print(mechanism_table() if name is None else mechanism(name))


def main() -> None:
    """Entry point of the ``cutbench`` command."""
    app()


def _changes(
    sets: list[str] | None, options: dict[str, str | None], with_: list[str] | None, without: list[str] | None
) -> dict[str, object]:
    """All that the options say, as ``Case.set`` takes it."""
    from cutbench.case import parse_overrides
    from cutbench.errors import BadInput

    changes = parse_overrides(sets or [])
    for key, value in options.items():
        if value is None:
            continue
        if key in changes:
            raise BadInput(
                key=f"--{key}", value=value, expected=f"either --{key} or --set {key}=..., not both"
            )
        changes[key] = value
    for key, names in (("with", with_), ("without", without)):
        if names:
            changes[key] = names
    return changes


def _asked(material: str, changes: dict[str, object], out: Path | None, *, dim: int) -> tuple[Case, Path]:
    """The case and a folder that can be written to."""
    from cutbench.case import load_case
    from cutbench.output import check_writable

    case = load_case(material, changes, dim=dim)
    return case, check_writable(out if out is not None else Path("runs") / f"{_slug(case.name)}-{case.id}")


def _computed(case: Case, snapshots: Sequence[float] = ()) -> Result:
    """Run ``case`` under a bar; fields are kept at these parts of the travel."""
    from cutbench.run import run_case  # the solver is loaded only once the input is known to be good

    with _travel(case) as on_step:
        return run_case(case, on_step=on_step, snapshots_mm=[part * case.p.depth for part in snapshots])


def _flat(case: Case, depth_mm: float) -> Case:
    """The same case in plane strain, as far as the block came."""
    values = {**case.values, "depth": depth_mm}
    numerics = replace(case.numerics, symmetry="auto", mesh=None)
    return replace(case, name=f"{case.name} (plane strain)", dim=2, values=values, numerics=numerics)


def _finish(result: Result, folder: Path) -> None:
    """Write and show a run; leaves with the exit status that its outcome asks for."""
    from cutbench.output import write_run

    write_run(result, folder)
    _show_result(result, folder)
    if not result.outcome.done:
        raise typer.Exit(130 if result.outcome.kind == "interrupted" else 1)


def _whole(key: str, text: str | None) -> int | None:
    """A whole number of 0 or more. Raises BadInput, which names the value where typer would not."""
    from cutbench.errors import BadInput

    if text is None:
        return None
    if not text.strip().isdecimal():
        raise BadInput(key=key, value=text, expected="a whole number, 0 or more")
    return int(text)


def _in_mm(text: str | None) -> str | None:
    """``"0.4"`` -> ``"0.4 mm"``; anything else is left to be read, or refused, as a quantity."""
    if text is None:
        return None
    try:
        return f"{float(text):.15g} mm"
    except ValueError:
        return text


def _slug(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "case"


def _print(*parts: object) -> None:
    from rich.console import Console

    console = Console()
    # Away from a terminal nobody can widen the window: do not cut numbers short.
    if not console.is_terminal:
        console = Console(width=160)
    for part in parts:
        console.print(part)


@contextmanager
def _travel(case: Case) -> Iterator[Callable[[float, dict], None]]:
    """A bar of the blade's travel with the time left, on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("[bold]{task.description}"), BarColumn(),
        TextColumn("{task.completed:.2f} of {task.total:g} mm  {task.fields[force]}"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(case.name, total=case.p.depth, force="")

        def on_step(displacement_mm: float, row: dict) -> None:
            force = row.get("force_N")
            bar.update(task, completed=displacement_mm, force="" if force is None else f"{force:.3g} N")

        yield on_step


def _show_result(result: Result, folder: Path) -> None:
    from cutbench.show import result_table

    _print(result_table(result))
    typer.echo(str(result.outcome))
    typer.echo(f"written to {folder}")
