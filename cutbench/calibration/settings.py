"""The numbers that a fit and a search rest on beside the data: all of them, with their reasons."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Recorded in ``fit.json`` and ``discovery.json``.

    Attributes
    ----------
    broad : float
        Standard deviation beforehand of a parameter of the baseline, as a logarithm or in units of its start,
        or of what is typical in such tests where that is more: a factor of twenty either way, so that only
        what the data do not tell feels it.
    strength, shape : float
        Of a candidate's strength in units of what is typical, and of its shape, as a logarithm: a factor of
        ten either way.
    reach : float
        Half of the side of the box that the first cuts fill, as a logarithm: a factor of two and a half, as
        far as a person's guess may be off.
    first, each : int
        Cuts of the first design of a model that the atlas has not: so many, and so many more for each
        parameter, twice what a linear trend needs.
    rounds : int
        So often at most cuts are computed at the best place that the emulator knows.
    hopeless : float
        A run that takes so many times the median effort of its search is given up: it holds up the others for
        longer than what it tells is worth.
    fit_runs, search_runs : int
        Cuts that a fit, and a whole search for causes, compute at most where three tests are cuts or fewer,
        but for those that end it.
    gained : float
        The best place is found when the log posterior grows by less from there: less than one of two models
        must be likelier to be told.
    chance : float
        Probability of naming anything where nothing is wrong.
    undecided : float
        Logarithm of the evidence ratio up to which two models count as equally good: 20 to 1, Kass and
        Raftery's "strong".
    share : float
        Part of what a model misses beyond noise that a cause must explain to be named.
    trifle : float
        Part of what the baseline misses, as a root mean square, of which no cause is looked for: no specimen
        follows a formula.
    tried, computed : int
        Candidates that take runs of their own and are fitted in a round; and so often cuts are computed at
        the best place of one.
    most : int
        Causes at most.
    """

    broad: float = 3.0
    strength: float = 3.0
    shape: float = 2.3
    reach: float = 0.9
    first: int = 6
    each: int = 2
    rounds: int = 8
    hopeless: float = 5.0
    fit_runs: int = 60
    search_runs: int = 120
    gained: float = 0.5
    chance: float = 0.005
    undecided: float = 3.0
    share: float = 0.3
    trifle: float = 0.1
    tried: int = 6
    computed: int = 3
    most: int = 4

    def budget(self, runs: int, cuts: int) -> float:
        """``runs`` of three cuts or fewer, and in proportion of more."""
        return runs * max(cuts, 3) / 3


SETTINGS = Settings()
