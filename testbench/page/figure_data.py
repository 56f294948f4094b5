"""What a figure shows, as a CSV file, and the few lines of Python that draw it again from that file.

The CSV has two columns for each curve: x and y, with the labels and units of their axes as heads. It holds what is
drawn: long records are drawn by their envelopes, and the records themselves hold every sample.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pprint import pformat
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.escape import csv_cell, one_line, python_docstring
from testbench.core.record import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLE_IN = 0.2
_NO_MARKER = ("None", "none", "", " ")
_NEAR = 1e-3  # of a figure's width or height: two panels are in one column or row
_SCRIPT = '''\
"""Draws {name} again from {name}.csv: python {name}.py writes {name}_redrawn.png."""

import csv
from pathlib import Path

import matplotlib.pyplot as plt

HERE = Path(__file__).resolve()
plt.rcParams.update({{"font.size": 9, "axes.titlelocation": "left", "axes.titlesize": 9}})
SIZE_IN = {size}
PANELS = {panels}  # place in the figure, and settings of the axes
CURVES = {curves}  # panel, how it is drawn, and how it looks; in the order of the file's columns
MAPS = {maps}  # panel, file of its values, and how they are shown
figure = plt.figure(figsize=SIZE_IN)
panels = [figure.add_axes(place, **settings) for place, settings in PANELS]
with HERE.with_suffix(".csv").open(encoding="utf-8", newline="") as file:
    heads, *rows = csv.reader(file)
for k, (panel, how, look) in enumerate(CURVES):
    points = [(float(row[2 * k]), float(row[2 * k + 1])) for row in rows if row[2 * k]]
    getattr(panels[panel], how)(*zip(*points), **look)
for panel, file, settings in MAPS:
    values = [[float(v) for v in row] for row in csv.reader(HERE.with_name(file).open(encoding="utf-8"))]
    panels[panel].imshow(values, **settings)
for panel, (_, settings) in zip(panels, PANELS):
    panel.set(xlim=settings["xlim"], ylim=settings["ylim"])
    panel.xaxis.set_minor_formatter("")
    panel.yaxis.set_minor_formatter("")
if any("label" in look for _, _, look in CURVES):
    figure.legend(loc="lower left", bbox_to_anchor=(0, {above}), frameon=False)
figure.savefig(HERE.with_name(HERE.stem + "_redrawn.png"), dpi=150, bbox_inches="tight")
'''


@dataclass(frozen=True, eq=False)
class Curve:
    """What one artist of a panel shows.

    Attributes:
        panel: number of its panel, from 0.
        how: "plot" a line or points, "fill" the outline of an area.
        x, y: points (n,), in the units of the axes; NaN where a line is broken.
        look: colour and so on, as the method ``how`` of matplotlib's Axes takes them.
        label: as the legend names it, or "".
    """

    panel: int
    how: str
    x: FloatArray
    y: FloatArray
    look: dict[str, Any]
    label: str


def curves_of(figure: Figure) -> list[Curve]:
    """Return all curves, points and areas of a figure's panels, panel by panel; :func:`maps_of` has the images."""
    named = _named(figure)
    out: list[Curve] = []
    for k, axes in enumerate(_panels(figure)):
        for how, own, look, x, y in _drawn(axes):
            unnamed = own in ("", "None") or own.startswith("_")
            shade = look.get("alpha") is not None  # behind curves, for which its colour says nothing
            key = (look["color"], str(look.get("linestyle", "")), str(look.get("marker", "")))
            label = ("" if shade else named.get(key, "")) if unnamed else own
            out.append(Curve(k, how, x, y, look, label))
    return out


def maps_of(figure: Figure, name: str) -> list[tuple[int, str, dict[str, Any], str]]:
    """Return panel, file name, settings of ``imshow`` and values as CSV, a row of the image each, of all images."""
    out: list[tuple[int, str, dict[str, Any], str]] = []
    for k, axes in enumerate(_panels(figure)):
        for image in axes.images:
            values: FloatArray = np.ma.filled(np.ma.asarray(image.get_array(), float), np.nan)
            low, high = image.get_clim()
            settings = {
                "extent": tuple(float(v) for v in image.get_extent()), "origin": image.origin, "aspect": "auto",
                "cmap": image.get_cmap().name, "vmin": float(low or 0.0), "vmax": float(1.0 if high is None else high),
            }  # fmt: skip
            text = "".join(",".join(f"{v:.10g}" for v in row) + "\n" for row in values)
            out.append((k, f"{name}_map_{len(out) + 1}.csv", settings, text))
    return out


