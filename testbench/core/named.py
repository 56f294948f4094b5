"""Names and paths in the place of objects: what a function takes may be given as itself, by name or by path."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from testbench.core.errors import ScenarioError

T = TypeVar("T")
Named: TypeAlias = T | Path | str
"""``Named[Aircraft]``: an aircraft, its name or its path."""
_READERS = {
    "Aircraft": ("an aircraft", "testbench.flight.load:load_aircraft"),
    "Asked": ("a scenario", "testbench.questions.files:read"),
    "Campaign": ("a campaign", "testbench.questions.campaign.load:load_campaign"),
    "FlightRecord": ("a record", "testbench.core.record:load_record"),
    "SensorSuite": ("a sensor suite", "testbench.sensors.suite:load_suite"),
}
"""Class -> one of it in words, and what reads it, by name: the rooms of the readers lie above this one."""


def obtain_all(kind: type[T], given: Iterable[Named[T]]) -> list[T]:
    """Return each of several objects as :func:`obtain` does."""
    return [obtain(kind, each) for each in given]


def obtain(kind: type[T], given: Named[T]) -> T:
    """Return an object as it was given, or what its name or path means.

    Args:
        kind: class of the object: an aircraft, a sensor suite, a record, a campaign, a scenario of any question.
        given: one of that class, or a name or path that the reader of the class takes.

    Raises:
        ScenarioError: it is neither; or the name means nothing.
        RecordError: the file cannot be read.
    """
    if isinstance(given, kind):
        return given
    words, place = next(_READERS[c.__name__] for c in kind.__mro__ if c.__name__ in _READERS)
    if not isinstance(given, (str, Path)):
        raise ScenarioError(f"{words} must be a {kind.__name__}, a name or a path, got a {type(given).__name__}")
    module, name = place.split(":")
    read: Any = getattr(import_module(module), name)
    found: T = read(given, kind) if words == "a scenario" else read(given)
    return found
