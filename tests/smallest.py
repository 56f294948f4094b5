"""Studies and benchmarks at their smallest: with TESTBENCH_SMALLEST=FOLDER each does its first unit of work alone.

``TESTBENCH_SMALLEST=build/smallest make benchmarks`` shows in seconds for each that all of them still run. What they
write goes to FOLDER, so that no committed table is written over, and no law of speed is judged: it holds at full size.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
ROOT = Path(__file__).resolve().parents[1]
SMALLEST = os.environ.get("TESTBENCH_SMALLEST", "")


def sized(full: T, smallest: T) -> T:
    """Return how much a study does: all of it, or the least that shows that it runs."""
    return smallest if SMALLEST else full


def results(*parts: str) -> Path:
    """Return the place of a result below results/, its folder made."""
    return _place("results", *parts)


def build(*parts: str) -> Path:
    """Return the place below build/ of what a study keeps to go on from, its folder made."""
    return _place("build", *parts)


def _place(*parts: str) -> Path:
    path = ROOT.joinpath(SMALLEST, *parts)
    (path.parent if path.suffix else path).mkdir(parents=True, exist_ok=True)
    return path
