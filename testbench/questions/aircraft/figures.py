"""The figures on an aircraft: three views, trim, modes over speed, mode shapes along the wing, responses to de."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.page.labels import axis_label, ratio_unit, symbol
from testbench.page.plot import (
    COLOURS,
    DASHES,
    INK,
    QUIET,
    Plate,
    grid,
    label,
    legend,
    legend_in,
    log_axis,
    new_figure,
    notes,
)
from testbench.questions.aircraft.three_view_figures import three_view_plates

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from testbench.aircraft.elastic import ElasticMode
    from testbench.core.record import FloatArray
    from testbench.evaluation.envelope import Envelope
    from testbench.questions.aircraft.ask import Survey

_UNSTABLE = "#fbe9e0"
_MOST_LETTERS = 42  # of a name in a narrow legend
_RESPONSES = ("V", "q", "alpha", "theta")


def aircraft_plates(survey: Survey) -> list[Plate]:
    """Return the figures of a survey; the first shows the onset of instability, or trims of a rigid one."""
    modes, trims = _mode_plate(survey, "longitudinal"), _trim_plate(survey)
    lead, second = (modes, trims) if survey.envelope.elastic else (trims, modes)
    out = [lead, *three_view_plates(survey), second, _mode_plate(survey, "lateral-directional")]
    if survey.shaped:
        out.append(_shape_plate(survey))
    if survey.responses and "de" in survey.envelope.aircraft.controls:
        out.append(_response_plate(survey))
    return out


@dataclass(frozen=True)
class _Line:
    """How one mode is drawn and what it is called."""

    name: str
    text: str
    colour: str
    dash: Any

    def handle(self, wide: bool) -> Any:
        """Return the legend handle, its text cut for narrow figures."""
        from matplotlib.lines import Line2D

        short = wide or len(self.text) <= _MOST_LETTERS
        text = self.text if short else self.text[: _MOST_LETTERS - 1] + "…"
        return Line2D([], [], color=self.colour, linestyle=self.dash, label=text)


def _elastic_lines(envelope: Envelope, motion: str) -> list[_Line]:
    names = envelope.names(motion, elastic=True)
    return [
        _Line(n, f"{symbol(f'eta_{envelope.elastic[n]}')} {n}", COLOURS[k % 6], DASHES[k % 6])
        for k, n in enumerate(names)
    ]


# --- trim -------------------------------------------------------------------------------------------------------------


def _trim_plate(survey: Survey) -> Plate:
    envelope = survey.envelope
    V = np.array(envelope.speeds)
    marked = [envelope.nearest(v) for v in survey.tabled]
    curves = {"alpha": np.array([t.alpha for t in envelope.trims]) / DEG_RAD}
    for name, unit in (("de", DEG_RAD), ("thr", PERCENT)):
        if name in envelope.aircraft.controls:
            curves[name] = np.array([t.controls[name] for t in envelope.trims]) / unit
    lines = _elastic_lines(envelope, "longitudinal")
    count = len(curves) + bool(lines)

    def make(wide: bool) -> Figure:
        """Draw one panel per trimmed quantity, and one for all static deflections."""
        columns = (2 if count == 4 else count) if wide else 1
        rows = -(-count // columns)
        handles = [line.handle(wide) for line in lines]
        top = (legend_in([h.get_label() for h in handles], wide) if handles else 0.0) + 0.16
        figure = new_figure(wide, top + 1.6 * rows + 0.45 * (rows - 1) + 0.5)
        panels = grid(figure, top, [1.6] * rows, [1.0] * columns, gap_in=0.45, between_in=0.8).ravel()
        for i, axes in enumerate(panels):
            _speed_axis(axes, envelope)
            name = list(curves)[i] if i < len(curves) else ""
            if name:
                axes.plot(V, curves[name], color=INK)
                axes.plot(V[marked], curves[name][marked], "o", color=INK, markersize=3, clip_on=False)
            for line in () if name else lines:
                eta = [t.state[f"eta_{envelope.elastic[line.name]}"] for t in envelope.trims]
                axes.plot(V, eta, color=line.colour, linestyle=line.dash)
            low, high = axes.get_ylim()
            axes.set_ylim(low, high)  # zero is shown where it is near
            if low < 0.0 < high:
                axes.axhline(0.0, color="#9aa1a9", linewidth=0.7)
            last = i >= len(panels) - columns
            label(axes, "V, m/s" if last else "", axis_label(name) if name else "static deflection η")
        if handles:
            legend(figure, handles)
        return figure

    caption = (
        f"Steady level flight at {envelope.h_m:g} m; dots: the speeds of the table. Dotted: the design speed."
        f"{' Deflections of the symmetric modes, in the unit of each mode.' if lines else ''}"
    )
    return Plate("trim", "Trim over speed", caption, make)


def _speed_axis(axes: Axes, envelope: Envelope) -> None:
    low, high = envelope.speeds[0], envelope.speeds[-1]
    pad = 0.5 if high == low else 0.0
    axes.set_xlim(low - pad, high + pad)
    axes.axvline(envelope.speeds[envelope.design], color=QUIET, linewidth=0.8, linestyle=":")


# --- modes over speed -------------------------------------------------------------------------------------------------


def _mode_plate(survey: Survey, motion: str) -> Plate:
    envelope = survey.envelope
    rigid = [
        _Line(n, n, INK, dash)
        for n, dash in zip(envelope.names(motion, elastic=False), ("-", DASHES[1], DASHES[4]), strict=False)
    ]
    elastic = _elastic_lines(envelope, motion)
    groups = [("rigid modes", rigid), *([("elastic modes", elastic)] if elastic else [])]
    onsets = [envelope.onset(line.name) for line in elastic]
    unstable = [o for o in onsets if o.V_m_s is not None]

    def make(wide: bool) -> Figure:
        """Draw damping ratio above frequency, rigid modes beside elastic ones; those of a rigid aircraft in one row."""
        handles = [line.handle(wide) for _, lines in groups for line in lines]
        top = legend_in([h.get_label() for h in handles], wide) + 0.32
        across = wide and len(groups) == 2
        rows, gap = (2, 0.55) if across else (1, 0.0) if wide else (2 * len(groups), 0.75)
        figure = new_figure(wide, top + 2.1 * rows + gap * (rows - 1) + 0.5)
        panels = grid(figure, top, [2.1] * rows, [1.0] * (2 if wide else 1), gap_in=gap, between_in=0.8)
        pairs = panels.T if across else panels.reshape(len(groups), 2)
        for (damping, frequency), (title, lines) in zip(pairs, groups, strict=True):
            _draw_modes(damping, frequency, envelope, lines)
            label(damping, "V, m/s" if wide and not across else "", "damping ratio ζ", title)
            label(frequency, "V, m/s", "|s|/2π, Hz")
        if elastic:
            _mark_onsets(pairs[-1], envelope, elastic)
        legend(figure, handles)
        return figure

    said = "; ".join(o.sentence for o in unstable) or (
        f"none up to {envelope.speeds[-1]:g} m/s" if elastic else "no elastic modes in this motion"
    )
    caption = (
        "Damping ratio (above) and frequency (below) of all poles over speed, each mode followed by the similarity of "
        "its eigenvector. A real root has ratio 1 if it decays, −1 if it grows; a mode that splits into two real "
        f"roots is drawn as two lines. Shaded: unstable. Onset of instability of an elastic mode: {said}."
        f"{' Drawn is the quasi-steady air that flies; it is no flutter clearance.' if elastic else ''}"
    )
    word = motion.capitalize()
    return Plate(f"modes_{motion.replace('-', '_')}", f"{word} modes over speed", caption, make)


def _draw_modes(damping: Axes, frequency: Axes, envelope: Envelope, lines: Sequence[_Line]) -> None:
    V = np.array(envelope.speeds)
    everything: list[FloatArray] = []
    for line in lines:
        f, zeta = envelope.history(line.name)
        everything.append(f[np.isfinite(f)])
        for j in (0, 1):
            look: dict[str, Any] = {"color": line.colour, "linestyle": line.dash, "linewidth": 1.4}
            damping.plot(*_broken(V, zeta[:, j]), **look)
            frequency.plot(V, f[:, j], **look)
    for axes in (damping, frequency):
        _speed_axis(axes, envelope)
    low, high = damping.get_ylim()
    low, high = min(low, -0.06 * (high - low)), max(high, 0.02)
    damping.set_ylim(low, high)
    damping.axhspan(low, 0.0, color=_UNSTABLE, linewidth=0, zorder=0)
    damping.axhline(0.0, color="#9aa1a9", linewidth=0.9)
    values = np.concatenate(everything) if everything else np.ones(1)
    positive = values[values > 1e-6]
    if positive.size and positive.max() > 8.0 * positive.min():
        # a root that crosses zero goes down without end
        frequency.set_ylim(max(0.8 * positive.min(), 1e-4 * positive.max()), 1.25 * positive.max())
        log_axis(frequency, "y", powers=False)
    else:
        frequency.set_ylim(0.0, 1.1 * float(values.max()))


def _broken(V: FloatArray, zeta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve with a gap where a real root changes sign, and its damping ratio jumps between 1 and -1."""
    jumps = np.flatnonzero(np.abs(np.diff(zeta)) > 1.5) + 1
    return np.insert(V, jumps, np.nan), np.insert(zeta, jumps, np.nan)


