"""Discovery: what a model gets wrong of measured data, which mechanism explains it, what it gains.

from cutbench.discovery import discover
found = discover(load_campaign("campaign.toml"))
print(found.verdict, found.found)
"""

from cutbench.discovery.search import Discovery, discover

__all__ = ["Discovery", "discover"]
