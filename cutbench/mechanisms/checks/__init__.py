"""What every law must satisfy: run by the tests on all, by ``cutbench mechanisms --check`` on a file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from cutbench.base.errors import BadInput
from cutbench.mechanisms.base import Mechanism
from cutbench.mechanisms.checks import every_slot, of_bulk, of_cut, of_surfaces  # noqa: F401
from cutbench.mechanisms.checks.base import CHECKS, Check, NotTested
from cutbench.mechanisms.checks.of_cut import damage_says_what_is_cut
from cutbench.mechanisms.checks.trial import Trial
from cutbench.mechanisms.law_registry import file_of, laws_of, load_file, registry
from cutbench.mechanisms.law_validation import refuse_incomplete


class Finding(NamedTuple):
    """One check of one law, by their names, what it requires, what is wrong, and why nothing could be tested
    (empty: nothing)."""

    law: str
    check: str
    says: str
    wrong: str
    untested: str = ""


def checks_of(law: Mechanism) -> Iterator[Check]:
    """The requirements on a law of its slot."""
    return (check for check in CHECKS if check.slot in ("", law.slot) and check.applies(law))


def check_file(path: str | Path) -> Iterator[Finding]:
    """Every check of the laws in a file, one after the other; a law that lacks something has one finding.

    Raises BadInput for a file that cannot be read or has no law.
    """
    laws = laws_of(load_file(Path(path).resolve()))
    known = registry() | {law.name: law for law in laws}
    for law in laws:
        try:
            refuse_incomplete(law, known)
        except BadInput as error:
            wrong = f"{error.value}: expected {error.expected}"
            yield Finding(law.name, "is_complete", "What a law of its slot must have is there", wrong)
            continue
        trial = Trial(law, known)
        for check in checks_of(law):
            yield finding(check, trial)


def refuse_wrong(law: Mechanism) -> None:
    """Raises BadInput for a law that a run would go astray with and say nothing: for a blade that fails a
    check of its slot, and a cohesive law whose damage does not say what is cut."""
    trial = Trial(law)
    decisive = [
        each for each in checks_of(law) if each.slot == "blade" or each.run is damage_says_what_is_cut
    ]
    for check in decisive:
        if wrong := finding(check, trial).wrong:
            expected = (
                f"a law that passes 'cutbench mechanisms --check': {check.says[0].lower()}{check.says[1:]}"
            )
            raise BadInput(file=str(file_of(law)), key=law.name, value=wrong, expected=expected)


def finding(check: Check, trial: Trial) -> Finding:
    """What a check finds of a law."""
    wrong = untested = ""
    try:
        check.run(trial)
    except NotTested as error:
        untested = str(error)
    except AssertionError as error:
        wrong = str(error) or "it does not"
    except Exception as error:  # whatever a law does wrong
        wrong = f"{type(error).__name__}: {error}"
    return Finding(trial.law.name, check.name, check.says, wrong, untested)
