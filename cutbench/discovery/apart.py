"""What each cut says on its own: the model with one of its values free in each of them.

A model that lacks an effect of speed bends its other values until it describes cuts at several speeds badly
instead of one of them well, and what candidates would change is asked far from where any of them is right.
With a toughness of its own in each cut, say, the same model finds the valley in which all of them are
described; there derivatives hold, and the values say what the cause has to make of one. Derivatives by a
value of one cut are those that the fit has, so to begin with none are computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cutbench.base.errors import BadInput, ComputationFailed
from cutbench.base.progress import OnProgress
from cutbench.base.units import powers_of
from cutbench.calibration import by_work, lm
from cutbench.calibration.emulated import settled_at
from cutbench.calibration.likely import likely
from cutbench.calibration.sparing import Sparing
from cutbench.calibration.survey import Survey
from cutbench.data.discrepancy import likeliest
from cutbench.discovery.candidates import Candidate
from cutbench.discovery.causes import PRICE
from cutbench.discovery.extending import Place
from cutbench.discovery.foreseen import Foreseen, owning
from cutbench.discovery.point import Point
from cutbench.discovery.score import Score
from cutbench.mechanisms import registry

#: Few evaluations, as derivatives are only updated.
STEPS = replace(by_work.STEPS, evaluations=5, enough=0.3)
FORCES = lm.Settings(promise=0.3, evaluations=4, failures=2)
#: Cuts of each test before, and how far they lie in q, where the first look knows too little.
PLACES, NEAR = 10, 0.8
#: So many parameters are tried, those that are foreseen to gain most, else by their derivatives; how far
#: these reach, in q.
TRIED, REACH = 3, 1.0
#: Part of what is wrong that one must explain to be where candidates are asked; less where data are
#: likeliest, as what is left may be jags, which another computation has elsewhere.
MOST, MOST_FORESEEN = 0.5, 0.25
#: What gains this part as much may be it, too, as a search of few steps ends now lower, now higher; so many
#: are gone on with.
NEARLY, BOTH = 0.3, 2


def apart(point: Point, on_progress: OnProgress, chosen: Sequence[Candidate] = ()) -> list[Place]:
    """Where each cut has a value of its own, of the parameter that explains most of what is wrong so, and of
    another that explains nearly as much; none where nothing explains enough of it. Of those that the laws
    among ``chosen`` resemble, if any does.

    Raises KeyboardInterrupt.
    """
    cuts = [e for e in point.campaign.train if e.kind == "cut"]
    if len(cuts) < 2 or len(cuts) < len(point.campaign.train):
        return []
    laws = [registry()[c.name] for c in chosen if c.name in registry()]
    wanted = {name for law in laws for name in law.resembles}
    names = [u.name for u in point.inverse.unknowns if u.experiment is None]
    names = [name for name in names if name in wanted] or names
    foreseen, price = Foreseen(point), PRICE * (len(cuts) - 1)
    if foreseen.able:
        on_progress(math.nan, math.nan, "looking around where each cut may have values of its own")
        survey = Survey(point.inverse, [point.q])
        survey.around(point.q, np.where(survey.free, NEAR, 0.0), PLACES)
    names = _promising(foreseen, names, price)
    if names:
        on_progress(math.nan, math.nan, f"{' or '.join(names)} of its own in each cut")
    if not foreseen.able:
        stepped = (partial(_stepped, point, name) for name in names)
        return _places((own for own in _computed(stepped) if own.left <= 1 - MOST), 1)
    race = _Race(likely(point.inverse, point.w.noise, point.q))
    asked = point.inverse.run.side_by_side([partial(_foreseen, point, name, race) for name in names])
    owns = [own for own in asked if isinstance(own, _Own)]
    found = sorted((own for own in owns if own.gain >= price), key=lambda own: -own.gain)
    found = [own for own in found if own.left <= 1 - MOST_FORESEEN and own.gain >= NEARLY * found[0].gain]
    return _places(found, BOTH)


def _places(owns: Iterable[_Own], most: int) -> list[Place]:
    """Of the first of ``owns`` whose derivatives can be computed, so many at the ``most``."""
    places: list[Place] = []
    for own in owns:
        with suppress(ComputationFailed, BadInput):
            places.append(own.place)
        if len(places) == most:
            break
    return places


def _computed(each: Iterable[Callable[[], _Own]]) -> Iterator[_Own]:
    """Of ``each`` what can be computed, when it is asked for."""
    for own in each:
        with suppress(ComputationFailed, BadInput):
            yield own()


def _promising(foreseen: Foreseen, names: Sequence[str], price: float) -> list[str]:
    """Of ``names``, that which explains most if it is a cut's own first."""
    gain = _promised if foreseen.able else _gain
    ranked = sorted(((gain(foreseen.point, name), name) for name in names), reverse=True)
    return [name for gain, name in ranked[:TRIED] if gain >= price]


