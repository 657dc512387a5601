"""Hold claims against runs: calibrate the free choice, read, compare the numerics, look for the reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from cutbench.case.case import Case
from studies.paper.base import CONVERGED, NUMERICS, PAPER, Claim, Finding
from studies.paper.cases import CHANGES, OPEN, TARGETS, best_tip, case_of, left_open, scan
from studies.paper.runner import Runner

REPRODUCED = "reproduced"
COARSE = "only with coarse numerics"
RESOLVED = "only with converged numerics"
NOT = "not reproduced"
CHOICE = "depends on what the paper leaves open"
UNKNOWN = "not known"
BEYOND = "needs three dimensions"
SOLID = "a run in three dimensions; no single change was tried"
VERDICTS = (REPRODUCED, COARSE, RESOLVED, NOT, CHOICE, UNKNOWN, BEYOND)


@dataclass(frozen=True)
class Scan:
    """How a material's tip length was chosen: by what, the value found with each b, and the b taken (mm)."""

    material: str
    measure: str
    published_mm: float
    found_mm: Mapping[float, float]
    ids: Mapping[float, str]
    tip_mm: float


@dataclass(frozen=True)
class ClaimRow:
    """One statement of a claim: what each set of numerics says, the verdict, and why.

    ``changed`` has what runs with one thing changed say, by the names of ``CHANGES``; ``choices`` what those
    with another choice of ``OPEN`` say.
    """

    findings: Mapping[str, Finding]
    verdict: str
    reason: str
    changed: Mapping[str, Finding] = field(default_factory=dict)
    choices: Mapping[str, Finding] = field(default_factory=dict)

    @property
    def what(self) -> str:
        return self.findings[PAPER].what


@dataclass(frozen=True)
class Judged:
    """A claim with its rows; ``ids`` are the runs behind it: numerics or change -> ask -> id."""

    claim: Claim
    rows: tuple[ClaimRow, ...]
    ids: Mapping[str, Mapping[str, str]]


def calibrate(runner: Runner, materials: Iterable[str]) -> dict[str, Scan]:
    """Choose b for each material, once, by the scan on the paper's numerics."""
    cases = {name: scan(name) for name in materials}
    runner.ask((case, "cut") for tried in cases.values() for case in tried.values())
    out = {}
    for name, tried in cases.items():
        results = {tip: runner.results[case.id] for tip, case in tried.items()}
        target, ids = TARGETS[name], {tip: case.id for tip, case in tried.items()}
        found = {tip: target.of(result) for tip, result in results.items()}
        out[name] = Scan(name, target.measure, target.published_mm, found, ids, best_tip(name, results))
    return out


def judge(runner: Runner, chosen: Sequence[Claim], scans: Mapping[str, Scan]) -> list[Judged]:
    """All of ``chosen`` with verdicts and reasons; what is still to be computed is."""
    cases = {claim.id: {word: _cases(claim, word, scans) for word in NUMERICS} for claim in chosen}
    for claim in chosen:
        if any(map(left_open, claim.asks.values())):
            cases[claim.id] |= {name: _cases(claim, PAPER, scans, name) for name in OPEN}
    runner.ask(_pairs(chosen, cases))
    rows = {claim.id: _compared(claim, cases[claim.id], runner) for claim in chosen}
    for claim in chosen:
        if claim.asks and (claim.dissect or any(row.verdict != REPRODUCED for row in rows[claim.id])):
            for name in changes_for(claim):
                cases[claim.id][name] = _cases(claim, CHANGES[name].start, scans, name)
    runner.ask(_pairs(chosen, cases))
    judged = []
    for claim in chosen:
        mine = cases[claim.id]
        ids = {word: {ask: case.id for ask, case in asked.items()} for word, asked in mine.items()}
        judged.append(Judged(claim, tuple(_explained(claim, rows[claim.id], mine, runner)), ids))
    return judged


def changes_for(claim: Claim) -> list[str]:
    """The names of the changes that are tried for ``claim``."""
    names = CHANGES if claim.changes is None else claim.changes
    return [name for name in names if not CHANGES[name].claims or claim.id in CHANGES[name].claims]


