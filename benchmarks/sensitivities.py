"""Sensitivities of a run: how exact they are, and what they cost.

    python -m benchmarks.sensitivities --depth 6 --json FILE

For each material at the default numerics: a run with all parameters' derivatives, timed; and for each
parameter six runs beside it at the same steps and on the same mesh, each step from the state found there, for
central differences at three distances (with a sharper tolerance of Newton's method, so that they have digits
to compare). Near a snap only small differences stay on its branch, elsewhere only large ones have digits: at
each reading the nearer of the two neighbours that agree best is taken. Where even these differ by more than
half of what is to be shown, or end early, distances between are added. Readings at which a point's contact,
friction or damage switches within it, or no two differences agree to that, are counted, not compared. Where a
derivative is below a thousandth of its largest, its error is relative to that. Exit status 1 if an error
exceeds 1e-4, differences disagree at more than 1 % of the readings, the runs beside it end early, or a
parameter costs more than 15 % of the run, 2 for bad input.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.tools import facts
from cutbench.base.errors import BadInput
from cutbench.base.files import write_json
from cutbench.case.case import Case, load_case
from cutbench.run.build import Built, build
from cutbench.run.runner import run_case
from cutbench.run.sensitivity import Following
from cutbench.solver.march import Accepted, Given, Stalled

MATERIALS = ("gelatin", "elastomer")
NAMES = ("G", "nu", "G_c", "delta_c", "eta_reg", "thickness", "tip", "tau_W", "mu", "speed")
#: Changes that differences make where they make most, relative to the largest force; Newton's tolerance.
STEPS, TOLERANCE = (1e-5, 1e-6, 1e-7), 1e-11
#: Distances between, for parameters whose differences do not agree among themselves.
BETWEEN = (3e-6, 3e-7)
#: Part of a derivative's largest value below which errors are relative to that part.
FLOOR = 1e-3
#: Readings at which no two differences agree, as a part of all, at the most.
FEW = 0.01
WANTED_ERROR, WANTED_COST = 1e-4, 0.15


class Marched:
    """One march: forces (n,), derivatives (n, k), steps taken, and at each step all that can switch.

    ``lost`` and ``unresolved`` are those of its derivatives; ``stopped`` says why it ended early, if it did.
    """

    def __init__(
        self,
        case: Case,
        names: Sequence[str] = (),
        beside: Marched | None = None,
        steps: Sequence[float] | None = None,
    ):
        """``beside``: the march whose mesh and steps are taken; states are looked for near its own.
        ``steps``: their lengths in mm, where the march is not to choose them itself."""
        built = build(case, beside.geometry if beside else None)
        follower = Following(built, names).sensitivities if names else None
        given = None if steps is None else [Given(size) for size in steps]
        self.geometry, self.stopped = built.geometry, None
        self.steps, self.switches = [], []
        forces, slopes = [], []
        try:
            for step in built.march.steps(given=beside.steps if beside else given):
                forces.append(step.force)
                self.steps.append(step.given)
                self.switches.append(switches(built, step))
                if follower is not None:
                    slopes.append(follower.add(step))
        except Stalled as error:
            self.stopped = error.reason
        self.lost = None if follower is None else follower.lost
        self.unresolved = 0 if follower is None else follower.unresolved
        self.forces, self.slopes = np.array(forces), np.array(slopes)


def switches(built: Built, step: Accepted) -> np.ndarray:
    """Contact, Θ, sticking, loading and opening at every point, one after the other."""
    before, values = step.solves[-1][0], built.case.values
    mu, tau_W = (values.get(name, 0.0) for name in ("mu", "tau_W"))
    found = []
    for form in built.blades:
        old, new = before[form.name], step.states[form.name]
        strength = mu * old["pressure"] + tau_W * old["touched"]
        shear = np.sqrt((new["shear"] ** 2).sum(axis=0))
        found += [old["touched"] > 0, new["active"] > 0, shear < strength * (1 - 1e-9)]
    cut = "cohesion"
    found.append(step.states[cut]["delta_max"] > before[cut]["delta_max"])
    found.append(built.form(cut).jump(step.u)[0] > 0)
    return np.concatenate([np.ravel(f) for f in found])


def moved(case: Case, name: str, by: float) -> Case:
    """The case with another value to the last digit: a case itself keeps fourteen."""
    other = object.__new__(Case)
    vars(other).update({**vars(case), "values": {**case.values, name: case.values[name] + by}})
    vars(other).pop("id", None)
    return other


def differences(case: Case, name: str, middle: Marched, by: float) -> tuple[np.ndarray, np.ndarray]:
    """Central differences (n,) by a parameter, ``by`` each way, on the mesh and at the steps of ``middle``;
    and the readings (n,) at which nothing switches.

    Where one of the two marches ends early, n is smaller than in ``middle``.
    """
    plus, minus = (Marched(moved(case, name, sign * by), beside=middle) for sign in (1, -1))
    n = min(plus.forces.size, minus.forces.size)
    same = [
        np.array_equal(a, b) and np.array_equal(a, c)
        for a, b, c in zip(plus.switches[:n], minus.switches[:n], middle.switches[:n], strict=True)
    ]
    return (plus.forces[:n] - minus.forces[:n]) / (2 * by), np.array(same, dtype=bool)


def extrapolated(
    case: Case, name: str, middle: Marched, i: int, part: float = 1e-5, closer: float = 4.0, most: int = 4
) -> tuple[np.ndarray, np.ndarray]:
    """dF/dθ (n,) from central differences at two distances, and how far the two are apart (n,).

    θ = ``name`` is the ``i``-th that ``middle`` was differentiated by. The first distance moves the force by
    about ``part`` of its largest value; for as long as anything switches within it, it is ``closer`` times
    shorter, and the second is so once more: a point that switches bends all that follows. Raises ValueError
    where something switches within ``most`` distances, or a march does not get to the end.
    """
    by = part * np.abs(middle.forces).max() / np.abs(middle.slopes[:, i]).max()
    kept: list[np.ndarray] = []
    for k in range(most):
        values, same = differences(case, name, middle, by / closer**k)
        kept = [*kept, values] if same.all() and values.size == middle.forces.size else []
        if len(kept) == 2:
            far, near = kept
            return near + (near - far) / (closer**2 - 1), np.abs(near - far)
    raise ValueError(f"{name}: something switches within {by / closer ** (most - 1):g}")


def cost(case: Case, names: Sequence[str]) -> dict:
    """Seconds of a run with its derivatives, and their share a parameter of the run without them."""
    result = run_case(case, sensitivities=names)
    extra = result.timings["sensitivities"]
    alone = result.timings["total"] - extra
    return {
        "reached_mm": result.outcome.reached_mm,
        "steps": result.counts["steps"],
        "degrees_of_freedom": result.counts["degrees_of_freedom"],
        "run_s": alone,
        "sensitivities_s": extra,
        "part_per_parameter": extra / alone / len(names),
        "unresolved": result.counts["unresolved_sensitivities"],
    }


def relative(by: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """``by`` (n,) relative to ``expected`` (n,), or to ``FLOOR`` of its largest where it is smaller."""
    size = np.abs(expected)
    return np.abs(by) / np.maximum(size, FLOOR * size.max())


def settled(tried: Mapping[float, tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, ...]:
    """Of differences by distance: at each reading the nearer of the two neighbours that agree best (n,),
    whether nothing switches within it (n,), and how far the two are apart, relative (n,).

    Some may have ended early; n is how far two of them reach.
    """
    n = sorted(values.size for values, _ in tried.values())[-2]
    values, same = np.full((len(tried), n), np.nan), np.zeros((len(tried), n), dtype=bool)
    for k, step in enumerate(sorted(tried, reverse=True)):
        most = min(tried[step][0].size, n)
        values[k, :most], same[k, :most] = (part[:most] for part in tried[step])
    apart, at = np.abs(np.diff(values, axis=0)), np.arange(n)
    pair = np.where(np.isnan(apart), np.inf, apart).argmin(axis=0)
    found = values[pair + 1, at]
    return found, same[pair + 1, at], relative(apart[pair, at], found)


def errors(case: Case, names: Sequence[str]) -> dict[str, dict]:
    """By parameter: largest relative error over the readings, how many switch, and how much it matters."""
    exact = case.set(tolerance=TOLERANCE)
    middle = Marched(exact, names)
    found = {}
    for i, name in enumerate(names):
        most = np.abs(middle.forces).max() / np.abs(middle.slopes[:, i]).max()
        tried = {step: differences(exact, name, middle, float(step * most)) for step in STEPS}
        expected, same, doubt = settled(tried)
        if expected.size < middle.forces.size or not doubt[same].max() <= WANTED_ERROR / 2:
            tried |= {step: differences(exact, name, middle, float(step * most)) for step in BETWEEN}
            expected, same, doubt = settled(tried)
        n, size = expected.size, np.abs(expected).max()
        error = relative(middle.slopes[:n, i] - expected, expected)
        known = same & (doubt <= WANTED_ERROR / 2)
        found[name] = {
            "error": float(error[known].max()),
            "median_error": float(np.median(error[known])),
            "worst_reading": int(np.argmax(np.where(known, error, 0.0))),
            "unsettled": int((same & ~known).sum()),
            "readings": int(n),
            "switching": int((~same).sum()),
            "distances": len(tried),
            "largest_doubt": float(doubt[same].max()),
            "not_reached": int(middle.forces.size - n),
            "elasticity": float(size * abs(exact.values[name]) / np.abs(middle.forces).max()),
        }
        print(f"  {name:<10} error {found[name]['error']:.1e}, median {found[name]['median_error']:.1e},"
              f" {found[name]['switching']} of {n} readings switch,"
              f" at {found[name]['unsettled']} differences disagree", flush=True)  # fmt: skip
    return found


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.sensitivities", description=__doc__.split("\n")[0]
    )
    parser.add_argument("--material", action="append", choices=MATERIALS, help="default: both")
    parser.add_argument("--depth", type=float, default=6.0, metavar="MM")
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args(argv)
    try:
        cases = [load_case(m).set(depth=f"{asked.depth!r} mm") for m in asked.material or MATERIALS]
    except BadInput as error:
        parser.error(str(error))
    report, good = {"machine": facts(), "materials": {}}, True
    for case in cases:
        names = [name for name in NAMES if case.values.get(name)]
        paid = cost(case, names)
        print(
            f"{case.name}, {paid['reached_mm']:g} mm, {paid['steps']} steps: run {paid['run_s']:.1f} s,"
            f" {len(names)} derivatives {paid['sensitivities_s']:.1f} s:"
            f" {100 * paid['part_per_parameter']:.1f} % a parameter",
            flush=True,
        )
        by_name = errors(case, names)
        report["materials"][case.name] = {**paid, "parameters": by_name}
        good &= paid["part_per_parameter"] < WANTED_COST
        good &= all(
            e["error"] < WANTED_ERROR and e["not_reached"] == 0 and e["unsettled"] <= FEW * e["readings"]
            for e in by_name.values()
        )
        if asked.json is not None:
            write_json(report, asked.json)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
