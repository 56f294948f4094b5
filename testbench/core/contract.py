"""The laws of a family of parts, packaged or brought by a user, and whether one member keeps them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from testbench.core.bring import running
from testbench.core.errors import Refusal


class Law(NamedTuple):
    """A law in words, and whether it holds; if not, what was got and how to mend it."""

    words: str
    holds: bool
    why: str = ""

    @property
    def sentence(self) -> str:
        """The law; if it does not hold, also why."""
        return self.words if self.holds else f"{self.words}: {self.why}"


class LawError(Exception):
    """A law is broken: what was expected, what was got."""


def need(holds: bool, otherwise: str) -> None:
    """Raise :class:`LawError` with these words unless something holds."""
    if not holds:
        raise LawError(otherwise)


def tried_on(case: Any, laws: Sequence[Callable[[Any], None]], path: Path) -> Iterator[Law]:
    """Try laws one by one and yield what becomes of each; its name says it in words.

    Args:
        case: what every law is called with.
        laws: functions that raise if they do not hold.
        path: the user's file, whose line is said if its code raises an error of another kind.
    """
    for law in laws:
        words = law.__name__.replace("_", " ")
        why = ""
        try:
            with running(path, "its code must run without an error"):
                try:
                    law(case)
                except LawError as error:
                    why = str(error)
        except Refusal as error:
            why = str(error)
        yield Law(words, not why, why)
