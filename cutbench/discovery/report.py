"""What a discovery says: as a record for text, page and notebook, and as ``discovery.json``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from cutbench.base.files import check_writable, picked, write_json, write_text
from cutbench.base.report import Chapter, Picture, Report, Table
from cutbench.base.units import Parameter
from cutbench.base.versions import versions
from cutbench.calibration.case_file import write_case
from cutbench.calibration.posterior import Estimated
from cutbench.calibration.settings import SETTINGS
from cutbench.data.covariance import relative_discrepancy
from cutbench.discovery.candidates import cause_of, cause_title, family_of
from cutbench.discovery.comparison import ComparedModel, ComparisonRound, FoundCause
from cutbench.discovery.figures import plot as plot
from cutbench.discovery.figures import plot_curves, plot_ranking
from cutbench.discovery.held_out import TESTS, HeldOut
from cutbench.discovery.misfit_sections import Section
from cutbench.discovery.score import Score
from cutbench.discovery.search import Discovery
from cutbench.mechanisms import registry

_IN_SHORT = {
    "mechanism": "A mechanism was found",
    "none": "Nothing is missing",
    "undecided": "What is missing is not known yet",
    "unexplained": "Something is missing that no candidate explains",
}
_HOW_TO_READ = """\
Each candidate is a mechanism that the baseline lacks. The score z says how many standard deviations of chance
its first effect stands out of the residual, after all that the free parameters could take up. The best were
then fitted for real; they are in the order of their evidence. Blue was added to the model, light blue cannot
be told from it by these data."""


def verdict_sentence(d: Discovery) -> str:
    """Say which cause was found, or that there is none to name.

    Parameters
    ----------
    d : Discovery
        The discovery.

    Returns
    -------
    str
        A sentence or several.
    """
    if not d.campaign.doubts:
        return _answer(d)
    first, *more = d.campaign.doubts
    rest = f", and {len(more)} more that the notes name" if more else ""
    return f"Readings are in doubt before any mechanism is: {first}{rest}. As they are read: {_answer(d)}"


def _beside(d: Discovery) -> str:
    """What the computation leaves open beside the scatter: an effect of that size is not seen."""
    at = d.first and d.first.at
    parts = (
        [np.sqrt(np.median(np.diag(at.error[id]))) / np.abs(y).max() for id, y in at.y.items()] if at else []
    )
    worst = max(parts, default=0.0)
    return (
        f" and the error of the computation, up to {100 * worst:.1f} % of the largest force" if worst else ""
    )


def _answer(d: Discovery) -> str:
    """What the readings say, as they are read."""
    if d.verdict == "none":
        known = f"to within their scatter{_beside(d)}"
        return f"The baseline describes the tests {known}: nothing needs to be added."
    if not d.steps:
        return f"The baseline is not fitted to its end ({d.stopped}): no cause was looked for.{_so_far(d)}"
    place = f"'{d.wrong[0].experiment.id}', {d.wrong[0].place}"
    if d.numerics.explains:
        return (
            f"The baseline is wrong (most in {place}), and a numerical choice, {d.numerics.explains},"
            " explains that as well as any mechanism: no physical cause can be named before that is settled."
        )
    if d.verdict == "undecided":
        early = {"the search ended early": d.stopped} if d.stopped else {}
        why = early | {cause_title(name): reason for name, reason in d.not_tried.items()}
        reasons = "; ".join(": ".join(each) for each in why.items())
        return (
            f"The baseline is wrong beyond the scatter (most in {place}). The cause is undecided, since"
            f" candidates could not be tried: {reasons or 'there were none'}.{_so_far(d)}"
        )
    if d.verdict == "unexplained":
        nearest = [
            f" Nearest came {cause_title(c.name)}: {'; '.join(c.doubts)}." for c in d.steps[0].compared
        ]
        return (
            f"The baseline is wrong beyond the scatter (most in {place}), and none of the candidates explains"
            f" it: the cause is unexplained.{''.join(nearest[:1])}"
        )
    lacks = "lacks" if any(cause_of(n) == "mechanism" for n in d.names) else "gets wrong"
    part = "A part of what" if d.remains and d.rest > 0.25 else "What"
    names = " and ".join(cause_title(n) for n in d.names)
    words = [f"{part} the baseline {lacks} is {names}{_confounded_with(d)}.", *map(meaning, d.names)]
    if d.remains and d.final is not None:
        id, missed = max(misfits(d.final).items(), key=lambda item: item[1])
        worst = f"in '{id}' {100 * missed:.2g} % of its maximum"
        words.append(f"{100 * d.rest:.0f} % of what was wrong remains, {worst}.")
    return " ".join(words)


def _so_far(d: Discovery) -> str:
    """What is known of a search that was stopped: the best of its cuts, and what was compared."""
    if d.steps:
        how = {True: "", False: " by the emulator alone"}
        tried = [f"{cause_title(c.name)} (log evidence {_evidence(c)}{how[c.computed]})"
                 for c in d.steps[-1].compared[:4]]  # fmt: skip
        return f" Compared until then: {', '.join(tried)}." if d.stopped and tried else ""
    known = [c for c in d.fit.compared if c.experiment.role == "train"] if d.stopped else []
    misses = [f"{100 * c.relative_rmse:.0f} % of the maximum of '{c.experiment.id}'"
              for c in sorted(known, key=lambda c: -c.relative_rmse)]  # fmt: skip
    return f" The best of {d.fit.runs} cuts misses {misses[0]}." if misses else ""


def _confounded_with(d: Discovery) -> str:
    """What the data cannot tell from the first cause, of other classes."""
    first = d.found[0]
    names = [n for n in first.group if family_of(n) != family_of(first.name) and n not in d.names]
    others = [*map(cause_title, names), *([d.numerics.alike] if d.numerics.alike else [])]
    it = cause_title(first.name) if len(d.found) > 1 else "it"
    return f"; these data cannot tell {it} from {' or '.join(others)}" if others else ""


def misfits(fitted: Estimated) -> dict[str, float]:
    """What a model misses of each curve, as a part of its largest value (root mean square), by id."""
    return {id: relative_discrepancy(fitted.w, id, r) for id, r in fitted.at.residual.items()}


def meaning(name: str) -> str:
    """What a mechanism does: the first line that its file says of it."""
    if name not in registry():
        return f"Measure {name}, or leave it to the fit."
    return (type(registry()[name]).__doc__ or "").strip().splitlines()[0]


def gain_sentence(d: Discovery) -> str:
    """Say what the extension gains on data that it was not fitted to.

    Parameters
    ----------
    d : Discovery
        The discovery.

    Returns
    -------
    str
        A sentence or two; empty where nothing was found or held out.
    """
    if d.held_out is None or not d.found:
        return ""
    g = d.held_out
    where = "experiments that were not fitted" if g.how == TESTS else f"held-out data ({g.how})"
    clean = (
        f" Without noise and scatter of specimens it would fall by {d.noise_free.text}."
        if d.noise_free
        else ""
    )
    return (
        f"On {where} the error falls from {g.baseline_rmse:.3g} to {g.extended_rmse:.3g} {_unit(g.unit)}, by"
        f" {100 * g.gain:.0f} ± {100 * g.gain_se:.0f} %; the scatter alone makes {g.noise_floor:.2g}.{clean}"
    )


def _unit(unit: str) -> str:
    return "of the maximum" if unit == "1" else unit


def report(d: Discovery) -> Report:
    """All that a discovery says to a person."""
    caption = (
        "Band: measured mean ± two standard deviations (scatter between specimens, noise, and what the mesh"
        f" leaves open). Orange dashes: the baseline.{' Blue: the extended model.' if d.found else ''} Below:"
        " measured less computed."
    )
    drawn = Picture(lambda: plot_curves(d), "curves", caption)
    ranked = [Picture(lambda: plot_ranking(d), "ranking")] if d.telling and d.telling.compared else []
    rounds: list[str | Table] = [_candidates(d, number, step) for number, step in enumerate(d.steps, 1)]
    chapters = [
        Chapter("What was found", [_causes(d)]),
        Chapter("Measured and computed", [drawn if d.fit.compared else "Nothing was computed."]),
        Chapter(
            "Where the baseline is wrong",
            [_misfits(d.wrong, "Nowhere by more than three standard deviations.")],
        ),
        Chapter("What would explain it", [*ranked, *(rounds or ["No candidate was tried."])], _HOW_TO_READ),
        Chapter("Numerical causes", [_numerical(d)]),
        Chapter("What was gained", [_errors(d)]),
        Chapter("What remains", _remains(d)),
        Chapter("Next experiment", [d.next_experiment], brief=True),
        Chapter("Notes", d.notes or ["none"]),
    ]
    return Report(
        d.campaign.title,
        [("baseline", d.fit.case.model.described), ("verdict", d.verdict)],
        (d.fit.far, verdict_sentence(d), gain_sentence(d)),
        chapters,
        _IN_SHORT[d.verdict],
        d.verdict,
    )


def _causes(d: Discovery) -> Table:
    rows = []
    for f in d.found:
        for q, v, sd in estimates(f.compared):
            spread = f"± {_shown(q, sd, '.2g')}" if sd < 10 * abs(v) else "not determined by these data"
            rows.append((cause_title(f.name), f"{q.symbol} = {_shown(q, v)}", spread, q.doc))
    return Table(("cause", "value", "standard deviation", "what"), rows)


def _shown(q: Parameter, value: float, form: str = ".3g") -> str:
    return q.show(float(format(value, form)))


def _misfits(sections: Sequence[Section], none: str) -> Table:
    heads = ("experiment", "where", "from – to", "measured less computed", "z (standard deviations)")
    rows = []
    for s in [s for s in sections if s.wrong][:12]:
        e, (scale, unit) = s.experiment, s.experiment.shown
        where, bias = s.regime or e.kind.replace("_", " "), f"{scale * s.bias:+.3g} {unit}"
        rows.append((e.id, where, s.range, bias, f"{s.z:+.1f}"))
    return Table(heads, rows, none=none, most=6)


def _candidates(d: Discovery, number: int, step: ComparisonRound) -> Table:
    heads = (
        "candidate",
        "z",
        "log evidence",
        "explains",
        "gain on held-out data",
        "fitted values",
        "said of it",
    )
    alike = [c.name for c in step.group] if len(step.group) > 1 else []
    rows = []
    for s, c in step.ranking:
        doubts, fitted = "", [""] * 4
        if c is not None:
            values = ", ".join(f"{q.symbol} = {_shown(q, v)}" for q, v, _ in estimates(c))
            fitted = [_evidence(c), f"{100 * c.explained_variance:.0f} %", c.held_out.percent, values]
            doubts = "; ".join(c.doubts)
        said = "added" if s.name in d.names else "not told apart" if s.name in alike else doubts
        rows.append((cause_title(s.name), f"{s.z:.1f}", *fitted, said))
    title = f"round {number}" if len(d.steps) > 1 else ""
    return Table(heads, rows, title, none="No candidate was tried.", most=10)


def _evidence(c: ComparedModel) -> str:
    return f"{c.evidence:+.1f}" + (f" ± {c.evidence_sd:.1f}" if c.evidence_sd > 0 else "")


def _numerical(d: Discovery) -> Table:
    mesh = any(e.kind == "cut" for e in d.campaign.train)
    rows = [
        (
            f"{s.name} ({s.sensitivity.candidate.title})",
            f"{s.z:.1f}",
            f"{d.numerics.evidence[s.name]:+.1f}",
            f"{100 * max(d.numerics.shares[s.name], 0):.0f} %",
        )
        for s in d.numerics.scores
    ]
    by_atlas = d.first is not None and d.first.posterior.predictions.by_atlas
    why = "no cut was computed" if by_atlas else "the baseline does not fail"
    none = f"Not asked: {why}." if mesh else "These tests are computed without a mesh."
    return Table(("cause", "z", "log evidence", "would explain"), rows, none=none)


def _remains(d: Discovery) -> list[str | Table]:
    if not d.steps:
        return ["Not asked."]
    last = d.steps[-1].scores
    return [
        f"{'More than' if d.remains else 'Nothing beyond'} the scatter: χ² = {last.chi2:.0f}, data that"
        f" the model describes have {last.expected:.0f} on average.",
        *([_misfits(d.left, "No single section stands out.")] if d.remains else []),
    ]


def _errors(d: Discovery) -> Table:
    gains = {"fitted tests": _train(d), "held out": _gain(d.held_out)}
    rows = [
        (
            words + (f": {g['how']}" if "how" in g else ""),
            *(f"{g[k]:.3g} {_unit(g['unit'])}" for k in ("baseline_rmse", "extended_rmse", "noise_floor")),
        )
        for words, g in gains.items()
        if g is not None
    ]
    return Table(("root mean square error", "baseline", "extended model", "scatter and noise alone"), rows)


def summary(d: Discovery) -> str:
    """Write the report of a discovery as text.

    Parameters
    ----------
    d : Discovery
        The discovery.

    Returns
    -------
    str
        The verdict, where the baseline is wrong, causes and candidates, the next experiment, notes.
    """
    return report(d).text()


def summary_lines(d: Discovery) -> list:
    """Head, then pairs of words."""
    return report(d).summary_lines()


def table(d: Discovery) -> dict[str, list]:
    """The candidates of the round that found, a row each; not a number where one was not fitted."""
    rows = [] if d.telling is None else d.telling.ranking
    return {
        "candidate": [s.name for s, _ in rows],
        "class": [family_of(s.name) for s, _ in rows],
        "kind": [s.sensitivity.candidate.cause for s, _ in rows],
        "score": [s.z for s, _ in rows],
        "log_evidence": [math.nan if c is None else c.evidence for _, c in rows],
        "explains": [math.nan if c is None else c.explained_variance for _, c in rows],
        "gain_heldout": [math.nan if c is None else c.held_out.gain for _, c in rows],
        "gain_se": [math.nan if c is None else c.held_out.gain_se for _, c in rows],
        "added": [s.name in d.names for s, _ in rows],
    }


def write_discovery(d: Discovery, folder: Path) -> list[Path]:
    """Write ``discovery.json``, ``discovery.html`` and the case file ``case.toml``, each whole or not at all.

    A discovery without a final model has no case file.

    Parameters
    ----------
    d : Discovery
        The discovery.
    folder : Path
        Where to; made if need be.

    Returns
    -------
    list of Path
        What was written.
    """
    case = check_writable(folder) / "case.toml"
    paths = [
        write_json(to_dict(d), folder / "discovery.json"),
        write_text(report(d).page(), folder / "discovery.html"),
    ]
    if d.final is None or not d.fit.done:
        case.unlink(missing_ok=True)
        return paths
    name = f" of {d.campaign.path.name}" if d.campaign.path else ""
    note = f"Model at the end of a discovery{name}: {verdict_sentence(d)}"
    remarks = {u.name: "fitted" for u in d.final.posterior.parameters}
    return [*paths, write_case(d.campaign, d.final.case, note, remarks, case)]


#: What ``Discovery.save`` calls.
write = write_discovery


def estimates(c: ComparedModel) -> list[tuple[Parameter, float, float]]:
    """Parameters of the candidate with values and standard deviations, internal units; inf: held."""
    fitted = c.fitted
    sd = np.sqrt(np.diag(fitted.covariance))
    known = {
        u.name: (u.value(x), s * abs(u.slope(x)))
        for u, x, s in zip(fitted.posterior.parameters, fitted.q, sd, strict=True)
    }
    return [(q, *known.get(q.name, (fitted.case.values[q.name], math.inf))) for q in c.candidate.parameters]


def to_dict(d: Discovery) -> dict:
    """Plain data with units."""
    telling = d.telling
    return {
        "schema": 2,
        "title": d.campaign.title,
        "status": d.stopped or "complete",
        "verdict": d.verdict,
        "found": list(d.names),
        "causes": [_cause(f) for f in d.found],
        "remains_of_what_was_wrong": d.rest,
        "misfit": {
            name: {} if fitted is None else misfits(fitted)
            for name, fitted in (("baseline", d.first), ("extended", d.final))
        },
        "kinds": {name: cause_of(name) for name in d.names},
        "sentence": verdict_sentence(d),
        "gain_sentence": gain_sentence(d),
        "ranking": [] if telling is None else [_ranked(s, c, d.names) for s, c in telling.ranking],
        "not_tried": d.not_tried,
        "confounded": [list(group) for group in d.groups],
        "where_wrong": [_section(s) for s in d.wrong if s.wrong],
        "remains": [_section(s) for s in d.left if s.wrong],
        "gain": {
            "train": _train(d),
            "heldout": _gain(d.held_out),
            "clean": None if d.noise_free is None else picked(d.noise_free, "value", "low", "high", "near"),
        },
        "next_experiment": d.next_experiment,
        "proposed_experiments": [
            {"experiment": p.text, "standard_errors": p.standard_errors, "difference_of_maximum": p.part}
            for p in d.proposed
        ],
        "numerical": [
            {"cause": s.name, "what": s.sensitivity.candidate.title, "score_z": s.z,
             "log_evidence": d.numerics.evidence[s.name], "explains": d.numerics.shares[s.name]}
            for s in d.numerics.scores
        ],
        "numerical_not_computed": dict(d.numerics.missing),
        "residual": {
            name: _residual(d.steps[i]) if d.steps else None
            for name, i in (("baseline", 0), ("extended", -1))
        },
        "baseline": _model(d.first),
        "extended": _model(d.final),
        "rounds": [_round(step, d) for step in d.steps],
        "bias_is": "measured less computed",
        "cuts_computed": d.fit.runs if d.first is None else d.first.posterior.predictions.runs.count,
        "settings": asdict(SETTINGS),
        "seconds": d.seconds,
        "notes": list(d.notes),
        "case": (d.fit.case if d.final is None else d.final.case).to_dict(),
        "versions": versions(),
    }  # fmt: skip


def _gain(g: HeldOut | None) -> dict | None:
    """What is reported of a gain."""
    names = "baseline_rmse", "extended_rmse", "noise_floor", "unit", "gain", "gain_se", "how"
    return None if g is None else picked(g, *names)


def _cause(f: FoundCause) -> dict:
    """Name, kind, and what the model gained by it."""
    c = f.compared
    return {
        "name": f.name, "title": c.candidate.title, "kind": c.candidate.cause, "class": family_of(f.name),
        "log_evidence": c.evidence, "log_evidence_sd": c.evidence_sd,
        "explains": c.explained_variance, "gain": _gain(c.held_out),
    }  # fmt: skip


def _ranked(s: Score, c: ComparedModel | None, found: tuple[str, ...]) -> dict:
    candidate = s.sensitivity.candidate
    entry = {"mechanism": s.name, "title": candidate.title, "kind": candidate.cause, "score_z": s.z,
             "fitted": c is not None}  # fmt: skip
    if c is None:
        first = zip(candidate.strengths, s.strengths, strict=True)
        shown = {q.name: _value(q, q.off_value + v, math.inf) for q, v in first}
        return {**entry, "parameters": shown, "gain_heldout": None, "gain_se": None}
    return {
        **entry,
        "parameters": {q.name: _value(q, v, sd) for q, v, sd in estimates(c)},
        "gain_heldout": c.held_out.gain,
        "gain_se": c.held_out.gain_se,
        "heldout": c.held_out.how,
        "log_evidence": c.evidence,
        "explains": c.explained_variance,
        "chance": c.p,
        "doubts": list(c.doubts),
        "accepted": s.name in found,
    }


def _value(q: Parameter, v: float, sd: float) -> dict:
    low, high = (-math.inf if q.low is None else q.low, math.inf if q.high is None else q.high)
    value, reach = v / q.factor, 1.96 * sd / q.factor  # 95 % of a normal distribution
    near = 1e-6 * max(abs(value), abs(q.typical) * 1e-3)
    return {
        "value": value, "unit": q.unit, "low": max(value - reach, low), "high": min(value + reach, high),
        "at_bound": bool(value - low < near or high - value < near),
    }  # fmt: skip


def _section(s: Section) -> dict:
    mm = s.in_mm_and_N()
    return {
        "experiment": s.experiment.id,
        "regime": s.regime or None,
        "from_mm": mm[0] if mm else s.start if s.experiment.x_unit == "mm" else None,
        "to_mm": mm[1] if mm else s.end if s.experiment.x_unit == "mm" else None,
        "bias_N": mm[2] if mm else None,
        "z": s.z,
        "from": s.start,
        "to": s.end,
        "x": s.experiment.x_name,
        "x_unit": s.experiment.x_unit,
        "bias": s.bias,
        "unit": s.experiment.y_unit,
    }


def _train(d: Discovery) -> dict | None:
    """Root mean square errors of the fitted tests before and after, and what scatter and noise make."""
    if d.first is None or d.final is None:
        return None
    units = {e.y_unit for e in d.campaign.train}
    relative, sums, count = len(units) > 1, np.zeros(3), 0
    for id, block in d.first.w.tests.items():
        scale = float(np.abs(d.first.w.grids[id].mean).max()) if relative else 1.0
        parts = d.first.at.residual[id] ** 2, d.final.at.residual[id] ** 2, block.deviation**2
        sums += [p.sum() / scale**2 for p in parts]
        count += block.deviation.size
    before, after, floor = np.sqrt(sums / count)
    return {"baseline_rmse": before, "extended_rmse": after, "noise_floor": floor,
            "unit": "1" if relative else units.pop()}  # fmt: skip


def _residual(step: ComparisonRound) -> dict:
    s = step.scores
    return {
        "chi2": s.chi2, "expected_chi2": s.expected, "degrees_of_freedom": s.dof, "chance": s.p_residual,
        "significant": step.significant,
    }  # fmt: skip


def _model(fitted: Estimated | None) -> dict | None:
    if fitted is None:
        return None
    sd, model = np.sqrt(np.diag(fitted.covariance)), fitted.case.model
    parameters = {
        u.label: {"value": u.value(x) / u.quantity.factor, "sd": s * abs(u.slope(x)) / u.quantity.factor,
                  "unit": u.quantity.unit}
        for u, x, s in zip(fitted.posterior.parameters, fitted.q, sd, strict=True)
    }  # fmt: skip
    return {"model": model.described, "mechanisms": list(model.mechanisms), "parameters": parameters}


def _round(step: ComparisonRound, d: Discovery) -> dict:
    taken = next((f.name for f in d.found if f.step is step), None)
    return {
        "mechanisms": list(step.null.case.mechanisms),
        "accepted": taken,
        "cannot_be_told_apart": [c.name for c in step.group],
        "residual": _residual(step),
        "candidates": [_ranked(s, c, d.names) for s, c in step.ranking],
        "left_out": dict(step.left_out),
        "not_tried": dict(step.failed),
    }
