"""A pre-cut holds nothing, and what lies below it takes its work of separation, no less and no more."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutbench.case.case import load_case
from cutbench.mechanisms.base import Points
from verification._common import finished, law, parameters
from verification._strip import BEHIND, H, process_zone, pulled, stretch_for, strip
from verification.base import Check, Reference

#: Elements at the strip's front and how far they stay as small, in process zones; part of G_c at the end.
FINE, RUN, PART = 1 / 20, 0.3, 0.9
#: A cut through the elastomer, whose process zone of 1.2 mm coarse elements resolve, and how deep it begins.
COARSE = {
    "without": "surface_gradient", "mu": 0, "tau_W": "0 kPa", "eta_reg": "0 s", "h": "0.6 mm",
    "corner": 0.0625, "shallow": 1, "around": 0, "step": "0.1 mm", "depth": "6 mm", "width": "16 mm",
    "height": "14 mm",
}  # fmt: skip
PRECUT, FROM = 3.0, 4.0


def compute() -> Iterator[Check]:
    yield from pulled_apart()
    yield from cut_on()


def pulled_apart() -> Iterator[Check]:
    """The long strip in pure shear, its plane held all along by the law, but for the pre-cut."""
    for name in ("gelatin", "meat"):
        p = parameters(name, precut=BEHIND * H)
        zone = process_zone(p)
        body = strip(p, "P2", FINE * zone, RUN * zone, viscosity=1e-5 * p.G, uncut=True)
        ((u, states),) = pulled(body, (PART,))
        state, y = states["cohesion"], body.cut.faces.X[1].ravel()
        ahead, jump = y <= body.front * (1 + 1e-12), body.cut.jump(u)
        work = law("smith_ferrante").work(jump, p, state, Points())
        at_tip = float(work[np.argmax(np.where(ahead, y, 0.0))])
        what = f"{name}: spent below the pre-cut at λ = {stretch_for(PART * p.G_c, p):.4f}"
        yield Check(what, "J/m^2", 1e3 * PART * p.G_c, 1e3 * at_tip, 5e-3)
        pull = state["tractions"].sum(axis=0)[0][~ahead]
        yield Check(f"{name}: largest traction in the pre-cut", "kPa", 0.0, 1e3 * np.abs(pull).max(), 1e-9)


def cut_on() -> Iterator[Check]:
    """A blade without friction on a specimen with a pre-cut: what the ledger books for the growth alone."""
    case = load_case("elastomer", {**COARSE, "precut": f"{PRECUT} mm"})
    curve, L = finished(case).curve, case.p.length
    length, spent = curve["cut_length_mm"], curve["work_stiff_cohesion_mJ"]
    first = int(np.argmax(curve["displacement_mm"] >= FROM))
    yield Check("length of the cut before the blade comes", "mm", PRECUT, float(length[0]), 0.02)
    per_length = float((spent[-1] - spent[first]) / (length[-1] - length[first]))
    yield Check("work of separation per length of its growth, G_c L", "N", case.p.G_c * L, per_length, 0.01)


REFERENCE = Reference(
    "precut",
    "A strip in pure shear and a blade's specimen, cut beforehand: energy below the pre-cut.",
    "J = W(λ) H (Rivlin and Thomas 1953; Rice 1968); energy balance of cutting",
    compute,
    laws=("smith_ferrante", "stiff_cohesion"),
    quick=False,
    seconds=15.0,
)
