"""``discovery.json`` and ``discovery.html``: one page that needs neither a network nor the tool."""

from __future__ import annotations

import html
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from cutbench.base.files import replacing, write_json
from cutbench.calibration.case_file import write_case
from cutbench.discovery.figures import curves, ranking, svg
from cutbench.discovery.misfit_sections import Section
from cutbench.discovery.report import (
    GAIN,
    cause_title,
    estimates,
    gain_sentence,
    to_dict,
    verdict_sentence,
)
from cutbench.discovery.report import ranking as ranked
from cutbench.discovery.search import Discovery

_SAID = {
    "mechanism": "A mechanism was found",
    "none": "Nothing is missing",
    "undecided": "What is missing is not known yet",
    "unexplained": "Something is missing that no candidate explains",
}


def write_discovery(d: Discovery, folder: Path) -> list[Path]:
    """Write ``discovery.json``, ``discovery.html`` and the case file ``case.toml``, each whole or not at all.

    A discovery without a final model has no case file.

    Parameters
    ----------
    d : Discovery
        The discovery.
    folder : Path
        Where to; it must be there.

    Returns
    -------
    list of Path
        What was written.
    """
    paths = [folder / "discovery.json", folder / "discovery.html", folder / "case.toml"]
    write_json(to_dict(d), paths[0])
    name = f" of {d.campaign.path.name}" if d.campaign.path else ""
    note = f"Model at the end of a discovery{name}: {verdict_sentence(d)}"
    if d.final is None or not d.fit.done:
        paths.pop().unlink(missing_ok=True)
    else:
        remarks = {u.name: "fitted" for u in d.final.posterior.parameters}
        write_case(d.campaign, d.final.case, note, remarks, paths[2])
    with replacing(paths[1]) as draft:
        draft.write_text(page(d), encoding="utf-8")
    return paths


def page(d: Discovery) -> str:
    """The whole page as HTML."""
    template = resources.files("cutbench.discovery").joinpath("page.html").read_text(encoding="utf-8")
    rank = ranking(d)
    parts = {
        "TITLE": _text(d.campaign.title),
        "VERDICT": _SAID[d.verdict],
        "CLASS": d.verdict,
        "SENTENCE": _text(verdict_sentence(d)),
        "MODEL": _text(d.fit.case.model.described),
        "GAIN": _text(gain_sentence(d)),
        "CURVES": _wide(svg(curves(d), "curves")) if d.fit.compared else "<p>Nothing was computed.</p>",
        "CAPTION": _caption(d),
        "WRONG": _sections(d.wrong, "Nowhere by more than three standard deviations."),
        "RANKING": (_wide(svg(rank, "ranking")) if rank is not None else "") + _ranking(d),
        "FOUND": _found(d),
        "NUMERICAL": _numerical(d),
        "REMAINS": _remains(d),
        "NEXT": _text(d.next_experiment),
        "ERRORS": _errors(to_dict(d)["gain"]),
        "NOTES": "".join(f"<li>{_text(note)}</li>" for note in d.notes) or "<li>none</li>",
    }
    for key, value in parts.items():
        template = template.replace(f"__{key}__", value)
    return template


def _text(words: str) -> str:
    return html.escape(words, quote=False)


def _wide(inner: str) -> str:
    """What scrolls sideways where the page is narrow, by keys, too."""
    return f'<div class="wide" tabindex="0">{inner}</div>'


def _table(head: list[str], rows: list[list[str]]) -> str:
    """Cells are text; those that start with a digit or a sign are set as numbers."""

    def cell(text: str) -> str:
        number = text[:1].isdigit() or text[:1] in "+-−±"
        return f'<td class="number">{_text(text)}</td>' if number else f"<td>{_text(text)}</td>"

    top = "".join(f"<th>{_text(h)}</th>" for h in head)
    body = "".join(f"<tr>{''.join(map(cell, row))}</tr>" for row in rows)
    return _wide(f"<table><tr>{top}</tr>{body}</table>")


