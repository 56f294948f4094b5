"""Read what pages of results say of themselves, and set two results beside each other."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

from testbench.core.door import open_file, read_text
from testbench.core.errors import RecordError
from testbench.core.paths import not_found
from testbench.core.store import INDEX, OWN, PAGE, Manifest, entry_of, input_at, manifest_of, packages, settle
from testbench.page.shown import Shown

_HEAD_BYTES = 100_000  # of a page; title and answer stand before the first figure
_DEEPEST = 4  # folders below the one that is listed
_MOST = 2000  # pages of one list
KICKER = "flight-testbench: testbench results"
"""Above the title of an index that an earlier version wrote, which is no result itself."""


@dataclass(frozen=True)
class ResultSummary:
    """What one page of results says of itself.

    Attributes:
        folder: of the result.
        kind: which question it is, and of what.
        title: for people.
        question: as it was asked; "" if it was not.
        answer: its first sentence.
        written: when, with the zone of this machine's clock.
        page: name of its page in the folder.
    """

    folder: Path
    kind: str
    title: str
    question: str
    answer: str
    written: datetime
    page: str = PAGE


@dataclass(frozen=True)
class Difference:
    """One number of a table that two results share: ``row`` and ``column`` name it; None where one has none."""

    table: str
    row: str
    column: str
    first: float | None
    second: float | None


@dataclass(frozen=True)
class ResultsCompared(Shown, page="testbench.questions.results.page:compared_page"):
    """Two results side by side: what each says, which numbers differ, and what only one of them has."""

    first: ResultSummary
    second: ResultSummary
    differences: tuple[Difference, ...]
    equal: int
    only_first: tuple[str, ...]
    only_second: tuple[str, ...]


def list_results(folder: Path | str) -> list[ResultSummary]:
    """Return what lies in a folder of results, the newest first; links that lead elsewhere are not followed.

    Raises:
        RecordError: the folder is missing, or holds no result.

    Example:
        >>> import testbench as tb
        >>> [r.title for r in tb.list_results("results")]  # doctest: +SKIP
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise RecordError(
            f"a folder of results must be a folder that exists, got {not_found(folder, files=Path.is_dir)}"
        )
    found = [summary for path in _pages(folder, 0) if (summary := _summary(path)) is not None]
    if not found:
        raise RecordError(
            f"a folder of results must hold pages ({PAGE}), but '{folder}' has none; run a question first"
        )
    return sorted(found, key=lambda r: (-r.written.timestamp(), str(r.folder)))[:_MOST]


def compare_results(first: Path | str, second: Path | str) -> ResultsCompared:
    """Return two results side by side: every number of the tables that both have.

    Rows are matched by their texts, and rows of the same texts by their order.

    Raises:
        RecordError: a folder holds no result, or a table cannot be read.

    Example:
        >>> import testbench as tb
        >>> tb.compare_results("results/eolo_alpha", "results/eolo_alpha_2").differences  # doctest: +SKIP
    """
    folders = [settle(Path(first)), settle(Path(second))]
    summaries = [_summary(folder / PAGE) for folder in folders]
    for folder, summary in zip(folders, summaries, strict=True):
        if summary is None:
            raise RecordError(f"a result must be a folder with {PAGE}, got '{folder}'; `testbench results` lists them")
    tables = [{p.stem: p for p in sorted((f / "tables").glob("*.csv")) if not p.is_symlink()} for f in folders]
    differences: list[Difference] = []
    equal = 0
    for name in sorted(tables[0].keys() & tables[1].keys()):
        numbers = [_numbers(t[name]) for t in tables]
        for key in dict.fromkeys([*numbers[0], *numbers[1]]):
            a, b = (n.get(key) for n in numbers)
            if a == b:
                equal += 1
            else:
                differences.append(Difference(name, *key, a, b))
    assert summaries[0] is not None
    assert summaries[1] is not None
    only = [tuple(sorted(tables[k].keys() - tables[1 - k].keys())) for k in (0, 1)]
    return ResultsCompared(summaries[0], summaries[1], tuple(differences), equal, only[0], only[1])


def _pages(folder: Path, depth: int) -> Iterator[Path]:
    """Yield pages of results below a folder, without following links."""
    try:
        entries = sorted(os.scandir(settle(folder)), key=lambda e: e.name)
    except OSError:
        return
    page = PAGE if any(entry.name == PAGE for entry in entries) else INDEX
    for entry in entries:
        if entry.is_symlink() or entry.name == OWN:
            continue
        if entry.name == page and entry.is_file():
            yield Path(entry.path)
        elif entry.is_dir() and depth < _DEEPEST:
            yield from _pages(Path(entry.path), depth + 1)


