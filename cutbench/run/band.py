"""A run with its band: repeated over what the model leaves open, one thing at a time.

What that is the laws and the numerics declare (``cutbench.case.model_alternatives``). The band of a measure
is what the repetitions make of it; a label is undecided where the drop's band holds the threshold of abrupt.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from cutbench.base.figure_style import save
from cutbench.base.files import check_writable, csv_text, plain, write_json, write_text
from cutbench.base.notebook import watched
from cutbench.base.progress import OnProgress, silent
from cutbench.base.versions import versions
from cutbench.case.case import Case, load_case
from cutbench.case.model_alternatives import alternative_cases
from cutbench.case.motion import TRANSITION
from cutbench.run.figures.choices import plot_choices
from cutbench.run.measures import ABRUPT, ABRUPT_DROP, MEASURES, SMOOTH, UNCUT, UNDECIDED, label
from cutbench.run.pool.batch import Batch
from cutbench.run.pool.worker import Run
from cutbench.run.result import Result
from cutbench.run.store.runs import Store

#: The run without a change, in tables and files.
AS_ASKED = "as asked"


@dataclass(frozen=True)
class Range:
    """A measure: of the run as asked, the least and the largest, and of how many runs that have it."""

    value: float
    low: float
    high: float
    runs: int


@dataclass(frozen=True)
class Band:
    """A band holds one run and its repetitions, each with one thing changed that the model leaves open.

    Such things are the radius of the blade's tip, the stiffness of contact and others that the laws and the
    numerics declare. The range of a measure over the runs says how far it depends on them.

    Attributes
    ----------
    case : Case
        The run as asked.
    results : mapping of str to Result
        Runs by what is changed, ``"as asked"`` first.
    refused : mapping of str to str
        Changes that the case cannot have, and why.

    Examples
    --------
    >>> import cutbench
    >>> case = cutbench.load_case("gelatin")
    >>> def invented(drop):
    ...     return cutbench.Result(case, {}, cutbench.Outcome("done", "reached"), measures={"drop_rel": drop})
    >>> band = cutbench.Band(case, {"as asked": invented(0.12), "tip = 2.1 mm": invented(0.06)})
    >>> band.label, band.ranges["drop_rel"].low
    ('undecided', 0.06)
    """

    case: Case
    results: Mapping[str, Result]
    refused: Mapping[str, str] = field(default_factory=dict)

    @property
    def asked(self) -> Result:
        """The run without a change."""
        return self.results[AS_ASKED]

    @cached_property
    def labels(self) -> dict[str, str]:
        """``abrupt``, ``smooth`` or ``uncut`` for each run that came to its end."""
        done = {name: result for name, result in self.results.items() if result.outcome.done}
        return {name: label(result.measures.get("drop_rel", math.nan)) for name, result in done.items()}

    @property
    def short(self) -> tuple[str, ...]:
        """The runs that fell short: no range has them."""
        return tuple(name for name in self.results if name not in self.labels)

    @cached_property
    def ranges(self) -> dict[str, Range]:
        """The range of each measure that any run has."""
        found = {}
        for key in MEASURES:
            values = [self.results[name].measures.get(key, math.nan) for name in self.labels]
            if there := [float(value) for value in values if math.isfinite(value)]:
                value = float(self.asked.measures.get(key, math.nan))
                found[key] = Range(value, min(there), max(there), len(there))
        return found

    @property
    def label(self) -> str:
        """The label of the run as asked; ``undecided`` where runs are abrupt and smooth.

        The band of the drop then holds the threshold of abrupt.
        """
        if {ABRUPT, SMOOTH} <= set(self.labels.values()):
            return UNDECIDED
        return label(self.asked.measures.get("drop_rel", math.nan))

    def sentence(self) -> str:
        """Say in words what the run found, and what of it is left open.

        Returns
        -------
        str
            One sentence without a full stop.
        """
        drop, cut = self.ranges.get("drop_rel"), self.labels.get(AS_ASKED) != UNCUT
        text = self.asked.sentence((drop.low, drop.high) if drop and cut else None)
        otherwise = [name for name, each in self.labels.items() if (each != UNCUT) != cut]
        if otherwise:
            text += f"; {'not cut' if cut else 'cut'}: {', '.join(otherwise)}"
        return text + (f"; fell short: {', '.join(self.short)}" if self.short else "")

    def describe(self) -> dict:
        """Write the content of band.json.

        Returns
        -------
        dict
            Plain data: the sentence, the label, the case, ranges, runs and versions.
        """
        return {
            "schema": 1,
            "said": self.sentence(),
            "label": self.label,
            "threshold": ABRUPT_DROP,
            "case": self.case.to_dict(),
            "ranges": {key: vars(each) for key, each in self.ranges.items()},
            "runs": {
                name: {
                    "id": result.id,
                    "label": self.labels.get(name),
                    "outcome": str(result.outcome),
                    "measures": plain(result.measures),
                }
                for name, result in self.results.items()
            },
            "refused": dict(self.refused),
            "versions": versions(),
        }


def case_to_transition(case: Case) -> Case:
    """``case`` as a band has it by default: each run ends with its transition, unless it has a motion."""
    return case if case.motion else replace(case, until=TRANSITION)


@watched("runs")
def band(
    source: str | Path | Case,
    *,
    out: str | Path | None = None,
    workers: int | None = 0,
    on_progress: OnProgress = silent,
    run: Run | None = None,
    **changes: object,
) -> Band:
    """Repeat a run over what the model leaves open, changing one thing at a time.

    Such things are the radius of the blade's tip, the stiffness of contact and others that the laws and the
    numerics declare.

    A KeyboardInterrupt passes through: runs that ended are kept.

    Parameters
    ----------
    source : str, Path or Case
        A material's name, a TOML file or a case.
    out : str or Path, optional
        Folder for band.json, band.csv and band.png. Runs are kept in ``out/runs``, and what is there is not
        computed again. Nothing is written unless it is given.
    workers : int, optional
        Processes that compute; 0: this one; None: one a core.
    on_progress : callable
        Called as ``on_progress(done, total, text)`` with numbers of runs.
    run : callable, optional
        Replaces how a case is run: takes a case and returns its result.
    **changes : object
        What ``Case.set`` takes. Without ``until`` among them runs end with their transition.

    Returns
    -------
    Band
        The runs, their labels and ranges.

    Raises
    ------
    BadInput
        For a source or a change that cannot be used, or a folder that cannot be written.

    Examples
    --------
    >>> import cutbench
    >>> quick = {"h": "0.8 mm", "element": "P1", "depth": "0.1 mm"}  # leave these out for a run that cuts
    >>> bare = ("neo_hookean", "volumetric", "contact")
    >>> found = cutbench.band("gelatin", mechanisms=bare, **quick)
    >>> found.label, list(found.results)[:2]
    ('uncut', ['as asked', 'tip = 0.525 mm'])
    """
    case = source.set(**changes) if isinstance(source, Case) else load_case(source, changes)
    case = case if "until" in changes else case_to_transition(case)
    changed, refused = alternative_cases(case)
    cases = {AS_ASKED: case, **changed}
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory()) if out is None else check_writable(out)
        batch = Batch(Store(Path(folder) / "runs"), workers=workers, on_progress=on_progress)
        batch.go(cases.values(), run)
    found = Band(case, {name: batch.results[each.id] for name, each in cases.items()}, refused)
    if out is not None:
        write_band(found, out)
    return found


def write_band(found: Band, out: str | Path) -> list[Path]:
    """band.json, band.csv and band.png in ``out``; the paths."""
    folder = check_writable(out)
    rows = [
        [name, found.labels.get(name), *map(result.measures.get, MEASURES), result.outcome.kind, result.id]
        for name, result in found.results.items()
    ]
    head = ["change", "label", *MEASURES, "outcome", "run_id"]
    known = {name: found.results[name].measures for name in found.labels}
    return [
        write_json(found.describe(), folder / "band.json"),
        write_text(csv_text(head, rows), folder / "band.csv"),
        *save(plot_choices({found.case.name: known}), folder / "band.png"),
    ]
