"""What the page of a campaign or a data set shows while it is flown: counts, and the runs since the last look.

Both are told alike: a run has a number, ``names`` that it is counted by, ``inputs`` that were drawn, ``figures`` that
were found, and why it failed. The runs of a data set are its draws, and the attempts that could not fly.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from testbench.core.errors import CampaignError
from testbench.core.store import manifest_of
from testbench.core.words import without_numbers
from testbench.questions.campaign.store import FILE, RECORDS, Row, Store
from testbench.questions.dataset.open import draws_so_far
from testbench.questions.dataset.store import SHEET_PAGE, STORE, command_of, made_in

_AT_ONCE = 2000  # runs of one look
_MOST = 500  # folders that are looked into


def list_campaigns(folder: Path, results: Path) -> list[str]:
    """Return the folders with a campaign or a data set, in that of the app and in its results, the newest first."""
    found = {}
    for place in (p for above in (results, folder) if above.is_dir() for p in islice(above.iterdir(), _MOST)):
        drawn = made_in(place) if place.is_dir() else None
        store = place / FILE if drawn is None else drawn / STORE
        if store.is_file():
            found[place.relative_to(folder).as_posix()] = store.stat().st_mtime
    return sorted(found, key=lambda name: -found[name])


def campaign_told(folder: Path, results: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return what there is of a ``campaign`` or a data set: counts, and finished runs from number ``first`` on.

    Raises:
        CampaignError: there is no such store.
    """
    name, first = str(given.get("campaign")), given.get("first", 0)
    if name not in list_campaigns(folder, results):
        raise CampaignError(f"a campaign or data set to look at must be one of the list, got '{name[:200]}'")
    place, first = folder / name, first if isinstance(first, int) else 0
    return (_campaign if (place / FILE).is_file() else _dataset)(place, name, first)


def _campaign(place: Path, name: str, first: int) -> dict[str, Any]:
    with Store.read(place) as store:
        counts, lowest = store.counts(), store.first_unfinished()
        rows = [_run(row) for row in islice(store.rows(first), _AT_ONCE)]
        kept: dict[int, list[str]] = {}
        for file in sorted((place / RECORDS).glob("*.nc"))[:_AT_ONCE]:
            kept.setdefault(int(file.name.split("_")[1]), []).append(f"{name}/{RECORDS}/{file.name}")
        return {
            "unit": "run",
            "per_run": 1,
            "total": counts.total,
            "finished": counts.finished,
            "failed": counts.failed,
            "stopped": store.meta("stopped") is not None,
            "next": rows[-1]["run"] + 1 if len(rows) == _AT_ONCE else lowest,
            "whole": len(rows) < _AT_ONCE,
            "command": _began(place, str(store.meta("name"))),
            "sheet": "",
            "records": kept,
            "rows": rows,
        }


def _began(place: Path, name: str) -> list[str]:
    """Return the words that began a campaign: as its manifest has them, else by a file or packaged one of its name."""
    made = manifest_of(place)
    if made is not None and made.command[1:2] == ("campaign",):
        return list(made.command[1:])
    own = (place.parent.parent / f"{name}.toml").is_file()
    return ["campaign", "run", f"{name}.toml" if own else f"campaign/{name}"]


def _run(row: Row) -> dict[str, Any]:
    found = json.loads(row.results) if row.results else {}
    figures = {f"{case}: {key}": value for case, own in found.get("figures", {}).items() for key, value in own.items()}
    reason = row.reason or "; ".join(f"{case}: {why}" for case, why in found.get("failed", {}).items())
    return {
        "run": row.run,
        "name": f"run {row.run}",
        "seed": row.seed,
        "reason": reason,
        "because": without_numbers(reason),
        "failed": row.state != "done",
        "names": {"state": row.state},
        "inputs": json.loads(row.inputs),
        "figures": figures,
    }


def _dataset(place: Path, name: str, first: int) -> dict[str, Any]:
    so_far = draws_so_far(place, first, _AT_ONCE)
    per, last = so_far.per_draw, first + _AT_ONCE
    whole = so_far.first_missing is None and last * per >= so_far.flights
    flights = {row["draw"]: range(row["draw"] * per, min((row["draw"] + 1) * per, so_far.flights))
               for row in so_far.rows if not row["why"]}  # fmt: skip
    rows = [
        {
            "run": f"{row['draw']}, attempt {row['attempt']}" if row["why"] else row["draw"],
            "name": f"draw {row['draw']}" + (f", attempt {row['attempt'] + 1}" if row["why"] else ""),
            "reason": row["why"],
            "because": without_numbers(row["why"]),
            "failed": bool(row["why"]),
            "names": {**row["names"], "state": "failed" if row["why"] else "done"},
            "inputs": row["values"],
            "figures": row["truth"],
        }
        for row in so_far.rows
    ]
    waits = so_far.first_missing is not None and so_far.first_missing < last
    return {
        "unit": "flight",
        "per_run": per,
        "total": so_far.flights,
        "finished": min(so_far.finished * per, so_far.flights),
        "failed": so_far.failed,
        "stopped": False,
        "next": so_far.first_missing if waits or whole else last,
        "whole": waits or whole,
        "command": command_of(place),
        "sheet": f"{name}/{SHEET_PAGE}" if (place / SHEET_PAGE).is_file() else "",
        "records": {draw: [f"{name}/{STORE}#{k}" for k in own] for draw, own in flights.items()},
        "rows": rows,
    }
