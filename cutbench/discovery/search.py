"""Discovery: what a model gets wrong of measured curves, which cause explains it, and what that gains."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

from cutbench.base.display import Displayed
from cutbench.base.errors import ComputationFailed
from cutbench.base.notebook import watched
from cutbench.base.progress import ALWAYS, OnProgress, silent
from cutbench.calibration.cut_runs import CutRuns
from cutbench.calibration.fitting import INTERRUPTED, LATE, UNDER_WAY, Fit, Fitting, runs_for
from cutbench.calibration.parameters import free_parameters
from cutbench.calibration.posterior import Estimated
from cutbench.data.campaign import Campaign
from cutbench.discovery.candidates import NO_TIME_MEASURED, ONE_ANGLE, baseline_of, family_of
from cutbench.discovery.comparison import (
    Comparison,
    ComparisonRound,
    FoundCause,
    comparisons,
    squared_discrepancy,
)
from cutbench.discovery.held_out import HeldOut, held_out
from cutbench.discovery.misfit_sections import Section, sections
from cutbench.discovery.next_test import Proposal, next_tests, sentence
from cutbench.discovery.noise_free_gain import NoiseFreeGain, noise_free_gain
from cutbench.discovery.numerical_causes import NumericalCauses, numerical_causes


@dataclass(frozen=True, repr=False)
class Discovery(Displayed):
    """A discovery says what a baseline model gets wrong of measured tests, and which cause explains it.

    Attributes
    ----------
    campaign : Campaign
        The tests.
    fit : Fit
        The fit of the baseline.
    verdict : str
        ``mechanism``: a cause was found; ``none``: the baseline describes the tests; ``unexplained``: no
        candidate explains what it misses; ``undecided``: candidates could not be tried.
    found : tuple of FoundCause
        The causes, in the order in which they were found.
    steps : tuple of ComparisonRound
        What was compared; none where the baseline was not fitted to its end.
    final : Estimated or None
        The model with all causes.
    numerics : NumericalCauses
        What numerical choices would explain.
    held_out : HeldOut or None
        What the causes gain on what was not fitted.
    noise_free : NoiseFreeGain or None
        What they would gain without noise and scatter.
    wrong : tuple of Section
        Where the baseline misses the tests, the most significant first.
    left : tuple of Section
        Where the final model does.
    proposed : tuple of Proposal
        Tests that would tell apart what these do not.
    next_experiment : str
        The same in a sentence.
    seconds : float, s
        How long it took.
    notes : tuple of str
        What else a person should know.
    stopped : str
        Why it ended before all was asked; empty where all was.

    Examples
    --------
    >>> import cutbench
    >>> import numpy as np
    >>> from cutbench.data import Experiment, FitPlan, Repetition, start_case
    >>> stretch = np.linspace(1.02, 1.5, 30)
    >>> stress = 0.01 * (stretch - stretch**-2)  # MPa, of a solid whose shear modulus is 10 kPa
    >>> pulled = Experiment("pulled", "uniaxial", (Repetition(stretch, stress),))
    >>> laws, soft = ["neo_hookean", "volumetric"], {"G": "20 kPa", "nu": 0.499}
    >>> base, _ = start_case(None, baseline=laws, kinds=["uniaxial"], parameters=soft)
    >>> plan = FitPlan(free=("G",))
    >>> campaign = cutbench.Campaign("Pulled", base, (pulled,), candidates=("gent",), plan=plan)
    >>> found = cutbench.discover(campaign, workers=0)
    >>> found.verdict, found.names, found.fit.status
    ('none', (), 'converged')
    """

    display_module: ClassVar[str] = "cutbench.discovery.report"

    campaign: Campaign
    fit: Fit
    verdict: str
    found: tuple[FoundCause, ...]
    steps: tuple[ComparisonRound, ...]
    final: Estimated | None
    numerics: NumericalCauses
    held_out: HeldOut | None
    noise_free: NoiseFreeGain | None
    wrong: tuple[Section, ...]
    left: tuple[Section, ...]
    proposed: tuple[Proposal, ...]
    next_experiment: str
    seconds: float
    notes: tuple[str, ...]
    stopped: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the causes."""
        return tuple(f.name for f in self.found)

    @property
    def first(self) -> Estimated | None:
        """The fitted baseline."""
        return self.fit.estimated

    @property
    def rest(self) -> float:
        """The part of what the baseline misses that the final model does, too, as squares."""
        if self.first is None or self.final is None or not self.found:
            return 1.0
        return squared_discrepancy(self.final) / max(squared_discrepancy(self.first), 1e-300)

    @property
    def remains(self) -> bool:
        """Whether the final model misses more than chance makes."""
        return bool(self.steps) and self.steps[-1].significant

    @property
    def telling(self) -> ComparisonRound | None:
        """The round that found the first cause, else the first."""
        return self.found[0].step if self.found else self.steps[0] if self.steps else None

    @property
    def not_tried(self) -> dict[str, str]:
        """The candidates that could not be tried at last, with the reason.

        Where no candidate was tried, also those that do not apply.
        """
        if not self.steps:
            return {}
        last = self.steps[-1]
        return {**({} if last.scores.scores else last.left_out), **last.failed}

    @property
    def groups(self) -> list[tuple[str, ...]]:
        """The groups of causes that cannot be told apart, for each cause that was found."""
        return [f.group for f in self.found if len(f.group) > 1]


