"""A change relative to a value, in words: in percent, unless the value is so small that percent of it say nothing."""

from __future__ import annotations

_PERCENT_TO = 2.0
_TIMES_TO = 100.0
_MOST_PERCENT = 1000.0


def share_in_words(share: float) -> str:
    """Return ``share`` of a value in words: "40 %", "12 times its size" or "more than 100 times its size".

    A value with such a share is near zero, and the digits of its share are those of its error.

    Args:
        share: change over value, 1; not negative.
    """
    if share <= _PERCENT_TO:
        return f"{100.0 * share:.0f} %"
    return f"{share:.2g} times its size" if share < _TIMES_TO else f"more than {_TIMES_TO:g} times its size"


def percent_in_words(percent: float) -> str:
    """Return an error in percent of what is predicted, "17.3 %", or "over 1000 %": more digits say nothing."""
    if percent > _MOST_PERCENT:
        return f"over {_MOST_PERCENT:g} %"
    return f"{percent:.3g} %" if percent < _MOST_PERCENT / 10.0 else f"{percent:.0f} %"