def csv_of(figure: Figure, curves: list[Curve]) -> str:
    """Return the points of curves as CSV, two columns each, under the labels of their axes, with units.

    A head is "PANEL.CURVE label of the axis", that of y followed by the panel's title and the curve's label.
    """
    panels = _panels(figure)
    heads: list[str] = []
    counted = [0] * len(panels)
    for curve in curves:
        counted[curve.panel] += 1
        axes = panels[curve.panel]
        number = f"{curve.panel + 1}.{counted[curve.panel]}"
        x, y = _axis_label(axes, panels, "x"), _axis_label(axes, panels, "y")
        heads.append(f"{number} {x}")
        more = [part for part in (_title(axes), curve.label) if part]
        heads.append(" | ".join([f"{number} {y}", *more]))
    longest = max((curve.x.size for curve in curves), default=0)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([csv_cell(one_line(head)) for head in heads])
    texts = [[f"{value:.10g}" for value in values] for curve in curves for values in (curve.x, curve.y)]
    writer.writerows([column[i] if i < len(column) else "" for column in texts] for i in range(longest))
    return out.getvalue()


def script_of(figure: Figure, curves: list[Curve], name: str) -> str:
    """Return a Python program that draws the curves of NAME.csv again; it needs matplotlib alone."""
    places = [tuple(round(float(v), 4) for v in axes.get_position().bounds) for axes in _panels(figure)]
    panels = [(place, _settings(axes)) for place, axes in zip(places, _panels(figure), strict=True)]
    open_names = set(_named(figure).values())  # that the legend has still to show
    looks = []
    for curve in curves:
        look = dict(curve.look)
        if curve.label in open_names:
            look["label"] = curve.label
            open_names.remove(curve.label)
        looks.append((curve.panel, curve.how, look))
    maps = [(panel, file, settings) for panel, file, settings, _ in maps_of(figure, name)]
    width, height = (round(float(v), 3) for v in figure.get_size_inches())
    above = max((place[1] + place[3] for place in places), default=1.0) + _TITLE_IN / height
    shown = [pformat(part, width=116, compact=True, sort_dicts=False) for part in (panels, looks, maps)]
    return _SCRIPT.format(
        name=python_docstring(name),
        size=(width, height),
        panels=shown[0],
        curves=shown[1],
        maps=shown[2],
        above=round(above, 4),
    )


def _panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_visible() and axes.get_label() != "<colorbar>"]


def _title(axes: Axes) -> str:
    return axes.get_title(loc="left") or axes.get_title()


def _axis_label(axes: Axes, panels: list[Axes], which: str) -> str:
    """Return the label of an axis; of a panel that has none, that of the next one below it or left of it."""
    own = str(getattr(axes, f"get_{which}label")())
    if own:
        return own
    box = axes.get_position()
    best, found = np.inf, ""
    for other in panels:
        text = str(getattr(other, f"get_{which}label")())
        there = other.get_position()
        off, away = (there.x0 - box.x0, box.y0 - there.y0) if which == "x" else (there.y0 - box.y0, box.x0 - there.x0)
        if text and abs(off) < _NEAR and 0.0 < away < best:
            best, found = away, text
    return found or which


def _named(figure: Figure) -> dict[tuple[str, str, str], str]:
    """Return (colour, dash, marker) -> label of all that legends of a figure name; of areas dash and marker are "".

    Legends show bars as lines, so that their colour is enough. A look that a legend gives two names is left out.
    """
    from matplotlib.lines import Line2D

    found: dict[tuple[str, str, str], set[str]] = {}
    for legend in [*figure.legends, *(axes.get_legend() for axes in figure.axes)]:
        if legend is None:
            continue
        handles: list[Any] = list(legend.legend_handles)  # of the many kinds, all that the testbench uses have a colour
        for handle, text in zip(handles, legend.get_texts(), strict=True):
            if isinstance(handle, Line2D):
                marker = str(handle.get_marker())
                look = (str(_dash(handle)), "" if marker in _NO_MARKER else marker)
                key = (_hex(handle.get_color()), *look)
            else:
                key = (_hex(handle.get_facecolor()), "", "")
            for known in {key, (key[0], "", "")}:
                found.setdefault(known, set()).add(text.get_text())
    return {key: texts.pop() for key, texts in found.items() if len(texts) == 1}