def _summary(path: Path) -> ResultSummary | None:
    try:
        with open_file(path, "text") as file:
            head = file.read(_HEAD_BYTES).decode("utf-8", errors="replace")
        written = datetime.fromtimestamp(path.stat().st_mtime, UTC).astimezone()
    except (OSError, RecordError):
        return None
    reader = _Reader()
    reader.feed(head)
    texts = {name: " ".join(text.split()) for name, text in reader.found.items()}
    kind, question = texts.get("kicker", ""), texts.get("question", "")
    of_ours = path.name == PAGE or kind.startswith("flight-testbench:")
    if not texts.get("h1") or not of_ours or kind == KICKER:
        return None
    return ResultSummary(path.parent, kind, texts["h1"], question, texts.get("answer", ""), written, path.name)


class _Reader(HTMLParser):
    """Reads title, kind, question and first sentence of the answer of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, str] = {}
        self._open: tuple[str, str] | None = None
        self._answer = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note where a text begins."""
        kind = dict(attrs).get("class") or ""
        self._answer = self._answer or (tag == "section" and kind == "answer")
        name = "h1" if tag == "h1" else kind if tag == "p" and kind in ("kicker", "question") else ""
        if tag == "li" and self._answer:
            name = "answer"
        if name and name not in self.found:
            self._open = (tag, name)
            self.found[name] = ""

    def handle_endtag(self, tag: str) -> None:
        """End the text."""
        if self._open is not None and tag == self._open[0]:
            self._open = None

    def handle_data(self, data: str) -> None:
        """Take the text."""
        if self._open is not None:
            self.found[self._open[1]] += data


def _numbers(path: Path) -> dict[tuple[str, str], float]:
    """Return (row, column) -> number of a table; a row is named by its texts, and by its place among equal ones."""
    try:
        heads, *rows = list(csv.reader(read_text(path, "table").splitlines(keepends=True))) or [[]]
    except csv.Error as error:
        raise RecordError(f"a table of results must be CSV, but '{path}' cannot be read: {error}") from None
    out: dict[tuple[str, str], float] = {}
    seen: dict[str, int] = {}
    texts = {k for k, _ in enumerate(heads) if any(_number(r[k]) is None and r[k] for r in rows if k < len(r))}
    for row in rows:
        name = ", ".join(row[k] for k in sorted(texts) if k < len(row) and row[k])
        seen[name] = seen.get(name, 0) + 1
        name = name if seen[name] == 1 and name else f"{name} no. {seen[name]}".strip()
        for k, (head, cell) in enumerate(zip(heads, row, strict=False)):
            value = None if k in texts else _number(cell)
            if value is not None:
                out[name, head] = value
    return out


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


# --- verify -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Verified:
    """A folder of results, held against its manifest.

    Attributes:
        folder: of the result.
        manifest: what was written, by which command, from which inputs.
        changed: files that are not what was written.
        missing: files that are gone.
        extra: files that no manifest lists: the user's.
        inputs_changed: files that it was made from, which have changed since.
        inputs_gone: files that it was made from, which are no longer found.
        versions: (name, then, now) of the testbench and of packages whose versions differ.
    """

    folder: Path
    manifest: Manifest
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    inputs_changed: tuple[str, ...]
    inputs_gone: tuple[str, ...]
    versions: tuple[tuple[str, str, str], ...]

    @property
    def whole(self) -> bool:
        """Whether every file still is what was written."""
        return not self.changed and not self.missing


def verify_results(folder: Path | str) -> Verified:
    """Hold a folder of results against its manifest.

    Raises:
        RecordError: it has no manifest, or a damaged one.

    Example:
        >>> import testbench as tb
        >>> tb.verify_results("results/eolo_alpha").whole  # doctest: +SKIP
        True
    """
    from testbench import __version__

    folder = Path(folder)
    manifest = manifest_of(folder)
    if manifest is None:
        raise RecordError(
            f"a result must have a manifest, but '{folder}' has none: it is no single result, or was made before there "
            "were manifests; run its command again into a new folder"
        )
    fixed = {name: entry for name, entry in manifest.files.items() if entry is not None}
    now = {name: entry_of(folder / name) for name in fixed}
    inputs = {name: input_at(name, folder) for name in manifest.inputs}
    then = {"flight-testbench": manifest.version, **manifest.packages}
    here = {"flight-testbench": __version__, **packages()}
    return Verified(
        folder,
        manifest,
        changed=tuple(name for name in fixed if now[name] not in (None, fixed[name])),
        missing=tuple(name for name in fixed if now[name] is None),
        extra=tuple(sorted(set(_files(folder)) - manifest.files.keys())),
        inputs_changed=tuple(n for n, p in inputs.items() if p is not None and entry_of(p) != manifest.inputs[n]),
        inputs_gone=tuple(name for name, path in inputs.items() if path is None),
        versions=tuple((name, old, here.get(name, "none")) for name, old in then.items() if here.get(name) != old),
    )


def _files(folder: Path) -> list[str]:
    """Return the files in a folder, without those of results that lie in it."""
    found = []
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if name != OWN and not (Path(place) / name / OWN).is_dir()]
        found += [(Path(place) / name).relative_to(folder).as_posix() for name in files]
    return found
