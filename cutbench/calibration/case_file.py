"""What a fit or a discovery found as a case file, for runs, maps and guidance to begin from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from cutbench.base.files import write_text
from cutbench.case.case import Case, load_case
from cutbench.case.case_file_text import case_text
from cutbench.data.campaign import Campaign, cut_case
from cutbench.data.experiment import SLOTS
from cutbench.mechanisms import registry


def runnable(campaign: Campaign, case: Case) -> Case:
    """``case``, a model found for ``campaign``, as a run of its material in the campaign's first cut, or in
    the start material's specimen where none was cut.

    The testing machine is left out, for it is none of the material's. What the tests do not see, such as the
    toughness in tension, is as in the start material; a campaign that names none leaves it open.
    """
    kept, values, outline = case.model.unrigged, {**case.values}, case.outline
    cut = next((e for e in (*campaign.train, *campaign.test) if e.kind == "cut"), None)
    if cut is not None:
        values |= cut_case(cut, case).values
    elif campaign.material is not None:
        whole = load_case(campaign.material)
        seen = {"bulk", "rig"} | {slot for e in campaign.experiments for slot in SLOTS[e.kind]}
        unseen = [name for name in whole.mechanisms if registry()[name].slot not in seen]
        found = {q.name: values[q.name] for m in kept.all for q in m.parameters}
        kept, values, outline = kept.with_(*unseen), {**whole.values, **found}, whole.outline
    own = {name: value for name, value in values.items() if name in kept.parameters()}
    return replace(case, mechanisms=kept.mechanisms, values=own, outline=outline, motion=())


def write_case(campaign: Campaign, case: Case, note: str, remarks: Mapping[str, str], path: Path) -> Path:
    """``case`` as it runs, as a file at ``path``: ``note`` says where it comes from, ``remarks`` what is
    known of values, by name."""
    made = runnable(campaign, case)
    if made.model.tool is None:
        note = f"{note.rstrip('.')}. No blade and no cut are known: a run needs laws for both"
    return write_text(case_text(made, {"name": campaign.title, "note": note}, remarks), path)
