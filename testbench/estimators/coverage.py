"""How often intervals that are only approximate held the truth in the study of results/estimators."""

from __future__ import annotations

from testbench.core.advice import Advice, note
from testbench.estimators.coverage_table import HELD


def approximate(method: str, of: str = "its") -> tuple[Advice, ...]:
    """Return the note that says by how much the 95 % intervals of a method are off; empty where they are right.

    Args:
        method: an entry of :data:`.coverage_table.HELD`.
        of: whose intervals, for the sentence.
    """
    if method not in HELD:
        return ()
    low, high, seeds = HELD[method]
    share = f"{low} % of the cases" if low == high else f"{low} to {high} % of the cases, by quantity and aircraft"
    said = (
        f"{of} 95 % intervals are approximate: in {seeds} simulated flights of each of two small aircraft they "
        f"contained the truth in {share} (results/estimators)"
    )
    return (note("approximate_intervals", said),)
