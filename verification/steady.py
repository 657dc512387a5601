"""Deep steady cutting: what a run's force comes to, and how it rises, once the start is forgotten."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutbench.case.case import load_case
from cutbench.run.result import Snapshot
from verification._common import blade_work, finished, rate
from verification.base import Check, Reference

#: The elastomer, whose process zone of 1.2 mm is resolved at this element size.
COARSE = {
    "without": "surface_gradient", "mu": 0, "h": "0.6 mm", "corner": 0.0625, "shallow": 1, "step": "0.1 mm",
    "depth": "13.5 mm",
}  # fmt: skip
#: Blade travel over which cutting is steady, mm: its start, the block's base and its end are far.
FROM, TO = 5.0, 13.0


def compute() -> Iterator[Check]:
    yield from free()
    yield from rubbing()
    for ratio in (1.0, 3.0):
        yield from slicing(ratio)
        yield from sliding(ratio)


def free() -> Iterator[Check]:
    """Without friction, adhesion and viscosity all that is spent is the work of separation."""
    case = load_case("elastomer", {**COARSE, "tau_W": "0 kPa", "eta_reg": "0 s"})
    curve, L = finished(case).curve, case.p.length

    def grows(values: np.ndarray) -> float:
        return rate(values, curve, FROM, TO)

    force, length = grows(blade_work(curve)), grows(curve["cut_length_mm"])
    stored = grows(curve["work_neo_hookean_mJ"] + curve["work_volumetric_mJ"])
    separation = grows(curve["work_stiff_cohesion_mJ"])
    what = "no friction, no viscosity: work of separation per length of the cut, G_c L"
    yield Check(what, "N", case.p.G_c * L, separation / length, 0.01)
    what = "mean force less the growth of stored energy, G_c L"
    yield Check(what, "N", case.p.G_c * L, force - stored, 0.02)
    yield Check("mean force, G_c L if nothing were stored", "N", case.p.G_c * L, force, 0.06)
    yield Check("length of the cut per travel", "1", 1.0, length, 0.02)


def rubbing() -> Iterator[Check]:
    """With adhesion the force rises with the faces that rub, two of them."""
    case = load_case("elastomer", {**COARSE, "tau_W": "8 kPa"})
    curve, expected = (
        finished(case).curve,
        2 * case.p.length * load_case("elastomer", {"tau_W": "8 kPa"}).p.tau_W,
    )
    d = curve["displacement_mm"]
    inside = (d >= FROM) & (d <= TO)
    work = curve["work_adhesion_mJ"]
    share = np.polyfit(d[inside], work[inside], 2)[0] * 2
    # The force's own ups and downs from element to element are taken out by its integral.
    slope = np.polyfit(d[inside], blade_work(curve)[inside], 2)[0] * 2
    yield Check("τ_W = 8 kPa: slope of the force of adhesion, 2 τ_W L", "N/mm", expected, share, 0.02)
    yield Check("slope of the force, 2 τ_W L", "N/mm", expected, slope, 0.05)


def slicing(ratio: float) -> Iterator[Check]:
    """A blade that slides along its edge, by adhesion alone: its force F_a is that of the faces that adhere,
    and has the direction of the blade's way."""
    case = load_case("elastomer", {**COARSE, "tau_W": "2 kPa", "eta_reg": "0 s", "slice_push": ratio})
    result = finished(case, snapshots_mm=list(np.arange(FROM, TO + 0.1, 0.2)))
    curve, p = result.curve, case.p
    push, along = (rate(blade_work(curve, name), curve, FROM, TO) for name in ("force_N", "force_along_N"))
    stored = rate(curve["work_neo_hookean_mJ"] + curve["work_volumetric_mJ"], curve, FROM, TO)
    drag = 2 * p.tau_W * p.length * float(np.mean([adhering(picture) for picture in result.snapshots]))
    separation, root = p.G_c * p.length, np.hypot(1, ratio)
    what = f"sliding by {ratio:g} along the edge"
    yield Check(f"{what}: G_c L + F_a/√(1 + ξ²)", "N", separation + drag / root, push - stored, 0.01)
    yield Check(f"{what}: along it, F_a ξ/√(1 + ξ²)", "N", drag * ratio / root, along, 0.01)