def _caption(d: Discovery) -> str:
    more = " Blue: the extended model." if d.found else ""
    return (
        "Band: measured mean ± two standard deviations (scatter between specimens, noise, and what the mesh"
        f" leaves open). Orange dashes: the baseline.{more} Below: measured less computed."
    )


def _sections(found: Sequence[Section], none: str) -> str:
    rows = []
    for s in [s for s in found if s.wrong][:12]:
        e, (scale, unit) = s.experiment, s.experiment.shown
        where, bias = s.regime or e.kind.replace("_", " "), f"{scale * s.bias:+.3g} {unit}"
        rows.append([e.id, where, s.range, bias, f"{s.z:+.1f}"])
    head = ["experiment", "where", "from – to", "measured less computed", "standard deviations"]
    return _table(head, rows) if rows else f"<p>{none}</p>"


def _ranking(d: Discovery) -> str:
    step, rows = d.telling, []
    if step is None or not step.scores.scores:
        return "<p>No candidate was tried.</p>"
    group = [c.name for c in step.group]
    marks = dict.fromkeys(group if len(group) > 1 else (), "not told apart")
    for s, c in ranked(step):
        fitted = ["", "", "", ""]
        if c is not None:
            values = ", ".join(f"{q.symbol} = {q.show(float(f'{v:.3g}'))}" for q, v, _ in estimates(c))
            fitted = [f"{c.evidence:+.1f}", f"{100 * c.explained_variance:.0f} %", c.held_out.percent, values]
        said = "added" if s.name in d.names else marks.get(s.name, "; ".join(c.doubts) if c else "")
        rows.append([cause_title(s.name), f"{s.z:.1f}", *fitted, said])
    head = [
        "score (standard deviations)",
        "log evidence",
        "explains",
        "gain on held-out data",
        "fitted values",
    ]
    return _table(["candidate", *head, "said of it"], rows)


def _found(d: Discovery) -> str:
    items = []
    for f in d.found:
        values = ", ".join(
            f"{q.symbol} = {q.show(float(f'{v:.3g}'))}"
            + (f" ± {q.show(float(f'{sd:.2g}'))}" if sd < 10 * abs(v) else ", not determined by these data")
            + f" ({q.doc})"
            for q, v, sd in estimates(f.compared)
        )
        items.append(f"<li><b>{_text(cause_title(f.name))}</b>: {_text(values)}.</li>")
    return f"<ul>{''.join(items)}</ul>" if items else ""


def _numerical(d: Discovery) -> str:
    if not any(e.kind == "cut" for e in d.campaign.train):
        return "<p>These tests are computed without a mesh.</p>"
    if not d.numerics.scores:
        return "<p>Not asked: the baseline does not fail.</p>"
    shares = {name: f"{100 * max(share, 0):.0f} %" for name, share in d.numerics.shares.items()}
    rows = [
        [f"{s.name} ({s.sensitivity.candidate.title})", f"{s.z:.1f}", shares[s.name]]
        for s in d.numerics.scores
    ]
    return _table(["cause", "score (standard deviations)", "would explain"], rows)


def _remains(d: Discovery) -> str:
    if not d.steps:
        return "<p>Not asked.</p>"
    last = d.steps[-1].scores
    return (
        f"<p>{'More than' if d.remains else 'Nothing beyond'} the scatter: χ² = {last.chi2:.0f}, data that"
        f" the model describes have {last.expected:.0f} on average.</p>"
    ) + (_sections(d.left, "No single section stands out.") if d.remains else "")


def _errors(gain: dict) -> str:
    rows = []
    for key, words in (("train", "fitted tests"), ("heldout", "held out")):
        if (g := gain[key]) is None:
            continue
        unit = "of the maximum" if g["unit"] == "1" else g["unit"]
        words += f": {g['how']}" if "how" in g else ""
        rows.append([words, *(f"{g[k]:.3g} {unit}" for k in GAIN[:3])])
    return _table(["root mean square error", "baseline", "extended model", "scatter and noise alone"], rows)
