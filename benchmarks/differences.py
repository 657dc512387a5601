"""Central differences of a march, at the steps and on the mesh of another, to hold derivatives against."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cutbench.case.case import Case
from cutbench.run.build import Built, build
from cutbench.run.sensitivity import start_sensitivities
from cutbench.solver.march import Accepted, Given, Stalled


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
        follower = start_sensitivities(built, names) if names else None
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
