"""Numbers in words, alike in every layer."""

from __future__ import annotations

import math

_MOST_DECIMALS = 8


def with_error(value: float, error: float) -> str:
    """Return a value and its standard error, both with as many decimals as the error has in two digits."""
    if not (math.isfinite(error) and error > 0.0):
        return f"{value:.6g} ± {error:.2g}"
    decimals = max(1 - math.floor(math.log10(error)), 0)
    if decimals > _MOST_DECIMALS:
        return f"{value:.4g} ± {error:.2g}"
    return f"{value:z.{decimals}f} ± {error:.{decimals}f}"
