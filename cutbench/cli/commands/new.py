"""``cutbench new``: a commented file to start from."""

from __future__ import annotations

from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import exits


class Kind(StrEnum):
    """What can be begun."""

    RUN = "run"
    STUDY = "study"
    CAMPAIGN = "campaign"


@exits
def new(
    kind: Annotated[Kind, typer.Argument(help="run: one cut; study: a map; campaign: measured curves.")],
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.toml]", help="Where to write; default: KIND.toml.")
    ] = None,
) -> None:
    """Write a commented file that runs as it stands, to be changed."""
    from cutbench.base.errors import BadInput
    from cutbench.base.files import write_text

    target = file or Path(f"{kind.value}.toml")
    readings = target.with_name(f"{target.stem}-readings.csv")
    wanted = [target] + [readings] * (kind is Kind.CAMPAIGN)
    for path in wanted:
        if path.exists():
            raise BadInput("FILE.toml", str(path), "a file that is not there yet: nothing is written over")
    if target.suffix != ".toml" or not target.parent.is_dir():
        raise BadInput("FILE.toml", str(target), "a file ending in .toml, in a folder that is there")
    folder = resources.files("cutbench.cli").joinpath("templates")
    text = folder.joinpath(f"{kind.value}.toml").read_text(encoding="utf-8")
    write_text(text.replace("__FILE__", str(target)).replace("__STEM__", target.stem), target)
    if kind is Kind.CAMPAIGN:
        write_text(_readings(), readings)
    for path in wanted:
        typer.echo(path)
    typer.echo(
        text.splitlines()[0]
        .removeprefix("# ")
        .replace("__FILE__", str(target))
        .replace("__STEM__", target.stem)
    )


def _readings() -> str:
    """Three specimens that are pulled; invented, and stiffer at the end than neo-Hooke's law has it."""
    import numpy as np

    rng = np.random.default_rng(1)
    rows = ["specimen,t [s],u [mm],F [N]"]
    for specimen, own in enumerate((0.96, 1.0, 1.05), 1):
        for u in np.linspace(0.4, 32, 80):
            x = 1 + u / 40
            stress = 0.009 * (x - x**-2) * (1 + 0.12 * (x**2 + 2 / x - 3) ** 2)
            rows.append(
                f"{specimen},{u / 0.5:.2f},{u:.3f},{25 * own * stress + 5e-4 * rng.standard_normal():.5f}"
            )
    return "\n".join(rows)
