"""Blind campaigns for tests: made once, in a folder that goes with the process."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

from benchmarks.blind import Answer, judge
from benchmarks.blind_campaigns import SEVERAL, Planned, Truth, make
from cutbench.data.campaign import Campaign, load_campaign
from cutbench.discovery import Discovery, discover

SEED = 11
_FOLDER = tempfile.TemporaryDirectory(prefix="blind-")


@cache
def made(effect: str, shows: str, several: bool = True, number: int = 3, specimens: int = 3) -> Truth:
    """A campaign of homogeneous tests in which ``effect`` is hidden; '' hides nothing."""
    how = shows, SEVERAL if several else "one condition"
    planned = Planned(number, "homogeneous", (effect,) if effect else (), how)
    name = f"{effect or 'nothing'}-{'-'.join(how)}-{number}-{specimens}".replace(" ", "_")
    return make(planned, SEED, Path(_FOLDER.name) / name, specimens=specimens)


def campaign(*asked, **more) -> Campaign:
    """The campaign that ``made`` makes."""
    return load_campaign(made(*asked, **more).file)


@cache
def found(*asked, **more) -> tuple[Truth, Discovery]:
    """The same, with what a search finds in it."""
    return made(*asked, **more), discover(campaign(*asked, **more), workers=0)


def judged(truth: Truth, d: Discovery) -> dict:
    """The search's answer beside what was hidden."""
    return judge(truth, Answer.of(d))
