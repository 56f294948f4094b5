"""The pole map: found poles beside the true ones, over circles of natural frequency and rays of damping ratio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.labels import number, symbol
from testbench.page.plot import FAINT, INK, Plate, grid, label, legend, legend_in, marker_look, new_figure
from testbench.questions.run.explored import pole_map
from testbench.questions.run.labels import case_names, elastic_names
from testbench.questions.run.pole_tables import printed_poles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.questions.run.result import RunResult

_RAYS = (0.1, 0.3, 0.5, 0.7, 0.9)  # damping ratios that are drawn
_Found = Sequence[tuple[str, list[complex], int]]  # label, poles of the upper half-plane, number of colour


def pole_plates(result: RunResult) -> list[Plate]:
    """Return the pole map: found poles of every model and the true ones, whole and near the origin."""
    found = _found_poles(result)
    true = printed_poles(result) if result.truth is None else dict(result.truth.modes)
    word = "printed" if result.truth is None else "true"
    if not found:
        return []
    windows = _windows(result, found, true)
    beyond = [f"{n} ({number(abs(p))} rad/s)" for n, p in true.items() if abs(p) > windows[0]]
    strays = sum(abs(p) > windows[0] for _, poles, _ in found for p in poles)
    caption = (
        "Continuous-time poles in the upper half of the s-plane. Circles: equal natural frequency; rays: equal damping "
        f"ratio. {f'Upright crosses: {word} modes. ' if true else ''}Coloured: found. A pole right of the vertical "
        f"axis is unstable.{f' {word.capitalize()} modes beyond the map: ' + ', '.join(beyond) + '.' if beyond else ''}"
        f"{f' Found poles beyond the map: {strays}, see the table.' if strays else ''}"
    )

    def make(wide: bool) -> Figure:
        """Draw one panel per window."""
        handles = _pole_handles(found, word if true else "")
        top = legend_in([str(h.get_label()) for h in handles], wide, 0.5 * len(windows)) + 0.28
        rows = 1 if wide else len(windows)
        tall = 3.2 if wide else 2.7
        figure = new_figure(wide, top + rows * tall + (rows - 1) * 0.8 + 0.5, 0.5 * len(windows))
        columns = [1.0] * len(windows) if wide else [1.0]
        panels = grid(figure, top, [tall] * rows, columns, gap_in=0.8).ravel()
        for i, (axes, reach) in enumerate(zip(panels, windows, strict=True)):
            _draw_poles(axes, reach, found, true)
            label(axes, "Re s, rad/s", "Im s, rad/s", "near the origin" if i else "")
        legend(figure, handles)
        return figure

    explore = partial(pole_map, found, true, word, windows)
    return [Plate("poles", f"Poles found and {word}" if true else "Poles found", caption, make, explore)]


def _windows(result: RunResult, found: _Found, true: Mapping[str, complex]) -> list[float]:
    """Return the reach of the map, rad/s: rigid modes and most found poles, and the slowest ones if far below them."""
    poles = [p for _, group, _ in found for p in group]
    rigid = [abs(p) for n, p in true.items() if n not in elastic_names(result)]
    base = max(rigid) if rigid else float(np.median(np.abs(poles))) if poles else 1.0
    far = 1.25 * max([base, *(abs(p) for p in poles if abs(p) < 4.0 * base)])
    slow = [w for w in rigid or [abs(p) for p in poles if p.imag > 1e-9] if w > 0.02]
    near = 2.0 * min(slow, default=far)
    return [far] if near > 0.4 * far else [far, near]


def _found_poles(result: RunResult) -> list[tuple[str, list[complex], int]]:
    """Return (label, poles of the upper half-plane, number of colour) of every model, or of a single one's outputs."""
    names = case_names(result.cases)
    sets = [case.model.poles() for case in result.cases]
    if len(sets) == 1 and len(sets[0]) > 1:
        return [(symbol(key), _upper(poles), k) for k, (key, poles) in enumerate(sets[0].items())]
    return [
        (name, [p for poles in found.values() for p in _upper(poles)], k)
        for k, (name, found) in enumerate(zip(names, sets, strict=True))
    ]


def _upper(poles: Any) -> list[complex]:
    return [complex(p) for p in poles if p.imag >= -1e-9]


