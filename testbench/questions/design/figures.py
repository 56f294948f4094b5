"""The figures of a design: the winner in flight inside its limits, spectra among the modes, and predicted errors."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.page.labels import axis_label, number, shown_unit
from testbench.page.plot import (
    COLOURS,
    INK,
    QUIET,
    Plate,
    envelope,
    grid,
    label,
    legend,
    legend_in,
    line_handles,
    line_look,
    log_axis,
    name_lines,
    new_figure,
    time_axis,
)
from testbench.questions.design.answer import family_label, is_ratio

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.design.amplitude import Flown
    from testbench.questions.design.result import DesignResult

_RIGID, _ELASTIC = "#00664a", "#8a4f74"
_LIMIT, _DASHED = "#b34700", (0, (4, 2))
_COMPARED = 5
_DECADES = 6
_LIMITED = 4  # limited channels that are drawn: those that use up most of their limit
_BINS, _PER_BIN = 240, 10  # of a spectrum: means over narrow bands, which long inputs would fill with lines else


def design_plates(result: DesignResult) -> list[Plate]:
    """Return the figures of a design, that of the answer first."""
    return [_flight_plate(result), _spectrum_plate(result), _error_plate(result)]


def compared(result: DesignResult) -> list[Flown]:
    """Return the designs drawn side by side: the best few, and single doublet and 3-2-1-1 whatever their rank."""
    out = [r for k, r in enumerate(result.ranking) if k < _COMPARED - 2 or r.design.family in ("doublet", "3211")]
    return out[:_COMPARED]


# --- the winner in flight ---------------------------------------------------------------------------------------------


def _flight_plate(result: DesignResult) -> Plate:
    best = result.best
    record, design = best.record, best.design
    used = {n: _used(result, n) for n in result.envelope.bands if n not in design.controls and n in record}
    limited = sorted(used, key=lambda n: -used[n])[:_LIMITED]
    lateral = result.scenario.plane == "lateral"
    extra = [n for n in (("p", "r") if lateral else ("q",)) if n in record]
    names = [*design.controls, *extra, *limited]

    def make(wide: bool) -> Figure:
        """Draw commands on top, then the motion and every limited channel."""
        columns = 2 if wide else 1
        rows = -(-len(names) // columns)
        top = 0.5
        figure = new_figure(wide, top + rows * 1.05 + (rows - 1) * 0.42 + 0.5)
        panels = grid(figure, top, [1.05] * rows, (1.0,) * columns, gap_in=0.42, between_in=0.75)
        flat = panels.T.ravel()
        for i, axes in enumerate(flat):
            if i >= len(names):
                axes.set_visible(False)
                continue
            _draw_channel(axes, result, names[i], best)
            last = i % rows == rows - 1 or i == len(names) - 1
            label(axes, "t, s" if last else "", "load factor" if names[i] == "az" else axis_label(names[i]))
            axes.tick_params(labelbottom=last)
        handles = line_handles([], [("flown", COLOURS[0]), ("command", INK, ":"), ("limit", _LIMIT, _DASHED)])
        legend(figure, handles)
        return figure

    caption = (
        "The recommended input as the nonlinear simulator flies it at its largest admissible amplitude: command, "
        "motion of the surface, and the channels that come nearest to their limits (dashed). The dot marks where a "
        "limit is used up most."
    )
    return Plate("flight", f"The recommended input in flight: {family_label(design.family)}", caption, make)


def _used(result: DesignResult, name: str) -> float:
    """Return the share of the room from trim to the limits of a channel that the winner uses."""
    low, high = result.envelope.bands[name]
    x = result.best.record[name]
    at = result.envelope.trim.get(name, float(x[0]))
    return float(max((x.max() - at) / (high - at), (at - x.min()) / (at - low)))


def _draw_channel(axes: Axes, result: DesignResult, name: str, best: Flown) -> None:
    record = best.record
    factor = -1.0 / G0_M_S2 if name == "az" else shown_unit(name)[0]
    y = factor * record[name]
    axes.plot(*envelope(record.t_s, y), color=COLOURS[0], linewidth=1.3)
    shown = [float(y.min()), float(y.max())]
    if name in best.design.controls:
        command = factor * record[f"{name}_cmd"]
        axes.plot(*envelope(record.t_s, command), color=INK, linewidth=1.3, linestyle=":")
        shown += [float(command.min()), float(command.max())]
    middle, half = 0.5 * (max(shown) + min(shown)), max(0.5 * (max(shown) - min(shown)), 1e-9)
    for bound in sorted(factor * b for b in result.envelope.bands.get(name, ())):
        if abs(bound - middle) < 2.2 * half:
            axes.axhline(bound, color=_LIMIT, linewidth=1.1, linestyle=_DASHED)
            shown.append(bound)
    tight = best.tightest
    if tight.name == name:
        k = int(np.argmin(np.abs(record.t_s - tight.t_s)))
        axes.plot([record.t_s[k]], [y[k]], "o", color=_LIMIT, markersize=4.5, zorder=5)
    pad = 0.1 * (max(shown) - min(shown) or 1.0)
    axes.set_ylim(min(shown) - pad, max(shown) + pad)
    axes.set_xlim(0.0, record.t_s[-1])
    time_axis(axes)


# --- spectra among the modes ------------------------------------------------------------------------------------------


def _spectrum_plate(result: DesignResult) -> Plate:
    entries = compared(result)
    names = [family_label(r.design.family) for r in entries]
    wn = [abs(p) for p in result.modes.values() if abs(p) > 0.05]
    low, high = 0.5 * min(wn), 2.5 * max(wn)
    fine = np.geomspace(low, high, _BINS * _PER_BIN)
    centres = np.sqrt(fine[::_PER_BIN] * fine[_PER_BIN - 1 :: _PER_BIN])
    curves = [
        (centres, result.spectrum(r.design, fine).reshape(_BINS, _PER_BIN).mean(axis=1) / DEG_RAD**2) for r in entries
    ]

    def make(wide: bool) -> Figure:
        """Draw the spectra over one frequency axis with the modes named above."""
        key = legend_in(names, wide)
        room = 1.75 if wide else 1.6
        figure = new_figure(wide, key + room + 2.7 + 0.55)
        axes = grid(figure, key + room, [2.7])[0, 0]
        peak = 0.0
        for k, (omega, energy) in enumerate(curves):
            peak = max(peak, float(energy.max()))
            axes.plot(omega, energy, **line_look(k), linewidth=1.6 if k == 0 else 1.0, zorder=3.0 - 0.1 * k)
        log_axis(axes, "x", powers=False)
        log_axis(axes, "y", powers=True)
        axes.set_xlim(low, high)
        axes.set_ylim(10.0**-_DECADES * peak, 3.0 * peak)
        _draw_modes(axes, result, wide)
        label(axes, "frequency, rad/s", "energy density, (deg s)²")
        handles = line_handles(names)
        legend(figure, handles)
        return figure

    caption = (
        "Energy spectra of the commands, as means over narrow bands; each design has its own largest admissible "
        "amplitude. Vertical lines: the modes of this plane (green: rigid, over their half-power bands; purple: "
        "elastic). An input does not excite a mode where its spectrum has little energy."
    )
    return Plate("spectra", "Where each input puts its energy", caption, make)


def _draw_modes(axes: Axes, result: DesignResult, wide: bool) -> None:
    elastic = result.aircraft.flown_modes()
    flexible = {m.name for m in elastic.modes} if elastic else set()
    low, high = axes.get_xlim()
    inside = [(abs(p), n, p) for n, p in result.modes.items() if low < abs(p) < high]
    width, size, per_line = (26, 7.4, 0.019) if wide else (24, 6.4, 0.043)
    lines = []
    for wn, name, pole in inside:
        colour = _ELASTIC if name in flexible else _RIGID
        zeta = min(abs(pole.real) / wn, 0.95)
        top = wn * (1.0 + zeta) if abs(pole.imag) > 1e-9 else wn
        axes.axvspan(wn * (1.0 - zeta), top, color=colour, alpha=0.09, linewidth=0)
        lines.append((wn, f"{name} {number(wn)} rad/s", "-", colour))
    name_lines(axes, lines, width, size, per_line, gap=0.4, linewidth=0.8)


# --- predicted errors -------------------------------------------------------------------------------------------------


def _error_plate(result: DesignResult) -> Plate:
    entries = compared(result)
    names = [family_label(r.design.family) for r in entries]
    t = result.problem.targets
    ratios = np.array([r.design.errors / t.wanted for r in entries])
    drawn = result.best.over is not None
    worst = np.array([r.over.told.over(np.max) if r.over else row for r, row in zip(entries, ratios, strict=True)])
    worst = np.where(np.isnan(worst), ratios, worst)  # no draw has the target
    largest = float(worst[np.isfinite(worst)].max(initial=float(ratios.max())))
    worst = np.minimum(worst, 10.0 * largest)  # without bound: beyond the edge

    def make(wide: bool) -> Figure:
        """Draw one group of bars per target, one bar per design."""
        key = legend_in([*names, "wanted"], wide) + 0.12
        each = 0.13 * len(entries) + 0.16
        height = each * len(t.names)
        figure = new_figure(wide, key + height + 0.55)
        axes = grid(figure, key, [height], left_in=2.3 if wide else 1.35)[0, 0]
        low = min(0.5 * float(ratios.min()), 0.6)  # the wanted error, 1, stands inside
        for i in range(len(t.names)):
            for k in range(len(entries)):
                y = i * each + 0.13 * k
                axes.barh(y, ratios[k, i] - low, left=low, height=0.115, color=COLOURS[k % 6])
                if drawn:
                    axes.plot([ratios[k, i], worst[k, i]], [y, y], color=INK, linewidth=0.8, marker="|", markersize=4)
            text = _short_error(result, entries[0].design.errors, i)
            end = min(worst[0, i], 1.2 * largest)
            axes.annotate(
                text, (end, i * each), xytext=(3, 0), textcoords="offset points", va="center", fontsize=7, color=QUIET
            )
        axes.axvline(1.0, color=_LIMIT, linewidth=1.2, linestyle=_DASHED)
        middle = 0.065 * (len(entries) - 1)
        axes.set_yticks(
            [i * each + middle for i in range(len(t.names))],
            ["\n".join(textwrap.wrap(n, 32 if wide else 22)) for n in t.names],
            fontsize=8 if wide else 7,
        )
        axes.set_ylim(height - 0.5 * 0.16 - 0.06, -0.5 * 0.16 - 0.06)
        axes.grid(axis="y", visible=False)
        axes.set_xlim(low, max(2.0, 1.6 * largest))
        log_axis(axes, "x", powers=True)
        label(axes, "predicted standard error over the wanted one" if wide else "error over the wanted one")
        handles = line_handles([], [*((n, COLOURS[k % 6]) for k, n in enumerate(names)), ("wanted", _LIMIT, _DASHED)])
        legend(figure, handles)
        return figure

    caption = (
        "Predicted standard error of every target over the wanted one: left of the dashed line is good enough. Bars "
        "stand in the order of the legend. The number beside the first bar is the error of the recommended input."
    )
    if drawn:
        caption += " The thin line runs to the error in the worst of the drawn aircraft."
    return Plate("errors", "What each input tells", caption, make)


def _short_error(result: DesignResult, errors: Any, i: int) -> str:
    t = result.problem.targets
    value = 100.0 * errors[i] / abs(t.values[i]) if is_ratio(t.names[i]) else errors[i]
    return f"{number(float(value), 2)}{' %' if is_ratio(t.names[i]) else ''}"
