"""What a run leaves in its folder: run.json, curve.csv, fields for ParaView, pictures.

Every file appears whole or not at all; the folder is tried before the run, so that hours of
computing do not end at a write protection.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.base.figure_style import save
from cutbench.base.files import csv_text, file_digest, folder_lock, plain, write_json, write_text
from cutbench.base.threads import threads
from cutbench.run.paraview import write_fields
from cutbench.run.result import Result, ordered_columns
from cutbench.run.store.runs import keep_laws, record_of, result_of

#: How long a run waits for another process that writes into the same folder.
WAIT_S = 60.0

#: Pictures of fields; those of an earlier run in the same folder are taken away.
PICTURES = ("section.png", "solid.png", "solid.html", "cut_plane.png", "front.png", "plane_strain.png")


def write_run(
    result: Result, out_dir: str | Path, *, command: str | None = None, plane: Result | None = None
) -> dict[str, Path]:
    """Write everything about a run into a folder; the paths by name.

    Files of an earlier run in the same folder are replaced; numbers are written before pictures. ``command``
    is recorded as the line that the run came from, this process's unless it is said; ``plane`` is the
    plane-strain run that a block is drawn beside. Raises BadInput if the folder cannot be written to, or
    another process writes there for longer than ``WAIT_S`` seconds."""
    from cutbench.run.figures import plot_curve, plot_section
    from cutbench.run.figures.motion import save_frames
    from cutbench.run.figures.solid import save_solid

    with folder_lock(out_dir, WAIT_S) as out:
        paths = {"curve": out / "curve.csv", "run": out / "run.json"}
        write_curve(result.curve, paths["curve"])
        record = describe(result, command=command) | {"curve_sha256": file_digest(paths["curve"])}
        write_json(record, paths["run"])
        keep_laws(result, out)
        if result.sensitivities:
            paths["sensitivities"] = out / "sensitivities.csv"
            slopes = _slopes(result)
            write_curve(slopes, paths["sensitivities"], list(slopes))
        else:
            (out / "sensitivities.csv").unlink(missing_ok=True)
        paths |= write_fields(result.frames or result.snapshots, out, result.case)
        paths["curve_png"] = save(plot_curve(result), out / "curve.png")[0]
        pictured, pictures = replace(result, snapshots=result.snapshots or result.frames), {}
        if result.case.dim == 3:
            pictures = save_solid(pictured, out, plane)
        elif pictured.snapshots:
            pictures["section_png"] = save(plot_section(pictured), out / "section.png")[0]
        for name in PICTURES:
            if out / name not in pictures.values():
                (out / name).unlink(missing_ok=True)
        paths |= pictures | save_frames(result, out)
        record["files"] = sorted(str(path.relative_to(out)) for path in paths.values())
        write_json(record, paths["run"])
        return paths


def run_id(folder: Path) -> str:
    """Which run's results a folder has; empty where it has none."""
    try:
        return str(json.loads((folder / "run.json").read_text(encoding="utf-8"))["id"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def describe(result: Result, *, command: str | None = None) -> dict:
    """The content of run.json: all inputs with units, groups, outcome, measures, cost, versions, machine."""
    record = record_of(result)
    laws = {os.path.dirname(place) for law in record["laws"].values() for place in law["files"]}
    taken_up = "".join(
        f"from cutbench import use_mechanisms; use_mechanisms({place!r}); " for place in sorted(laws)
    )
    return {
        **record,
        "groups": plain(result.case.groups()),
        "said": result.sentence(),
        "platform": {
            "system": platform.platform(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
            "threads": threads(),
        },
        "reproduce": {
            "command": command or shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
            "folder": os.getcwd(),
            "python": f"{taken_up}from cutbench.run import read_run, run_case; run_case(read_run('.').case)",
        },
    }


def write_curve(curve: Mapping[str, np.ndarray], path: str | Path, names: Sequence[str] = ()) -> None:
    """Write ``curve`` as CSV, a row a step, every digit kept; ``names`` orders columns that are no run's."""
    names = names or ordered_columns(list(curve))
    columns = (map(repr, np.asarray(curve[name], dtype=float).tolist()) for name in names)
    write_text(csv_text(names, zip(*columns, strict=True)), path)


def _slopes(result: Result) -> dict[str, np.ndarray]:
    """Travel, and dF/dθ in N per unit of each parameter as a person writes it."""
    parameters = result.case.model.parameters()
    columns = {"displacement_mm": result.displacement_mm}
    for name, slope in result.sensitivities.items():
        q = parameters[name]
        unit = "" if q.unit == "1" else "_per_" + q.unit.replace("/", "_per_").replace("^", "")
        columns[f"dF_d{name}_N{unit}"] = slope * q.factor
    return columns


def read_curve(path: str | Path) -> dict[str, np.ndarray]:
    """Read the curve of a run from a curve.csv or a run's folder: columns (n,) by name, with the unit in the
    name. Raises BadInput, with file and line, for a file that is not there or is no curve."""
    path = Path(path)
    path = path / "curve.csv" if path.is_dir() else path
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(key="curve", value=str(path), expected="a readable curve.csv of a run") from error
    names = rows[0] if rows else []

    def wrong(line: int, key: str, value: str, expected: str) -> BadInput:
        return BadInput(file=str(path), line=line, key=key, value=value, expected=expected)

    for needed in ("displacement_mm", "force_N"):
        if needed not in names:
            raise wrong(1, "header", ",".join(names), f"a column '{needed}'")
    if len(set(names)) < len(names):
        raise wrong(1, "header", ",".join(names), "each column once")
    table = np.empty((len(rows) - 1, len(names)))
    for i, row in enumerate(rows[1:]):
        if len(row) != len(names):
            raise wrong(i + 2, "row", ",".join(row), f"{len(names)} numbers")
        for j, text in enumerate(row):
            try:
                table[i, j] = float(text)
            except ValueError as error:
                raise wrong(i + 2, names[j], text, "a number") from error
    return {name: table[:, j].copy() for j, name in enumerate(names)}


def read_run(out_dir: str | Path) -> Result:
    """Read a run as ``write_run`` left it, without its fields. Raises BadInput where the folder holds no
    run, run.json cannot be read, or curve.csv is of another run."""
    path = Path(out_dir) / "run.json"
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        curve = path.with_name("curve.csv")
        if record.get("curve_sha256", digest := file_digest(curve)) != digest:
            expected = "the curve that run.json was written with; this one was changed, or is of another run"
            raise BadInput(file=str(curve), key="sha256", value=digest[:12], expected=expected)
        return result_of(record, path, read_curve(out_dir))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BadInput(key="run", value=str(path), expected="the run.json that a run wrote") from error
