"""What happens once in one cut is told, and no cause of it is looked for."""

from __future__ import annotations

import pytest
from formula_of_cuts import SPEEDS, TRUE, Formula, X, campaign_in, force

from cutbench.data.campaign import load_campaign
from cutbench.discovery import discover


def off_between(tmp_path, first: float, last: float, part: float, ids: tuple[str, ...]):
    """The true campaign, but the force of ``ids`` is changed by ``part`` from ``first`` to ``last``."""
    campaign_in(tmp_path)
    for id in ids:
        y = force(X, **TRUE, speed=SPEEDS[id]) * (1 + part * ((first <= X) & (last >= X)))
        rows = [f"{x:.6g},{f:.6g}" for x, f in zip(X, y, strict=True)]
        (tmp_path / f"{id}.csv").write_text("\n".join(["u [mm],F [N]", *rows]) + "\n")
    return load_campaign(tmp_path / "campaign.toml")


@pytest.mark.parametrize(
    ("part", "ids", "once"),
    [(-0.2, ("fast",), 1), (0.2, ("fast",), 1), (-0.2, ("slow", "fast"), 0), (0.0, ("fast",), 0)],
)
def test_what_happens_once_is_told_and_is_no_cause(part, ids, once, tmp_path):
    campaign = off_between(tmp_path, 4.2, 4.6, part, ids)
    found = discover(campaign, run=Formula(), refine=False)
    assert found.verdict == "none" and len(found.once) == once
    assert all("'fast'" in said and said in found.notes for said in found.once)