@dataclass
class _SearchState:
    """What is known of a search until now."""

    comparison: Comparison | None = None
    numerics: NumericalCauses = field(default_factory=NumericalCauses)
    proposed: list[Proposal] = field(default_factory=list)
    next_experiment: str = ""
    stopped: str = ""
    doing: str = ""


@watched("")
def discover(
    campaign: Campaign,
    *,
    workers: int | None = None,
    refine: bool = True,
    on_progress: OnProgress = silent,
    seed: int = 0,
    store: str | Path | None = None,
    limit_s: float = math.inf,
    runs: CutRuns | None = None,
    on_stage: Callable[[Discovery], None] | None = None,
    by_atlas: bool = False,
) -> Discovery:
    """Fit the baseline model of a campaign, and find which cause explains what it gets wrong.

    Ctrl-C ends the search with what was found until then.

    Parameters
    ----------
    campaign : Campaign
        The tests, the baseline, and the candidates.
    workers : int, optional
        Processes that compute cuts; one a core unless given, 0 for this one.
    refine : bool
        Whether the error of a cut's mesh is measured.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with what is done.
    seed : int
        Seed of the draws of chance.
    store : str or Path, optional
        Folder with a store of runs: what is there is not computed again, and the rest is left there.
    limit_s : float, s
        The search ends after this time, too, with what was found until then.
    runs : CutRuns, optional
        Computes cuts in place of ``workers`` and ``store``.
    on_stage : callable, optional
        Called with what is known after each stage.
    by_atlas : bool
        Whether cuts are those of the atlas that cutbench brings along: none is computed, and what takes runs
        of its own is not asked.

    Returns
    -------
    Discovery
        The verdict, the causes, and the test to do next.

    Raises
    ------
    BadInput
        If a name of the campaign cannot be fitted.
    ComputationFailed
        If the baseline cannot be computed.

    Examples
    --------
    >>> import cutbench
    >>> import numpy as np
    >>> from cutbench.data import Experiment, FitPlan, Repetition, start_case
    >>> rng, stretch = np.random.default_rng(0), np.linspace(1.02, 1.5, 12)
    >>> stress = 0.01 * (stretch - stretch**-2) * (1 + 2 * (stretch - 1) ** 2)  # MPa; it stiffens
    >>> def specimen(name):
    ...     return Repetition(stretch, stress * (1 + 0.01 * rng.standard_normal()), name=name)
    >>> pulled = Experiment("pulled", "uniaxial", tuple(map(specimen, "abc")))
    >>> laws, soft = ["neo_hookean", "volumetric"], {"G": "20 kPa", "nu": 0.499}
    >>> base, _ = start_case(None, baseline=laws, kinds=["uniaxial"], parameters=soft)
    >>> plan = FitPlan(free=("G",))
    >>> campaign = cutbench.Campaign("Pulled", base, (pulled,), candidates=("gent",), plan=plan)
    >>> cutbench.discover(campaign, workers=0).names
    ('gent',)
    """
    began, due, campaign = time.perf_counter(), time.monotonic() + limit_s, baseline_of(campaign)
    known = _SearchState()

    def told(done: float, total: float, text: str) -> None:
        known.doing = text
        on_progress(done, total, text)

    def stage(fit: Fit) -> None:
        if on_stage is not None:
            so_far = replace(known, stopped=UNDER_WAY)
            on_stage(_result(campaign, fit, so_far, time.perf_counter() - began, seed))

    with runs_for(campaign, workers, store, limit_s, runs) as ready:
        fitting = Fitting(
            campaign, ready, free_parameters(campaign), told, refine, on_stage and stage, by_atlas
        )
        check = ready.check
        fitting.go(due)
        fit = fitting.result()
        ready.check = check
        try:
            if fit.done and fit.estimated is not None:
                _search(fit.estimated, known, seed, told, partial(stage, fit))
        except KeyboardInterrupt:
            known.stopped = LATE if time.monotonic() >= due else INTERRUPTED
        ready.check = ALWAYS  # what is known can be asked
        known.stopped = known.stopped or ("" if fit.done else fit.status)
    return _result(campaign, fit, known, time.perf_counter() - began, seed)


