"""What following a path has found, in words, as a table and as JSON."""

from __future__ import annotations

import math

from cutbench.run.measures import measures
from cutbench.run.result import SNAP
from cutbench.run.snap_back import (
    MESH,
    MIN_JUMP_ELEMENTS,
    OPEN,
    PHYSICAL,
    STABLE,
    Jump,
    SnapBack,
    as_seen_by_advancing_blade,
)

#: Steady force and slope mean nothing here; these are measures of the transition.
TRANSITION = ("drop_rel", "onset_mm", "peak_N", "peak_mm")


def limit_rows(followed: SnapBack) -> list[dict[str, object]]:
    """Onset, peak and drop with less and less viscosity, and of the path, over one stretch of travel."""
    viscous = [SNAP, *(law.name for law in followed.case.model.all if law.regularises)]
    rows = []
    for text, result in (("as asked", followed.run), *followed.limit):
        spent = [result.curve[key][-1] for name in viscous if (key := f"work_{name}_mJ") in result.curve]
        rows.append((text, result.measures, str(result.outcome), float(sum(spent))))
    shape, p = as_seen_by_advancing_blade(followed), followed.case.p
    if shape["displacement_mm"].size > 2:
        found = measures(shape, window_mm=p.thickness, height_mm=p.height)
        rows.append(("path at rest", found, followed.stopped or "done", 0.0))
    return [
        {"what": text, "outcome": outcome, "to_viscosity_mJ": spent}
        | {key: found.get(key, math.nan) for key in TRANSITION}
        for text, found, outcome, spent in rows
    ]


def sentence(followed: SnapBack) -> str:
    """What was found, in words."""
    jump, h = followed.jump, followed.case.numerics.h_mm
    end_mm = float(followed.curve["displacement_mm"][-1])
    drop = followed.run.measures.get("drop_rel", math.nan)
    asked = (
        f"As asked, the force falls by {drop:.0%}." if math.isfinite(drop) else "As asked, nothing is cut."
    )
    if followed.verdict == STABLE:
        return (
            f"No jump: equilibrium at rest goes forward all the way to {end_mm:.2f} mm of travel. {asked}"
            " What falls, falls in a stable way."
        )
    if jump is None:
        return f"Open: the path ended at {end_mm:.2f} mm before it turned ({followed.stopped}). {asked}"
    end = "" if jump.landed else f", where the path ended ({followed.stopped})"
    signs = ""
    if math.isfinite(jump.softest_before) and math.isfinite(jump.softest_after):
        signs = (
            f"; the tangent's lowest eigenvalue goes from {jump.softest_before:.2g} to"
            f" {jump.softest_after:.2g} there"
        )
    what = (
        f"at {jump.travel_mm:.3f} mm equilibrium at rest turns back by {jump.back_mm:.2f} mm{signs}."
        f" The force jumps from {jump.force_N:.3g} to {jump.landing_N:.3g} N ({jump.drop_rel:.0%}){end},"
        f" the cut grows by {jump.advance_mm:.2f} mm ({jump.advance_mm / h:.1f} elements), and"
        f" {jump.freed_mJ:.3g} mJ are set free"
    )
    heads = {
        PHYSICAL: "The jump is physical: ",
        MESH: f"A jump of fewer than {MIN_JUMP_ELEMENTS:g} elements, which may be theirs (try a smaller h): ",
        OPEN: "Open: ",
    }
    parts = ""
    if jump.releases:
        parts = (
            f" No equilibrium was near at {jump.releases} place(s) of this stretch, and the body was let go:"
            f" {jump.released_mm:.2f} mm of the cut's growth, {jump.released_mJ:.2g} mJ."
        )
    return f"{heads[followed.verdict]}{what}.{parts} {asked}"


def describe_followed(followed: SnapBack) -> dict[str, object]:
    """The content of follow.json."""
    jump = followed.jump

    def plain(one: Jump) -> dict[str, object]:
        known = {k: v for k, v in vars(one).items() if k not in ("first", "last")}
        return known | {"drop_rel": one.drop_rel}

    return {
        "schema": 1,
        "verdict": followed.verdict,
        "text": sentence(followed),
        "case": followed.case.to_dict(),
        "jump": None if jump is None else plain(jump),
        "jumps": [plain(one) for one in followed.jumps],
        "limit": limit_rows(followed),
        "path": {
            "points": int(followed.curve["force_N"].size),
            "to_mm": float(followed.curve["displacement_mm"][-1]),
            "cut_length_mm": float(followed.curve["cut_length_mm"][-1]),
            "stopped": followed.stopped,
            "released_points": int((followed.curve["released"] > 0).sum()),
            "without": [m.name for m in followed.case.model.all if m.regularises],
        },
        "seconds": followed.seconds,
    }
