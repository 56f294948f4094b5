"""The most memory that one thing may take: a file's numbers, a flight. Every door asks before memory is taken.

A file of a kilobyte can say that it holds gigabytes, and a scenario of a line that it lasts for months. The limit is
1 GB, or what the environment variable TESTBENCH_MEMORY_GB says. What a command takes in all is a few times as much.
"""

from __future__ import annotations

import math
import os

from testbench.core.errors import SizeError

VARIABLE = "TESTBENCH_MEMORY_GB"
USUAL_GB = 1.0
NUMBER = 8
"""Bytes of a number in memory, whatever it is on disk."""


def most_bytes() -> float:
    """Return the limit in bytes.

    Raises:
        SizeError: the environment variable is set and is no number above 0.
    """
    text = os.environ.get(VARIABLE, "").strip()
    try:
        limit = float(text) if text else USUAL_GB
    except ValueError:
        limit = math.nan
    if not limit > 0.0:
        raise SizeError(f"{VARIABLE} must be a number of gigabytes above 0, got '{text[:60]}'")
    return 1e9 * limit


def require_room(what: str, size: float, fix: str) -> None:
    """Check that something may be held in memory.

    Args:
        what: what it is, the subject of the message.
        size: that it will take, bytes.
        fix: what to do about it.

    Raises:
        SizeError: it takes more than the limit.
    """
    limit = most_bytes()
    if not size <= limit:
        raise SizeError(
            f"{what} must take at most {limit / 1e9:g} GB of memory ({VARIABLE}), got {size / 1e9:.3g} GB; {fix}"
        )
