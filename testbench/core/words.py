"""Numbers in words, alike in every layer."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MOST_DECIMALS = 8
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def with_error(value: float, error: float) -> str:
    """Return a value and its standard error, both with as many decimals as the error has in two digits."""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g} ± {error:.2g}"
    decimals = max(1 - math.floor(math.log10(error)), 0)
    if decimals > _MOST_DECIMALS:
        return f"{value:.4g} ± {error:.2g}"
    return f"{value:z.{decimals}f} ± {error:.{decimals}f}"


def without_numbers(text: str) -> str:
    """Return a text with # for each number, so that reasons which differ in numbers alone can be counted together."""
    return _NUMBER.sub("#", text)


def array_found(array: NDArray[Any]) -> str:
    """Return what an array is like, for an error that says what it must be: its shape, and whether it holds numbers."""
    odd = "" if np.isfinite(array).all() else ", with NaN" if np.isnan(array).any() else ", with infinite values"
    return f"shape {array.shape}{odd}"