def _search(
    baseline: Estimated, known: _SearchState, seed: int, on_progress: OnProgress, stage: Callable[[], None]
) -> None:
    """All rounds, a ``stage`` after each; what is ``known`` is up to date. Raises KeyboardInterrupt."""
    comparison: Comparison | None = None
    for comparison in comparisons(baseline, seed=seed, on_progress=on_progress):
        known.comparison = comparison
        if len(comparison.steps) == 1 and comparison.steps[0].whole and not comparison.found:
            known.numerics = numerical_causes(comparison.steps[0], seed)
            if known.numerics.explains:
                return
        stage()
    assert comparison is not None, "there is a round at least"
    final = comparison.final
    on_progress(math.nan, math.nan, "computing the tests that are predicted")
    for e in baseline.posterior.predictions.campaign.test:
        for fitted in (baseline, final):
            try:
                fitted.posterior.predictions.compute(e, fitted.posterior.values(e, fitted.q))
            except ComputationFailed:
                continue  # the fit's notes say why
    pair = _confounded_pair(comparison)
    if pair is not None:
        names = [each.name for each in pair]
        on_progress(math.nan, math.nan, f"looking for a test that tells {' from '.join(names)}")
        known.proposed = next_tests(*(each.fitted for each in pair))
        known.next_experiment = sentence(names, known.proposed)


def _confounded_pair(comparison: Comparison):
    """The first cause that is not told from another, and that one: of another class, if there is any."""
    steps = [f.step for f in comparison.found] or list(comparison.steps[:1])
    for step in steps:
        if len(step.group) > 1:
            first, *others = step.group
            return first, min(others, key=lambda c: family_of(c.name) == family_of(first.name))
    return None


def _result(campaign: Campaign, fit: Fit, known: _SearchState, seconds: float, seed: int) -> Discovery:
    comparison, baseline = known.comparison, fit.estimated
    found = () if comparison is None or known.numerics.explains else comparison.found
    steps = () if comparison is None else comparison.steps
    final = baseline if comparison is None or known.numerics.explains else comparison.final
    verdict = _verdict(steps, found, known)
    told = clean = None
    if baseline is not None and final is not None:
        told = held_out(baseline, final)
        clean = noise_free_gain(baseline, final, seed) if found else None
    notes = list(fit.notes)
    if known.stopped:
        notes.insert(0, f"Not at its end ({known.stopped}): what else there may be was not asked.")
    for what, reason in (("depends on time", NO_TIME_MEASURED), ("has a direction", ONE_ANGLE)):
        if mute := [name for name, why in steps[0].left_out.items() if why == reason] if steps else []:
            notes.append(f"What {what} is not asked ({', '.join(mute)}): {reason}.")
    return Discovery(
        campaign, fit, verdict, tuple(found), tuple(steps), final, known.numerics, told, clean,
        tuple(sections(baseline)) if baseline else (), tuple(sections(final)) if final else (),
        tuple(known.proposed), known.next_experiment or _next_test_text(verdict, known), seconds,
        tuple(dict.fromkeys(notes)), known.stopped,
    )  # fmt: skip


def _verdict(steps: tuple[ComparisonRound, ...], found: tuple[FoundCause, ...], known: _SearchState) -> str:
    if found:
        return "mechanism"
    if not steps:
        return "undecided"
    first = steps[0]
    if known.numerics.explains:
        return "unexplained"
    if not first.significant:
        # Within the atlas' error much may be hidden.
        return "undecided" if first.null.posterior.predictions.by_atlas else "none"
    # Nothing is unexplained before it was tried.
    tried = first.scores.scores and not first.failed and not known.stopped
    return "unexplained" if tried else "undecided"


def _next_test_text(verdict: str, known: _SearchState) -> str:
    if known.stopped:
        goes_on = f" It goes on, from the cuts that it has, with {known.doing}." if known.doing else ""
        return f"Not asked: {known.stopped}.{goes_on}"
    return {
        "none": "None is needed: the model describes the tests to within their scatter.",
        "mechanism": "None is needed to tell the candidates apart: these tests do.",
        "undecided": "None before runs, or the candidates that could not be tried, say more.",
    }.get(
        verdict,
        "Repeat the test that fails worst at another speed: what is left depends on time if it moves along"
        " the displacement, on place if it does not.",
    )
