"""Keys of caches for what cannot be hashed itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Keyed(Generic[T]):
    """What something is found from, as the key of a cache: the same as another if their contents are equal."""

    it: T = field(compare=False)  # what is read to find it
    contents: tuple[object, ...]  # all of it that matters, hashable