def sliding(ratio: float) -> Iterator[Check]:
    """The same by Coulomb friction alone: against the motion past the blade of a surface that moves, too, and
    integrated from pressures and displacements. A run's friction is by pressures that were foreseen from the
    last two steps, which are short beside the tip here: with 0.1 mm it is 9 % too large."""
    step, mu, deepest = 0.02, 0.1, 10.0
    changes = {"mu": mu, "tau_W": "0 kPa", "eta_reg": "0 s", "slice_push": ratio, "depth": f"{deepest} mm"}
    case = load_case("elastomer", {**COARSE, **changes, "step": f"{step} mm"})
    to = deepest - 0.5
    travels = np.arange(FROM, to, 0.2)
    result = finished(case, snapshots_mm=sorted([*travels, *(travels + 2 * step)]))
    curve, p = result.curve, case.p
    push, along = (rate(blade_work(curve, name), curve, FROM, to) for name in ("force_N", "force_along_N"))
    stored = rate(curve["work_neo_hookean_mJ"] + curve["work_volumetric_mJ"], curve, FROM, to)
    pairs = zip(result.snapshots[::2], result.snapshots[1::2], strict=True)
    drag, spent = 2 * p.length * mu * np.mean([rubbing_past(*pair, ratio) for pair in pairs], axis=0)
    what = f"sliding by {ratio:g} along the edge with μ = {mu:g}"
    yield Check(f"{what}: along it, ∫ μ t_N v_z/|v| dA", "N", drag, along, 0.01)
    expected = p.G_c * p.length + spent - ratio * drag
    yield Check(f"{what}: G_c L + ∫ μ t_N |v| dA less its part along", "N", expected, push - stored, 0.01)


def rubbing_past(before: Snapshot, after: Snapshot, ratio: float) -> tuple[float, float]:
    """∫ t_N v_z/|v| and ∫ t_N |v| over one face, by mm of its length, of its motion v past the blade by mm of
    the blade's way down."""
    one, other = before.faces["cut"], after.faces["cut"]
    travel = after.displacement_mm - before.displacement_mm
    v = (other["x"] - one["x"]) / travel - [0.0, -1.0, ratio]
    speed = np.linalg.norm(v, axis=1)
    # Of Lobatto's five points on an edge.
    height = one["X"][:, 1].reshape(5, -1)
    low, high = height.min(axis=0), height.max(axis=0)
    place = np.abs(2 * height - low - high) / (high - low)
    weight = np.where(place > 0.9, 1 / 10, np.where(place > 0.3, 49 / 90, 32 / 45)) * (high - low) / 2
    pressed = weight.ravel() * (one["contact_pressure_MPa"] + other["contact_pressure_MPa"]) / 2
    return float(pressed @ (-v[:, 2] / speed)), float(pressed @ speed)


def adhering(picture: Snapshot) -> float:
    """Length of one face, mm, before loading, that touches the blade."""
    face = picture.faces["cut"]
    order = np.argsort(face["X"][:, 1])
    on = face["contact_state"][order] + 0.0
    return float(np.diff(face["X"][order, 1]) @ (on[1:] + on[:-1]) / 2)


REFERENCE = Reference(
    "steady",
    "Elastomer cut 13 mm deep in plane strain: steady force without friction, slope with adhesion, and both"
    " along the edge.",
    "energy balance of steady cutting, F = G_c L + 2 τ_W L × depth, and its part along the edge; friction by"
    " direct integration",
    compute,
    laws=("stiff_cohesion", "adhesion", "coulomb"),
    quick=False,
    seconds=115.0,
)
