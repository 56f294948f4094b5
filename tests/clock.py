"""What a clock shows between two readings, as studies and benchmarks divide by it.

The clocks of some machines advance in steps of 10 ms: the smallest unit of work then takes no time at all.
"""

import time
from collections.abc import Callable

SHORTEST_S = 1e-9  # below what any clock tells apart; rates and ratios of what took no time are very large, and finite


def since(start_s: float, clock: Callable[[], float] = time.process_time) -> float:
    """Return the time that a clock has shown since a reading of it, s, above zero."""
    return some(clock() - start_s)


def some(seconds: float) -> float:
    """Return a time, s, above zero."""
    return max(seconds, SHORTEST_S)
