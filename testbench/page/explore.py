"""What a figure shows, as numbers that a reader explores: zooms, pans, reads under the cursor, switches on and off.

The numbers lie in the page as JSON in an attribute, where no text can become markup; curves are 32-bit floats in
base64, half the size of decimals. Without a script, and in print, the drawn figure stands alone.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.plot import COLOURS, DASHES, INK, MEASURED, QUIET

if TYPE_CHECKING:
    from testbench.core.record import FloatArray

MOST_VALUES = 30_000
"""Values of one figure that a page holds, 160 kB; curves that are longer keep the peaks of each stretch."""
_LEAST_POINTS = 300  # of a curve, however many there are
_TOKENS = {INK: "ink", QUIET: "quiet", MEASURED: "measured"}
_HUGE = float(np.finfo(np.float32).max)


@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """One line or set of signs: ``name`` is that of the legend, ``x`` and ``y`` (n,) are in the units of the panel.

    ``marker`` draws signs instead of a line: "o", "s", "D", "^", "v", "P" or "+".
    """

    name: str
    x: FloatArray
    y: FloatArray
    colour: str = INK
    dash: tuple[float, ...] = ()
    width: float = 1.4
    marker: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Panel:
    """Curves over one pair of axes.

    Attributes:
        title: symbol and unit, such as "q, deg/s"; it is the name of the channel that a reader switches.
        x: quantity and unit of the horizontal axis.
        curves: what is drawn.
        log_x, log_y: logarithmic axes.
        limits: lowest and highest y that is shown; None shows all. Numbers beyond are still read under the cursor.
        band: from and to on the horizontal axis, shaded.
        marks: (place on the horizontal axis, name), drawn as vertical lines.
        hidden: switched off until the reader asks for it.
    """

    title: str
    x: str
    curves: Sequence[Curve]
    log_x: bool = False
    log_y: bool = False
    limits: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    marks: Sequence[tuple[float, str]] = ()
    hidden: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """Panels one below the other over one horizontal axis, which they share; one of several that a reader chooses.

    Attributes:
        name: in the list of views.
        panels: at least one.
        reference: name of the curve from which the others are subtracted when residuals are asked for; "" offers none.
        plane: both axes are alike, as in a map of poles: zoom and cursor work in the plane.
        link: views of a page with one link move together; "" for none.
    """

    name: str
    panels: Sequence[Panel]
    reference: str = ""
    plane: bool = False
    link: str = ""


@dataclass(frozen=True, eq=False)
class Explorable:
    """A figure as numbers: one or more views."""

    views: Sequence[View] = field(default_factory=tuple)

    def to_json(self) -> str:
        """Return the figure as one line of JSON; what is not finite is a gap in its curve."""
        curves = sum(len(p.curves) for v in self.views for p in v.panels)
        most = max(_LEAST_POINTS, MOST_VALUES // max(curves, 1))
        axes: dict[Any, int] = {}
        views = [_view(v, most, axes) for v in self.views]
        return json.dumps({"x": list(map(_clock, axes)), "views": views}, ensure_ascii=False, separators=(",", ":"))


def line_style(k: int) -> dict[str, Any]:
    """Return colour and dash of the k-th model for a :class:`Curve`, as in the drawn figures."""
    dash = DASHES[(k + k // 6) % 6]
    return {"colour": COLOURS[k % 6], "dash": () if dash == "-" else tuple(dash[1])}


def peaks_kept(x: FloatArray, y: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """Return at most about ``most`` points of a curve: the lowest and the highest value of each stretch, in order.

    Both stand at times that depend on the clock alone, so that curves over one clock keep one clock, and one cursor
    reads them all. A value moves by less than the length of a stretch. A stretch without any finite value is a gap.
    """
    n = x.size
    size = -(-2 * n // most)
    if size < 3:
        return x, y
    count = n // size
    blocks = y[: count * size].reshape(count, size)
    low, high = np.fmin.reduce(blocks, axis=1), np.fmax.reduce(blocks, axis=1)
    at_low = np.argmin(np.where(np.isnan(blocks), np.inf, blocks), axis=1)
    at_high = np.argmax(np.where(np.isnan(blocks), -np.inf, blocks), axis=1)
    rising = at_low <= at_high
    ends = np.stack([np.where(rising, low, high), np.where(rising, high, low)], axis=1).ravel()
    starts = size * np.arange(count)
    rows = np.stack([starts, starts + size // 2], axis=1).ravel()
    return np.concatenate([x[rows], x[count * size :]]), np.concatenate([ends, y[count * size :]])


def _view(view: View, most: int, axes: dict[Any, int]) -> dict[str, Any]:
    out = {"name": view.name, "panels": [_panel(p, most, axes) for p in view.panels]}
    return out | _given(ref=view.reference, plane=view.plane, link=view.link)


def _panel(panel: Panel, most: int, axes: dict[Any, int]) -> dict[str, Any]:
    longest = max((c.x.size for c in panel.curves if not c.marker), default=0)
    out: dict[str, Any] = {
        "title": panel.title,
        "x": panel.x,
        "curves": [_curve(c, most, axes, panel) for c in panel.curves],
    }
    out |= _given(logX=panel.log_x, logY=panel.log_y, hidden=panel.hidden)
    if panel.limits is not None and all(map(math.isfinite, panel.limits)):
        out["limits"] = panel.limits
    if panel.band is not None:
        out["band"] = panel.band
    if panel.marks:
        out["marks"] = [(float(x), text) for x, text in panel.marks if math.isfinite(x)]
    stretch = -(-2 * longest // most)
    if stretch > 2:
        out["stretch"] = stretch
    return out


def _curve(curve: Curve, most: int, axes: dict[Any, int], panel: Panel) -> dict[str, Any]:
    x = np.asarray(curve.x, float)
    y = np.where(np.abs(curve.y) < _HUGE, curve.y, np.nan)
    if panel.log_y:
        y = np.where(y > 0.0, y, np.nan)
    if panel.log_x:
        x, y = x[x > 0.0], y[x > 0.0]
    if not curve.marker:
        x, y = peaks_kept(x, y, most)
    key = _uniform(x) or x.astype("<f4").tobytes()
    colour = _TOKENS.get(curve.colour, curve.colour)
    out = {"name": curve.name, "x": axes.setdefault(key, len(axes)), "y": _packed(y.astype("<f4").tobytes())}
    return out | {"colour": colour, "width": curve.width} | _given(dash=list(curve.dash), marker=curve.marker)


def _uniform(x: FloatArray) -> tuple[float, float, int] | None:
    """Return start, step and number of an even clock; None if it is uneven."""
    if x.size < 3:
        return None
    step = (float(x[-1]) - float(x[0])) / (x.size - 1)
    even = float(x[0]) + step * np.arange(x.size)
    return (float(x[0]), step, x.size) if np.abs(even - x).max() < 0.01 * abs(step) else None


def _clock(key: Any) -> Any:
    return _packed(key) if isinstance(key, bytes) else key


def _packed(values: bytes) -> str:
    return base64.b64encode(values).decode()


def _given(**values: Any) -> dict[str, Any]:
    return {key: value for key, value in values.items() if value}