def _draw_poles(axes: Axes, reach: float, found: _Found, true: Mapping[str, complex]) -> None:
    inside = [p for _, group, _ in found for p in group if abs(p) <= reach]
    right = max([0.16 * reach, *(1.25 * p.real for p in inside)])
    axes.set(xlim=(-reach, right), ylim=(-0.03 * reach, reach))
    axes.grid(False)
    _pole_grid(axes, reach)
    axes.axvline(0.0, color="#9aa1a9", linewidth=0.9)
    axes.axhline(0.0, color="#9aa1a9", linewidth=0.9)
    for k, (_, group, colour) in enumerate(found):
        points = np.array([p for p in group if abs(p) <= reach])
        look, marker = marker_look(colour)
        axes.plot(
            points.real, points.imag, marker, color=look, markersize=8 - k % 3,
            markerfacecolor="none", markeredgewidth=1.5, clip_on=False,
        )  # fmt: skip
    for name, pole in true.items():
        if abs(pole) <= reach:
            axes.plot(pole.real, pole.imag, "+", color=INK, markersize=11, markeredgewidth=1.6)
            if abs(pole) > 0.03 * reach:  # named in the map of what lies near the origin
                _name(axes, name, pole, [*(p for p in inside if p != pole), *_damping_labels(reach)])


def _name(axes: Axes, name: str, pole: complex, others: Sequence[complex]) -> None:
    """Write the name of a mode beside its pole, on the side where it covers fewest other poles; upright on the axis."""
    if abs(pole.imag) < 1e-9:  # real roots lie side by side
        axes.annotate(
            name, (pole.real, 0.0), (0, 9), textcoords="offset points", fontsize=8.5, rotation=90,
            ha="center", va="bottom",
        )  # fmt: skip
        return
    figure = axes.get_figure(root=True)
    assert figure is not None
    box, size = axes.get_position(), figure.bbox_inches.size
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    per_point = (right - left) / (72.0 * box.width * size[0]), (top - bottom) / (72.0 * box.height * size[1])
    wide, tall = (5.2 * len(name) + 14.0) * per_point[0], 20.0 * per_point[1]

    def cost(side: tuple[int, int]) -> float:
        """Return how many poles the name covers on that side; a side outside the axes counts as ten or more."""
        x = sorted((pole.real, pole.real + side[0] * wide))
        y = sorted((pole.imag, pole.imag + side[1] * tall))
        covered = sum(x[0] <= p.real <= x[1] and y[0] <= p.imag <= y[1] for p in others)
        return covered + 10.0 * (x[0] < left or x[1] > right or y[0] < bottom or y[1] > top)

    across, up = min(((-1, 1), (1, 1), (-1, -1), (1, -1)), key=cost)
    axes.annotate(
        name, (pole.real, pole.imag), (9 * across, 6 * up), textcoords="offset points", fontsize=8.5,
        ha="left" if across > 0 else "right", va="bottom" if up > 0 else "top",
    )  # fmt: skip


def _pole_grid(axes: Axes, reach: float) -> None:
    """Draw faint circles of equal natural frequency and rays of equal damping ratio."""
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    angle = np.linspace(0.5 * np.pi, np.pi, 60)
    for wn in MaxNLocator(5).tick_values(0.0, reach):
        if wn > 0.0:
            axes.plot(wn * np.cos(angle), wn * np.sin(angle), color=FAINT, linewidth=0.7, zorder=0)
    for zeta, place in zip(_RAYS, _damping_labels(reach), strict=True):
        x, y = -zeta, float(np.sqrt(1.0 - zeta**2))
        axes.plot([0.0, 2.0 * reach * x], [0.0, 2.0 * reach * y], color=FAINT, linewidth=0.7, zorder=0)
        axes.text(place.real, place.imag, f"ζ {zeta:g}", fontsize=7, color="#8b929a", ha="left", va="top", zorder=0)


def _damping_labels(reach: float) -> list[complex]:
    """Return where the damping ratio of each ray is written."""
    rays = [complex(-zeta, float(np.sqrt(1.0 - zeta**2))) for zeta in _RAYS]
    return [0.93 * reach / max(-ray.real, ray.imag) * ray for ray in rays]


def _pole_handles(found: _Found, true: str) -> list[Any]:
    from matplotlib.lines import Line2D

    rows = [(true, "+", INK, 10)] if true else []
    for text, _, colour in found:
        look, marker = marker_look(colour)
        rows.append((text, marker, look, 7))
    return [
        Line2D([], [], linestyle="none", marker=marker, color=colour, markersize=size, markerfacecolor="none",
               markeredgewidth=1.6, label=text)
        for text, marker, colour, size in rows
    ]  # fmt: skip
