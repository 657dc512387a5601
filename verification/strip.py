"""The pure-shear strip just before its cut runs: what is spent at the tip is W(λ) H."""

from __future__ import annotations

from collections.abc import Iterator

from cutbench.mechanisms.base import Points
from verification._common import law, parameters
from verification._strip import process_zone, pulled, stretch_for, strip
from verification.base import Check, Reference

#: Elements at the front, and how far ahead of it they stay as small, over the process zone, 4 G G_c/σ_c².
FINE, RUN = 1 / 14, 0.3
#: Parts of G_c up to which the strip is pulled.
PARTS = (0.8, 0.95)


def compute() -> Iterator[Check]:
    for name in ("gelatin", "elastomer", "meat"):
        p = parameters(name)
        zone = process_zone(p)
        for part, spent in zip(PARTS, at_tip(p, FINE * zone, RUN * zone), strict=True):
            what = f"{name}: spent at the tip at λ = {stretch_for(part * p.G_c, p):.4f}"
            yield Check(what, "J/m^2", 1e3 * part * p.G_c, 1e3 * spent, 5e-3)


def at_tip(p, fine: float, run: float) -> Iterator[float]:
    """Work of separation per area at the tip of the cut, by the law's own account, at each of PARTS."""
    # A viscosity that does not count, for Newton's method to lean on where the front softens.
    body = strip(p, "P2", fine, run, viscosity=1e-5 * p.G)
    for u, states in pulled(body, PARTS):
        work = law("smith_ferrante").work(body.cut.jump(u), p, states["cohesion"], Points())
        yield float(work[body.cut.faces.X[1].argmax()])


REFERENCE = Reference(
    "strip",
    "A cut in a long strip in pure shear, H = 21 mm, at finite strain, before it runs.",
    "J = W(λ) H (Rivlin and Thomas 1953; Rice 1968), and J = ∫ T dδ at the tip of a cohesive zone",
    compute,
    laws=("neo_hookean", "smith_ferrante"),
    seconds=8.0,
)
