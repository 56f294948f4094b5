"""The exceptions of the testbench.

Every message states the law that was broken, the value that was got and the fix. The command line turns each of
them into one message and an exit status: 2 for bad input, 3 for a computation that cannot be carried out.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar

Made = TypeVar("Made")
QUOTED = 200
"""Letters of what it got that a refusal quotes at most."""
_LINE = 2000  # letters of a line; a longer one quotes a text that is not told from ours
_FAULTS = 50  # shown of one file
_KNOWN = 200  # texts that are remembered
_GIVEN: list[str] = []  # long texts that are known to be a user's
_IN_QUOTES = re.compile(r"(?<!\w)(?:'[^'\n]*'|\"[^\"\n]*\")(?!\w)")
_UNBROKEN = re.compile(r"\S+")
_ONE_LINE = re.compile(r"[^\n]+")
_OF_TERMINALS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""What steers a terminal instead of being shown: controls but tab and line end, marks of direction, lone surrogates."""


def given(texts: Iterable[str | None]) -> None:
    """Say which texts are a user's, such as arguments of a command or heads of a table.

    Each is cut as one, as it stands and with its blanks and quotation marks as messages write them.
    """
    for text in texts:
        if text is not None and len(text) > QUOTED:
            forms = (text, text.strip(), " ".join(text.split()), repr(text)[1:-1], " ".join(repr(text)[1:-1].split()))
            _GIVEN.extend(form for form in forms if form not in _GIVEN)
    del _GIVEN[:-_KNOWN]


def brief(text: str) -> str:
    """Return a message with what it quotes cut in the middle to :data:`QUOTED` letters: the ends of paths say most.

    Controls that a file's name or a log's text may hold are written as their codes, so that no terminal obeys them.

    Quoted is what :func:`given` says, what stands in quotation marks, and what no blank breaks. No line is longer than
    2000 letters.
    """
    if len(text) <= QUOTED:
        return _shown(text)
    for whole in sorted(_GIVEN, key=len, reverse=True):
        text = text.replace(whole, _cut(whole, QUOTED))
    for pattern, most in ((_IN_QUOTES, QUOTED + 2), (_UNBROKEN, QUOTED + 2), (_ONE_LINE, _LINE)):
        text = pattern.sub(lambda found, most=most: _cut(found[0], most), text)  # type: ignore[misc]
    return _shown(text)


def excerpt(text: str) -> str:
    """Return a user's prose as a message quotes it: one line of :data:`QUOTED` letters at most, in quotation marks.

    What steers a terminal is written as its code.

    Example:
        >>> excerpt("ask\\nMr. Smith")
        "'ask Mr. Smith'"
    """
    return f"'{_cut(_shown(' '.join(text.split())), QUOTED)}'"


def _shown(text: str) -> str:
    return _OF_TERMINALS.sub(lambda found: repr(found[0])[1:-1], text)


def _cut(text: str, most: int) -> str:
    half = (most - 3) // 2
    return text if len(text) <= most else f"{text[:half]}...{text[-half:]}"


class TestbenchError(Exception):
    """Root of all errors raised on purpose; ``exit_status`` is what the command line returns for it.

    Example:
        >>> import testbench as tb
        >>> try:
        ...     tb.run("eolo_alfa")
        ... except tb.TestbenchError as error:
        ...     print(str(error).partition("; ")[2])
        did you mean 'eolo_alpha'?
    """

    __test__ = False  # pytest would otherwise try to collect a class whose name begins with "Test"
    exit_status = 2

    def __init__(self, message: str) -> None:
        message = brief(message)
        super().__init__(message)
        self.message = message
        self.place: str | None = None

    def __str__(self) -> str:
        return f"{self.message} ({brief(self.place)})" if self.place else self.message


class Refusal(TestbenchError):
    """What was asked for or read is at fault.

    Where many are tried, flights, estimators, records, only this is caught and becomes a row of the result.
    """