def _mark_onsets(pair: Sequence[Axes], envelope: Envelope, lines: Sequence[_Line]) -> None:
    damping, frequency = pair
    found = [(line, envelope.onset(line.name)) for line in lines]
    unstable = [(line, o) for line, o in found if o.V_m_s is not None]
    for line, onset in unstable:
        V = float(onset.V_m_s or 0.0)
        for axes in (damping, frequency):
            axes.axvline(V, color=line.colour, linewidth=0.9, linestyle=(0, (2, 2)))
        damping.plot(V, 0.0, "o", color=line.colour, markersize=5, zorder=5)
    if unstable:  # above the panel, where no curve runs
        notes(damping, [("onset", QUIET), *((f"{o.V_m_s:.3g} m/s", line.colour) for line, o in unstable)])
    if not unstable:
        damping.set_title(f"onset: none up to {envelope.speeds[-1]:g} m/s", loc="right", fontsize=8, color=QUIET, pad=4)


# --- mode shapes ------------------------------------------------------------------------------------------------------


def _shape_plate(survey: Survey) -> Plate:
    flown = survey.envelope.aircraft.flown_modes()
    assert flown is not None
    modes = survey.shaped
    y, deg_m = np.array(flown.stations_m), 1.0 / (flown.cbar_m * DEG_RAD)
    span = np.concatenate([-y[::-1], y])
    looks: list[dict[str, Any]] = [{"color": COLOURS[k], "linestyle": DASHES[k], "linewidth": 1.4} for k in (0, 1)]

    def make(wide: bool) -> Figure:
        """Draw one panel per mode: displacement on its left axis, twist on its right one."""
        from matplotlib.lines import Line2D
        from matplotlib.ticker import MaxNLocator

        texts = ("displacement, m per unit of η (left axis)", "twist, deg per unit of η (right axis)")
        handles = [Line2D([], [], label=text, **look) for text, look in zip(texts, looks, strict=True)]
        columns = min(2, len(modes)) if wide else 1
        rows = -(-len(modes) // columns)
        top = legend_in(texts, wide) + 0.32
        figure = new_figure(wide, top + 1.25 * rows + 0.45 * (rows - 1) + 0.5)
        panels = grid(figure, top, [1.25] * rows, [1.0] * columns, gap_in=0.45, between_in=1.3, right_in=0.66).ravel()
        for k, (axes, (i, mode)) in enumerate(zip(panels, modes.items(), strict=False)):
            bend, twist = _both_wings(mode)
            right = axes.twinx()
            axes.axhline(0.0, color="#9aa1a9", linewidth=0.7)
            axes.plot(span, bend, **looks[0])
            right.plot(span, twist / DEG_RAD, **looks[1])
            reach = 1.1 * max(float(np.abs(bend).max()), float(np.abs(twist).max()) * flown.cbar_m) or 1.0
            axes.set_ylim(-reach, reach)
            right.set_ylim(-reach * deg_m, reach * deg_m)
            axes.set_xlim(-y[-1], y[-1])
            for one, look, text in ((axes, looks[0], "m per η"), (right, looks[1], "deg per η")):
                one.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10], symmetric=True))
                one.tick_params(axis="y", colors=look["color"])
                one.set_ylabel(text, color=look["color"])
            right.grid(False)
            last = k >= len(modes) - columns
            label(axes, "y, m (left wing negative)" if last else "")
            width = float(axes.get_position().width * figure.get_size_inches()[0])
            right.yaxis.set_label_coords(1.0 + 0.45 / width, 0.5)
            axes.set_title(_shape_title(i, mode, most=int(17.0 * (width + 0.6))), fontsize=8.0, pad=4.0)
        for axes in panels[len(modes) :]:
            axes.remove()
        legend(figure, handles)
        return figure

    caption = (
        "Displacement of the elastic axis, positive up, and twist, positive nose up, along both wings for one unit of "
        "each mode's coordinate, in vacuo; titles give the frequency in vacuo. Symmetric modes move both wings alike, "
        "asymmetric ones oppositely. Panels differ in scale; in each, equal height on both axes is equal displacement "
        f"at one mean chord ({flown.cbar_m:.3g} m) ahead of the elastic axis."
    )
    return Plate("mode_shapes", "Shapes of the elastic modes along the wing", caption, make)


