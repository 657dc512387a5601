"""Regimes with a foundation: is equilibrium at rest lost at a limit point, and how fast is the front then?

The force's drop is what an experiment sees, but its threshold and its window are a choice. Behind it are two
questions. At rest, does the path of equilibria have a limit point, where the blade would have to turn back
for the cut to grow? And at the actual speed, how fast does viscosity let the front go there? So cutting is

- stable where there is no limit point at rest,
- held back by viscosity where there is one, but the front stays below ``SNAP_SPEED`` times the blade's speed,
- a snap where it is faster.

Rest is taken to be η v/δ_c = ``REST``: a front that jumps at rest is then as fast as a step of the travel
lets it be.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
import xarray as xr

from cutbench.case.case import Case
from cutbench.case.model import groups

#: The group that viscosity enters by, and its value at which a run counts as one at rest.
VISCOSITY, REST = "viscosity", 0.01
#: A front that is so many times as fast as the blade snaps.
SNAP_SPEED = 2.0

UNKNOWN, STABLE, HELD, SNAP = "unknown", "stable", "held_back", "snap"
#: Values of the variable ``kind``: position in this tuple.
KINDS = (UNKNOWN, STABLE, HELD, SNAP)
KIND = "kind"
#: In words.
KIND_WORDS = {STABLE: "stable", HELD: "held back by viscosity", SNAP: "snap", UNKNOWN: "not known"}
#: What a run at rest says, as variables of a map: of which measure, unit, meaning.
AT_REST = {
    "rest_front_speed": ("front_speed", "1", "front_speed of the run at rest"),
    "rest_freed_rel": ("freed_rel", "1", "freed_rel of the run at rest: what its limit point frees"),
}


def quasi_static_case(case: Case) -> Case:
    """``case`` with viscosity of ``REST``; as it is, where it has less or none."""
    if VISCOSITY not in case.model.settable_groups() or groups()[VISCOSITY].value(case.p) <= REST:
        return case
    return case.set(**{VISCOSITY: REST})


def kind(front_speed: float, rest_front_speed: float) -> str:
    """Which of ``KINDS`` a run is by the speed of its front and that of its run at rest; nan: not known."""
    if front_speed >= SNAP_SPEED:
        return SNAP
    if math.isnan(front_speed) or math.isnan(rest_front_speed):
        return UNKNOWN
    return HELD if rest_front_speed >= SNAP_SPEED else STABLE


def rest_variables(
    ids: np.ndarray, rest: Mapping[str, str], measures: Mapping[str, Mapping[str, float]]
) -> dict[str, tuple[np.ndarray, dict[str, object]]]:
    """What runs at rest add to a map with the run ``ids`` (any shape): arrays and what is said of them.

    ``rest`` is the run at rest of each run, ``measures`` are those of runs that have ended.
    """

    def of(runs: list[str], name: str) -> list[float]:
        return [measures.get(id, {}).get(name, math.nan) for id in runs]

    runs = [str(id) for id in ids.ravel()]
    stills = [rest.get(id, "") for id in runs]
    speeds = zip(of(runs, "front_speed"), of(stills, "front_speed"), strict=True)
    kinds = [KINDS.index(kind(*both)) for both in speeds]
    about = {
        "units": "1", "long_name": "limit point at rest, and the speed of the front",
        "flag_values": np.arange(len(KINDS), dtype=np.int8), "flag_meanings": " ".join(KINDS),
        "snap_speed": SNAP_SPEED, "rest": REST,
    }  # fmt: skip
    columns: dict[str, tuple[list, type, dict[str, object]]] = {
        **{
            name: (of(stills, measure), float, {"units": unit, "long_name": text})
            for name, (measure, unit, text) in AT_REST.items()
        },
        KIND: (kinds, np.int8, about),
        "rest_run_id": (stills, str, {"long_name": "the run at rest; its folder in the store"}),
    }
    return {
        name: (np.array(values, dtype=dtype).reshape(ids.shape), said)
        for name, (values, dtype, said) in columns.items()
    }


def kind_sentences(data: xr.Dataset) -> list[str]:
    """How many runs are of which kind, in a sentence; nothing of maps without runs at rest."""
    if KIND not in data:
        return []
    ids, kinds = data["run_id"].values.ravel(), data[KIND].values.ravel()
    _, first = np.unique(ids, return_index=True)
    counted = Counter(KINDS[kinds[i]] for i in first if ids[i])
    told = [f"{counted[name]} {text}" for name, text in KIND_WORDS.items() if counted[name]]
    return [f"by limit point at rest and speed of the front: {', '.join(told)}"] if told else []
