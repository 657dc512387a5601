"""Discovery: what a model gets wrong of measured data, which mechanism explains it, what it gains.

from cutbench.discovery import discover
found = discover(load_campaign("campaign.toml"))
print(found.verdict, found.found)
"""

from cutbench.discovery.outcome import Discovery
from cutbench.discovery.report import gain_sentence, verdict_sentence
from cutbench.discovery.search import discover

__all__ = ["Discovery", "discover", "gain_sentence", "verdict_sentence"]
