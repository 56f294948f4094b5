"""The store of a campaign as tidy tables; SQLite takes the figures apart, some runs at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.files import write_file
from testbench.questions.campaign.store import Store
from testbench.questions.tidy import CSV, PARQUET, csv_text, parquet_bytes, tidy

if TYPE_CHECKING:
    import pandas as pd

_AT_ONCE = 2000
MOST_IN_CSV = 20_000
"""Runs beyond which the tidy table is written as Parquet alone: CSV would take gigabytes."""
_LONG = """
SELECT r.run AS run, r.seed AS seed, c.key AS cell, f.key AS figure, f.value AS value, '' AS reason
FROM runs r, json_each(r.results, '$.figures') c, json_each(c.value) f
WHERE r.state = 'done' AND r.run >= :first AND r.run < :end
UNION ALL
SELECT r.run, r.seed, c.key, '', NULL, c.value
FROM runs r, json_each(r.results, '$.failed') c
WHERE r.state = 'done' AND r.run >= :first AND r.run < :end
UNION ALL
SELECT r.run, r.seed, '', '', NULL, coalesce(r.reason, '')
FROM runs r WHERE r.state = 'failed' AND r.run >= :first AND r.run < :end
"""
_TRUE = """
SELECT r.run AS run, t.key AS name, t.value AS value FROM runs r, json_each(r.results, '$.true') t
WHERE r.state = 'done' AND r.run >= :first AND r.run < :end
"""
_VARIED = """
SELECT r.run AS run, v.key AS name, v.value AS value FROM runs r, json_each(r.inputs) v
WHERE r.state IN ('done', 'failed') AND r.run >= :first AND r.run < :end
"""


def tidy_store(folder: Path) -> Iterator[pd.DataFrame]:
    """Yield the finished runs of the store in a folder as tidy tables, with a column for everything that is varied.

    Raises:
        CampaignError: there is no store, or it is of another version.
    """
    import pandas as pd

    with Store.read(folder) as store:
        same = {
            "scenario": store.meta("name") or "",
            "aircraft": store.meta("aircraft") or "",  # stores of earlier versions do not say
            "input": store.meta("input") or "",
        }
        for first in range(0, store.counts().total, _AT_ONCE):
            part = {"first": first, "end": first + _AT_ONCE}
            with store.whole():  # figures of a damaged store may be texts
                long, true, varied = (
                    pd.DataFrame(store.asked(query, part), columns=names)
                    for query, names in (
                        (_LONG, ["run", "seed", "cell", "figure", "value", "reason"]),
                        (_TRUE, ["run", "name", "value"]),
                        (_VARIED, ["run", "name", "value"]),
                    )
                )
                if long.empty:
                    continue
                out = tidy(long, true, **same).sort_values("run", kind="stable", ignore_index=True)
                if not varied.empty:
                    wide = varied.pivot_table(index="run", columns="name", values="value", aggfunc="first", sort=False)
                    out = out.merge(wide, how="left", left_on="run", right_index=True)
            yield out


def tidy_files(folder: Path | None, runs: int) -> dict[str, Callable[[Path], None]]:
    """Return the files of the tidy table of a store with so many finished runs, for its page."""
    if folder is None:
        return {}

    def parquet(path: Path) -> None:
        """Write the table as Parquet."""
        packed = parquet_bytes(tidy_store(folder))
        if packed is not None:
            write_file(path, packed)

    def csv(path: Path) -> None:
        """Write the table as CSV, all digits."""
        import pandas as pd

        write_file(path, csv_text(pd.concat(list(tidy_store(folder)), ignore_index=True)))

    out: dict[str, Callable[[Path], None]] = {f"tables/{PARQUET}": parquet} if runs and _has_pyarrow() else {}
    return out | ({f"tables/{CSV}": csv} if 0 < runs <= MOST_IN_CSV else {})


def _has_pyarrow() -> bool:
    from importlib.util import find_spec

    return find_spec("pyarrow") is not None
