"""What a figure shows, as numbers that a reader explores: zooms, pans, reads under the cursor, switches on and off.

The numbers lie in the page as JSON in an attribute, where no text can become markup; curves are 32-bit floats in
base64, half the size of decimals. Without a script, and in print, the drawn figure stands alone.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.figure import BAND, INK, MEASURED, QUIET, Curve, Panel, Rule, Span

if TYPE_CHECKING:
    from testbench.core.record import FloatArray

MOST_VALUES = 30_000
"""Values of one figure that a page holds, 160 kB; curves that are longer keep the peaks of each stretch."""
_LEAST_POINTS = 300  # of a curve, however many there are
_TOKENS = {INK: "ink", QUIET: "quiet", MEASURED: "measured"}
_HUGE = float(np.finfo(np.float32).max)


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """Panels one below the other over one horizontal axis, which they share; one of several that a reader chooses."""

    name: str  # in the list of views
    panels: Sequence[Panel]  # at least one
    # name of the curve from which the others are subtracted when residuals are asked for; "" offers none
    reference: str = ""
    plane: bool = False  # both axes are alike, as in a map of poles: zoom and cursor work in the plane
    link: str = ""  # views of a page with one link move together; "" for none


def to_json(views: Sequence[View], values: int = MOST_VALUES) -> str:
    """Return a figure of about so many values as one line of JSON; what is not finite is a gap in its curve."""
    curves = sum(len(p.curves) for v in views for p in v.panels)
    most = max(_LEAST_POINTS, values // max(curves, 1))
    axes: dict[Any, int] = {}
    shown = [_view(v, most, axes) for v in views]
    return json.dumps({"x": list(map(_clock, axes)), "views": shown}, ensure_ascii=False, separators=(",", ":"))


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
    curves = [c for c in panel.curves if c.name]
    longest = max((np.size(c.x) for c in curves if not _signs(c)), default=0)
    out: dict[str, Any] = {
        "title": panel.name or panel.y,
        "x": panel.x,
        "curves": [_curve(c, most, axes, panel) for c in curves],
    }
    out |= _given(logX=panel.log_x, logY=panel.log_y, hidden=panel.hidden)
    if panel.y_range is not None and all(v is not None and math.isfinite(v) for v in panel.y_range):
        out["limits"] = panel.y_range
    out |= _given(bands=[(d.low, d.high) for d in panel.draws if isinstance(d, Span) and d.colour == BAND])
    rules = [d for d in panel.draws if isinstance(d, Rule) and d.of == "x" and math.isfinite(d.at)]
    out |= _given(marks=[(float(d.at), d.text.rsplit("\n")[0]) for d in rules])
    stretch = -(-2 * longest // most)
    if stretch > 2:
        out["stretch"] = stretch
    return out


def _signs(curve: Curve) -> bool:
    return bool(curve.marker) and not curve.joined


def _curve(curve: Curve, most: int, axes: dict[Any, int], panel: Panel) -> dict[str, Any]:
    x, y = np.asarray(curve.x, float), np.asarray(curve.y, float)
    y = np.where(np.abs(y) < _HUGE, y, np.nan)
    if panel.log_y:
        y = np.where(y > 0.0, y, np.nan)
    if panel.log_x:
        x, y = x[x > 0.0], y[x > 0.0]
    if not _signs(curve):
        x, y = peaks_kept(x, y, most)
    key = _uniform(x) or x.astype("<f4").tobytes()
    colour = _TOKENS.get(curve.colour, curve.colour)
    out = {"name": curve.name, "x": axes.setdefault(key, len(axes)), "y": _packed(y.astype("<f4").tobytes())}
    out |= {"colour": colour, "width": curve.width}
    return out | _given(dash=list(curve.dash), marker=curve.marker if _signs(curve) else "")


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
