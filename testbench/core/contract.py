"""The laws of a family of parts, packaged or brought by a user, and whether one member keeps them."""

from __future__ import annotations

from typing import NamedTuple


class Law(NamedTuple):
    """A law in words, and whether it holds; if not, what was got and how to mend it."""

    words: str
    holds: bool
    why: str = ""

    @property
    def sentence(self) -> str:
        """The law; if it does not hold, also why."""
        return self.words if self.holds else f"{self.words}: {self.why}"
