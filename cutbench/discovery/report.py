"""What a discovery says: in sentences, as text for the terminal, and as ``discovery.json``."""

from __future__ import annotations

import math

import numpy as np

from cutbench.base.units import Parameter
from cutbench.base.versions import versions
from cutbench.discovery.candidates import cause_of, family_of
from cutbench.discovery.causes import Cause
from cutbench.discovery.heldout import compare
from cutbench.discovery.outcome import CHANCE, Discovery, Round, Tried
from cutbench.discovery.point import Point
from cutbench.discovery.score import Score
from cutbench.discovery.where import Section
from cutbench.mechanisms import registry

SCHEMA = 1
#: 95 % of a normal distribution lie within so many standard deviations.
WIDE = 1.96
#: Where more than this part of what was wrong remains, what was found is said to be a part of it.
PART = 0.25
#: What is reported of a gain.
GAIN = ("baseline_rmse", "extended_rmse", "noise_floor", "unit", "gain", "gain_se", "how")


def called(name: str) -> str:
    """Class and formula of a cause: ``strain stiffening (gent)``, ``the fixed value of nu``; of a rig or a
    reading its title."""
    if name not in registry():
        return f"the fixed value of {name}"
    words = family_of(name) if cause_of(name) == "mechanism" else registry()[name].title
    return words if words.lower() == name.lower() else f"{words} ({name})"


def verdict_sentence(d: Discovery) -> str:
    """The sentence that names the cause, or says that there is none to name."""
    if d.verdict == "none":
        but = ", but for what happened once in a cut" if d.once else ""
        return f"The baseline describes the tests to within their scatter{but}: nothing needs to be added."
    names, worst = " and ".join(called(n) for n in d.found), d.wrong[0]
    place = f"'{worst.experiment.id}', {_place(worst)}"
    if d.verdict == "unexplained" and d.numerics.explains:
        return (
            f"The baseline is wrong (most in {place}), and a numerical choice, {d.numerics.explains},"
            " explains that as well as any mechanism: no physical cause can be named before that is settled."
        )
    if d.verdict == "undecided":
        part = f"{names[0].upper()}{names[1:]} explains a part of that; " if d.found else ""
        early = {"the search ended early": d.stopped} if d.stopped else {}
        why = early | {called(name): reason for name, reason in d.not_tried.items()}
        reasons = "; ".join(": ".join(each) for each in why.items())
        return (
            f"The baseline is wrong beyond the scatter (most in {place}). {part}the cause is undecided, since"
            f" candidates could not be tried: {reasons or 'there were none'}."
        )
    if d.verdict == "unexplained":
        return (
            f"The baseline is wrong beyond the scatter (most in {place}), and none of the candidates explains"
            " it: the cause is unexplained."
        )
    first = d.telling.accepted or ""
    others = [n for n in d.telling.group if family_of(n) != family_of(first) and n not in d.found]
    physics = any(cause_of(n) == "mechanism" for n in d.found)
    part = "A part of what" if remains(d) and d.rest > PART else "What"
    text = f"{part} the baseline {'lacks' if physics else 'gets wrong'} is {names}"
    if others:
        it = called(first) if len(d.found) > 1 else "it"
        text += f"; these data cannot tell {it} from {' or '.join(called(n) for n in others)}"
    return " ".join([text + ".", *(meaning(n) for n in d.found), *_shares(d)])


def remains(d: Discovery) -> bool:
    """Whether what was found leaves more than scatter."""
    return d.rounds[-1].scores.p_residual < CHANCE


def _shares(d: Discovery) -> list[str]:
    """Of several causes what each gains; what is left of what was wrong, where that is more than scatter."""
    words = []
    if len(d.causes) > 1:
        each = [f"{c.name} {c.alone.percent}" for c in d.causes if c.alone is not None]
        words.append(f"Beside the others each gains on held-out data: {', '.join(each)}.")
    if remains(d):
        id, part = max(d.final.misfit.items(), key=lambda item: item[1])
        words.append(
            f"{100 * d.rest:.0f} % of what was wrong remains, in '{id}' {100 * part:.2g} % of its maximum."
        )
    return words


def meaning(name: str) -> str:
    """What a mechanism does: the first line that its file says of it."""
    if name not in registry():
        return f"Measure {name}, or leave it to the fit."
    return (type(registry()[name]).__doc__ or "").strip().splitlines()[0]


def gain_sentence(d: Discovery) -> str:
    """What the extension gains on data that it was not fitted to."""
    if d.gain is None:
        return ""
    g = d.gain
    where = "experiments that were not fitted" if g.how.startswith("test") else f"held-out data ({g.how})"
    unit = "of the maximum" if g.unit == "1" else g.unit
    return (
        f"On {where} the error falls from {g.baseline_rmse:.3g} to {g.extended_rmse:.3g} {unit}, by"
        f" {100 * g.gain:.0f} ± {100 * g.gain_se:.0f} %; the scatter alone makes {g.noise_floor:.2g}."
    ) + _clean(d)


