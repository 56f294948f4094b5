"""What an answer is worth: the names that were said of a case against the names that are right.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Sequence

VERDICTS = ("right", "in set", "one of two", "wrong", "wrong set", "none", "unexplained")
NO_GAP, UNEXPLAINED = "no gap", "unexplained"
"""Outcomes without a name: nothing is missing; something is, and no effect explains it."""


def verdict(right: Sequence[Sequence[str]], outcome: str, names: Sequence[str]) -> str:
    """Return the verdict on one answer, one of :data:`VERDICTS`.

    Of two effects at once both must be named for "right". Where nothing is hidden, or nothing that the library holds,
    any name is wrong, and so is a set. Where one effect has several right names, several of them together are right,
    too: a vane of second order is a lag and a delay.

    Args:
        right: for each hidden effect, the names that are right; none for an effect that the library does not hold.
        outcome: "no gap", "unexplained", or anything else if names are given.
        names: that were said; effects that act together are joined by " + ".
    """
    if outcome in (NO_GAP, UNEXPLAINED):
        return "none" if outcome == NO_GAP else "unexplained"
    known = [r for r in right if r]
    fits = [_fitting(name, known) for name in names]
    if not known or not any(fits):
        return "wrong" if len(names) == 1 else "wrong set"
    if len(names) > 1:
        return "in set" if max(fits) == len(known) else "wrong set"
    if not set(names[0].split(" + ")) <= set().union(*known):
        return "wrong"
    return "right" if fits[0] == len(known) else "one of two"


def _fitting(name: str, right: Sequence[Sequence[str]]) -> int:
    """Return how many of the hidden effects the parts of a name stand for."""
    parts, found = name.split(" + "), 0
    for names in right:
        match = next((p for p in parts if p in names), None)
        if match is not None:
            parts.remove(match)
            found += 1
    return found
