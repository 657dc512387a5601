"""Where cuts agree best, by a look around and by what is foreseen from it.

A first look computes cuts at places far apart. From these, works and forces are foreseen anywhere between
(see ``memory``), and minimised from many starts at no cost: first where works agree, then where forces are
likeliest. What is found is computed, known from then on, and foreseen again, until no more is to be gained
than what was foreseen is off by. A valley near the start need not hide a better one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import optimize
from scipy.stats import qmc

from cutbench.base.errors import ComputationFailed
from cutbench.base.progress import OnProgress, silent
from cutbench.calibration import by_work, lm, secant
from cutbench.calibration.emulated import Emulated, Foreseeing
from cutbench.calibration.identifiability import Unknown
from cutbench.calibration.inverse import Inverse
from cutbench.calibration.likely import both, expected, likely, unsure
from cutbench.calibration.prediction import Task
from cutbench.data.covariance import Covariance
from cutbench.data.discrepancy import allowing

#: Places of each test in the first look (with 14 a toughness of each cut's own was foreseen at a third of
#: what it explained), and how far they lie in q: so far that works change by this part, between two lengths.
PLACES, CHANGE, NEAREST, FARTHEST = 14, 0.2, 0.5, 2.0
#: Starts of a search among what is foreseen, by works and by forces, beside the best that are known; how far
#: beyond these it goes; so many, the best, are gone on from. A rig goes as far as changes the works by this
#: part: what it makes of a run is no guess.
STARTS, FEW, KNOWN, BEYOND, RIGGED = 24, 8, 3, 0.7, 0.5
BEST = 6
FORESEEN = lm.Settings(promise=0.5, evaluations=40, failures=2)
#: Computed at the most, by likelihood; in vain, before it ends.
LIKELIEST, VAIN = 6, 2
#: In q: what moves no farther is the same place.
CLOSE = 0.01
#: What is foreseen to be so many times as bad as the best may be better.
UNSURE = 2.0
#: Works agree with χ² a value, in their noise of 2 %: half of it.
ENOUGH = 0.25
#: Less in χ² of forces is noise. What is foreseen to gain less is computed only as far as what is foreseen
#: may be off: by this at first, then by as much as the last was.
GAINS, ERRS = 4.0, 30.0


def nearby(inverse: Inverse, q: np.ndarray, on_progress: OnProgress = silent) -> by_work.Nearby:
    """Where the works agree best, from ``q`` on, where ``inverse`` has been computed; by its derivatives
    where nothing can be foreseen.

    Raises ComputationFailed if it cannot be computed.
    """
    survey = Survey(inverse, [q])
    try:
        if survey.look(on_progress):
            return survey.stepped(on_progress)
    except KeyboardInterrupt:
        return survey.nearby(interrupted=True)
    return by_work.nearby(inverse, q, on_progress)


def _away(u: Unknown, q: float, far: float) -> float:
    """So ``far`` from ``q``, by a factor where values are positive: powers of e as in a logarithm."""
    value = u.value(q)
    there = u.q(value * np.exp(far)) if value > 0 and (u.quantity.low or 0) >= 0 else q + far
    return float(np.clip(there, *u.reach))


def _ends(
    residual: lm.Residual, starts: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray
) -> list[lm.Minimum]:
    """Minima within ``low`` and ``high`` (k,) from the best of ``starts``; from others they are the same."""
    begun = [(q, residual(q)) for q in (np.clip(q, low, high) for q in starts)]
    begun.sort(key=lambda each: float(each[1][0] @ each[1][0]))
    found = [lm.minimise(residual, q, low, high, FORESEEN, first=first) for q, first in begun[:BEST]]
    return sorted(found, key=lambda end: end.chi2)


class Survey:
    """Of ``inverse`` from ``starts`` (k,) on."""

    def __init__(self, inverse: Inverse, starts: Sequence[np.ndarray]):
        self.inverse, self.starts, self.evaluations = inverse, [*starts], 0
        self.problem = Emulated(inverse)
        #: χ² of the works, and where.
        self.known: list[tuple[float, np.ndarray]] = []
        self.low, self.high = self.problem.hull(starts)
        self._open()
        #: Where places are looked for.
        self.within = inverse.bounds

    def _open(self) -> None:
        """Let rigs go as far as they change works much."""
        rigged = np.array([u.name in self.problem.rig for u in self.inverse.unknowns])
        if not (rigged.any() and self.problem.able):
            return
        q = self.starts[0]
        J = by_work.difference(Foreseeing(self.inverse), q)[1][:, rigged]
        far = RIGGED / np.maximum(by_work.NOISE * np.sqrt(np.mean(J**2, axis=0)), 1e-3)
        low, high = (bound[rigged] for bound in self.inverse.bounds)
        self.low[rigged] = np.clip(np.minimum(self.low[rigged], q[rigged] - far), low, high)
        self.high[rigged] = np.clip(np.maximum(self.high[rigged], q[rigged] + far), low, high)

    @property
    def free(self) -> np.ndarray:
        """Which unknowns (k,) tell more than the scale of all forces, which needs no run."""
        return np.array([u.name not in self.problem.proportional for u in self.inverse.unknowns])

    def nearby(self, interrupted: bool = False) -> by_work.Nearby:
        """The best place that is known, which the problem itself knows from then on."""
        q = min(self.known, key=lambda each: each[0])[1] if self.known else self.starts[0]
        if self.known:
            self.inverse.know(q, self.problem.predictions(q))
        return by_work.Nearby(q, self.problem, self.evaluations, interrupted)

    def look(self, on_progress: OnProgress = silent) -> bool:
        """Compute cuts around the first start; whether others can be foreseen from them."""
        if not self.problem.emulable:
            return False
        q = self.starts[0]
        r, J = by_work.difference(self.inverse, q)
        self.known.append((float(r @ r), q))
        size = by_work.NOISE * np.sqrt(np.mean(J**2, axis=0))
        reach = np.clip(CHANGE / np.maximum(size, 1e-300), NEAREST, FARTHEST)
        reach[~self.free] = 0.0
        on_progress(0, PLACES, "looking around")
        self.around(q, reach, PLACES)
        return self.problem.able

    def around(self, q: np.ndarray, reach: np.ndarray, places: int, longest: int | None = None) -> int:
        """Compute so many ``places`` of each test, no farther from ``q`` than ``reach`` (k,), as far as they
        can be, in ``longest`` steps at the most, to foresee others; how many were. Each test elsewhere: what
        one of them tells counts for all."""

        def there(ways: np.ndarray) -> np.ndarray:
            each = zip(self.inverse.unknowns, q, ways * reach, strict=True)
            return np.array([_away(u, x, far) for u, x, far in each])

        self.low, self.high = there(-np.ones(q.size)), there(np.ones(q.size))
        train, tasks = self.inverse.campaign.train, []
        # One test after the other: every third of a sequence in base 3 has one of its coordinates in common.
        each = [e for e in train for _ in range(places)]
        for e, part in zip(each, self._parts(places * len(train)), strict=True):
            with suppress(ComputationFailed):
                case = self.inverse.checked_case(e, there(2 * part - 1))
                tasks.append(Task(e, case, self.inverse.grids[e.id], longest=longest))
        found = secant.tried(self.inverse, tasks)
        self.evaluations += places
        return sum(p is not None for p in found)

    def stepped(self, on_progress: OnProgress = silent) -> by_work.Nearby:
        """Compute where works are foreseen to agree best, unless they agree where they are known."""
        best, _ = min(self.known, key=lambda each: each[0])
        on_progress(self.evaluations, np.nan, f"χ² {best:.5g}")
        there = None if best <= self.agreeing else self._unknown()
        if there is not None:
            self.evaluations += 1
            with suppress(ComputationFailed):
                r, _ = by_work.difference(self.problem, there)
                self.known.append((float(r @ r), there))
        return self.nearby()

    def minimum(
        self, w: Covariance, q: np.ndarray, settings: lm.Settings, on_progress: OnProgress = silent
    ) -> lm.Minimum:
        """Where forces agree best, near where the data are likeliest or there if that leads astray, from a
        ``q`` on that is known; the problem itself knows it from then on."""
        forces, none = partial(self.problem.whitened, covariance=w), replace(settings, evaluations=0)
        interrupted = False
        try:
            q = self.likeliest(w.noise, q, on_progress)
        except KeyboardInterrupt:
            settings, interrupted = none, True
        low, high = self.inverse.bounds
        before = self.evaluations

        def told(done: float, total: float, text: str) -> None:
            on_progress(before + done, total, text)

        best = lm.minimise(forces, q, low, high, settings, told, first=forces(q))
        self.evaluations += best.evaluations
        if likely(self.problem, w.noise, best.q) < likely(self.problem, w.noise, q) - GAINS:
            there = lm.minimise(forces, q, low, high, none, first=forces(q))
            best = replace(there, converged=best.converged, message=best.message, history=best.history)
        if interrupted:
            best.message = lm.INTERRUPTED
        self.inverse.know(best.q, self.problem.predictions(best.q))
        return best

    def likeliest(
        self,
        noise: Covariance,
        q: np.ndarray,
        on_progress: OnProgress = silent,
        least: float = -np.inf,
        hopeful: Callable[[float, float], bool] = lambda best, promised: True,
    ) -> np.ndarray:
        """Where of all that is computed from ``q`` on the data are likeliest in ``noise``, see ``likely``.
        What is to be had without, ``least``, is looked for twice as long, and through as many failures; what
        is not ``hopeful``, of the best and what is promised, ends it, too."""
        known, failed, error = [(likely(self.problem, noise, q), q)], 0, ERRS
        for step in range(2 * LIKELIEST):
            best, here = max(known, key=lambda each: each[0])
            on_progress(self.evaluations, np.nan, f"log likelihood {best / 2:.5g}")
            there, promised = self._likelier(noise, here, [q for _, q in known])
            done = failed >= VAIN or step >= LIKELIEST or promised < best + GAINS - error
            enough = best >= least - GAINS or failed >= 2 * VAIN
            if there is None or (done and enough) or not hopeful(best, promised):
                break
            self.evaluations += 1
            likelihood = -np.inf
            with suppress(ComputationFailed):
                likelihood = likely(self.problem, noise, there)
            if likelihood > -np.inf:
                error = max(abs(likelihood - promised), GAINS)
            known.append((likelihood, there))
            failed = 0 if likelihood > best + GAINS else failed + 1
        return max(known, key=lambda each: each[0])[1]

    def _likelier(
        self, noise: Covariance, q: np.ndarray, known: Sequence[np.ndarray]
    ) -> tuple[np.ndarray | None, float]:
        """The likeliest of what is foreseen to agree and is not ``known``, and how likely it is to be."""
        problem = Foreseeing(self.inverse)
        found = self._agreeing(problem, noise, [q, *known[-KNOWN:]])
        new = [there for there in found if all(np.abs(there - each).max() > CLOSE for each in known)]
        ranked = [(expected(problem, noise, there), there) for there in new]
        promised, best = max(ranked, key=lambda each: each[0], default=(-np.inf, None))
        return best, promised

    def foreseen_likeliest(self, noise: Covariance, surely: bool = False) -> tuple[float, np.ndarray]:
        """How likely the data are foreseen to be at the best, and where; ``surely``: ``expected`` to be."""
        problem, rule = Foreseeing(self.inverse), expected if surely else likely
        found = self._agreeing(problem, noise, self.starts)
        return max(((rule(problem, noise, q), q) for q in found), key=lambda each: each[0])

    def _agreeing(
        self, problem: Foreseeing, noise: Covariance, starts: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """Where works are foreseen to agree best, alone, and with forces in ``noise``, or beside what is
        missed where the works do."""
        works = self.foreseen().q
        beside = allowing(noise, *problem.residuals_inside(works, noise))
        from_there = [works, *starts, *self._spread(FEW, seed=2)]
        found = [works]
        for w in (noise, beside):
            ends = _ends(both(problem, w), from_there, *self.within)
            found += [end.q for end in ends[:1]]
            surely = both(problem, *unsure(problem, w, ends[0].q)[:2])
            found += [end.q for end in _ends(surely, [ends[0].q, *from_there], *self.within)]
        apart = [q for i, q in enumerate(found) if all(np.abs(q - p).max() > CLOSE for p in found[:i])]
        return apart

    def _unknown(self) -> np.ndarray | None:
        """Of the places where works are foreseen to agree, and those to which the best that are known lead,
        the best that is not known; None if there is none that may be better than what is."""
        best = min(chi2 for chi2, _ in self.known)
        found = [(each.chi2, each.q) for each in self._minima()] + [self._led(q) for q in self._best]
        for chi2, there in sorted(found, key=lambda each: each[0]):
            near = any(np.abs(there - q).max() <= CLOSE for _, q in self.known)
            if not near and chi2 <= UNSURE * best:
                return there
        return None

    def _led(self, q: np.ndarray) -> tuple[float, np.ndarray]:
        """Where a step by derivatives leads to from ``q``, which is known, and what χ² it promises: what is
        foreseen can be off by more than the works' noise, what was computed is not."""
        r, J = by_work.difference(self.problem, q)
        low, high = (np.clip(bound - q, -BEYOND, BEYOND) for bound in self.inverse.bounds)
        step = optimize.lsq_linear(J, -r, (low - 1e-9, high + 1e-9)).x
        left = r + J @ step
        return float(left @ left), np.clip(q + step, *self.inverse.bounds)

    @property
    def _best(self) -> list[np.ndarray]:
        return [q for _, q in sorted(self.known, key=lambda each: each[0])[:KNOWN]]

    def foreseen(self) -> lm.Minimum:
        """Where works are foreseen to agree best."""
        return min(self._minima(), key=lambda each: each.chi2)

    def _minima(self) -> list[lm.Minimum]:
        """From each start."""
        low, high = self.within
        starts = [*self._best, *self.starts, *self._spread(STARTS, seed=1)]
        low = np.maximum(np.minimum(self.low, np.min(starts, axis=0)) - BEYOND, low)
        high = np.minimum(np.maximum(self.high, np.max(starts, axis=0)) + BEYOND, high)
        works = partial(by_work.difference, Foreseeing(self.inverse))
        return _ends(works, starts, low, high)

    def foreseen_forces(self, w: Covariance, starts: Sequence[np.ndarray]) -> lm.Minimum:
        """Where forces are foreseen to agree best, from ``starts`` on."""
        problem = Foreseeing(self.inverse)
        forces = partial(problem.whitened, covariance=w)
        return min(_ends(forces, starts, *self.inverse.bounds), key=lambda each: each.chi2)

    @property
    def agreeing(self) -> float:
        """χ² of works that agree."""
        return ENOUGH * sum(self.inverse.grids[e.id].mean.size for e in self.inverse.campaign.train)

    def _spread(self, count: int, seed: int = 0) -> list[np.ndarray]:
        """So many places between ``low`` and ``high``."""
        return [self.low + (self.high - self.low) * part for part in self._parts(count, seed)]

    def _parts(self, count: int, seed: int = 0) -> np.ndarray:
        """(count, k) between 0 and 1, evenly spread."""
        return qmc.Halton(self.low.size, seed=seed).random(count)