def _clean(d: Discovery) -> str:
    if d.clean is not None:
        return f" Without noise and scatter of specimens it would fall by {d.clean.text}."
    beyond = math.nan if d.gain is None else d.gain.beyond_scatter
    return "" if math.isnan(beyond) else f" Of what is beyond it, {100 * beyond:.0f} % goes."


def _place(s: Section) -> str:
    regime = f"{s.regime}, " if s.regime else ""
    return f"{regime}{s.experiment.x_name} {s.range}"


def summary(d: Discovery) -> str:
    """For the terminal."""
    lines = [
        d.campaign.title,
        *([d.fit.far] if d.fit.far else []),
        f"baseline: {d.first.case.model.described}",
        f"verdict: {d.verdict}",
        verdict_sentence(d),
    ]
    if text := gain_sentence(d):
        lines.append(text)
    wrong = [s for s in d.wrong if s.wrong][:6]
    if wrong:
        lines += ["", "where the baseline is wrong (measured less computed)"]
        lines += [
            f"  {s.experiment.id}: {_place(s)}: {s.bias:+.3g} {s.experiment.y_unit}, z = {s.z:+.1f}"
            for s in wrong
        ]
    if d.numerics.scores:
        lines += ["", "numerical causes"]
        lines += [f"  {s.name}: z = {s.z:.1f}, would explain {100 * max(d.numerics.shares[s.name], 0):.0f} %"
                  for s in d.numerics.scores]  # fmt: skip
    for number, r in enumerate(d.rounds, 1):
        if r.scores.scores:
            lines += ["", f"candidates, round {number}: score z, part explained, gain on held-out data"]
            lines += ["  " + _line(s, t, r.accepted) for s, t in r.candidates[:10]]
    lines += ["", f"next experiment: {d.next_experiment}"]
    if d.notes:
        lines += ["", "notes", *(f"  {note}" for note in d.notes)]
    return "\n".join(lines)


def _line(s: Score, t: Tried | None, accepted: str | None) -> str:
    text = f"{s.name:<20} z = {s.z:4.1f}"
    if t is None:
        return text
    values = ", ".join(f"{q.symbol} = {q.show(v)}" for q, v, _ in estimates(t))
    mark = " <- added" if accepted == s.name else ""
    return f"{text}  {100 * t.share:4.0f} %  {t.heldout.percent}  {values}{mark}"


def estimates(t: Tried) -> list[tuple[Parameter, float, float]]:
    """Parameters of the candidate with values and standard deviations, internal units; inf: not
    determined."""
    c, point = t.score.column.candidate, t.point
    deviations = point.deviations() * math.sqrt(max(point.chi2 / max(point.r.size - point.q.size, 1), 1.0))
    known = {
        u.name: (u.value(x), sd * abs(u.slope(x)))
        for u, x, sd in zip(point.inverse.unknowns, point.q, deviations, strict=True)
    }
    return [(q, *known.get(q.name, (point.case.values[q.name], math.inf))) for q in c.parameters]


def to_dict(d: Discovery) -> dict:
    """Plain data with units."""
    explains = d.numerics.shares
    return {
        "schema": SCHEMA,
        "title": d.campaign.title,
        "status": d.stopped or "complete",
        "verdict": d.verdict,
        "found": list(d.found),
        "causes": [_cause(c) for c in d.causes],
        "remains_of_what_was_wrong": d.rest,
        "misfit": {"baseline": dict(d.first.misfit), "extended": dict(d.final.misfit)},
        "kinds": {name: cause_of(name) for name in d.found},
        "sentence": verdict_sentence(d),
        "gain_sentence": gain_sentence(d),
        "ranking": [_ranked(s, t, d.telling) for s, t in _ranking(d.telling)],
        "not_tried": d.not_tried,
        "confounded": [list(group) for group in d.groups],
        "where_wrong": [_section(s) for s in d.wrong if s.wrong],
        "remains": [_section(s) for s in d.left if s.wrong],
        "gain": {
            "train": _train(d),
            "heldout": _fields(d.gain or compare(d.first, d.final), *GAIN),
            "clean": None if d.clean is None else _fields(d.clean, "value", "low", "high", "near"),
        },
        "next_experiment": d.next_experiment,
        "proposed_experiments": [
            {"experiment": p.text, "standard_errors": p.apart, "difference_of_maximum": p.part}
            for p in d.proposed
        ],
        "numerical": [
            {"cause": s.name, "what": s.column.candidate.title, "score_z": s.z, "explains": explains[s.name]}
            for s in d.numerics.scores
        ],
        "numerical_not_computed": dict(d.numerics.missing),
        "residual": {"baseline": _residual(d.rounds[0]), "extended": _residual(d.rounds[-1])},
        "baseline": _model(d.first),
        "extended": _model(d.final),
        "rounds": [_round(r) for r in d.rounds],
        "bias_is": "measured less computed",
        "seconds": d.seconds,
        "notes": list(d.notes),
        "case": d.final.case.to_dict(),
        "versions": versions(),
    }


