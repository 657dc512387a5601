"""What a fit says: as a record for text and notebook, and as plain data."""

from __future__ import annotations

import math
from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import numpy as np

from cutbench.base.figure_style import save
from cutbench.base.files import check_writable, picked, write_json
from cutbench.base.report import Chapter, Report, Table
from cutbench.base.versions import versions
from cutbench.calibration.case_file import write_case
from cutbench.calibration.figure import plot as plot
from cutbench.calibration.figure import plot_fit
from cutbench.calibration.fitting import ComparedCurve, Fit
from cutbench.calibration.settings import SETTINGS
from cutbench.data.measures import MeasuredCut


def by_regime(c: ComparedCurve) -> dict[str, dict[str, float]]:
    """Range in mm, mean and root mean square of the residual in N, and the largest in standard deviations."""
    regimes = {}
    for name, mask in c.regimes().items():
        x, r = c.x[mask], c.residual[mask]
        regimes[name] = {
            "from_mm": float(x[0]), "to_mm": float(x[-1]), "bias_N": float(r.mean()),
            "rms_N": float(np.sqrt((r**2).mean())), "largest_z": float(np.abs(r / c.sd[mask]).max()),
        }  # fmt: skip
    return regimes


def report(fit: Fit) -> Report:
    """All that a fit says to a person."""
    k, curves = len(fit.estimates), [c for c in fit.compared if c.experiment.role == "train"]
    # A discrepancy above a hundredth of a curve's maximum is said to be one.
    wrong = fit.done and (fit.reduced_chi2 > 2 or max((c.misfit for c in curves), default=0.0) > 0.01)
    worst = max((c.relative_rmse for c in curves if c.experiment.curve), default=0.0)
    pairs = [(a, b, f"{value:+.2f}") for a, b, value in _pairs(fit)]
    # Beside a model that misses them, the square of readings in units of what it misses says nothing.
    chi2 = "" if wrong or not fit.done else f" chi2 = {fit.chi2:.4g}, reduced {fit.reduced_chi2:.3g},"
    values = (
        f"{fit.readings} values, {k} parameter{'s' * (k != 1)},{chi2} {fit.runs} cuts computed,"
        f" {fit.seconds:.0f} s"
    )
    misses = (
        "The model does not describe the data to within their noise: it misses up to"
        f" {100 * worst:.1f} % of a curve's maximum (root mean square); intervals allow for that."
    )
    return Report(
        fit.campaign.title,
        [("model", fit.case.model.described), ("status", fit.message or fit.status), ("compared", values)],
        (fit.far, misses if wrong and not fit.far else ""),
        (
            Chapter(
                "parameters (95 % intervals)" if fit.done else "parameters, not estimated",
                [_parameters(fit)],
                brief=True,
            ),
            Chapter("correlations above 0.3", [Table(("of", "and", "is"), pairs)]),
            Chapter("experiments", [_experiments(fit)], brief=True),
            Chapter("regimes", [_regimes(fit)]),
            Chapter("measures of a cut", [_measures(fit)]),
            Chapter("profiles", [_profiles(fit)]),
            Chapter("identifiability before the fit", fit.before.sentences),
            Chapter("identifiability after the fit", fit.after.sentences),
            Chapter("notes", fit.notes),
        ),
    )


def _parameters(fit: Fit) -> Table:
    rows = []
    for e in fit.estimates:
        show = e.parameter.quantity.show
        relative = f" ({100 * e.sd / abs(e.value):.2g} %)" if e.value else ""
        flags = [text for is_so, text in ((e.at_bound, "at a bound"), (not e.moved, "not moved")) if is_so]
        estimate = [f"{show(e.value)} +/- {show(e.sd)}{relative}", f"[{show(e.low)}, {show(e.high)}]"]
        said = estimate if math.isfinite(e.sd) else [f"{show(e.value)} reached", ""]
        rows.append((e.label, *said, f"start {show(e.parameter.start)}", ", ".join(flags)))
    rows += [(label, f"left at its start: {reason}", "", "", "") for label, reason in fit.fixed.items()]
    return Table(("parameter", "value", "interval", "from", ""), rows)


def _role(c: ComparedCurve) -> str:
    return "fitted" if c.experiment.role == "train" else "predicted"


def _experiments(fit: Fit) -> Table:
    rows = [
        (c.experiment.id, f"{c.experiment.kind}, {_role(c)}", f"{c.rmse:.3g} {c.experiment.y_unit}",
         f"{100 * c.relative_rmse:.1f} % of the maximum",
         f"{100 * c.misfit:.1f} % that the model cannot describe" if c.misfit else "")
        for c in fit.compared if c.experiment.curve
    ]  # fmt: skip
    return Table(("experiment", "kind", "root mean square residual", "", ""), rows)


def _regimes(fit: Fit) -> Table:
    rows = [
        (c.experiment.id, name, f"{v['from_mm']:.2f} to {v['to_mm']:.2f} mm", f"{v['rms_N']:.3g} N",
         f"{v['bias_N']:+.3g} N")
        for c in fit.compared for name, v in by_regime(c).items()
    ]  # fmt: skip
    return Table(("experiment", "regime", "where", "root mean square residual", "bias"), rows)


