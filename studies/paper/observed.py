"""A run whose fields are looked at every tenth of a millimetre: what claims about pressure and stress need.

The fields themselves are not kept. Their largest values become columns of the curve, nan at steps between
two looks, so that a stored run holds all that a claim reads.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from cutbench.case.case import Case
from cutbench.run.result import Result, Snapshot
from studies.paper.base import NOTCH_MM

#: Travel between two looks at the fields, mm.
EVERY_MM = 0.1
#: Columns added to the curve.
COLUMNS = (
    "contact_peak_MPa",  # largest contact pressure, per reference area
    "contact_peak_above_tip_mm",  # how far above the blade's lowest point it acts, in the current state
    "contact_peak_depth_mm",  # how far below the block's top it acts, in the reference state
    "contact_behind_MPa",  # mean over cut material that lies above the blade's tip
    "von_mises_peak_MPa",  # largest on the nodes of the cut plane
    "widest_opening_mm",
    "damage_at_widest",
)


def observed_run(case: Case) -> Result:
    """``run_case`` with ``COLUMNS`` in its curve."""
    from cutbench.run.runner import run_case

    looks = np.arange(1, int(case.p.depth / EVERY_MM + 1e-9) + 1) * EVERY_MM
    result = run_case(case, snapshots_mm=[float(mm) for mm in looks])
    columns = {name: np.full(result.displacement_mm.shape, np.nan) for name in COLUMNS}
    for picture in result.snapshots:
        row = int(np.argmin(np.abs(result.displacement_mm - picture.displacement_mm)))
        for name, value in looked_at(picture, case).items():
            columns[name][row] = value
    result.curve |= columns
    result.snapshots.clear()
    return result


def looked_at(picture: Snapshot, case: Case) -> dict[str, float]:
    """The values of ``COLUMNS`` in one picture of the fields."""
    tool = case.model.tool
    assert tool is not None, "nothing presses without a blade"
    height, lowest = case.p.height, case.p.height - picture.displacement_mm
    faces = list(picture.faces.values())
    pressure = np.concatenate([face["contact_pressure_MPa"] for face in faces])
    X, x = (np.concatenate([face[key] for face in faces]) for key in ("X", "x"))
    top = int(np.argmax(pressure))
    touched = pressure[top] > 0
    cut = picture.faces["cut"]
    widest = int(np.argmax(cut["opening_mm"]))
    on_plane = np.abs(picture.points[:, 0]) < 1e-9 * height
    return {
        "contact_peak_MPa": float(pressure[top]),
        "contact_peak_above_tip_mm": float(x[top, 1] - lowest) if touched else np.nan,
        "contact_peak_depth_mm": float(height - X[top, 1]) if touched else np.nan,
        "contact_behind_MPa": _behind(cut, lowest + tool.height(case.p)),
        "von_mises_peak_MPa": float(picture.point_data["von_mises"][on_plane].max()),
        "widest_opening_mm": float(cut["opening_mm"][widest]),
        "damage_at_widest": float(cut["damage"][widest]),
    }


def _behind(cut: dict[str, np.ndarray], above: float) -> float:
    """Mean pressure, by reference length, on broken parts of the cut plane that lie above ``above``."""
    order = np.argsort(cut["X"][:, 1])
    y, pressure = cut["X"][order, 1], cut["contact_pressure_MPa"][order]
    there = (cut["x"][order, 1] > above) & (cut["damage"][order] > 0.5)
    if there.sum() < 2:
        return np.nan
    return float(np.trapezoid(pressure[there], y[there]) / np.ptp(y[there]))


def pulled(case: Case, notch_mm: float = 0.0) -> Result:
    """The strip ``case`` in tension as a result: the travel is its elongation."""
    from cutbench.run.tension import run_tension

    test = run_tension(case, notch_mm)
    curve = {"displacement_mm": test.curve["elongation_mm"]}
    curve |= {name: values for name, values in test.curve.items() if name != "elongation_mm"}
    return Result(case, curve, test.outcome, test.timings, test.counts, [], test.measures)


#: The same with a notch.
notched = partial(pulled, notch_mm=NOTCH_MM)
