"""Keys of caches for what cannot be hashed itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Keyed(Generic[T]):
    """What something is found from, as the key of a cache: the same as another if their contents are equal.

    Attributes:
        it: what is read to find it.
        contents: all of it that matters, hashable.
    """

    it: T = field(compare=False)
    contents: tuple[object, ...]