def _cause(c: Cause) -> dict:
    """Name, kind, and what the model gains by it beside the others."""
    alone = {} if c.alone is None else _fields(c.alone, *GAIN)
    return {
        "name": c.name, "title": c.candidate.title, "kind": c.candidate.cause, "class": family_of(c.name),
        "beside_the_others": alone,
    }  # fmt: skip


def _ranking(r: Round) -> list[tuple[Score, Tried | None]]:
    """The accepted one, the other fitted candidates, then the others by their score."""
    return sorted(r.candidates, key=lambda pair: pair[0].name != r.accepted)


def _ranked(s: Score, t: Tried | None, r: Round) -> dict:
    entry = {
        "mechanism": s.name,
        "title": s.column.candidate.title,
        "kind": s.column.candidate.cause,
        "score_z": s.z,
        "fitted": t is not None,
    }
    if t is None:
        c = s.column.candidate
        values = dict(zip([q.name for q in c.strengths], s.strengths, strict=True))
        shown = {q.name: _value(q, q.off_value + values[q.name], math.inf) for q in c.strengths}
        return {**entry, "parameters": shown, "gain_heldout": None, "gain_se": None}
    return {
        **entry,
        "parameters": {q.name: _value(q, v, sd) for q, v, sd in estimates(t)},
        "gain_heldout": t.heldout.gain,
        "gain_se": t.heldout.gain_se,
        "heldout": t.heldout.how,
        "likelihood_gain_heldout": t.heldout.better,
        "likelihood_gain_se": t.heldout.better_se,
        "explains": t.share,
        "chance": t.p_any,
        "chi2_above_best": t.behind,
        "chi2_above_best_se": t.behind_se,
        "shapes_determined": not t.shapes_open,
        "accepted": r.accepted == s.name,
    }


def _value(q: Parameter, v: float, sd: float) -> dict:
    low, high = (-math.inf if q.low is None else q.low, math.inf if q.high is None else q.high)
    value = v / q.factor
    reach = WIDE * sd / q.factor
    near = 1e-6 * max(abs(value), abs(q.typical) * 1e-3)
    return {
        "value": value,
        "unit": q.unit,
        "low": max(value - reach, low),
        "high": min(value + reach, high),
        "at_bound": bool(value - low < near or high - value < near),
    }


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


def _fields(one: object, *names: str) -> dict:
    return {name: getattr(one, name) for name in names}


def _train(d: Discovery) -> dict:
    """Root mean square errors of the fitted tests before and after, and what scatter and noise make."""
    units = {e.y_unit for e in d.campaign.train}
    relative = len(units) > 1
    sums, count = np.zeros(3), 0
    for e in d.campaign.train:
        grid = d.first.inverse.grids[e.id]
        scale = float(np.abs(grid.mean).max()) if relative else 1.0
        sd = d.first.w.tests[e.id].deviation
        parts = (d.first.residual[e.id] ** 2, d.final.residual[e.id] ** 2, sd**2)
        sums += [p.sum() / scale**2 for p in parts]
        count += grid.x.size
    errors = dict(zip(GAIN[:3], np.sqrt(sums / count), strict=True))
    return {**errors, "unit": "1" if relative else units.pop()}


def _residual(r: Round) -> dict:
    s = r.scores
    return {
        "chi2": s.chi2, "expected_chi2": s.expected, "degrees_of_freedom": s.dof, "chance": s.p_residual,
        "significant": s.p_residual < CHANCE,
    }  # fmt: skip


def _model(p: Point) -> dict:
    deviations = p.deviations()
    parameters = {
        u.label: {"value": u.value(x) / u.quantity.factor, "sd": sd * abs(u.slope(x)) / u.quantity.factor,
                  "unit": u.quantity.unit}
        for u, x, sd in zip(p.inverse.unknowns, p.q, deviations, strict=True)
    }  # fmt: skip
    model = p.case.model
    return {"model": model.described, "mechanisms": list(model.mechanisms), "parameters": parameters}


def _round(r: Round) -> dict:
    return {
        "mechanisms": list(r.point.case.mechanisms),
        "accepted": r.accepted,
        "cannot_be_told_apart": list(r.group),
        "residual": _residual(r),
        "candidates": [_ranked(s, t, r) for s, t in r.candidates],
        "left_out": dict(r.left_out),
        "not_tried": dict(r.failed),
    }
