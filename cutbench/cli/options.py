"""What the commands share: options, exit status, progress, tables; no physics.

Exit status: 0 done, 1 the computation fell short (what it reached is kept), 2 bad input, 130
interrupted (what was reached is kept).
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cutbench.base.threads import leave_cores_to_workers, sharing, threads_of_a_run
from cutbench.cli.progress import bar
from cutbench.cli.terminal import loudness, show

if TYPE_CHECKING:
    from cutbench.base.progress import Pace
    from cutbench.case.case import Case
    from cutbench.case.group_ranges import UntypicalGroup
    from cutbench.run.result import Outcome, Result

#: What the command that runs holds until it ends.
_locks: ContextVar[ExitStack] = ContextVar("held")


def with_exit_status(command: Callable) -> Callable:
    """Turn what the code raises on purpose into one message and an exit status."""

    @functools.wraps(command)
    def wrapped(*args: object, **kwargs: object) -> object:
        from cutbench.base.errors import CutbenchError

        try:
            with ExitStack() as held:
                _locks.set(held)
                return command(*args, **kwargs)
        except CutbenchError as error:
            typer.echo(f"cutbench: {error}", err=True)
            raise typer.Exit(error.exit_code) from error
        except BrokenPipeError:
            raise  # whoever read has gone: nobody is there to be told
        except OSError as error:
            file = f"{error.filename}: " if error.filename else ""
            typer.echo(
                f"cutbench: {file}{error.strerror or error}; what was written until then stays", err=True
            )
            raise typer.Exit(1) from error
        except KeyboardInterrupt as error:
            typer.echo("cutbench: interrupted: start the same command again to go on", err=True)
            raise typer.Exit(130) from error

    return wrapped


Laws = Annotated[
    list[Path] | None,
    typer.Option("--mechanisms", metavar="DIR", help="A folder with laws of your own; may be repeated."),
]


Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say only what was found, and what is wrong.")]
Loud = Annotated[bool, typer.Option("--verbose", "-v", help="Show counters and the log, too.")]


def with_laws(command: Callable) -> Callable:
    """Give a command ``--mechanisms DIR``, the laws of the folder are known in all that it does; and ``-q``
    and ``-v``."""

    @functools.wraps(command)
    @with_exit_status
    def wrapped(
        *args: object,
        laws: list[Path] | None = None,
        quiet: bool = False,
        loud: bool = False,
        **kwargs: object,
    ) -> object:
        loudness(quiet, loud)
        if laws:
            from cutbench.mechanisms import use_mechanisms

            use_mechanisms(*laws)
        return command(*args, **kwargs)

    own = inspect.signature(command, eval_str=True).parameters.values()
    more = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, default, annotation in (
            ("laws", None, Laws),
            ("quiet", False, Quiet),
            ("loud", False, Loud),
        )
    ]
    return _with_signature(wrapped, [*own, *more])


def _with_signature(command: Callable, options: list[inspect.Parameter]) -> Callable:
    """A command with these options: typer reads them from the signature."""
    vars(command)["__signature__"] = inspect.Signature(options)
    command.__annotations__ = {each.name: each.annotation for each in options}
    return command


# The options of a run, the same for a section and for a block.
Source = Annotated[str, typer.Argument(metavar="MATERIAL|FILE.toml", help="A material or a case file.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a value: --set eta_reg='0.5 s'."),
]
Size = Annotated[str | None, typer.Option("--h", metavar="MM", help="Element size at the cut plane.")]
Depth = Annotated[str | None, typer.Option(metavar="MM", help="Blade travel.")]
Until = Annotated[
    str | None,
    typer.Option(metavar="depth|transition", help="Where it ends; transition: once that is known."),
]
Element = Annotated[str | None, typer.Option(metavar="P1|P2|P2P1", help="Finite element.")]
Normal = Annotated[
    str | None, typer.Option(metavar="tool|material", help="Direction of the contact pressure.")
]
Preset = Annotated[
    str | None,
    typer.Option(
        "--numerics",
        metavar="converged|fast|paper|tetrahedra",
        help="All numerical choices under one word; tetrahedra: of blocks.",
    ),
]
Quick = Annotated[bool, typer.Option("--quick", help="A first look: the same as --numerics fast.")]
Without = Annotated[
    list[str] | None, typer.Option(metavar="NAME", help="Leave a mechanism out; may be repeated.")
]
With = Annotated[
    list[str] | None,
    typer.Option("--with", metavar="NAME", help="Add a mechanism, or put it in place of its kind."),
]
Keep = Annotated[
    str | None,
    typer.Option(
        "--checkpoint",
        metavar="SECONDS",
        help="Keep the state every so many seconds (60); a run that was killed goes on from there.",
    ),
]
Out = Annotated[Path | None, typer.Option(metavar="DIR", help="Where to write; default: runs/NAME-ID.")]
CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="Tests and their readings.")]
FrameCount = Annotated[
    str | None,
    typer.Option(
        "--frames",
        metavar="N",
        help="The cut in motion: N pictures, an animation, ParaView's series.",
    ),
]
Workers = Annotated[
    str | None, typer.Option(metavar="N", help="Processes; default: one a core; 0: this one.")
]
Limit = Annotated[
    str | None,
    typer.Option(metavar="TIME", help="No longer than this, in s or with a unit: '10 min'; what is known then"
                 " is told."),
]  # fmt: skip
Threads = Annotated[
    str | None, typer.Option(metavar="N", help="Threads that share a run's work; default: one a core.")
]
ByAtlas = Annotated[
    bool, typer.Option("--estimate", help="Take cuts from the atlas: no run is computed, it is soon done.")
]
Refine = Annotated[
    bool, typer.Option(help="Measure the error of the computation on a finer mesh on the way.")
]


def changes(
    sets: list[str] | None, options: dict[str, str | None], with_: list[str] | None, without: list[str] | None
) -> dict[str, object]:
    """All that the options say, as ``Case.set`` takes it."""
    from cutbench.base.errors import BadInput
    from cutbench.case.values import parse_overrides

    changes = parse_overrides(sets or [])
    given = {key: value for key, value in options.items() if value is not None}
    for key in given:
        if key in changes:
            expected = f"either --{key} or --set {key}=..., not both"
            raise BadInput(f"--{key}", given[key], expected)
    lists = {key: names for key, names in (("with", with_), ("without", without)) if names}
    return {**changes, **given, **lists}


def print_doubts(*cases: Case) -> None:
    """Say once what there is to know before runs of these ``cases`` are believed; of each dimensionless group
    the case that is farthest off."""
    worst: dict[str, UntypicalGroup] = {}
    for one in (one for case in cases for one in case.far):
        if one.group not in worst or one.times > worst[one.group].times:
            worst[one.group] = one
    sentences = [each for case in cases for each in case.cautions]
    for sentence in dict.fromkeys([*sentences, *map(str, worst.values())]):
        typer.echo(f"cutbench: note: {sentence}", err=True)


def case_and_folder(
    material: str, changes: dict[str, object], out: Path | None, *, dim: int, under: str = "runs"
) -> tuple[Case, Path]:
    """The case and a folder that can be written to, by default one of its own ``under`` this name."""
    from cutbench.base.errors import BadInput
    from cutbench.case.case import load_case
    from cutbench.case.values import check_driven
    from cutbench.run.files import run_id

    case = load_case(material, changes, dim=dim)
    check_driven(case.model)
    print_doubts(case)
    folder = locked_folder(out if out is not None else Path(under) / f"{slug(case.name)}-{case.id}")
    if (before := run_id(folder)) not in ("", case.id):
        expected = f"another folder: this one has run {before}, which would be lost"
        raise BadInput("--out", str(folder), expected)
    return case, folder


def locked_folder(out: Path) -> Path:
    """The folder that a command writes to, made if need be and held until the command ends."""
    from cutbench.base.files import folder_lock

    return _locks.get().enter_context(folder_lock(out))


def share_work(threads: str | None) -> None:
    """Among so many threads until the command ends, by default one a core."""
    _locks.get().enter_context(sharing(whole_number("--threads", threads, 1) or threads_of_a_run()))


@dataclass(frozen=True)
class RunRequest:
    """What the options of a run ask for: a case, a folder to write to, seconds between checkpoints, how many
    frames."""

    case: Case
    folder: Path
    every_s: float
    frames: int


def run_options(*, dim: int) -> Callable[[Callable], Callable]:
    """Give the options of a run to a command that takes a ``RunRequest`` and options of its own."""

    def give(command: Callable) -> Callable:
        def wrapped(
            material: Source,
            sets: Sets = None,
            h: Size = None,
            depth: Depth = None,
            until: Until = None,
            element: Element = None,
            normal: Normal = None,
            numerics: Preset = None,
            quick: Quick = False,
            without: Without = None,
            with_: With = None,
            out: Out = None,
            checkpoint: Keep = None,
            frames: FrameCount = None,
            **own: object,
        ) -> None:
            if dim == 3:
                leave_cores_to_workers()
            from cutbench.base.errors import BadInput
            from cutbench.case import materials
            from cutbench.case.motion import TRANSITION
            from cutbench.run.fields import checked_frames

            every_s = seconds("--checkpoint", checkpoint, 60.0)
            count = checked_frames(frames)
            options = {"h": in_mm(h), "depth": in_mm(depth), "element": element, "normal": normal}
            if quick and numerics not in (None, "fast"):
                raise BadInput("--quick", numerics, "one of --quick and --numerics, not both")
            options |= {"numerics": "fast" if quick else numerics, "until": until}
            given = changes(sets, options, with_, without)
            if dim == 3 and material in materials.names():
                # What comes behind the transition takes most of a block's hours; a file says itself how far.
                given.setdefault("until", TRANSITION)
            case, folder = case_and_folder(material, given, out, dim=dim)
            command(RunRequest(case, folder, every_s, count), **own)

        shared = [*inspect.signature(wrapped, eval_str=True).parameters.values()][:-1]
        own = [*inspect.signature(command, eval_str=True).parameters.values()][1:]
        functools.update_wrapper(wrapped, command)
        return _with_signature(wrapped, [*shared, *own])

    return give


def run_with_progress(
    case: Case,
    folder: Path | None = None,
    every_s: float = 60.0,
    frames: int = 0,
    limit_s: float = math.inf,
    pace: Pace | None = None,
) -> Result:
    """Run ``case`` under a bar.

    With a ``folder`` fields and so many ``frames`` are kept, and the state every so many seconds: a run that
    was killed, or took longer than ``limit_s``, goes on from there.
    """
    from cutbench.base.progress import at_most
    from cutbench.run.checkpoint import NAME, Checkpoint
    from cutbench.run.cutting import usual_snapshots_mm
    from cutbench.run.runner import run_case  # the solver is loaded only once the input is known to be good

    keep = None if folder is None else Checkpoint(folder / NAME, case.id, every_s)
    with bar(case.name, "mm", pace=pace) as on_progress:
        at = [] if folder is None else usual_snapshots_mm(case)
        told = at_most(limit_s, on_progress)
        return run_case(case, on_progress=told, snapshots_mm=at, frames=frames or None, checkpoint=keep)


def finish(result: Result, folder: Path, plane: Result | None = None) -> None:
    """Write and show a run; leaves with the exit status that its outcome asks for.

    ``plane`` is the plane-strain run that a block is drawn beside.
    """
    from cutbench.cli.tables import result_table
    from cutbench.emulator.atlas import held_by_friction

    write_result(result, folder, plane)
    show(result_table(result))
    typer.echo(str(result.outcome))
    typer.echo(f"written to {folder}")
    typer.echo(result.sentence())
    uncut = result.outcome.done and math.isnan(result.measures.get("onset_mm", 0.0))
    if uncut and (held := held_by_friction(result.case)):
        typer.echo(held)
    exit_by_outcome(result.outcome)


def write_result(result: Result, folder: Path, plane: Result | None = None) -> None:
    """Write a run; its checkpoint goes where there is nothing to go on from."""
    from cutbench.run.checkpoint import NAME
    from cutbench.run.files import write_run

    write_run(result, folder, plane=plane)
    if result.outcome.kind != "interrupted":
        (folder / NAME).unlink(missing_ok=True)


def whole_number(key: str, text: str | None, least: int = 0) -> int | None:
    """A whole number of ``least`` or more. Raises BadInput, which names the value where typer would not."""
    from cutbench.base.errors import BadInput

    if text is None:
        return None
    if not text.strip().isdecimal() or int(text) < least:
        raise BadInput(key, text, f"a whole number, {least} or more")
    return int(text)


def seconds(key: str, text: str | None, default: float) -> float:
    """A time in s, bare or with its unit. Raises BadInput."""
    from cutbench.base.units import Parameter

    if text is None:
        return default
    return Parameter(key, "s", "t", "time", low=0).parse(_with_unit(text, "s"), key=key)


def in_mm(text: str | None) -> str | None:
    """``"0.4"`` -> ``"0.4 mm"``; anything else is left to be read, or refused, as a quantity."""
    return None if text is None else _with_unit(text, "mm")


def _with_unit(text: str, unit: str) -> str:
    with suppress(ValueError):
        return f"{float(text):.15g} {unit}"
    return text


def slug(name: str) -> str:
    """A name as folders and files may have it."""
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "case"


def exit_by_outcome(outcome: Outcome) -> None:
    """With the exit status that an outcome asks for; stays after one that is done."""
    if not outcome.done:
        raise typer.Exit(130 if outcome.kind == "interrupted" else 1)


def search_campaign(
    search: Callable[..., Any],
    report: ModuleType,
    campaign: Path,
    out: Path,
    workers: str | None,
    limit: str | None,
    **how: object,
) -> Any:
    """Search for what a campaign tells, under a bar; write it to ``out`` and print it as ``report`` does."""
    from cutbench.data.campaign import load_campaign

    loaded = load_campaign(campaign)
    count, limit_s = whole_number("workers", workers), seconds("--limit", limit, math.inf)
    folder = locked_folder(out)
    with bar(search.__name__) as on_progress:
        found = search(
            loaded, workers=count, on_progress=on_progress, store=folder / "runs", limit_s=limit_s, **how
        )
    paths = report.write(found, folder)
    typer.echo(report.summary(found))
    print_written(paths)
    return found


def print_written(paths: Sequence[Path]) -> None:
    typer.echo("written: " + ", ".join(map(str, paths)))
