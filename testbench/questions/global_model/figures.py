"""The functions over alpha with bands, the coefficients felt beside them, and their slopes by what they follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.page.plot import COLOURS, MEASURED, Plate, grid, label, legend, legend_in, line_handles, new_figure
from testbench.questions.global_model.result import GlobalFound

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.core.record import FloatArray

_INTERVAL = 1.96
_SLOPES = (
    ("CL", "alpha"), ("CL", "de"), ("Cm", "alpha"), ("Cm", "q_hat"), ("Cm", "de"), ("CY", "beta"), ("Cl", "beta"),
    ("Cn", "beta"), ("Cl", "p_hat"), ("Cl", "da"), ("Cn", "r_hat"), ("Cn", "dr"),
)  # fmt: skip
_POINTS = 600  # drawn of what was felt
_STEP = 0.5  # of the half range of a signal, to either side, over which a slope is taken
_ALPHA_STEP = 1.0 * DEG_RAD
_LEAST_SHARE = 0.2  # of a slope, that its panel spans at least
_KEPT = ("V_rel", "de")  # signals of trim, which go with alpha; the others are zero in the figures


def global_plates(found: GlobalFound) -> list[Plate]:
    """Return the coefficients over alpha, and their slopes over alpha."""
    domain, functions = found.model.domain, found.model.functions
    alpha = np.linspace(domain.low, domain.high, 61)
    at = {"alpha": alpha} | {
        s: np.interp(alpha, domain.alpha, domain.middle[:, i]) * (s in _KEPT) for i, s in enumerate(domain.signals)
    }
    flights = [f.signals for f in found.of_use("identification")]
    flown = np.concatenate([f["alpha"] for f in flights]) / DEG_RAD
    some = slice(None, None, max(1, flown.size // _POINTS))

    def value(axes: Axes, c: str) -> None:
        f = functions[c]
        felt = np.concatenate([s[c] - f.beside(s) for s in flights])
        axes.plot(flown[some], felt[some], ".", color=MEASURED, markersize=1.5)
        _band(axes, alpha, *f.at(at))
        label(axes, "alpha, deg", "", c)

    def slope(axes: Axes, shown: tuple[str, str]) -> None:
        c, s = shown
        half = np.full_like(alpha, _ALPHA_STEP)
        if s != "alpha":
            half = _STEP * np.interp(alpha, domain.alpha, domain.half[:, domain.signals.index(s)])
        change, std = functions[c].at({**at, s: at[s] + half}, {**at, s: at[s] - half})
        _band(axes, alpha, change / (2.0 * half), std / (2.0 * half))
        low, high = axes.get_ylim()
        spare = max(0.0, _LEAST_SHARE * max(abs(low), abs(high)) - (high - low)) / 2.0
        axes.set_ylim(low - spare, high + spare)
        label(axes, "alpha, deg", "", f"{c} by {s}")

    shown = [(c, s) for c, s in _SLOPES if s == "alpha" or s in domain.signals]
    middle = "with the V and de of the middle of the flown domain at that alpha; all other signals are zero"
    return [
        _plate(
            "functions", "Coefficients over the angle of attack", list(functions), value,
            "Points: coefficients felt in the flights of the fit, at all deflections, rates and sideslips: where data "
            f"lie. Line and band: the function and its 95 % interval {middle}.",
            [("felt", MEASURED), ("function, 95 %", COLOURS[0])],
        ),
        _plate(
            "slopes", "Derivatives over the angle of attack", shown, slope,
            "Differences of the functions across half of the flown range of one signal (of alpha, 2 deg), per rad or "
            f"per nondimensional rate, with 95 % intervals, {middle}.",
            [("function, 95 %", COLOURS[0])],
        ),
    ]  # fmt: skip


def _band(axes: Axes, alpha: FloatArray, value: FloatArray, std: FloatArray) -> None:
    x, wide = alpha / DEG_RAD, _INTERVAL * std
    axes.fill_between(x, value - wide, value + wide, color=COLOURS[0], alpha=0.3, linewidth=0)
    axes.plot(x, value, color=COLOURS[0], linewidth=1.4)


def _plate(
    name: str, title: str, items: Sequence[Any], draw: Callable[[Axes, Any], None], caption: str,
    lines: Sequence[tuple[str, str]],
) -> Plate:  # fmt: skip
    def make(wide: bool) -> Figure:
        """Draw one panel per item."""
        across = 3 if wide else 1
        rows, top = -(-len(items) // across), legend_in([n for n, _ in lines], wide) + 0.3
        figure = new_figure(wide, top + 1.5 * rows + 0.55 * (rows - 1) + 0.5)
        panels = grid(figure, top, [1.5] * rows, [1.0] * across, gap_in=0.55).ravel()
        for i, axes in enumerate(panels):
            if i < len(items):
                draw(axes, items[i])
            else:
                axes.set_visible(False)
        legend(figure, line_handles([], lines))
        return figure

    return Plate(name, title, caption, make)
