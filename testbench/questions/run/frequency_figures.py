"""The figures over frequency: an input's spectrum among the modes, and Bode plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.inputs.signal import energy_spectrum, frequency_below
from testbench.page.explore import line_style
from testbench.page.labels import axis_label, number, ratio_unit, shown_unit, symbol
from testbench.page.plot import (
    BAND,
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
    rows_of,
    time_axis,
    widths,
)
from testbench.questions.run.explored import movement, responses
from testbench.questions.run.labels import case_names, elastic_names, outputs_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.line import Flight
    from testbench.page.explore import Explorable
    from testbench.questions.run.result import RunResult

_MOST_DRAWN = 9  # records whose input is drawn over time
_DECADES = 5  # of energy density that are shown
_RIGID, _ELASTIC = "#00664a", "#8a4f74"
_Moved = Sequence[tuple["Flight", FlightRecord, FloatArray]]


# --- the input and its spectrum ---------------------------------------------------------------------------------------


def input_plates(result: RunResult) -> list[Plate]:
    """Return one plate per input: its time history in every flight, and its energy spectrum among the modes."""
    return [_input_plate(result, name) for name in result.source.identification.inputs]


def _movement(flight: Flight, name: str) -> tuple[FlightRecord, FloatArray]:
    """Return the record that ``name`` is shown from, the truth if there is one, and its deviation from trim, SI."""
    if flight.truth is not None and name in flight.truth:
        return flight.truth, flight.truth[name] - flight.truth[name][0]
    record = next(r for r in flight.measured.values() if name in r)
    return record, record[name] - record[name].mean()


def _input_plate(result: RunResult, name: str) -> Plate:
    moved = [(flight, *_movement(flight, name)) for flight in result.flights]
    simulated = result.truth is not None
    bands = " Green: rigid modes, shaded over their half-power bands; purple: elastic modes." if simulated else ""
    caption = (
        f"{symbol(name)} as {'flown' if simulated else 'recorded'}, deviation from trim, and its energy spectrum. "
        "A mode cannot be identified from this input if the spectrum has little energy there."
        f"{bands} Dashed: 95 % of the energy of the identification input lies below this frequency. Dotted: half the "
        "sample rate of the record."
    )
    drawn = moved[:_MOST_DRAWN]
    if len(drawn) < len(moved):
        caption += f" Of {len(moved)} records the first {len(drawn)} are drawn above; the spectra are those of all."

    def make(wide: bool) -> Figure:
        """Draw the time histories of the flights above their spectra."""
        rows = rows_of(drawn, 3 if wide else 1)
        top = 0.26 + len(rows) * 1.0 + (len(rows) - 1) * 0.75 + 0.55
        names = (1.55 if wide else 1.35) if simulated else 1.4
        figure = new_figure(wide, top + names + 2.4 + 0.9)
        for k, row in enumerate(rows):
            panels = grid(figure, 0.26 + 1.75 * k, [1.0], widths([r for _, r, _ in row]), between_in=0.3)[0]
            _draw_input(panels, row, name)
        axes = grid(figure, top + names, [2.4])[0, 0]
        _draw_spectrum(axes, result, moved, name, wide)
        return figure

    def explore() -> Explorable:
        """Return spectra and time histories."""
        low, high, omega, spectra = _spectra(result, moved, name)
        modes = {} if result.truth is None else result.truth.modes
        marks = [(abs(pole), mode) for mode, pole in modes.items() if low < abs(pole) < high]
        return movement(drawn, name, spectra, omega, marks, {f.use: _use_colour(f.use) for f, _, _ in moved})

    return Plate(f"input_{name}", f"The input {symbol(name)} and its energy spectrum", caption, make, explore)


def _use_colour(use: str) -> str:
    return COLOURS[4] if use == "validation" else INK


def _draw_input(row: Sequence[Axes], moved: _Moved, name: str) -> None:
    factor = shown_unit(name)[0]
    reach = 1.15 * factor * max([float(np.abs(u).max()) for _, _, u in moved]) or 1.0
    for i, (axes, (flight, record, u)) in enumerate(zip(row, moved, strict=True)):
        axes.plot(*envelope(record.t_s, factor * u), color=_use_colour(flight.use), linewidth=1.0)
        axes.set_ylim(-reach, reach)
        axes.tick_params(labelleft=i == 0)
        time_axis(axes)
        label(axes, "t, s", "" if i else axis_label(name, deviation=True), f"{flight.use}: {flight.name}")


def _spectra(result: RunResult, moved: _Moved, name: str) -> tuple[float, float, FloatArray, dict[str, FloatArray]]:
    """Return lowest and highest frequency shown, the frequencies between, and use -> energy density in shown units."""
    factor = shown_unit(name)[0]
    modes = {} if result.truth is None else dict(result.truth.modes)
    low = min([0.3, *(0.5 * abs(pole) for pole in modes.values() if abs(pole) > 0.02)])
    high = 1.4 * max([_nyquist(result), *(abs(pole) for pole in modes.values())])
    omega = np.geomspace(low, high, 1200)
    return low, high, omega, {
        use: np.sum([energy_spectrum(factor * u, r.dt_s, omega)[:, 0] for f, r, u in moved if f.use == use], axis=0)
        for use in dict.fromkeys(flight.use for flight, _, _ in moved)
    }  # fmt: skip


def _nyquist(result: RunResult) -> float:
    return float(np.pi / next(iter(result.flights[0].measured.values())).dt_s)


def _draw_spectrum(axes: Axes, result: RunResult, moved: _Moved, name: str, wide: bool) -> None:
    unit, nyquist = shown_unit(name)[1], _nyquist(result)
    low, high, omega, spectra = _spectra(result, moved, name)
    peak = 0.0
    for use, energy in spectra.items():
        peak = max(peak, float(energy.max()))
        axes.plot(omega, energy, color=_use_colour(use), linewidth=1.0 if use == "validation" else 1.3, label=use)
    log_axis(axes, "x", powers=False)
    log_axis(axes, "y", powers=True)
    axes.set_xlim(low, high)
    bottom = 10.0**-_DECADES * (peak or 1.0)
    axes.set_ylim(bottom, 2.0 * (peak or 1.0))
    limits = [frequency_below(u, r.dt_s)[0] for f, r, u in moved if f.use != "validation" and np.any(u != 0.0)]
    marks = [(nyquist, f"sampling limit {number(nyquist)} rad/s", ":", QUIET)]
    if limits and max(limits) < high:
        marks.append((max(limits), f"95 % below {number(max(limits))} rad/s", "--", INK))
    _draw_marks(axes, result, marks, wide)
    label(axes, "frequency, rad/s", f"energy density, ({unit} s)²" if unit else "energy density, s²")
    if len({f.use for f, _, _ in moved}) > 1:
        axes.legend(loc="lower left", bbox_to_anchor=(0.01, 0.02))
    hertz = axes.secondary_xaxis(-0.21, functions=(_to_hertz, _from_hertz))
    log_axis(hertz, "x", powers=False)
    hertz.set_xlabel("frequency, Hz", labelpad=1)


def _to_hertz(omega: Any) -> Any:
    return omega / (2.0 * np.pi)


def _from_hertz(f: Any) -> Any:
    return f * (2.0 * np.pi)


def _draw_marks(axes: Axes, result: RunResult, marks: Sequence[tuple[float, str, str, str]], wide: bool) -> None:
    """Draw the true modes and ``marks`` (frequency, text, dash, colour), and name them above the panel."""
    elastic = elastic_names(result)
    low, high = axes.get_xlim()
    lines = [(x, text, dash, colour) for x, text, dash, colour in marks]
    for name, pole in () if result.truth is None else result.truth.modes.items():
        wn = abs(pole)
        if low < wn < high:
            colour = _ELASTIC if name in elastic else _RIGID
            lines.append((wn, f"{name} {number(wn)} rad/s", "-", colour))
            if name not in elastic:
                zeta = min(abs(pole.real) / wn, 0.95)
                top = wn * (1.0 + zeta) if abs(pole.imag) > 1e-9 else wn  # a real root is a lag: its band ends at |s|
                axes.axvspan(wn * (1.0 - zeta), top, color=COLOURS[2], alpha=0.13, linewidth=0)
    lines.sort()
    width, size, per_line = (26, 7.4, 0.019) if wide else (26, 6.4, 0.043)
    name_lines(axes, lines, width, size, per_line)


# --- Bode plots -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Curve:
    """One frequency response: magnitude in shown units per shown unit, phase in deg."""

    omega: FloatArray
    magnitude: FloatArray
    phase_deg: FloatArray
    line: Mapping[str, Any]
    name: str
    look: Mapping[str, Any]


def bode_plates(result: RunResult) -> list[Plate]:
    """Return one plate per input: magnitude and phase of every model and of the truth, the excited band shaded."""
    inputs = list(dict.fromkeys(name for case in result.cases for name in case.model.inputs))
    return [_bode_plate(result, name) for name in inputs]


def _bode_plate(result: RunResult, given: str) -> Plate:
    from testbench.evaluation.truth import excited_band

    cases = [c for c in result.cases if given in c.model.inputs]
    outputs = outputs_of(cases)
    band = excited_band(cases[0].identification, [given])
    low, high = 0.3 * band[0], min(3.0 * band[-1], 0.97 * np.pi / min(c.model.dt_s for c in cases))
    curves = {output: _curves(result, output, given, np.geomspace(low, high, 300), band) for output in outputs}
    truth = (
        "" if result.truth is None else " Uncoloured: the true aircraft, linearised about trim, without sensor lags."
    )
    caption = (
        f"Response of each output to {symbol(given)}.{truth} Coloured: the identified models, up to half the sample "
        "rate. Shaded: the band that the identification input excites (at least 1 % of its peak energy density). "
        "Outside that band a model extrapolates, whatever its curve looks like."
        f"{' Dotted: true modes.' if result.truth else ''}"
    )

    def make(wide: bool) -> Figure:
        """Draw magnitude and phase of each output."""
        rows, columns = (len(outputs), 2) if wide else (2 * len(outputs), 1)
        extra = [] if result.truth is None else [("true aircraft", INK)]
        top = legend_in([*(text for text, _ in extra), *case_names(result.cases)], wide) + 0.28
        figure = new_figure(wide, top + rows * 1.25 + (rows - 1) * 0.42 + 0.5)
        panels = grid(figure, top, [1.25] * rows, [1.0] * columns, gap_in=0.42, between_in=0.74).reshape(
            len(outputs), 2
        )
        for pair, output in zip(panels, outputs, strict=True):
            name = f"{symbol(output)} / {symbol(given)}"
            for curve in curves[output]:
                pair[0].plot(curve.omega, curve.magnitude, **curve.line)
                pair[1].plot(curve.omega, curve.phase_deg, **curve.line)
            log_axis(pair[0], "y", powers=True)
            last = output == outputs[-1]
            x = "frequency, rad/s" if last else ""
            label(pair[0], x if wide else "", ratio_unit(output, given)[1], f"{name}, magnitude")
            label(pair[1], x, "deg", f"{name}, phase")
            pair[1].yaxis.set_major_locator(steps_of_phase(pair[1].get_ylim()))
            for i, axes in enumerate(pair):
                log_axis(axes, "x", powers=False)
                axes.set_xlim(low, high)
                axes.tick_params(labelbottom=last and (wide or i == 1))
                axes.axvspan(band[0], band[-1], color=BAND, linewidth=0, zorder=0)
                for pole in () if result.truth is None else result.truth.modes.values():
                    axes.axvline(abs(pole), color=QUIET, linewidth=0.7, linestyle=":")
        legend(figure, line_handles(case_names(result.cases), extra))
        return figure

    def explore() -> Explorable:
        """Return magnitude and phase of each output."""
        named = {output: [(c.name, c, c.look) for c in found] for output, found in curves.items()}
        modes = {} if result.truth is None else result.truth.modes
        marks = [(abs(pole), name) for name, pole in modes.items() if low < abs(pole) < high]
        return responses(outputs, given, named, (float(band[0]), float(band[-1])), marks)

    return Plate(f"bode_{given}", f"Frequency responses to {symbol(given)}", caption, make, explore)


def steps_of_phase(limits: tuple[float, float]) -> Any:
    """Return where the ticks of a phase axis with these limits stand: at round numbers of degrees."""
    from matplotlib.ticker import MultipleLocator

    span = abs(limits[1] - limits[0])
    return MultipleLocator(next((step for step in (15, 30, 45, 90, 180, 360) if span <= 5 * step), 720))


def _curves(result: RunResult, output: str, given: str, omega: FloatArray, band: FloatArray) -> list[_Curve]:
    """Return the truth's response first, if known, then each model's; phases on the same sheet at the band's centre."""
    factor = ratio_unit(output, given)[0]
    centre = float(np.sqrt(band[0] * band[-1]))
    names = case_names(result.cases)
    complex_ones: list[tuple[FloatArray, Any, dict[str, Any], str, dict[str, Any]]] = []
    known = result.truth
    if known is not None and output in known.linear.outputs and given in known.linear.inputs:
        H = known.response(omega, [output], [given], result.cases[0].model.dt_s)[:, 0, 0]
        line = {"color": INK, "linewidth": 2.2, "alpha": 0.85}
        complex_ones.append((omega, H, line, "true aircraft", {"colour": INK, "width": 2.2}))
    for k, case in enumerate(result.cases):
        if output in case.model.outputs and given in case.model.inputs:
            own = omega[omega <= 0.97 * np.pi / case.model.dt_s]
            H = case.model.frequency_response(own)[:, case.model.outputs.index(output), case.model.inputs.index(given)]
            complex_ones.append((own, H, {**line_look(k), "linewidth": 1.4}, names[k], line_style(k)))
    found: list[_Curve] = []
    for own, H, line, name, look in complex_ones:
        phase = np.degrees(np.unwrap(np.angle(H)))
        goal = float(np.interp(centre, found[0].omega, found[0].phase_deg)) if found else 0.0
        sheet = 360.0 * np.round((goal - float(np.interp(centre, own, phase))) / 360.0)
        found.append(_Curve(own, factor * np.abs(H), phase + sheet, line, name, look))
    return found
