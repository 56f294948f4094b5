"""The part that a verdict points to, drawn on a sketch of an aircraft from above and from the side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from testbench.core.record import FloatArray
from testbench.page.plot import COLOURS, FAINT, QUIET, Plate, new_figure
from testbench.questions.gap.explain import percent
from testbench.questions.gap.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARK = COLOURS[1]
Outline = Sequence[tuple[float, float]]


def _box(x: float, y: float, dx: float, dy: float) -> Outline:
    return ((x, y), (x + dx, y), (x + dx, y + dy), (x, y + dy))


def _round(x: float, y: float, r: float) -> Outline:
    angle = np.linspace(0.0, 2.0 * np.pi, 40)
    return tuple(zip(x + r * np.cos(angle), y + r * np.sin(angle), strict=True))


# A sketch, nose to the left, half a span long: (from above, from the side), each outlines in that length.
_BODY_X = (0.0, 0.07, 0.35, 1.0, 1.0, 0.35, 0.07, 0.0)
_BODY_ABOVE: Outline = tuple(zip(_BODY_X, (-0.03, -0.06, -0.06, -0.02, 0.02, 0.06, 0.06, 0.03), strict=True))
_BODY_SIDE: Outline = tuple(zip(_BODY_X, (-0.03, -0.07, -0.06, 0.0, 0.05, 0.08, 0.07, 0.03), strict=True))
_WINGS: tuple[Outline, ...] = (_box(0.25, 0.06, 0.2, 0.94), _box(0.25, -1.0, 0.2, 0.94))
_TAIL_ABOVE, _FIN = _box(0.85, -0.3, 0.15, 0.6), ((0.82, 0.05), (0.9, 0.28), (1.0, 0.28), (1.0, 0.05))
_WING_SIDE, _TAIL_SIDE = _box(0.25, 0.06, 0.2, 0.03), _box(0.85, 0.03, 0.15, 0.025)
_ELEVATOR = (_box(0.95, -0.3, 0.05, 0.6),), (_box(0.94, 0.03, 0.06, 0.025),)
_AILERON = (_box(0.4, 0.55, 0.05, 0.42), _box(0.4, -0.97, 0.05, 0.42)), (_box(0.4, 0.06, 0.05, 0.03),)
_RUDDER: tuple[tuple[Outline, ...], tuple[Outline, ...]] = ((), (_box(0.95, 0.05, 0.05, 0.23),))
_PROPELLER = (_box(-0.03, -0.14, 0.03, 0.28),), (_box(-0.03, -0.14, 0.03, 0.28),)
_BALANCE = (_round(0.32, 0.0, 0.045),), (_round(0.32, 0.02, 0.045),)
_LIFTING = (*_WINGS, _TAIL_ABOVE), (_WING_SIDE, _TAIL_SIDE)
_BOX = (_box(0.14, -0.035, 0.1, 0.07),), (_box(0.14, -0.03, 0.1, 0.06),)
_NOSE = (_round(0.03, 0.0, 0.035),), (_round(0.03, 0.0, 0.035),)
_REGIONS: Mapping[str, tuple[tuple[Outline, ...], tuple[Outline, ...]]] = {
    **dict.fromkeys(("elevator path", "de sensor"), _ELEVATOR),
    **dict.fromkeys(("aileron path", "da sensor"), _AILERON),
    **dict.fromkeys(("rudder path", "dr sensor"), _RUDDER),
    "thrust": _PROPELLER,
    "mass": _BALANCE,
    "structure": ((*_WINGS, _box(0.5, -0.045, 0.35, 0.09)), (_WING_SIDE, _box(0.5, -0.02, 0.35, 0.07))),
    "lift": (_WINGS, (_WING_SIDE,)),
    "drag": ((_BODY_ABOVE,), (_BODY_SIDE,)),
    "pitching moment": _LIFTING,
    "wing": (_WINGS, (_WING_SIDE,)),
    "fin": ((_box(0.82, -0.015, 0.18, 0.03),), (_FIN,)),
    "autopilot": _BOX,
}


def part_plate(verdict: Verdict) -> Plate | None:
    """Return the figure of the parts that a verdict calls; None if it calls none."""
    if not verdict.parts:
        return None

    def make(wide: bool) -> Figure:
        """Draw the sketch from above and from the side, the parts filled."""
        figure = new_figure(wide, 2.3 if wide else 2.0)
        above, side = figure.subplots(1, 2)
        figure.subplots_adjust(left=0.02, right=0.98, top=0.88, bottom=0.03, wspace=0.03)
        _sketch(above, (_BODY_ABOVE, *_WINGS, _TAIL_ABOVE), "from above", (-1.1, 1.1))
        _sketch(side, (_BODY_SIDE, _WING_SIDE, _TAIL_SIDE, _FIN), "from the side", (-0.35, 0.6))
        for part in verdict.parts:
            for axes, outlines in zip((above, side), _region(part.name), strict=True):
                for outline in outlines:
                    axes.fill(*np.transpose(outline), facecolor=_MARK, edgecolor=_MARK, linewidth=1.0)
                if part.name == "air":
                    _wind(axes)
        return figure

    caption = f"A sketch, not this aircraft. Filled: {verdict.where}. Probability: {percent(verdict.probability)}."
    return Plate("part", "Where to look", caption, make)


def _region(name: str) -> tuple[tuple[Outline, ...], tuple[Outline, ...]]:
    """Return the outlines of a part from above and from the side; a sensor sits in the nose, a vane beside it."""
    if name in _REGIONS:
        return _REGIONS[name]
    return _NOSE if name.endswith("sensor") else ((), ())


def _sketch(axes: Axes, outlines: Sequence[Outline], title: str, height: tuple[float, float]) -> None:
    for outline in outlines:
        axes.fill(*np.transpose(outline), facecolor=FAINT, edgecolor=QUIET, linewidth=0.8)
    axes.set(xlim=(-0.35, 1.1), ylim=height, aspect="equal")
    axes.set_title(title, fontsize=9, color=QUIET)
    axes.set_axis_off()


def _wind(axes: Axes) -> None:
    """Draw three gusts ahead of the nose."""
    x: FloatArray = np.linspace(-0.32, -0.08, 40)
    shift: Callable[[float], FloatArray] = lambda y: y + 0.025 * np.sin(2.0 * np.pi * (x + 0.32) / 0.12)  # noqa: E731
    for y in (-0.15, 0.0, 0.15):
        axes.plot(x, shift(y), color=_MARK, linewidth=1.6)