def _both_wings(mode: ElasticMode) -> tuple[FloatArray, FloatArray]:
    """Return displacement, m, and twist, rad, per unit of eta from the left tip to the right one."""
    assert mode.shape is not None
    sign = 1.0 if mode.symmetry == "symmetric" else -1.0
    bend, twist = np.array(mode.shape.bend_m), np.array(mode.shape.twist_rad)
    return np.concatenate([sign * bend[::-1], bend]), np.concatenate([sign * twist[::-1], twist])


def _shape_title(i: int, mode: ElasticMode, most: int) -> str:
    """Return number, frequency and name in at most so many letters; the frequency stands first, as names are cut."""
    name = mode.name.replace("asymmetric", "asym.").replace("symmetric", "sym.").replace(" and ", " + ")
    text = f"{symbol(f'eta_{i}')}, {mode.f_hz:.3g} Hz: {name}"
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


# --- frequency responses ----------------------------------------------------------------------------------------------


def _response_plate(survey: Survey) -> Plate:
    envelope = survey.envelope
    omega = np.geomspace(*_band(envelope), 600)
    curves = {V: _response(envelope, V, omega) for V in survey.responses}
    phases = {V: _phases(H, curves[survey.responses[0]]) for V, H in curves.items()}
    texts = [f"{V:g} m/s" for V in survey.responses]

    def make(wide: bool) -> Figure:
        """Draw magnitude and phase of each output, one line per speed."""
        from matplotlib.lines import Line2D
        from matplotlib.ticker import MultipleLocator

        rows, columns = (len(_RESPONSES), 2) if wide else (2 * len(_RESPONSES), 1)
        looks = [{"color": c, "linestyle": DASHES[k % 6]} for k, c in enumerate(_shades(len(texts)))]
        handles = [Line2D([], [], label=text, **look) for text, look in zip(texts, looks, strict=True)]
        top = legend_in(texts, wide) + 0.3
        figure = new_figure(wide, top + 1.3 * rows + 0.45 * (rows - 1) + 0.5)
        panels = grid(figure, top, [1.3] * rows, [1.0] * columns, gap_in=0.45, between_in=0.74)
        for i, (pair, output) in enumerate(zip(panels.reshape(len(_RESPONSES), 2), _RESPONSES, strict=True)):
            factor, unit = ratio_unit(output, "de")
            for V, look in zip(survey.responses, looks, strict=True):
                pair[0].plot(omega, factor * np.abs(curves[V][:, i]), linewidth=1.3, **look)
                pair[1].plot(omega, phases[V][:, i], linewidth=1.3, **look)
            log_axis(pair[0], "y", powers=True)
            last = i == len(_RESPONSES) - 1
            name = f"{symbol(output)} / {symbol('de')}"
            label(pair[0], "frequency, rad/s" if last and wide else "", unit, f"{name}, magnitude")
            label(pair[1], "frequency, rad/s" if last else "", "deg", f"{name}, phase")
            span = float(np.ptp(pair[1].get_ylim()))
            pair[1].yaxis.set_major_locator(MultipleLocator(next((s for s in (45, 90, 180) if span <= 5 * s), 360)))
            for k, axes in enumerate(pair):
                log_axis(axes, "x", powers=False)
                axes.set_xlim(omega[0], omega[-1])
                axes.tick_params(labelbottom=last and (wide or k == 1))
        legend(figure, handles)
        return figure

    left_out = {u.V_m_s for u in survey.untrimmed if u not in survey.range.beyond}
    missing = (
        f" Speeds that cannot be trimmed are left out: {', '.join(f'{V:g}' for V in sorted(left_out))} m/s."
        if left_out
        else ""
    )
    shaky = [f"{V:g}" for V in survey.responses if envelope.models[envelope.nearest(V)].poles().real.max() > 1e-6]
    unstable = (
        f" The aircraft is unstable at {', '.join(shaky)} m/s; there the response is that of the transfer function, "
        "not of a flight."
        if shaky
        else ""
    )
    caption = (
        f"True airspeed, pitch rate, angle of attack and pitch angle to elevator deflection at {envelope.h_m:g} m, "
        f"rigid and elastic motion together, without servo and sensor lags.{missing}{unstable}"
    )
    return Plate("bode_de", f"Frequency responses to {symbol('de')}", caption, make)


