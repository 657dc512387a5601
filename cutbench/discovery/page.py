"""``discovery.json`` and ``discovery.html``: one page that needs neither a network nor the tool."""

from __future__ import annotations

import html
from importlib import resources
from pathlib import Path

from cutbench.base.files import replacing, write_json
from cutbench.discovery.figures import curves, ranking, svg
from cutbench.discovery.outcome import Discovery
from cutbench.discovery.report import (
    called,
    estimates,
    gain_sentence,
    to_dict,
    verdict_sentence,
)
from cutbench.discovery.where import Section

_SAID = {
    "mechanism": "A mechanism was found",
    "none": "Nothing is missing",
    "undecided": "Something is missing, and candidates could not be tried",
    "unexplained": "Something is missing that no candidate explains",
}


def write_discovery(d: Discovery, folder: Path) -> list[Path]:
    """``discovery.json`` and ``discovery.html`` in ``folder``, each whole or not at all."""
    write_json(to_dict(d), folder / "discovery.json")
    with replacing(folder / "discovery.html") as draft:
        draft.write_text(page(d), encoding="utf-8")
    return [folder / "discovery.json", folder / "discovery.html"]


def page(d: Discovery) -> str:
    """The whole page as HTML."""
    template = resources.files("cutbench.discovery").joinpath("page.html").read_text(encoding="utf-8")
    data = to_dict(d)
    pictures = svg(curves(d), "curves")
    rank = ranking(d)
    parts = {
        "TITLE": _text(d.campaign.title),
        "VERDICT": _SAID[d.verdict],
        "CLASS": d.verdict,
        "SENTENCE": _text(verdict_sentence(d)),
        "MODEL": _text(d.first.case.model.described),
        "GAIN": _text(gain_sentence(d)),
        "CURVES": pictures,
        "CAPTION": _caption(d),
        "WRONG": _sections(
            [s for s in d.wrong if s.wrong], "Nowhere by more than three standard deviations."
        ),
        "RANKING": (svg(rank, "ranking") if rank is not None else "") + _ranking(d),
        "FOUND": _found(d),
        "NUMERICAL": _numerical(d),
        "REMAINS": _remains(d),
        "NEXT": _text(d.next_experiment),
        "ERRORS": _errors(data["gain"]),
        "NOTES": "".join(f"<li>{_text(note)}</li>" for note in d.notes) or "<li>none</li>",
    }
    for key, value in parts.items():
        template = template.replace(f"__{key}__", value)
    return template


def _text(words: str) -> str:
    return html.escape(words, quote=False)


def _table(head: list[str], rows: list[list[str]]) -> str:
    """Cells are text; those that start with a digit or a sign are set as numbers."""

    def cell(text: str) -> str:
        number = text[:1].isdigit() or text[:1] in "+-−±"
        return f'<td class="number">{_text(text)}</td>' if number else f"<td>{_text(text)}</td>"

    top = "".join(f"<th>{_text(h)}</th>" for h in head)
    return (
        f"<table><tr>{top}</tr>" + "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows) + "</table>"
    )


def _caption(d: Discovery) -> str:
    more = " Blue: the extended model." if d.found else ""
    return (
        "Band: measured mean ± two standard deviations (scatter between specimens, noise, and what the mesh"
        f" leaves open). Orange dashes: the baseline.{more} Below: measured less computed."
    )


def _range(s: Section) -> str:
    unit = "" if s.experiment.x_unit == "1" else f" {s.experiment.x_unit}"
    return f"{s.start:.3g} to {s.end:.3g}{unit}"


def _sections(found: list[Section], none: str) -> str:
    if not found:
        return f"<p>{none}</p>"
    rows = []
    for s in found[:12]:
        scale, unit = (1, "N") if s.experiment.y_unit == "N" else (1e3, "kPa")
        rows.append([
            s.experiment.id, s.regime or s.experiment.kind.replace("_", " "), _range(s),
            f"{scale * s.bias:+.3g} {unit}", f"{s.z:+.1f}",
        ])  # fmt: skip
    return _table(["experiment", "where", "from – to", "measured less computed", "standard deviations"], rows)


def _ranking(d: Discovery) -> str:
    r = next((r for r in d.rounds if r.accepted), d.rounds[0])
    if not r.scores.scores:
        return "<p>No candidate was left to try.</p>"
    tried, rows = {t.name: t for t in r.tried}, []
    for name in [*tried, *(s.name for s in r.scores.scores if s.name not in tried)]:
        s = next(s for s in r.scores.scores if s.name == name)
        t = tried.get(name)
        mark = (
            "added"
            if name == r.accepted
            else "not told apart"
            if name in r.group and len(r.group) > 1
            else ""
        )
        if t is None:
            rows.append([called(name), f"{s.z:.1f}", "", "", "", mark])
            continue
        values = ", ".join(f"{q.symbol} = {q.show(float(f'{v:.3g}'))}" for q, v, _ in estimates(t))
        gain = f"{100 * t.heldout.gain:+.0f} ± {100 * t.heldout.gain_se:.0f} %"
        rows.append([called(name), f"{s.z:.1f}", f"{100 * t.share:.0f} %", gain, values, mark])
    head = [
        "candidate",
        "score (standard deviations)",
        "explains",
        "gain on held-out data",
        "fitted values",
        "",
    ]
    return _table(head, rows)


def _found(d: Discovery) -> str:
    if not d.found:
        return ""
    items = []
    for name in d.found:
        t = next(t for r in d.rounds for t in r.tried if r.accepted == name == t.name)
        values = ", ".join(
            f"{q.symbol} = {q.show(float(f'{v:.3g}'))}"
            + (f" ± {q.show(float(f'{sd:.2g}'))}" if sd < 10 * abs(v) else ", not determined by these data")
            + f" ({q.doc})"
            for q, v, sd in estimates(t)
        )
        items.append(f"<li><b>{_text(called(name))}</b>: {_text(values)}.</li>")
    return f"<ul>{''.join(items)}</ul>"


def _numerical(d: Discovery) -> str:
    if not any(e.kind == "cut" for e in d.campaign.train):
        return "<p>These tests are computed without a mesh.</p>"
    if not d.numerics.scores:
        return "<p>Not asked: the baseline does not fail.</p>"
    rows = [
        [
            f"{s.name} ({s.column.candidate.title})",
            f"{s.z:.1f}",
            f"{100 * max(d.numerics.shares[s.name], 0):.0f} %",
        ]
        for s in d.numerics.scores
    ]
    return _table(["cause", "score (standard deviations)", "would explain"], rows)


def _remains(d: Discovery) -> str:
    last = d.rounds[-1].scores
    if last.p_residual >= 0.01:
        return (
            f"<p>Nothing beyond the scatter: χ² = {last.chi2:.0f}, data that the model describes have"
            f" {last.expected:.0f} on average.</p>"
        )
    return (
        f"<p>More than the scatter: χ² = {last.chi2:.0f}, data that the model describes have"
        f" {last.expected:.0f} on"
        " average.</p>" + _sections([s for s in d.left if s.wrong], "No single section stands out.")
    )


def _errors(gain: dict) -> str:
    rows = []
    for key, words in (("train", "fitted tests"), ("heldout", f"held out: {gain['heldout']['how']}")):
        g = gain[key]
        unit = "of the maximum" if g["unit"] == "1" else g["unit"]
        rows.append(
            [words, *(f"{g[k]:.3g} {unit}" for k in ("baseline_rmse", "extended_rmse", "noise_floor"))]
        )
    return _table(["root mean square error", "baseline", "extended model", "scatter and noise alone"], rows)
