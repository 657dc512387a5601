"""What a fit says: by regime of the cut, as text in the manner of lmfit, and as plain data."""

from __future__ import annotations

import math
from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import numpy as np

from cutbench.base.files import picked, write_json
from cutbench.base.versions import versions
from cutbench.calibration.case_file import write_case
from cutbench.calibration.fitting import ComparedCurve, Estimate, Fit
from cutbench.calibration.settings import SETTINGS
from cutbench.data.measures import MeasuredCut

#: Layout of fit.json.
SCHEMA = 1
#: A discrepancy above this part of a curve's maximum is said to be one.
AMISS = 0.01
#: Correlations below this are not worth a line.
SHOWN = 0.3


def by_regime(c: ComparedCurve) -> dict[str, dict[str, float]]:
    """Range in mm, mean and root mean square of the residual in N, and the largest in standard deviations."""
    names, found = ("from_mm", "to_mm", "bias_N", "rms_N", "largest_z"), {}
    for name, mask in c.regimes().items():
        x, r = c.x[mask], c.residual[mask]
        values = x[0], x[-1], r.mean(), np.sqrt((r**2).mean()), np.abs(r / c.sd[mask]).max()
        found[name] = dict(zip(names, map(float, values), strict=True))
    return found


def summary(fit: Fit) -> str:
    """Write the report of a fit as text.

    Parameters
    ----------
    fit : Fit
        The fit.

    Returns
    -------
    str
        Several lines: status, parameters with intervals, correlations, tests, identifiability, notes.
    """
    k = len(fit.estimates)
    lines = [
        fit.campaign.title,
        *([f"  {fit.far}"] if fit.far else []),
        f"  model: {fit.case.model.described}",
        f"  {fit.message}",
        f"  {fit.readings} values, {k} parameter{'s' if k != 1 else ''}, chi2 = {fit.chi2:.4g},"
        f" reduced {fit.reduced_chi2:.3g}, {fit.runs} cuts computed, {fit.seconds:.0f} s",
    ]
    worst = max((c.misfit for c in fit.compared), default=0.0)
    if fit.done and not fit.far and (fit.reduced_chi2 > 2 or worst > AMISS):
        lines.append(
            "  The model does not describe the data to within their noise: it misses up to"
            f" {100 * worst:.1f} % of a curve's maximum (root mean square); intervals allow for that."
        )
    lines += ["", "parameters (95 % intervals)" if fit.done else "parameters, not estimated"]
    lines += [_parameter(e) for e in fit.estimates]
    lines += [f"  {label:<16} left at its start: {reason}" for label, reason in fit.fixed.items()]
    if pairs := _pairs(fit):
        lines += ["", f"correlations above {SHOWN:g}"]
        lines += [f"  {a}, {b}: {value:+.2f}" for a, b, value in pairs]
    lines += ["", "experiments"]
    for c in fit.compared:
        if isinstance(c.experiment, MeasuredCut):
            lines += _measures(c, c.experiment)
            continue
        unit = c.experiment.y_unit
        part, role = c.rmse / np.abs(c.mean).max(), "fitted" if c.experiment.role == "train" else "predicted"
        beyond = f", {100 * c.misfit:.1f} % that the model cannot describe" if c.misfit else ""
        lines.append(
            f"  {c.experiment.id} ({c.experiment.kind}, {role}): root mean square residual"
            f" {c.rmse:.3g} {unit}, {100 * part:.1f} % of the maximum{beyond}"
        )
        lines += [
            f"    {name:<12} {v['from_mm']:.2f} to {v['to_mm']:.2f} mm: {v['rms_N']:.3g} N,"
            f" bias {v['bias_N']:+.3g} N"
            for name, v in by_regime(c).items()
        ]
    for profile in fit.profiles:
        q = fit.estimate(profile.label).parameter.quantity
        ends = [
            q.show(v) if math.isfinite(v) else "beyond what was tried" for v in (profile.low, profile.high)
        ]
        lines.append(f"  profile of {profile.label}: {ends[0]} to {ends[1]}")
    for title, said in (("before the fit", fit.before), ("after the fit", fit.after)):
        if said.sentences:
            lines += ["", f"identifiability {title}", *(f"  {s}" for s in said.sentences)]
    if fit.notes:
        lines += ["", "notes", *(f"  {note}" for note in fit.notes)]
    return "\n".join(lines)


def _measures(c: ComparedCurve, e: MeasuredCut) -> list[str]:
    """A line for each measure: what was measured, what is computed, and how far that is off."""
    role = "fitted" if e.role == "train" else "predicted"
    lines = [f"  {e.id} (measures of a cut, {role}): measured, computed, standard deviations off"]
    for m, value, off in zip(e.measures, c.computed, -c.residual, strict=True):
        unit = "" if m.unit == "1" else f" {m.unit}"
        lines.append(f"    {m.name:<13} {m!s:<20} {value:.4g}{unit}   {off:+.1f}")
    return lines


def _measured(c: ComparedCurve, e: MeasuredCut) -> list[dict]:
    """The same as plain data; what has no end, and what the computed curve does not have, is null."""
    rows = []
    for m, value, off in zip(e.measures, c.computed, -c.residual, strict=True):
        ends = {"low": m.low, "high": m.high, "sd": m.sd, "computed": value}
        known = {key: v if math.isfinite(v) else None for key, v in ends.items()}
        rows.append({"measure": m.name, "unit": m.unit, **known, "standard_deviations_off": float(off)})
    return rows


