"""The page of two results side by side, and the files of a folder of results as they are served."""

from __future__ import annotations

import mimetypes
import os
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from testbench.core.door import read_bytes
from testbench.core.errors import RecordError
from testbench.page.page import Page
from testbench.page.serve import Answer as Served
from testbench.page.tables import Column, Table
from testbench.page.words import counted

if TYPE_CHECKING:
    from testbench.core.store import Entry, Manifest
    from testbench.questions.results.ask import Difference, ResultsCompared, ResultSummary, Verified

_LARGEST_BYTES = 200_000_000  # of a file that is served
_MOST_ROWS = 500
_DIGITS = 16  # of a hash that is shown


def compared_page(compared: ResultsCompared) -> Page:
    """Return the page of two results side by side."""
    a, b = compared.first, compared.second
    both = [d for d in compared.differences if d.first is not None and d.second is not None]
    differ, alone = len(both), len(compared.differences) - len(both)
    total = differ + compared.equal
    lead = f"{differ} of {counted(total, 'number')} that both have differ" if total else "the two share no number"
    if alone:
        lead += f"; {alone} in tables of both {'stands' if alone == 1 else 'stand'} in one of them only"
    only = [
        f"only {name} has: {', '.join(tables)}"
        for name, tables in zip(_names(a, b), (compared.only_first, compared.only_second), strict=True)
        if tables
    ]
    largest = sorted(both, key=_relative, reverse=True)[:_MOST_ROWS]
    more = [f"the {_MOST_ROWS} largest of them are shown"] if differ > _MOST_ROWS else []
    return Page(
        kicker="Two results side by side",
        title=" and ".join(_names(a, b)),
        question="What differs between these two results?",
        answer=[("lead", lead), *(("finding", text) for text in (*more, *only))],
        tables=[_said(a, b), *([_differences(largest)] if largest else [])],
        packages=(),
        provenance=list(zip(("first", "second"), _names(a, b), strict=True)),
        terminal=[_differences(largest[:20])] if largest else [],
    )


def made_from(manifest: Manifest) -> list[tuple[str, str, str, str]]:
    """Return (what, name, bytes, first digits of the SHA-256) of all that a result was made by and from, and of it."""

    def row(what: str, name: str, entry: Entry) -> tuple[str, str, str, str]:
        size, digest = ("", "") if entry is None else (str(entry[0]), entry[1][:_DIGITS])
        return what, name, size, digest

    made_with = {"flight-testbench": manifest.version, **manifest.packages}
    return [
        ("command", shlex.join(manifest.command) or "none: a program wrote it", "", ""),
        *(("version", f"{name} {version}", "", "") for name, version in made_with.items()),
        *(row("input", name, entry) for name, entry in manifest.inputs.items()),
        *(row("file", name, entry) for name, entry in manifest.files.items()),
    ]


def states(found: Verified) -> list[tuple[str, str]]:
    """Return (file, state) of every file of a result, and of those beside it that are the user's."""
    said = {**dict.fromkeys(found.changed, "changed"), **dict.fromkeys(found.missing, "missing")}
    listed = [
        (name, said.get(name, "as written" if entry else "still changing"))
        for name, entry in found.manifest.files.items()
    ]
    return [*listed, *((name, "yours") for name in found.extra)]


def verdict(found: Verified) -> list[str]:
    """Return sentences: whether a result still is what was written, and what would change if it were made again."""
    wrong = len(found.changed) + len(found.missing)
    total = sum(entry is not None for entry in found.manifest.files.values())
    out = [f"{total - wrong} of {counted(total, 'file')} are unchanged" if wrong else "all files are unchanged"]
    out += [f"input {name} has changed since" for name in found.inputs_changed]
    out += [f"input {name} is not found any more" for name in found.inputs_gone]
    out += [f"{name} was {then}, and is {now} here" for name, then, now in found.versions]
    if len(out) == 1:
        out.append("its inputs are unchanged")
    return out


def _names(a: ResultSummary, b: ResultSummary) -> tuple[str, str]:
    """Return the names of both folders, with as many folders above as tell them apart."""
    paths = [r.folder.resolve() for r in (a, b)]
    if paths[0].name == paths[1].name and paths[0] != paths[1]:
        common = Path(os.path.commonpath(paths))
        above = common.parent if common in paths else common
        paths = [path.relative_to(above) for path in paths]
        return paths[0].as_posix(), paths[1].as_posix()
    return paths[0].name, paths[1].name


def _said(a: ResultSummary, b: ResultSummary) -> Table:
    rows = tuple(
        (name, getattr(a, key), getattr(b, key))
        for name, key in (("title", "title"), ("what", "kind"), ("question", "question"), ("answer", "answer"))
    )
    when = ("written", *(f"{r.written:%Y-%m-%d %H:%M}" for r in (a, b)))
    columns = (Column("what", "what"), Column("first", "first"), Column("second", "second"))
    first, second = _names(a, b)
    return Table("said", "The answers", f"First: {first}. Second: {second}.", columns, (*rows, when), wide=True)


def _differences(found: Sequence[Difference]) -> Table:
    columns = (
        Column("table", "table"), Column("row", "row"), Column("column", "column"), Column("first", "first", digits=5),
        Column("second", "second", digits=5), Column("change", "change", "%"),
    )  # fmt: skip
    rows = tuple((d.table, d.row, d.column, d.first, d.second, _change(d)) for d in found)
    caption = "Numbers of the tables that both have, the largest relative change first."
    return Table("differences", "Numbers that differ", caption, columns, rows, wide=True)


def _change(d: Difference) -> float | None:
    if d.first is None or d.second is None or d.first == 0.0:
        return None
    return 100.0 * (d.second - d.first) / abs(d.first)


def _relative(d: Difference) -> float:
    if d.first is None or d.second is None:  # stands in one result alone
        return 0.0
    return abs(d.second - d.first) / (abs(d.first) + abs(d.second) or 1.0)


def files_of(folder: Path) -> Callable[[str], Served | None]:
    """Return what answers a path below a folder: a file; nothing outside, and no link that leads out."""
    root = folder.resolve()

    def answer(path: str) -> Served | None:
        """Return the file at a path."""
        parts = [part for part in path.split("/") if part]
        if any(part.startswith(".") or "\0" in part or "\\" in part for part in parts):
            return None
        try:
            file = root.joinpath(*parts).resolve()
            if not file.is_relative_to(root) or not file.is_file() or file.stat().st_size > _LARGEST_BYTES:
                return None
            kind = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
            return Served(read_bytes(file, "table"), f"{kind}; charset=utf-8" if kind.startswith("text/") else kind)
        except (OSError, ValueError, RecordError):
            return None

    return answer
