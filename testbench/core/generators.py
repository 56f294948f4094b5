"""Random generators by name: what one quantity draws does not depend on the others, nor on their order."""

from __future__ import annotations

import zlib

import numpy as np


def keyed_generator(seed: int, index: int, key: str) -> np.random.Generator:
    """Return the generator of the quantity ``key`` in draw number ``index``.

    It is the child of SeedSequence([seed, index]) that the crc32 of the key numbers.
    """
    return np.random.default_rng(np.random.SeedSequence([seed, index], spawn_key=(zlib.crc32(key.encode()),)))
