"""Derivatives by differences of a function that is evaluated at many points together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from testbench.core.record import FloatArray

Ends = tuple[FloatArray | None, FloatArray | None]
"""What a function gives a step above and a step below; None where it gives nothing, or was not asked."""


def ends(
    evaluate: Callable[[list[FloatArray]], Sequence[FloatArray | None]],
    x: FloatArray,
    steps: FloatArray,
    both: bool = False,
) -> list[Ends]:
    """Evaluate a function beside a point, one parameter moved at a time, all in one call.

    Args:
        evaluate: takes points (p,) and gives the function at each, or None where it has no value.
        x: (p,) the point.
        steps: (p,) of each parameter.
        both: on both sides; else above only.

    Returns:
        For each parameter its two ends.
    """
    signs = (1.0, -1.0) if both else (1.0,)
    found = evaluate([x + sign * step for step in np.diag(steps) for sign in signs])
    return list(zip(found[::2], found[1::2], strict=True)) if both else [(up, None) for up in found]


def slope(of: Ends, step: float, centre: Callable[[], FloatArray]) -> FloatArray | None:
    """Return the derivative by one parameter: central where there are two ends, else to the one that there is.

    Args:
        of: the ends.
        step: between the point and each of them.
        centre: gives the function at the point; called only if an end is missing.
    """
    up, down = of
    if up is not None and down is not None:
        return np.asarray((up - down) / (2.0 * step))
    if up is not None:
        return np.asarray((up - centre()) / step)
    return None if down is None else np.asarray((centre() - down) / step)