def _parameter(e: Estimate) -> str:
    q = e.parameter.quantity
    if math.isnan(e.sd):
        return f"  {e.label:<16} {q.show(e.value)} reached   start {q.show(e.parameter.start)}"
    flags = [text for is_so, text in ((e.at_bound, "at a bound"), (not e.moved, "not moved")) if is_so]
    relative = f" ({100 * e.sd / abs(e.value):.2g} %)" if e.value else ""
    return (
        f"  {e.label:<16} {q.show(e.value)} +/- {q.show(e.sd)}{relative}"
        f"   [{q.show(e.low)}, {q.show(e.high)}]   start {q.show(e.parameter.start)}"
        + "".join(f"   {flag}" for flag in flags)
    )


def _pairs(fit: Fit) -> list[tuple[str, str, float]]:
    numbered = enumerate(e.label for e in fit.estimates)
    pairs = [(a, b, float(fit.correlation[i, j])) for (i, a), (j, b) in combinations(numbered, 2)]
    return sorted((p for p in pairs if abs(p[2]) >= SHOWN), key=lambda p: -abs(p[2]))


def to_dict(fit: Fit) -> dict:
    """Plain data with units; the arrays of the curves included."""
    parameters = {}
    for e in fit.estimates:
        q = e.parameter.quantity
        parameters[e.label] = {
            **{key: getattr(e, key) / q.factor for key in ("value", "low", "high", "sd")},
            "start": e.parameter.start / q.factor,
            "unit": q.unit,
            "experiment": e.parameter.experiment,
            "degrees_of_freedom": e.dof,
            "at_bound": e.at_bound,
            "moved": e.moved,
        }
    return {
        "schema": SCHEMA,
        "title": fit.campaign.title,
        "model": fit.case.model.described,
        "status": fit.status,
        "message": fit.message,
        "parameters": parameters,
        "left_at_start": dict(fit.fixed),
        "correlations": [{"of": [a, b], "value": v} for a, b, v in _pairs(fit)],
        "chi2": fit.chi2,
        "reduced_chi2": fit.reduced_chi2,
        "values_compared": fit.readings,
        "experiments": {c.experiment.id: _experiment(c) for c in fit.compared},
        "profiles": [_profile(fit, p) for p in fit.profiles],
        "identifiability": {
            when: {
                "singular_values": said.singular_values.tolist(),
                "parameters": list(said.labels),
                "sd_scaled": said.joint.tolist(),
                "sentences": list(said.sentences),
            }
            for when, said in (("before", fit.before), ("after", fit.after))
        },
        "notes": list(fit.notes),
        "cuts_computed": fit.runs,
        "settings": asdict(SETTINGS),
        "seconds": fit.seconds,
        "case": fit.case.to_dict(),
        "versions": versions(),
    }


def _experiment(c: ComparedCurve) -> dict:
    e = c.experiment
    curves = {"x": c.x, "measured": c.mean, "sd": c.sd, "fitted": c.fitted}
    return {
        "kind": e.kind,
        "role": e.role,
        "repetitions": len(e.repetitions),
        "x_unit": e.x_unit,
        "y_unit": e.y_unit,
        "rmse": c.rmse,
        "rmse_of_maximum": c.rmse / float(np.abs(c.mean).max()),
        "discrepancy_of_maximum": c.misfit if c.discrepancy is not None else None,
        "contact": {
            r.name: picked(r.contact, "at", "sd", "force", "force_sd", "unit", "taken_off")
            for r in e.repetitions
            if r.contact is not None
        },
        "onset_mm": c.onset_mm,
        "regimes": by_regime(c),
        "measures": _measured(c, e) if isinstance(e, MeasuredCut) else [],
        **{name: values.tolist() for name, values in curves.items()},
    }


def _profile(fit: Fit, p) -> dict:
    q = fit.estimate(p.label).parameter.quantity
    ends = {key: getattr(p, key) / q.factor for key in ("low", "high")}
    return {"parameter": p.label, "unit": q.unit, "values": (p.values / q.factor).tolist(),
            "chi2_rise": p.rise.tolist(), **ends}  # fmt: skip


def write_fit(fit: Fit, folder: Path) -> list[Path]:
    """Write ``fit.json``, ``fit.png`` and the case file ``fitted.toml``, each whole or not at all.

    A fit that was stopped before its end has no case file.

    Parameters
    ----------
    fit : Fit
        The fit.
    folder : Path
        Where to; it must be there.

    Returns
    -------
    list of Path
        What was written.
    """
    from cutbench.base.figure_style import save
    from cutbench.calibration.figure import plot_fit

    paths = [write_json(to_dict(fit), folder / "fit.json")]
    path, case = fit.campaign.path, folder / "fitted.toml"
    if not fit.done:
        case.unlink(missing_ok=True)
    else:
        note = f"Fitted to {path.name if path else 'a campaign'}: {fit.status}"
        paths.append(write_case(fit.campaign, fit.case, note, remarks(fit), case))
    return [*paths, *(save(plot_fit(fit), folder / "fit.png") if fit.compared else [])]


def remarks(fit: Fit) -> dict[str, str]:
    """What is known of each fitted value, by name."""
    found: dict[str, str] = {}
    for e in fit.estimates:
        if e.parameter.experiment is not None:
            found[e.parameter.name] = "mean of one value for each experiment"
        else:
            q = e.parameter.quantity
            found[e.parameter.name] = f"fitted, 95 %: {q.show(e.low)} to {q.show(e.high)}"
    return found
