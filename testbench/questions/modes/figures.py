"""The figures on modes found without an input: the stabilisation diagram, and the mode shapes along the wing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.estimators.model import ComplexArray
from testbench.page.labels import number
from testbench.page.plot import (
    COLOURS,
    FAINT,
    INK,
    MARKERS,
    MEASURED,
    QUIET,
    Plate,
    grid,
    label,
    legend,
    legend_in,
    log_axis,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.evaluation.operational import TrueMode
    from testbench.questions.modes.result import ModesResult

_DECADES = 5.0  # of the spectrum that are shown
_FEWEST = 3  # stations along the wing from which on a shape is drawn


def modes_plates(result: ModesResult) -> list[Plate]:
    """Return the stabilisation diagram, and the shapes where the places of at least three sensors are known."""
    places = [y for y in result.stations_m if y is not None]
    return [_stabilisation(result), *([_shapes(result)] if len(set(places)) >= _FEWEST else [])]


# --- stabilisation diagram --------------------------------------------------------------------------------------------


def _stabilisation(result: ModesResult) -> Plate:
    truth = " Ticks at the upper edge: modes of the linear model." if result.true else ""
    caption = (
        "Every pole of every model order over its frequency. Coloured: modes, which come back at order after order, "
        "with their 95 % intervals shaded. Rings: stable from one order to the next, but at too few orders or with "
        f"too large errors. Dots: the rest, which is noise. Grey line: mean spectrum of the outputs.{truth}"
    )

    def make(wide: bool) -> Figure:
        """Draw the poles over the spectrum."""
        handles = _handles(result)
        top = legend_in([str(h.get_label()) for h in handles], wide) + 0.12
        figure = new_figure(wide, top + 3.6 + 0.5)
        axes = grid(figure, top, [3.6])[0, 0]
        _draw_spectrum(axes, result)
        _draw_poles(axes, result)
        label(axes, "frequency, Hz", "model order")
        legend(figure, handles)
        return figure

    return Plate("stabilisation", "Stabilisation diagram", caption, make)


def _draw_spectrum(axes: Axes, result: ModesResult) -> None:
    low, high = result.found.settings["band_hz"]
    f, density = result.found.spectrum.T
    shown = (f >= low) & (f <= high)
    behind = axes.twinx()
    behind.set_zorder(0)
    axes.set_zorder(1)
    axes.patch.set_visible(False)
    if np.any(density[shown] > 0.0):
        peak = float(density[shown].max())
        behind.plot(f[shown], density[shown], color=MEASURED, linewidth=1.1)
        log_axis(behind, "y", powers=True)
        behind.set_ylim(peak * 10.0**-_DECADES, peak * 10.0**0.4)
    behind.grid(False)
    behind.tick_params(right=False, labelright=False, which="both")
    axes.set_xlim(low, high)


def _draw_poles(axes: Axes, result: ModesResult) -> None:
    found, q = result.found, result.found.quantile
    for k, mode in enumerate(found.modes):
        half = q * mode.frequency_std_hz
        axes.axvspan(mode.frequency_hz - half, mode.frequency_hz + half, color=COLOURS[k % 6], alpha=0.16, linewidth=0)
    for at in found.views:
        order = np.full(at.frequency_hz.size, at.order)
        loose, stable = ~at.stable, at.stable & (at.mode < 0)
        axes.plot(at.frequency_hz[loose], order[loose], ".", color=QUIET, markersize=2.5)
        axes.plot(at.frequency_hz[stable], order[stable], "o", color=QUIET, markersize=4.5, markerfacecolor="white")
        for k in range(len(found.modes)):
            mine = at.mode == k
            axes.plot(at.frequency_hz[mine], order[mine], MARKERS[k % 6], color=COLOURS[k % 6], markersize=5)
    top = found.views[-1].order + 2.0
    for true in result.true:
        axes.plot([abs(true.pole) / (2.0 * np.pi)] * 2, [top - 1.4, top], color=INK, linewidth=1.4)
    axes.set_ylim(0.0, top)


def _handles(result: ModesResult) -> list[Any]:
    from matplotlib.lines import Line2D

    def handle(text: str, **look: Any) -> Line2D:
        """Return the legend's entry of one look."""
        return Line2D([], [], **{"linestyle": "none", **look}, label=text)

    out = [
        handle(f"{number(m.frequency_hz)} Hz, ζ {number(m.damping, 2)}", marker=MARKERS[k % 6], color=COLOURS[k % 6])
        for k, m in enumerate(result.found.modes)
    ]
    out.append(handle("stable, no mode", marker="o", color=QUIET, markerfacecolor="white"))
    out.append(handle("not stable", marker=".", color=QUIET, markersize=4))
    if result.true:
        out.append(handle("linear model", marker="|", color=INK, markersize=9, markeredgewidth=1.4))
    return out