def _measures(fit: Fit) -> Table:
    """A line for each measure: what was measured, what is computed, and how far that is off."""
    rows = [
        (f"{c.experiment.id} ({_role(c)})", m.name, str(m), f"{value:.4g} {m.unit}".removesuffix(" 1"),
         f"{off:+.1f}")
        for c in fit.compared if isinstance(c.experiment, MeasuredCut)
        for m, value, off in zip(c.experiment.measures, c.computed, -c.residual, strict=True)
    ]  # fmt: skip
    return Table(("experiment", "measure", "measured", "computed", "standard deviations off"), rows)


def _profiles(fit: Fit) -> Table:
    rows = []
    for p in fit.profiles:
        show = fit.estimate(p.label).parameter.quantity.show
        ends = [show(v) if math.isfinite(v) else "beyond what was tried" for v in (p.low, p.high)]
        rows.append((p.label, *ends))
    return Table(("parameter", "from", "to"), rows)


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
    return report(fit).text()


def summary_lines(fit: Fit) -> list:
    """Head, then pairs of words."""
    return report(fit).summary_lines()


def table(fit: Fit) -> dict[str, list]:
    """The parameters, a row each, in the units that a person writes."""
    rows = _values(fit)
    keys = ("value", "low", "high", "unit", "at_bound")
    return {"parameter": list(rows)} | {key: [row[key] for row in rows.values()] for key in keys}


def _measured(c: ComparedCurve, e: MeasuredCut) -> list[dict]:
    """The same as plain data; what has no end, and what the computed curve does not have, is null."""
    rows = []
    for m, value, off in zip(e.measures, c.computed, -c.residual, strict=True):
        ends = {"low": m.low, "high": m.high, "sd": m.sd, "computed": value}
        known = {key: v if math.isfinite(v) else None for key, v in ends.items()}
        rows.append({"measure": m.name, "unit": m.unit, **known, "standard_deviations_off": float(off)})
    return rows


def _pairs(fit: Fit) -> list[tuple[str, str, float]]:
    numbered = enumerate(e.label for e in fit.estimates)
    pairs = [(a, b, float(fit.correlation[i, j])) for (i, a), (j, b) in combinations(numbered, 2)]
    return sorted((p for p in pairs if abs(p[2]) >= 0.3), key=lambda p: -abs(p[2]))


def _values(fit: Fit) -> dict[str, dict]:
    """What is known of each parameter, by its label, in the units that a person writes."""
    return {
        e.label: {
            **{key: getattr(e, key) / q.factor for key in ("value", "low", "high", "sd")},
            "start": e.parameter.start / q.factor,
            "unit": q.unit,
            "experiment": e.parameter.experiment,
            "degrees_of_freedom": e.dof,
            "at_bound": e.at_bound,
            "moved": e.moved,
        }
        for e, q in ((e, e.parameter.quantity) for e in fit.estimates)
    }


def to_dict(fit: Fit) -> dict:
    """Plain data with units; the arrays of the curves included."""
    return {
        "schema": 1,
        "title": fit.campaign.title,
        "model": fit.case.model.described,
        "status": fit.status,
        "message": fit.message,
        "parameters": _values(fit),
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
    return {
        "kind": e.kind,
        "role": e.role,
        "repetitions": len(e.repetitions),
        "x_unit": e.x_unit,
        "y_unit": e.y_unit,
        "rmse": c.rmse,
        "rmse_of_maximum": c.relative_rmse,
        "discrepancy_of_maximum": c.misfit if c.discrepancy is not None else None,
        "contact": {
            r.name: picked(r.contact, "at", "sd", "force", "force_sd", "unit", "taken_off")
            for r in e.repetitions
            if r.contact is not None
        },
        "onset_mm": c.onset_mm,
        "regimes": by_regime(c),
        "measures": _measured(c, e) if isinstance(e, MeasuredCut) else [],
        "x": c.x.tolist(),
        "measured": c.mean.tolist(),
        "sd": c.sd.tolist(),
        "fitted": c.fitted.tolist(),
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
        Where to; made if need be.

    Returns
    -------
    list of Path
        What was written.
    """
    path, case = fit.campaign.path, check_writable(folder) / "fitted.toml"
    paths = [write_json(to_dict(fit), folder / "fit.json")]
    if not fit.done:
        case.unlink(missing_ok=True)
    else:
        note = f"Fitted to {path.name if path else 'a campaign'}: {fit.status}"
        paths.append(write_case(fit.campaign, fit.case, note, remarks(fit), case))
    return [*paths, *(save(plot_fit(fit), folder / "fit.png") if fit.compared else [])]


#: What ``Fit.save`` calls.
write = write_fit


def remarks(fit: Fit) -> dict[str, str]:
    """What is known of each fitted value, by name."""
    return {
        e.parameter.name: "mean of one value for each experiment"
        if e.parameter.experiment is not None
        else f"fitted, 95 %: {show(e.low)} to {show(e.high)}"
        for e, show in ((e, e.parameter.quantity.show) for e in fit.estimates)
    }
