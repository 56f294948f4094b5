"""The model order from singular values."""

from __future__ import annotations

import numpy as np

from testbench.core.errors import EstimationError
from testbench.core.record import FloatArray

EXACT = 1e-9
"""Innovations below this share of an output's root mean square are rounding: the output is free of noise."""

_FLOOR = 2.0  # singular values beyond this many noise floors belong to states
_GAP = 3.0  # a fall by this factor from one singular value to the next is a clear gap


def choose_order(values: FloatArray, noisy: bool, most: int) -> tuple[int, str]:
    """Return the order and why, from singular values relative to the noise floor (noise-free: to the largest).

    Raises:
        EstimationError: no singular value stands above the floor.
    """
    floor = _FLOOR if noisy else EXACT
    above = min(int(np.sum(values > floor)), most)
    if above == 0:
        raise EstimationError(
            f"no state stands out of the noise: the largest singular value is {values[0]:.2g} times the noise floor, "
            f"{floor:g} is needed; excite more strongly, or lengthen the future horizon"
        )
    following = np.append(values[1:], 0.0)[:most]
    ratios = (values[:most] / np.maximum(following, 1e-3 * floor))[:above]
    clear = np.flatnonzero(ratios >= _GAP)
    n = int(clear[-1] if clear.size else np.argmax(ratios)) + 1
    kind = "last clear" if clear.size else "widest, not clear"
    return (
        n,
        f"{above} singular values stand above the noise floor; the {kind} gap, "
        f"a factor {ratios[n - 1]:.3g}, follows number {n}",
    )
