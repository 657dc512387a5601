"""A run by formula with pictures and all: what is written and drawn of one, without a computation."""

from __future__ import annotations

import numpy as np
from skfem import MeshTri

from cutbench.run.result import Outcome, Result, Snapshot


def made_up_curve(n=600, depth=21.0, seed=1):
    """A curve with an elastic rise, a drop at 4.2 mm, then a linear rise; ledger exact, steps uneven."""
    rng = np.random.default_rng(seed)
    d = np.concatenate(([0.0], np.cumsum(rng.uniform(0.2, 1.8, n - 1))))
    d *= depth / d[-1]
    cut = np.clip((d - 4.2) / 0.9, 0, 1)
    length = np.where(d > 4.2, (d - 4.2) * 0.93 + 1.2 * cut, 0.0)
    stored = 0.06 * np.minimum(d, 4.2) ** 2.4 * (1 - 0.55 * cut) + 0.01 * np.maximum(d - 4.2, 0)
    work = {
        "neo_hookean": stored,
        "volumetric": 0.002 * stored,
        "smith_ferrante": 0.159 * length,
        "viscous_degraded": 0.19 * length,
        "contact": 0 * d,
        "coulomb": 0.001 * length,
        "adhesion": 0.024 * length**2,
        "snap": 0.5 * cut,
    }
    total = sum(work.values())
    forces = {m: np.gradient(w, d) + rng.normal(0, 0.02, n) for m, w in work.items()}
    curve = {"closure": np.full(n, 1e-4), "reaction_N": np.gradient(total, d), "displacement_mm": d,
             "force_N": np.gradient(total, d), "time_s": d / 0.021, "cut_length_mm": length}  # fmt: skip
    for m, value in work.items():
        curve[f"work_{m}_mJ"] = value
        curve[f"force_{m}_N"] = forces[m]
    return curve


def made_up_snapshot(travel=6.0, quadratic=True, W=30.0, H=21.0, a=0.35, b=1.05):
    """A half block that gives way to the blade: invented, but smooth and cut down to the tip."""
    x = 15 * np.linspace(0, 1, 19) ** 1.8
    mesh = MeshTri.init_tensor(x, np.linspace(0, H, 37))
    p, cells = mesh.p, mesh.t.T
    if quadratic:
        # scikit-fem numbers a triangle's facets 01, 12, 02: meshio's order of the midsides.
        p = np.column_stack([p, mesh.p[:, mesh.facets].mean(axis=1)])
        cells = np.column_stack([cells, mesh.t2f.T + mesh.nvertices])
    X, Y = p
    tip = H - travel
    above = np.clip((Y - tip) / b, 0, 1)
    push = a * np.sqrt(1 - (1 - above) ** 2) * np.exp(-X / 4)
    bulge = 0.3 * np.exp(-((X - 4) ** 2) / 12) * np.exp(-(((Y - H) / 5) ** 2)) * Y / H
    u = np.column_stack([push, bulge - 0.8 * above * np.exp(-X / 1.5) * 0.5, 0 * X])
    r = np.hypot(X, Y - tip)
    mises = 0.03 / (1 + (r / 1.5) ** 1.2)
    n = len(X)
    s = np.linspace(0.1, H - 0.1, 80)
    face = np.column_stack([0 * s, s, 0 * s])
    moved = face + np.column_stack(
        [a * np.sqrt(np.clip(1 - (1 - np.clip((s - tip) / b, 0, 1)) ** 2, 0, 1)), 0 * s, 0 * s]
    )
    cut = {"X": face, "x": moved, "opening_mm": 2 * (moved - face)[:, 0], "damage": (s > tip) * 1.0,
           "contact_pressure_MPa": 0.2 * np.exp(-((s - tip) ** 2)), "tangential_traction_MPa": 0.01 * face,
           "contact_state": (s > tip).astype(int), "touched": (s > tip).astype(int)}  # fmt: skip
    top = {key: value[:5] for key, value in cut.items() if key not in ("opening_mm", "damage")}
    return Snapshot(travel, np.column_stack([X, Y, 0 * X]), cells, "triangle6" if quadratic else "triangle",
                    {"displacement": u, "piola": np.arange(9.0) * np.ones((n, 9)), "cauchy": np.ones((n, 9)),
                     "von_mises": mises}, {"cut": cut, "top": top})  # fmt: skip


def made_up_result(case):
    return Result(
        case=case,
        curve=made_up_curve(),
        outcome=Outcome("done", "reached 21 mm.", "", 21.0),
        timings={"assembly": 1.25},
        counts={"steps": 600, "iterations": np.int64(1800)},
        snapshots=[made_up_snapshot(3.0), made_up_snapshot(6.0), made_up_snapshot(np.float64(12.0))],
        measures={"onset_mm": 4.2, "peak_mm": 4.18, "peak_N": 1.06, "drop_rel": np.nan},
    )
