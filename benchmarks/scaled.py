"""``python -m benchmarks.scaled --out FOLDER``: is a campaign's answer the same in every size?

Campaigns of ``benchmarks.blind`` with a cause of the reading, the rig, the bulk or the surface in them are
searched as they are, and with all forces, lengths and times in them scaled. Verdict and names must be equal,
and evidences to 0.2. Cuts are those of the atlas.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.blind_campaigns import Planned, make
from cutbench.base.units import dimensions_of
from cutbench.data.campaign import Campaign, load_campaign
from cutbench.data.experiment import Experiment
from cutbench.data.repetition import Repetition
from cutbench.discovery import Discovery, discover

#: What is asked: family, what is hidden, and how it is shown.
ASKED = (
    ("homogeneous", "van der Waals", ("formula", "several conditions")),
    ("homogeneous", "compliance", ("formula", "several conditions")),
    ("homogeneous", "drift", ("formula", "several conditions")),
    ("homogeneous", "adhesion_speed", ("sliding", "several conditions")),
    ("cut", "late zero", ("coarse", "ellipse")),
    ("mixed", "stiffening", ("coarse", "ellipse", "tension")),
)
#: By what forces, lengths and times are multiplied.
SCALES = ((0.01, 1, 1), (100, 1, 1), (1, 0.1, 1), (1, 10, 1), (1, 1, 0.1), (1, 1, 10))
SEED = 781130


def scaled(campaign: Campaign, force: float, length: float, time: float) -> Campaign:
    """``campaign`` as it is with other units of force, length and time."""

    def factor(unit: str) -> float:
        of_force, of_length, of_time = dimensions_of(unit)
        return force**of_force * length**of_length * time**of_time

    parameters = campaign.base.model.parameters()
    values = {n: v * factor(parameters[n].unit) for n, v in campaign.base.values.items()}

    def test(e: Experiment) -> Experiment:
        x_by, y_by = factor(e.x_unit), factor(e.y_unit)
        repetitions = tuple(
            Repetition(
                r.x * x_by, r.y * y_by, None if r.time_s is None else r.time_s * time, r.name,
                None if r.pressure_MPa is None else r.pressure_MPa * factor("MPa"),
            )
            for r in e.repetitions
        )  # fmt: skip
        sizes = {k: v * length ** (2 if k == "area" else 1) for k, v in e.specimen.items()}
        blade = {k: v * factor(parameters[k].unit) for k, v in e.blade.items()}
        speed = e.speed and e.speed * x_by / time
        return replace(
            e, repetitions=repetitions, specimen=sizes, blade=blade, speed=speed,
            pressure_MPa=e.pressure_MPa * factor("MPa"),
        )  # fmt: skip

    tests = tuple(test(e) for e in campaign.experiments)
    return replace(campaign, base=replace(campaign.base, values=values), experiments=tests)


def said(d: Discovery) -> tuple[str, tuple[str, ...], dict[str, float]]:
    """Verdict, names, and the evidence of all that was compared."""
    return d.verdict, d.names, {c.name: c.evidence for c in d.steps[0].compared} if d.steps else {}


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scaled", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="where the campaigns are written")
    args = parser.parse_args(argv)
    for number, (family, effect, how) in enumerate(ASKED):
        folder = args.out / str(number)
        truth = make(Planned(number, family, (effect,), how), SEED, folder, args.out / "truths")
        campaign = load_campaign(truth.file)
        by_atlas = family != "homogeneous"
        plain = said(discover(campaign, workers=0, by_atlas=by_atlas))
        print(f"{family}, {effect}: {plain[0]}, {', '.join(plain[1]) or 'nothing'}", flush=True)
        for scale in SCALES:
            other = said(discover(scaled(campaign, *scale), workers=0, by_atlas=by_atlas))
            shared = plain[2].keys() & other[2].keys()
            off = max((abs(plain[2][n] - other[2][n]) for n in shared), default=np.nan)
            same = "the same" if other[:2] == plain[:2] else f"OTHERWISE: {other[0]}, {', '.join(other[1])}"
            missing = plain[2].keys() ^ other[2].keys()
            print(
                f"    {scale}: {same}, evidences to {off:.2g}" + f" ({missing} in one)" * bool(missing),
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