def _promised(point: Point, name: str) -> float:
    """In twice the log likelihood, by what is foreseen, of ``name`` free in each cut."""
    inverse, _ = owning(point, name)
    survey = Survey(inverse, [np.zeros(len(inverse.unknowns))])
    promise, _ = survey.foreseen_likeliest(point.w.noise, surely=True)
    return promise - likely(point.inverse, point.w.noise, point.q)


def by_rate(point: Point, chosen: Sequence[Candidate]) -> tuple[list[Candidate], dict[str, str]]:
    """Of ``chosen`` those that can tell cuts apart, and why the others cannot: where these differ by their
    speed alone, and by where they end, a law that no time occurs in does the same in all of them."""
    q, train = point.q, point.campaign.train
    values = [point.inverse.case(e, q).values for e in train]
    if any(len({v[name] for v in values}) > 1 for name in values[0] if name not in ("speed", "depth")):
        return list(chosen), {}
    idle = {
        c.name: "the cuts differ by their speed, which it does not know"
        for c in chosen
        if not any(powers_of(p.unit)[1] for p in c.parameters)
    }
    return [c for c in chosen if c.name not in idle], idle


def told(place: Place) -> str:
    """What cuts have of their own at ``place``, in a sentence."""
    u = next(u for u in place.shared if u.name == place.owned)
    each = [f"{id} {u.quantity.show(float(f'{values[u.label]:.3g}'))}" for id, values in place.values.items()]
    return f"Cuts are described better with a {u.label} of their own: {', '.join(each)}."


def resembles(name: str, place: Place) -> bool:
    """Whether a law does what cuts have of their own at ``place``."""
    return name in registry() and place.owned in registry()[name].resembles


def resembling(
    place: Place, chosen: Sequence[Candidate], every: Sequence[Candidate]
) -> tuple[list[Candidate], dict[str, str]]:
    """Of ``every`` formula those with the fewest parameters that do what cuts have of their own, and why none
    that is ``chosen``; the chosen ones, if there is none."""
    alike = [c for c in every if resembles(c.name, place)]
    alike = [c for c in alike if len(c.parameters) == min(len(each.parameters) for each in alike)]
    if not alike:
        return list(chosen), {}
    reason = f"not asked: with a value of {place.owned} of each cut's own they are described better"
    names = {c.name for c in alike}
    return alike, {c.name: reason for c in chosen if c.name not in names}


def _gain(point: Point, name: str) -> float:
    """In twice the log likelihood, by the derivatives at ``point``, of ``name`` free in each cut."""
    inverse, _ = owning(point, name)
    r, J = inverse.residuals(np.zeros(len(inverse.unknowns)), point.w)
    white = [point.w.white(by) for by in (r, J)]
    step = np.linalg.lstsq(white[1], -white[0], rcond=1e-6)[0]
    step *= min(1.0, REACH / max(np.abs(step).max(initial=0.0), 1e-300))
    return likeliest(point.w.noise, {id: r[id] + J[id] @ step for id in r}) - point.likelihood


@dataclass(frozen=True)
class _Own:
    """A value of each cut's own: a ``problem`` that was computed at ``q`` (k,), ``S`` as a place has it."""

    point: Point
    problem: Sparing
    S: np.ndarray
    q: np.ndarray

    @property
    def gain(self) -> float:
        """In twice the log likelihood."""
        noise, start = self.point.w.noise, self.point
        return likely(self.problem, noise, self.q) - likely(start.inverse, noise, start.q)

    @property
    def left(self) -> float:
        """The part of the point's misfit (in squares) that is left."""
        return self._wrong(self._residual) / self._wrong(self.point.residual)

    def _wrong(self, residual: Mapping[str, np.ndarray]) -> float:
        """Squares of ``residual`` (m,) by id, as parts of each curve's largest; a reading counts by its
        noise."""
        wrong = 0.0
        for id, r in residual.items():
            grid = self.point.inverse.grids[id]
            squares = (r / np.abs(grid.mean).max()) ** 2
            wrong += float(np.average(squares, weights=grid.reading**-2.0))
        return wrong

    @property
    def _residual(self) -> dict[str, np.ndarray]:
        return self.problem.residuals(self.q, self.point.w)[0]

    @property
    def place(self) -> Place:
        point, S = self.point, self.S
        self.problem.know(self.q, self.problem.predictions(self.q))
        there = settled_at(self.problem, self.q)
        q = np.zeros(self.q.size)
        found = there.predictions(q)
        mean = S.T @ self.q / S.sum(axis=0)
        at = point.inverse.at(point.q)
        shared = [replace(u, start=u.value(x)) for u, x in zip(at, mean, strict=True)]
        back = S @ mean - self.q
        residual, _ = there.residuals(q, point.w)
        for e in point.campaign.train:
            residual[e.id] = residual[e.id] + there.slopes(e, found[e.id], q) @ back
        return Place(there, q, S, shared, residual)


