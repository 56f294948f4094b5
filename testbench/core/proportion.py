"""How well a share is known that was counted: k of n."""

from __future__ import annotations

from typing import Literal


def proportion_interval(
    k: int, n: int, confidence: float = 0.95, method: Literal["wilson", "exact"] = "wilson"
) -> tuple[float, float]:
    """Return the interval of a probability after k of n; of none at all it is (0, 1).

    "wilson": the score interval (E. B. Wilson, JASA 22(158), 1927), close to its confidence near 0 and 1 too. "exact":
    never below its confidence (C. J. Clopper and E. S. Pearson, Biometrika 26, 1934).
    """
    from scipy.stats import binomtest

    if n == 0:
        return 0.0, 1.0
    found = binomtest(k, n).proportion_ci(confidence, method=method)
    return float(found.low), float(found.high)