def verdict(paper: bool | None, converged: bool | None, choices: Iterable[bool | None] = ()) -> str:
    """From whether a statement holds under the paper's numerics, with other ``choices`` of what the paper
    leaves open, and under the converged ones."""
    if paper is None or converged is None:
        return UNKNOWN
    if (not paper) in choices:
        return CHOICE
    if paper:
        return REPRODUCED if converged else COARSE
    return RESOLVED if converged else NOT


def reason(
    findings: Mapping[str, Finding],
    changed: Mapping[str, Finding],
    choices: Mapping[str, Finding] = MappingProxyType({}),
) -> str:
    """Why, as far as runs that change one thing tell."""
    paper, converged = findings[PAPER], findings[CONVERGED]
    ruling = verdict(paper.holds, converged.holds, [one.holds for one in choices.values()])
    if ruling == CHOICE:
        others = {name: one for name, one in choices.items() if one.holds == (not paper.holds)}
        word, other = ("holds", "not") if paper.holds else ("does not hold", "but")
        return f"{word} with the preset, {other} with {_listed(others)}"
    missing = [word for word, one in findings.items() if one.holds is None]
    if missing:
        return f"the runs do not have it ({', '.join(missing)})"
    told = {name: one for name, one in changed.items() if one.holds is not None}
    flips = {name: one for name, one in told.items() if one.holds != findings[CHANGES[name].start].holds}
    if ruling == REPRODUCED:
        return "holds with both" + (f"; not with {_listed(flips)}" if flips else "")
    if not told:
        return "no run tells"
    if not flips:
        alone = "no single change makes it hold" if ruling == NOT else "no single change decides it"
        return f"{alone}: {_listed(told)}"
    if ruling == NOT:
        return f"it holds with {_listed(flips)}"
    from_paper = {name: one for name, one in flips.items() if CHANGES[name].start == PAPER}
    back = {name: one for name, one in flips.items() if CHANGES[name].start == CONVERGED}
    word, undo = ("lost", "back") if ruling == COARSE else ("gained", "lost again")
    parts = [f"{word} with {_listed(from_paper)}"] if from_paper else []
    parts += [f"{undo} with {_listed(back)}"] if back else []
    rest = {name: one for name, one in told.items() if name not in flips and CHANGES[name].start == PAPER}
    parts += [f"unchanged by {_listed(rest)}"] if rest else []
    return "; ".join(parts)


def _listed(found: Mapping[str, Finding]) -> str:
    return ", ".join(f"{(CHANGES | OPEN)[name].text} ({one.text})" for name, one in found.items())


def _cases(claim: Claim, word: str, scans: Mapping[str, Scan], change: str | None = None) -> dict[str, Case]:
    step = None if change is None else (CHANGES | OPEN)[change]
    return {
        name: case_of(
            ask, word, scans[ask.material].tip_mm, None if change in OPEN and not left_open(ask) else step
        )
        for name, ask in claim.asks.items()
    }


def _pairs(chosen: Sequence[Claim], cases) -> list[tuple[Case, str]]:
    return [
        (case, claim.asks[name].test)
        for claim in chosen
        for asked in cases[claim.id].values()
        for name, case in asked.items()
    ]


def _read(claim: Claim, asked: Mapping[str, Case], runner: Runner) -> tuple[Finding, ...]:
    return claim.read({name: runner.results[case.id] for name, case in asked.items()})


def _compared(claim: Claim, cases, runner: Runner) -> list[ClaimRow]:
    choices = [name for name in OPEN if name in cases]
    rows = []
    for found in zip(*(_read(claim, cases[word], runner) for word in (*NUMERICS, *choices)), strict=True):
        pair, others = dict(zip(NUMERICS, found, strict=False)), found[len(NUMERICS) :]
        others = () if pair[PAPER].solid else others
        ruling = verdict(pair[PAPER].holds, pair[CONVERGED].holds, [one.holds for one in others])
        rows.append(ClaimRow(pair, ruling, "", choices=dict(zip(choices, others, strict=False))))
    return rows


def _explained(claim: Claim, rows: Sequence[ClaimRow], cases, runner: Runner) -> list[ClaimRow]:
    changed = {name: _read(claim, cases[name], runner) for name in CHANGES if name in cases}
    out = []
    for i, row in enumerate(rows):
        solid = row.findings[PAPER].solid
        mine = {} if solid else {name: found[i] for name, found in changed.items()}
        why = SOLID if solid else reason(row.findings, mine, row.choices)
        out.append(replace(row, reason=why, changed=mine))
    return out