@dataclass
class _Race:
    """How likely data are where each cut has a value of its own, beside how likely they are ``without``: what
    is foreseen to gain much less than another has gained is given up."""

    without: float
    most: float = 0.0

    def hopeful(self, best: float, promised: float) -> bool:
        self.most = max(self.most, best - self.without)
        return max(best, promised) - self.without >= NEARLY * self.most


def _foreseen(point: Point, name: str, race: _Race) -> _Own:
    """Where what is foreseen leads to. Raises ComputationFailed, BadInput."""
    inverse, S = owning(point, name)
    survey = Survey(inverse, [np.zeros(len(inverse.unknowns))])
    q = survey.likeliest(point.w.noise, survey.starts[0], hopeful=race.hopeful)
    return _Own(point, survey.problem, S, q)


def _stepped(point: Point, name: str) -> _Own:
    """Where derivatives lead to, by the works and then by the forces. Raises ComputationFailed, BadInput, and
    KeyboardInterrupt."""
    inverse, S = owning(point, name)
    problem, q, (low, high) = Sparing(inverse), np.zeros(len(inverse.unknowns)), inverse.bounds
    works = partial(by_work.difference, problem)
    best = lm.minimise(works, q, low, high, STEPS, first=by_work.difference(inverse, q))
    if best.chi2 <= best.r.size and best.message != lm.INTERRUPTED:
        # The works say no more.
        best = lm.minimise(lambda q: problem.whitened(q, point.w), best.q, low, high, FORCES)
    if best.message == lm.INTERRUPTED:
        raise KeyboardInterrupt
    return _Own(point, problem, S, best.q)


def alike(point: Point, place: Place, score: Score) -> tuple[float, Score]:
    """How much what a candidate changes is like what the cuts' own values do, between 0 and 1: the part of
    its change of the works (in squares, in units of their noise) that these make, times the part of their
    differences that its strength makes. And its score with that strength, and the value left to share.

    0 of a strength that would lie beyond its bounds, or of several strengths.
    """
    j = int(np.argmax(place.S.sum(axis=0)))
    own = np.flatnonzero(place.S[:, j])
    found, shared = place.inverse.predictions(place.q), place.shared[j]
    x, like, size, rest, whole = [], [], [], 0.0, 0.0
    for e in point.campaign.train:
        k = next(k for k in own if place.inverse.unknowns[k].experiment == e.id)
        u, white = place.inverse.unknowns[k], partial(by_work.changed, place.inverse.grids[e.id], found[e.id])
        x.append(shared.q(u.value(place.q[k])))
        slope = place.inverse.slopes(e, found[e.id], place.q)[:, k]
        by_own = white(slope / u.slope(place.q[k]) * shared.slope(x[-1]))
        by_candidate = white(score.column.by[e.id])
        if by_candidate.shape[1] != 1:
            return 0.0, score
        change = by_candidate[:, 0]
        size.append(max(float(by_own @ by_own), 1e-300))
        like.append(float(by_own @ change) / size[-1])
        rest += float(np.sum((change - like[-1] * by_own) ** 2))
        whole += float(change @ change)
    weight, values = np.sqrt(size), np.array(x)
    A = np.column_stack([np.ones(len(x)), like])
    same, strength = np.linalg.lstsq(A * weight[:, None], values * weight, rcond=None)[0]
    q = score.column.candidate.strengths[0]
    if not (whole > 0 and q.bounds[0] <= q.off_value + strength <= q.bounds[1]):
        return 0.0, score
    spread = weight * (values - np.average(values, weights=size))
    left = weight * (values - A @ [same, strength])
    part = (1 - rest / whole) * (1 - float(left @ left) / max(float(spread @ spread), 1e-300))
    free = np.zeros(len(place.shared))
    free[j] = same
    return part, replace(score, strengths=np.array([strength]), free=free)
