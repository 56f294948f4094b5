"""Campaigns: a scenario flown over distributions of anything in it, by worker processes, into one store."""

from __future__ import annotations

from testbench.campaign.execute import DIED, Ending, Progress, fly_campaign
from testbench.campaign.load import Campaign, load_campaign
from testbench.campaign.store import Counts, Row, Store
from testbench.campaign.summary import Summary, summarise

__all__ = [
    "DIED",
    "Campaign",
    "Counts",
    "Ending",
    "Progress",
    "Row",
    "Store",
    "Summary",
    "fly_campaign",
    "load_campaign",
    "summarise",
]