# --- shapes -----------------------------------------------------------------------------------------------------------


def _shapes(result: ModesResult) -> Plate:
    caption = (
        "Motion of each mode at the sensors along the span, turned to the phase in which it is largest and divided by "
        "the largest. Circles: accelerometers; squares: strain gauges. Line without colour: the matching mode of the "
        "linear model, with the MAC of the two. A sensor off the elastic axis feels twist as well as bending."
    )
    modes = result.found.modes
    true = {m.index: m for m in result.matches if m.index is not None}

    def make(wide: bool) -> Figure:
        """Draw one panel per mode."""
        columns = min(len(modes), 3) if wide else 1
        rows = -(-len(modes) // columns)
        figure = new_figure(
            wide, 0.3 + rows * 1.7 + (rows - 1) * 0.75 + 0.5, 1.0 if columns == 3 else columns / 3.0 + 0.1
        )
        panels = grid(figure, 0.3, [1.7] * rows, [1.0] * columns, gap_in=0.75, between_in=0.3).ravel()
        for axes in panels[len(modes) :]:
            axes.set_axis_off()
        for k, (axes, mode) in enumerate(zip(panels, modes, strict=False)):
            match = true.get(k)
            _draw_shape(axes, result, mode.shape, match.true if match else None, COLOURS[k % 6])
            likeness = f", MAC {match.mac:.3f}" if match is not None and match.mac is not None else ""
            y = "motion over the largest" if k % columns == 0 else ""
            label(axes, "y along the span, m", y, f"{number(mode.frequency_hz)} Hz{likeness}")
            axes.tick_params(labelleft=k % columns == 0)
        return figure

    return Plate("shapes", "Mode shapes at the sensors", caption, make)


def _draw_shape(axes: Axes, result: ModesResult, shape: ComplexArray, true: TrueMode | None, colour: str) -> None:
    axes.axhline(0.0, color=FAINT, linewidth=0.9)
    names = result.found.channels
    for kind, marker in (("az_wing_", "o"), ("strain_wing_", "s")):
        here = [
            (y, i)
            for i, (name, y) in enumerate(zip(names, result.stations_m, strict=True))
            if y is not None and name.startswith(kind)
        ]
        if not here:
            continue
        y, rows = (np.array(x) for x in zip(*sorted(here), strict=True))
        found = _real(shape[rows])
        if true is not None:
            line = _real(true.shape[rows])
            sign = np.sign(found @ line) or 1.0
            axes.plot(y, sign * line, color=INK, linewidth=1.0)
        axes.plot(y, found, marker, color=colour, markersize=5.5)
    axes.set_ylim(-1.15, 1.15)
    axes.margins(x=0.06)


def _real(shape: ComplexArray) -> Any:
    """Return the real part of a shape (r,) in the phase in which its energy is largest, over its largest element."""
    turned = (shape * np.exp(-0.5j * np.angle(np.sum(shape**2)))).real
    return turned / max(float(np.abs(turned).max()), 1e-300)