def _shades(count: int) -> list[Any]:
    """Return colours from dark to light, slow to fast."""
    from matplotlib import colormaps

    return [colormaps["viridis"](x) for x in np.linspace(0.0, 0.82, count)]


def _band(envelope: Envelope) -> tuple[float, float]:
    """Return the band of the responses, rad/s: from below the slowest longitudinal mode to above the fastest."""
    poles: Mapping[str, tuple[complex, ...]] = envelope.poles[envelope.design]
    wn = [abs(s) for n, found in poles.items() if envelope.motion[n] == "longitudinal" for s in found if abs(s) > 1e-3]
    return 0.3 * min(wn), 2.0 * max(wn)


def _response(envelope: Envelope, V: float, omega: FloatArray) -> Any:
    return envelope.models[envelope.nearest(V)].frequency_response(omega, _RESPONSES, ("de",))[:, :, 0]


def _phases(response: Any, first: Any) -> FloatArray:
    """Return the phases in deg without jumps, at the middle frequency on the same sheet as those of ``first``.

    An unstable phugoid turns the phase the other way: without this it would stand a whole turn off.
    """
    turned, goal = (np.degrees(np.unwrap(np.angle(H), axis=0)) for H in (response, first))
    middle = len(turned) // 2
    start = goal - 360.0 * np.round(goal[middle] / 360.0)
    return np.asarray(turned + 360.0 * np.round((start[middle] - turned[middle]) / 360.0), np.float64)