class WriteError(TestbenchError):
    """A file or folder cannot be written, which ends a command: no flight, estimator or record is at fault."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.place = ""  # no key of a file is at fault


class DiskError(WriteError):
    """A file cannot be written for want of space, or because its disk fails; nothing new stands under its name."""

    exit_status = 3


class BusyError(WriteError):
    """Another process writes into the same folder of results."""

    exit_status = 3


class ScenarioError(Refusal):
    """A scenario or description file breaks a law, or several; ``faults`` lists every one of them."""

    def __init__(self, faults: str | Iterable[str]) -> None:
        self.faults = tuple(brief(fault) for fault in ([faults] if isinstance(faults, str) else faults))
        count = len(self.faults)
        head = "" if count == 1 else f"{count} faults:\n  "
        more = (f"and {count - _FAULTS} more",) if count > _FAULTS else ()
        super().__init__(head + "\n  ".join((*self.faults[:_FAULTS], *more)))


class ChannelError(Refusal):
    """A channel name is unknown, or a record lacks a channel that is needed."""


class RecordError(Refusal):
    """A record file cannot be read, or a record breaks its own rules."""


class SizeError(RecordError):
    """What is asked for or read takes more memory than the limit of :mod:`testbench.core.door`."""


class LimitError(Refusal):
    """An input exceeds a limit of the aircraft; inputs are never clipped in silence."""


class ModelError(Refusal):
    """An aircraft folder, or the model generated from it, is not usable."""


class EstimationError(Refusal):
    """The data cannot support the estimate that was asked for."""

    exit_status = 3


class TrimError(Refusal):
    """No equilibrium exists at the flight condition within the limits of the controls."""

    exit_status = 3


class CampaignError(Refusal):
    """A campaign cannot go on: its store is in use, full or of another version, or its workers are gone."""

    exit_status = 3


class DatasetError(Refusal):
    """A data set cannot be drawn, gone on with, or scored: most draws cannot fly, or its folder holds another one."""

    exit_status = 3


class MissingPackage(Refusal, ImportError):
    """An optional package is not installed; the message names the extra that brings it."""


def missing(what: str, extra: str) -> str:
    """Return the message that a package is not installed, with the command that installs the extra.

    It names the folder that the testbench lies in or was installed from, which pip has recorded (PEP 610); without one
    it came from an index, and its name does.

    Args:
        what: that needs a package: "Parquet files need pyarrow".
        extra: that brings it.
    """
    from importlib.metadata import PackageNotFoundError, distribution
    from urllib.parse import unquote, urlsplit

    name = "flight-testbench"
    try:
        url = str(json.loads(distribution(name).read_text("direct_url.json") or "{}").get("url", ""))
    except (PackageNotFoundError, ValueError):
        url = ""
    folders = (Path(__file__).parents[2], Path(unquote(urlsplit(url).path or "/")))
    place = next(("." if f == Path.cwd() else str(f) for f in folders if (f / "pyproject.toml").is_file()), name)
    return f"{what}, which is not installed; pip install {shlex.quote(f'{place}[{extra}]')}"


def nearest(name: str, valid: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the closest valid name, else the list of valid names, to end a message."""
    names = sorted(valid)
    close = get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; valid: {', '.join(names)}" if names else ""


@contextmanager
def located(file: Path | str | None, key: str) -> Iterator[None]:
    """Name the file and key that an error comes from, unless an inner block has done so already."""
    try:
        yield
    except TestbenchError as error:
        if error.place is None:
            error.place = f"{file}, {key}" if file else key
        raise


class Faults(list[str]):
    """What is wrong with a file, fault by fault, each with the file and the key that it belongs to."""

    def __init__(self, file: Path | str | None) -> None:
        super().__init__()
        self.file = file

    def note(self, key: str, fault: str) -> None:
        """Add a fault of a key."""
        self.append(f"{self.file}, {key}: {fault}")

    def attempt(self, key: str, action: Callable[..., Made], *arguments: object) -> Made | None:
        """Return what the action returns; if it fails, note why under the key and return None."""
        try:
            return action(*arguments)
        except Refusal as error:
            for fault in error.faults if isinstance(error, ScenarioError) else (error.message,):
                self.note(key, fault)
            return None
