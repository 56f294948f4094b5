"""The figures of a design: the winner in flight inside its limits, spectra among the modes, and predicted errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.page.figure import (
    COLOURS,
    DASHED,
    DOTTED,
    QUIET,
    WARN,
    Chart,
    Curve,
    Drawn,
    Panel,
    Plate,
    Rule,
    Words,
    bars,
    grid,
    line_look,
    mode_marks,
)
from testbench.page.labels import axis_label, number, shown_unit
from testbench.questions.design.answer import family_label, is_ratio

if TYPE_CHECKING:
    from testbench.design.amplitude import Flown
    from testbench.questions.design.result import DesignResult

_COMPARED = 5
_DECADES = 6
_LIMITED = 4  # limited channels that are drawn: those that use up most of their limit
_BINS, _PER_BIN = 240, 10  # of a spectrum: means over narrow bands, which long inputs would fill with lines else
_BAR = 0.13  # height of a bar, in


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
    panels = [_channel(result, name) for name in (*design.controls, *extra, *limited)]
    caption = (
        "The recommended input as the nonlinear simulator flies it at its largest admissible amplitude: command, "
        "motion of the surface, and the channels that come nearest to their limits (dashed). The dot marks where a "
        "limit is used up most."
    )
    title = f"The recommended input in flight: {family_label(design.family)}"
    return Plate("flight", title, caption, grid(panels, 2, share_x=True))


def _used(result: DesignResult, name: str) -> float:
    """Return the share of the room from trim to the limits of a channel that the winner uses."""
    low, high = result.envelope.bands[name]
    x = result.best.record[name]
    at = result.envelope.trim.get(name, float(x[0]))
    return float(max((x.max() - at) / (high - at), (at - x.min()) / (at - low)))


def _channel(result: DesignResult, name: str) -> Panel:
    best = result.best
    record, tight = best.record, best.tightest
    factor = -1.0 / G0_M_S2 if name == "az" else shown_unit(name)[0]
    y = factor * record[name]
    draws: list[Drawn] = [Curve(x=record.t_s, y=y, name="flown", colour=COLOURS[0])]
    shown = [float(y.min()), float(y.max())]
    if name in best.design.controls:
        command = factor * record[f"{name}_cmd"]
        draws.append(Curve(x=record.t_s, y=command, name="command", dash=DOTTED))
        shown += [float(command.min()), float(command.max())]
    middle, half = 0.5 * (max(shown) + min(shown)), max(0.5 * (max(shown) - min(shown)), 1e-9)
    for bound in sorted(factor * b for b in result.envelope.bands.get(name, ())):
        if abs(bound - middle) < 2.2 * half:
            draws.append(Rule(at=bound, of="y", name="limit", colour=WARN, width=1.1, dash=DASHED))
            shown.append(bound)
    if tight.name == name:
        k = int(np.argmin(np.abs(record.t_s - tight.t_s)))
        draws.append(Curve(x=[record.t_s[k]], y=[y[k]], marker="o", colour=WARN, size=4.5, order=5.0))
    pad = 0.1 * (max(shown) - min(shown) or 1.0)
    return Panel(
        draws=draws, x="t, s", y="load factor" if name == "az" else axis_label(name), tall_in=1.05,
        x_range=(0.0, float(record.t_s[-1])), y_range=(min(shown) - pad, max(shown) + pad),
    )  # fmt: skip


# --- spectra among the modes ------------------------------------------------------------------------------------------


def _spectrum_plate(result: DesignResult) -> Plate:
    wn = [abs(p) for p in result.modes.values() if abs(p) > 0.05]
    low, high = 0.5 * min(wn), 2.5 * max(wn)
    fine = np.geomspace(low, high, _BINS * _PER_BIN)
    centres = np.sqrt(fine[::_PER_BIN] * fine[_PER_BIN - 1 :: _PER_BIN])
    curves = []
    for k, r in enumerate(compared(result)):
        energy = result.spectrum(r.design, fine).reshape(_BINS, _PER_BIN).mean(axis=1) / DEG_RAD**2
        look = line_look(k) | {"width": 1.0 if k else 1.6, "order": 3.0 - 0.1 * k}
        curves.append(Curve(x=centres, y=energy, name=family_label(r.design.family), **look))
    peak = max(float(np.max(c.y)) for c in curves)
    elastic = result.aircraft.flown_modes()
    marks = mode_marks(result.modes, [m.name for m in elastic.modes] if elastic else [], low, high)
    panel = Panel(
        draws=[*curves, *marks], x="frequency, rad/s", y="energy density, (deg s)²", log_x=True, log_y=True,
        x_range=(low, high), y_range=(10.0**-_DECADES * peak, 3.0 * peak), tall_in=2.7,
    )  # fmt: skip
    caption = (
        "Energy spectra of the commands, as means over narrow bands; each design has its own largest admissible "
        "amplitude. Vertical lines: the modes of this plane (green: rigid, over their half-power bands; purple: "
        "elastic). An input does not excite a mode where its spectrum has little energy."
    )
    return Plate("spectra", "Where each input puts its energy", caption, Chart([[panel]]))


# --- predicted errors -------------------------------------------------------------------------------------------------


def _error_plate(result: DesignResult) -> Plate:
    entries, t = compared(result), result.problem.targets
    ratios = np.array([r.design.errors / t.wanted for r in entries])
    drawn = result.best.over is not None
    worst = np.array([r.over.told.over(np.max) if r.over else row for r, row in zip(entries, ratios, strict=True)])
    worst = np.where(np.isnan(worst), ratios, worst)  # no draw has the target
    largest = float(worst[np.isfinite(worst)].max(initial=float(ratios.max())))
    worst = np.minimum(worst, 10.0 * largest)  # without bound: beyond the edge
    each, low = _BAR * len(entries) + 0.16, min(0.5 * float(ratios.min()), 0.6)  # the wanted error, 1, stands inside
    at = each * np.arange(len(t.names))
    draws: list[Drawn] = []
    for k, r in enumerate(entries):
        name = family_label(r.design.family)
        draws.append(bars(at + _BAR * k, low, ratios[k], 0.115, name=name, colour=COLOURS[k % 6]))
        if drawn:
            ends = np.column_stack([ratios[k], worst[k], np.full(at.size, np.nan)]).ravel()
            rows = np.repeat(at + _BAR * k, 3)
            draws.append(Curve(x=ends, y=rows, width=0.8, marker="|", size=4.0, joined=True, order=3.0))
    for i, y in enumerate(at):
        end = float(min(worst[0, i], 1.2 * largest))
        text = _short_error(result, entries[0].design.errors, i)
        draws.append(Words(x=end, y=y, text=text, shift=(3, 0), size=7.0, colour=QUIET))
    draws.append(Rule(at=1.0, name="wanted", colour=WARN, width=1.2, dash=DASHED))
    middle = 0.5 * _BAR * (len(entries) - 1)
    panel = Panel(
        draws=draws, x="predicted standard error over the wanted one", log_x=True,
        x_range=(low, max(2.0, 1.6 * largest)), tall_in=each * len(t.names),
        y_ticks=[(y + middle, n) for y, n in zip(at, t.names, strict=True)],
        y_range=(each * len(t.names) - 0.14, -0.14),
    )  # fmt: skip
    caption = (
        "Predicted standard error of every target over the wanted one: left of the dashed line is good enough. Bars "
        "stand in the order of the legend. The number beside the first bar is the error of the recommended input."
    )
    if drawn:
        caption += " The thin line runs to the error in the worst of the drawn aircraft."
    return Plate("errors", "What each input tells", caption, Chart([[panel]]))


def _short_error(result: DesignResult, errors: Any, i: int) -> str:
    t = result.problem.targets
    value = 100.0 * errors[i] / abs(t.values[i]) if is_ratio(t.names[i]) else errors[i]
    return f"{number(float(value), 2)}{' %' if is_ratio(t.names[i]) else ''}"
