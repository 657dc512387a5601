"""Tables for the terminal: materials, mechanisms, checks of laws, a run, a campaign, measured fields."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cutbench.base.greek import plain_formula
from cutbench.base.report import Table, number
from cutbench.base.units import Parameter
from cutbench.case import materials
from cutbench.case.case import Case, load_case
from cutbench.case.model import Model
from cutbench.case.model import groups as settable_groups
from cutbench.case.model import mechanism as find_mechanism
from cutbench.cli.terminal import verbose
from cutbench.mechanisms import registry
from cutbench.mechanisms.checks import Finding
from cutbench.run.result import Result, summary_lines

if TYPE_CHECKING:
    from cutbench.data.campaign import Campaign
    from cutbench.data.experiment import Experiment
    from cutbench.data.field_comparison import Comparison


def material_table() -> Sequence[str | Table]:
    """The known materials, a column each, with values and dimensionless groups."""
    cases = [load_case(name) for name in materials.names()]
    known = {name: q for case in cases for name, q in case.model.parameters().items()}
    rows = [
        (name, *(case.shown().get(name, "-") for case in cases))
        for name, q in known.items()
        # What all have by default says nothing.
        if {case.values.get(name) for case in cases} != {q.default and q.default * q.factor}
    ]
    texts = dict.fromkeys(text for case in cases for text in case.groups())
    groups = [(plain_formula(text), *(_group(case, text) for case in cases)) for text in texts]
    note = "a is half the blade's thickness. 'cutbench materials NAME' shows sources and corrections."
    return Table(("", *(case.name for case in cases)), [*rows, (), *groups]), note


def _group(case: Case, text: str) -> str:
    return number(case.groups().get(text), ".3g")


def _groups(case: Case) -> list[tuple[str, str]]:
    return [(plain_formula(text), _group(case, text)) for text in case.groups()]


def material(source: str | Path) -> Sequence[str | Table]:
    """All about one material or case file. Raises BadInput."""
    case, about = load_case(source), materials.about(source)
    known = case.model.parameters()
    rows = [(name, known[name].symbol, text, known[name].doc) for name, text in case.shown().items()]
    heads = ("quantity", "printed", "read as", "why")
    corrections = [list(row.values()) for row in about["corrections"]]
    return [
        Table(("name", "symbol", "value", "what"), rows, case.name),
        Table(("group", "value"), _groups(case)),
        *([Table(heads, corrections, "corrections")] if corrections else []),
        *(f"{key}: {about[key]}" for key in ("note", "source", "doi") if about[key]),
        f"model: {case.model.described}",
    ]


def mechanism_table() -> Sequence[str | Table]:
    """All mechanisms, with what they need and the group a person may set."""
    laws = [
        (
            m.slot, m.name, m.role or "-",
            ", ".join(q.name if q.unit == "1" else f"{q.name} ({q.unit})" for q in m.parameters) or "-",
            ", ".join(f"{name} = {value:g}" for name, value in m.off.items()) or "-",
            m.title,
        )
        for m in registry().values()
    ]  # fmt: skip
    groups = [(g.name, plain_formula(g.text), g.parameter) for g in settable_groups().values()]
    return (
        Table(("slot", "name", "kind", "parameters", "off at", "title"), laws),
        Table(("group", "is", "sets"), groups, "dimensionless groups that can be set"),
    )


def mechanism(name: str) -> Sequence[str | Table]:
    """All about one mechanism. Raises BadInput."""
    m = find_mechanism(name, key="mechanism")
    title = f"{m.title} ({m.name})"
    heads = ("parameter", "unit", "symbol", "range", "off at", "default", "what")
    rows = [
        (q.name, q.unit, q.symbol, _range(q), number(q.off), number(q.default), q.doc) for q in m.parameters
    ]
    # The texts of its groups are found by asking for them at some values.
    model = Model().with_(m.name)
    some = {q.name: q.typical * q.factor for q in model.parameters().values()}
    said = {
        "groups": m.groups(model.namespace(some)),
        "may be set": [f"{g.name} = {g.text}" for g in m.settable],
        "reads": m.reads,
        "slot": [m.slot + (f", one of its kind: {m.role}" if m.role else "")],
    }
    doc = inspect.cleandoc(sys.modules[type(m).__module__].__doc__ or type(m).__doc__ or "")
    return [
        Table(heads, rows, title) if rows else f"{title}: no parameters",
        *(f"{key}: {', '.join(texts)}" for key, texts in said.items() if texts),
        doc,
    ]


def findings_table(found: Iterable[Finding]) -> Table:
    """What checks of laws have found, a row each."""
    rows = []
    for each in found:
        why = each.wrong or each.untested
        state = "FAILED" if each.wrong else "not tested" if each.untested else "ok"
        rows.append((each.law, each.check, state, f"{each.says}: {why}" if why else each.says))
    return Table(("law", "check", "", "what it requires, and what is wrong"), rows)


def _range(q: Parameter) -> str:
    return q.range_text() if q.low is not None or q.high is not None else "any"


def result_table(result: Result) -> Table:
    """What a run found, in the order in which a person asks; ``-v``: all measures and counters, too."""
    head, _, *lines = summary_lines(result)
    rows = [*lines, (), *_groups(result.case)]
    if verbose():
        rows += [(), *((name, number(value, ".4g")) for name, value in result.measures.items())]
        rows += [(name, str(count)) for name, count in result.counts.items()]
    return Table(("", "value"), rows, head)


def data_table(campaign: Campaign) -> Table:
    """A row for each experiment: what was done, how often, how far, and how far it scatters."""
    heads = (
        "experiment", "kind", "role", "repetitions", "readings", "from", "to", "largest", "time",
        "between specimens", "noise on the grid",
    )  # fmt: skip
    rows = []
    for e in campaign.experiments:
        if not e.curve:
            count, none = f"{e.readings} measures", ("–",) * 4
            rows.append((e.id, e.kind, e.role, "–", count, "0 mm", f"{e.reach:.4g} mm", *none))
            continue
        averaged = e.on_grid()
        unit = "" if e.x_unit == "1" else f" {e.x_unit}"
        low = min(float(r.x.min()) for r in e.repetitions)
        largest = max(float(np.abs(r.y).max()) for r in e.repetitions)
        size = float(np.sqrt(np.mean(averaged.mean**2)))
        scatter = f"{np.sqrt(np.mean(averaged.scatter**2)) / size:.1%}" if averaged.dof else "not known"
        reading = f"{np.sqrt(np.mean(averaged.reading**2)) / size:.2%}"
        rows.append((
            e.id, e.kind, e.role, str(len(e.repetitions)), str(e.readings), f"{low:.4g}{unit}",
            f"{e.reach:.4g}{unit}", f"{e.shown[0] * largest:.4g} {e.shown[1]}",
            _time(e), scatter, f"{reading} (estimated)" if averaged.estimated else reading,
        ))  # fmt: skip
    return Table(heads, rows, campaign.title, right=("repetitions", "readings"))


def _time(e: Experiment) -> str:
    if not e.timed:
        return "not known"
    unit = "1/s" if e.x_unit == "1" else "mm/s"
    history = "" if e.monotone else ", holds or returns"
    return f"{e.repetitions[0].duration_s:.4g} s at {e.travel_speed:.3g} {unit}{history}"


def averages(campaign: Campaign) -> tuple[Sequence[str], list[Sequence[object]]]:
    """The averages of all experiments on their grids, a row a place, under heads; units in the columns."""
    heads = (
        "experiment", "kind", "role", "abscissa", "abscissa_unit", "x", "time_s", "ordinate_unit", "mean",
        "sd_of_mean", "sd_specimens", "sd_reading", "repetitions", "noise_estimated",
    )  # fmt: skip
    rows: list[Sequence[object]] = []
    for e, a in ((e, e.on_grid()) for e in campaign.experiments):
        times, scatters = [None] * a.x.size if a.time_s is None else a.time_s, a.scatter if a.dof else None
        rows += [
            (e.id, e.kind, e.role, e.x_name, e.x_unit, x, times[i], e.y_unit, a.mean[i], a.deviation[i],
             None if scatters is None else scatters[i], a.reading[i], a.repetitions, int(a.estimated))
            for i, x in enumerate(a.x)
        ]  # fmt: skip
    return heads, rows


def field_table(found: Sequence[Comparison], title: str) -> Table:
    """A row for each measured field beside a run: how many points, and how far off."""
    heads = ["travel", "points compared", "mean error u_x", "mean error u_y", "rms u_x", "rms u_y"]
    heads += ["rms E_xx", "rms E_yy", "rms E_xy"]
    rows = []
    for c in found:
        n = c.numbers()
        rows.append((
            f"{c.measured.travel_mm:g} mm", f"{n['compared']:.0f} of {n['measured']:.0f}",
            *(f"{n[f'mean_error_{name}']:.1%}" for name in ("u_x", "u_y")),
            *(f"{n[f'rms_{name}_mm']:.3g} mm" for name in ("u_x", "u_y")),
            *(f"{n[f'rms_{name}']:.3g}" for name in ("E_xx", "E_yy", "E_xy")),
        ))  # fmt: skip
    return Table(heads, rows, title, right=heads)


def field_points(found: Sequence[Comparison]) -> tuple[Sequence[str], list[Sequence[float]]]:
    """Measured and computed displacements and strains, a row a point, under heads."""
    heads = (
        "travel_mm", "x_mm", "y_mm", "measured_u_x_mm", "measured_u_y_mm", "computed_u_x_mm",
        "computed_u_y_mm", "relative_error_u_x", "relative_error_u_y", "measured_E_xx", "measured_E_yy",
        "measured_E_xy", "computed_E_xx", "computed_E_yy", "computed_E_xy",
    )  # fmt: skip
    rows: list[Sequence[float]] = []
    for c in found:
        parts = [c.measured.grid, c.measured.u, c.computed.u, c.relative_error]
        parts += [e[[0, 1, 0], [0, 1, 1]] for e in (c.measured.strain, c.computed.strain)]
        columns = np.concatenate(parts).reshape(len(heads) - 1, -1)
        rows += [(c.measured.travel_mm, *row) for row in columns.T]
    return heads, rows