def _dash(line: Any) -> Any:
    """Return the dashes of a line as matplotlib takes them: get_linestyle calls all that are its own "--"."""
    offset, dashes = getattr(line, "_unscaled_dash_pattern", (0, None))
    style = line.get_linestyle()
    return (offset, tuple(float(d) for d in dashes)) if dashes and style == "--" else style


_Drawn = Iterator[tuple[str, str, dict[str, Any], FloatArray, FloatArray]]
"""How, label, look, x and y of what is drawn."""


def _drawn(axes: Axes) -> _Drawn:
    """Return all that a panel shows as data."""
    yield from _lines(axes)
    yield from _collections(axes)
    for patch in axes.patches:
        look = {"color": _hex(patch.get_facecolor()), "alpha": patch.get_alpha(), "linewidth": 0.0}
        path = patch.get_patch_transform().transform_path(patch.get_path())
        for polygon in path.to_polygons():
            yield "fill", str(patch.get_label()), look, *_points(axes, polygon, patch.get_data_transform())


def _points(axes: Axes, points: Any, transform: Any) -> tuple[FloatArray, FloatArray]:
    """Return x and y of points (n, 2) in the units of the axes."""
    if transform != axes.transData:
        points = (transform - axes.transData).transform(points)
    out = np.asarray(points, float).reshape(-1, 2)
    return out[:, 0], out[:, 1]


def _lines(axes: Axes) -> _Drawn:
    """Return the lines of a panel; not those that lead from a line to its name beside the panel."""
    for line in axes.lines:
        if line.get_transform() != axes.transData and not line.get_clip_on():
            continue
        xy: FloatArray = np.column_stack([np.ma.filled(np.ma.asarray(d, float), np.nan) for d in line.get_data()])
        look = {"color": _hex(line.get_color()), "linestyle": _dash(line), "linewidth": line.get_linewidth()}
        if str(line.get_marker()) not in _NO_MARKER:
            inside = _hex(line.get_markerfacecolor())
            look |= {"marker": line.get_marker(), "markersize": line.get_markersize(), "markerfacecolor": inside}
        yield "plot", str(line.get_label()), look, *_points(axes, xy, line.get_transform())


def _collections(axes: Axes) -> _Drawn:
    """Return the scattered points, the segments and the areas of a panel."""
    from matplotlib.collections import LineCollection, PathCollection, PolyCollection

    for kept in axes.collections:
        label = str(kept.get_label())
        if isinstance(kept, PathCollection):
            look = {"color": _hex(kept.get_facecolor()), "linestyle": "none", "marker": "o", "markersize": 3.0}
            yield "plot", label, look, *_points(axes, kept.get_offsets(), kept.get_offset_transform())
        elif isinstance(kept, LineCollection):
            gap = np.full((1, 2), np.nan)  # between segments the pen is lifted
            parts = [part for s in kept.get_segments() if len(s) for part in (np.asarray(s, float), gap)]
            if parts:
                look = {"color": _hex(kept.get_color()), "linewidth": 0.8}
                yield "plot", label, look, *_points(axes, np.vstack(parts[:-1]), kept.get_transform())
        elif isinstance(kept, PolyCollection):
            look = {"color": _hex(kept.get_facecolor()), "alpha": kept.get_alpha(), "linewidth": 0.0}
            for polygon in (polygon for path in kept.get_paths() for polygon in path.to_polygons()):
                yield "fill", label, look, *_points(axes, polygon, kept.get_transform())


def _hex(color: Any) -> str:
    """Return one colour, the first of many, as "#rrggbb"; "none" if there is none."""
    from matplotlib.colors import to_hex

    if isinstance(color, str):
        return color if color == "none" else to_hex(color)
    values: Any = np.ravel(np.asarray(color, float))[:4]
    return "none" if values.size < 3 or (values.size > 3 and values[3] == 0.0) else to_hex(values)


def _settings(axes: Axes) -> dict[str, Any]:
    """Return the settings of a panel that ``Figure.add_axes`` takes."""
    from matplotlib.ticker import FixedLocator

    out: dict[str, Any] = {"title": _title(axes)}
    for which, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        out[f"{which}label"] = str(getattr(axes, f"get_{which}label")())
        out[f"{which}scale"] = str(getattr(axes, f"get_{which}scale")())
        out[f"{which}lim"] = tuple(float(f"{v:.6g}") for v in getattr(axes, f"get_{which}lim")())
        if isinstance(axis.get_major_locator(), FixedLocator):
            places = [float(v) for v in axis.get_majorticklocs()]
            out[f"{which}ticks"] = places
            out[f"{which}ticklabels"] = list(axis.get_major_formatter().format_ticks(places))
    return out
