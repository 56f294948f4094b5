"""Laws that members of a family keep, packaged or brought by a user, and what one member makes of them."""

from __future__ import annotations

from typing import NamedTuple


class Law(NamedTuple):
    """A law in words, whether it holds, and what was got and how to mend it if it does not."""

    words: str
    holds: bool
    why: str = ""

    @property
    def sentence(self) -> str:
        """The law and what became of it."""
        return self.words if self.holds else f"{self.words}: {self.why}"
