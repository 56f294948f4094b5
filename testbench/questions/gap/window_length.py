"""How long windows of records without quiet flight are."""

from __future__ import annotations

import math
from typing import Literal, cast

from testbench.core.errors import RecordError

Windows = float | Literal["auto", "off"]
"""Length of the windows, s; "auto" cuts what does not begin with quiet flight, by the fastest unstable mode."""
SHORTEST_S = 2.0
"""Of a window: about one short period, without which its coefficients do not show beside a free start."""


def windows_of(text: str | None) -> Windows | None:
    """Return what is wanted of windows; None if nothing is.

    Raises:
        RecordError: it is no length, nor "auto" or "off".
    """
    if text is None or text in ("auto", "off"):
        return cast(Windows | None, text)
    try:
        length_s = float(text)
    except ValueError:
        length_s = math.nan
    if not SHORTEST_S <= length_s < math.inf:
        raise RecordError(f"--windows must be auto, off, or a length of at least {SHORTEST_S:g} s, got '{text}'")
    return length_s
