"""What all figures of the reproduction share: the looks of their curves, and panels of one height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from testbench.page.figure import COLOURS, DASHES, INK, MEASURED, QUIET, Curve, Panel, Plate, grid

if TYPE_CHECKING:
    from testbench.core.record import FloatArray

_NAMED = {"ink": INK, "measured": MEASURED, "quiet": QUIET}


def line(x: FloatArray, y: FloatArray, name: str, colour: int | str, **more: Any) -> Curve:
    """Return one curve or, not ``joined``, one set of signs.

    Args:
        x: points (n,).
        y: the same.
        name: of the legend; it looks the same in every panel.
        colour: number of the palette, or "ink", "measured" or "quiet".
        more: of :class:`testbench.page.figure.Curve`.
    """
    joined = more.pop("joined", True)
    numbered = isinstance(colour, int)
    look: dict[str, Any] = {"colour": COLOURS[int(colour) % 6] if numbered else _NAMED[str(colour)]}
    if joined and numbered:
        look["dash"] = DASHES[int(colour) % 6]
    if more.get("marker"):
        look |= {"size": 4.0 if joined else 4.5, "hollow": not joined and more["marker"] in "osD^v"}
    return Curve(x=x, y=y, name=name, joined=joined, **look | more)


def plate(
    name: str, title: str, caption: str, panels: Sequence[Panel], columns: int = 2, height_in: float = 1.7
) -> Plate:
    """Return a figure of ``panels``, row by row in so many columns, under one legend of all names."""
    return Plate(name, title, caption, grid([replace(p, tall_in=height_in) for p in panels], columns))
