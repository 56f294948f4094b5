"""Tidy tables: one row per run, suite, estimator and figure, the same for runs, comparisons and campaigns."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbench.core.door import checked
from testbench.core.errors import RecordError
from testbench.core.store import settle
from testbench.questions.campaign.result import UNIT
from testbench.questions.campaign.summary import OUTPUTS

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "run",
    "seed",
    "scenario",
    "aircraft",
    "input",
    "suite",
    "estimator",
    "figure",
    "value",
    "unit",
    "truth",
    "standard_error",
    "reason",
)
"""Columns of a tidy table. A row without a figure says in ``reason`` why a run, or a suite and an estimator, failed."""
CSV, PARQUET = "results.csv", "results.parquet"
_STD, _TRUE = ", std", ", true"
_WORDS = ("scenario", "aircraft", "input", "suite", "estimator", "figure", "unit", "reason")


def tidy(long: pd.DataFrame, true: pd.DataFrame, **same: str) -> pd.DataFrame:
    """Return the tidy table of what runs found.

    Args:
        long: columns run, seed, cell ("SUITE, ESTIMATOR"), figure, value and reason. Figures "NAME, std" and
            "NAME, true" become columns of the figure NAME.
        true: columns run, name and value: the truth of modes.
        same: values of columns that are the same in every row.
    """
    import pandas as pd

    key = ["run", "cell", "figure"]
    plain = set(long["figure"].unique())
    beside = {}
    for end in (_STD, _TRUE):
        own = long["figure"].str.endswith(end) & long["figure"].str.removesuffix(end).isin(plain)
        beside[end] = long[own].assign(figure=lambda t, end=end: t["figure"].str.removesuffix(end))
        long = long[~own]
    out = long.merge(beside[_STD][[*key, "value"]].rename(columns={"value": "standard_error"}), how="left", on=key)
    out = out.merge(beside[_TRUE][[*key, "value"]].rename(columns={"value": "truth"}), how="left", on=key)
    out["mode"] = out["figure"].str.replace(OUTPUTS, "", regex=True)
    modes = true.rename(columns={"name": "mode", "value": "of_mode"})
    out = out.merge(modes[["run", "mode", "of_mode"]], how="left", on=["run", "mode"])
    number = {name: pd.to_numeric(out[name]) for name in ("value", "standard_error", "truth", "of_mode")}
    cells = out["cell"].str.partition(", ")
    out = out.assign(
        **same,
        **number,
        suite=cells[0],
        estimator=cells[2],
        unit=out["figure"].str.extract(UNIT, expand=False).fillna(""),
    )
    out["truth"] = out["truth"].fillna(out["of_mode"])
    out["figure"] = out["figure"].str.replace(UNIT, "", regex=True)
    return out[list(COLUMNS)].astype(dict.fromkeys(_WORDS, "category"))


def of_found(found: Mapping[str, Any], run: int, seed: int, **same: str) -> pd.DataFrame:
    """Return the tidy table of one run from what it found, see :func:`testbench.questions.run.result.found_of`."""
    import pandas as pd

    rows = [(run, seed, cell, name, value, "") for cell, of in found["figures"].items() for name, value in of.items()]
    rows += [(run, seed, cell, "", None, reason) for cell, reason in found.get("failed", {}).items()]
    true = [(run, name, value) for name, value in found.get("true", {}).items()]
    return tidy(
        pd.DataFrame(rows, columns=["run", "seed", "cell", "figure", "value", "reason"]),
        pd.DataFrame(true, columns=["run", "name", "value"]),
        **same,
    )


def csv_text(table: pd.DataFrame) -> str:
    """Return a tidy table as CSV, all digits; cells that a spreadsheet would run are quoted as text."""
    from testbench.core.escape import csv_cell

    out = table.copy()
    for name in _WORDS:
        if name in out:
            out[name] = out[name].astype(str).map(csv_cell)
    return str(out.to_csv(index=False, lineterminator="\n"))


def parquet_bytes(tables: Iterable[pd.DataFrame]) -> bytes | None:
    """Return tidy tables one after the other as one Parquet file; None where pyarrow is not installed."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        return None
    buffer, writer = io.BytesIO(), None
    for table in tables:
        plain = pa.Table.from_pandas(table.astype(dict.fromkeys(_WORDS, "string")), preserve_index=False)
        writer = writer or pq.ParquetWriter(buffer, plain.schema)
        writer.write_table(plain.cast(writer.schema))
    if writer is None:
        return None
    writer.close()
    return buffer.getvalue()


def files_of(table: pd.DataFrame) -> dict[str, str | bytes]:
    """Return the files of a tidy table for a page: CSV, and Parquet where pyarrow is installed."""
    packed = parquet_bytes([table])
    return {f"tables/{CSV}": csv_text(table)} | ({} if packed is None else {f"tables/{PARQUET}": packed})


def read_results(folder: Path | str) -> pd.DataFrame:
    """Return the results in a folder of a run, a comparison or a campaign as one tidy table.

    The store of a campaign is read as it is, also while the campaign flies. SQLite takes its figures apart, some
    thousand runs at a time. What a campaign varies is a column of its own, by its key.

    Args:
        folder: what ``testbench run``, ``compare`` or ``campaign`` wrote.

    Returns:
        Columns of :data:`COLUMNS`: angles and rates in SI unless ``unit`` says "%"; an empty unit is that of the
        parameter in SI, or none. ``value`` is an estimate or a figure of merit, ``truth`` and ``standard_error`` belong
        to it and are NaN where they are not known. Of a comparison ``value`` is the error of an estimate.

    Raises:
        RecordError: the folder holds no results.

    Example:
        >>> import testbench as tb
        >>> table = tb.read_results("results/campaign_taurus_scatter")  # doctest: +SKIP
        >>> table.groupby(["estimator", "figure"], observed=True).value.std()  # doctest: +SKIP
    """
    import pandas as pd

    from testbench.questions.campaign.store import FILE
    from testbench.questions.campaign.tidy import tidy_store

    folder = settle(Path(folder))
    if (folder / FILE).is_file():
        parts = list(tidy_store(folder))
        return _joined(parts) if parts else pd.DataFrame(columns=list(COLUMNS))
    tables = folder / "tables"
    for name in (PARQUET, CSV):
        if (tables / name).is_file():
            checked(tables / name, "table")
            try:
                found = pd.read_parquet(tables / name) if name == PARQUET else pd.read_csv(tables / name)
            except ImportError:
                continue
            except (ValueError, OSError) as error:
                raise RecordError(f"'{tables / name}' must be a table of results, got: {error}") from error
            words = [w for w in _WORDS if w in found]
            return found.assign(**{w: found[w].fillna("") for w in words}).astype(dict.fromkeys(words, "category"))
    raise RecordError(
        f"a folder of results must hold {FILE} or tables/{CSV}, got none in '{folder}'; give the folder that run, "
        "compare or campaign has written"
    )


def _joined(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Return tables one after the other, words as categories of all of them."""
    import pandas as pd
    from pandas.api.types import union_categoricals

    for name in _WORDS:
        every = union_categoricals([part[name] for part in parts]).categories
        for part in parts:
            part[name] = part[name].cat.set_categories(every)
    return pd.concat(parts, ignore_index=True)
