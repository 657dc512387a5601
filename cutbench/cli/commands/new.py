"""``cutbench new``: a commented file to start from."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cutbench.cli.options import with_exit_status

_KINDS = "run: one cut; material: one of your own; study: a map; campaign: measured curves."


class Kind(StrEnum):
    """What can be begun."""

    RUN = "run"
    MATERIAL = "material"
    STUDY = "study"
    CAMPAIGN = "campaign"


@with_exit_status
def new(
    kind: Annotated[Kind, typer.Argument(help=_KINDS)],
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.toml]", help="Where to write; default: KIND.toml.")
    ] = None,
) -> None:
    """Write a commented file that runs as it stands, to be changed."""
    from cutbench.cli.from_template import write_template

    target = file or Path(f"{kind.value}.toml")
    readings = {target.with_name(f"{target.stem}-readings.csv"): _readings} if kind is Kind.CAMPAIGN else {}
    for line in write_template(kind.value, target, name=target.stem, beside=readings):
        typer.echo(line)


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
