"""What the page of a campaign shows while it flies: counts, and the runs that have come since the last look."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from testbench.core.errors import CampaignError
from testbench.core.store import Manifest, manifest_of
from testbench.questions.campaign.store import FILE, RECORDS, Row, Store

_AT_ONCE = 2000  # runs of one look


def list_campaigns(results: Path) -> list[str]:
    """Return the folders of results that hold a campaign's store, the newest first."""
    found = sorted(results.glob(f"*/{FILE}"), key=lambda p: -p.stat().st_mtime)
    return [p.parent.name for p in found]


def campaign_told(results: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the store of a ``campaign`` holds: counts, and finished runs from number ``first`` on.

    Raises:
        CampaignError: there is no such store.
    """
    name, first = str(given.get("campaign")), given.get("first", 0)
    if name not in list_campaigns(results):
        raise CampaignError(f"a campaign to look at must be one of the list, got '{name[:200]}'")
    made = manifest_of(results / name)
    with Store.read(results / name) as store:
        counts, lowest = store.counts(), store.first_unfinished()
        rows = [_told(row) for row in islice(store.rows(first if isinstance(first, int) else 0), _AT_ONCE)]
        return {
            "counts": counts._asdict(),
            "stopped": store.meta("stopped") is not None,
            "title": store.meta("name"),
            "next": rows[-1]["run"] + 1 if len(rows) == _AT_ONCE else lowest,
            "whole": len(rows) < _AT_ONCE,
            "command": _command(results, made, str(store.meta("name"))),
            "records": sorted(p.name for p in (results / name / RECORDS).glob("*.nc"))[:_AT_ONCE],
            "rows": rows,
        }


def _command(results: Path, made: Manifest | None, name: str) -> list[str]:
    """Return the words that began a campaign: as its manifest has them, else by a file or packaged one of its name."""
    if made is not None and made.command[1:2] == ("campaign",):
        return list(made.command[1:])
    return ["campaign", "run", f"{name}.toml" if (results.parent / f"{name}.toml").is_file() else f"campaign/{name}"]


def _told(row: Row) -> dict[str, Any]:
    found = json.loads(row.results) if row.results else {}
    figures = {f"{case}: {key}": value for case, own in found.get("figures", {}).items() for key, value in own.items()}
    return {
        "run": row.run,
        "seed": row.seed,
        "reason": row.reason or "; ".join(f"{case}: {why}" for case, why in found.get("failed", {}).items()),
        "failed": row.state != "done",
        "inputs": json.loads(row.inputs),
        "figures": figures,
    }
