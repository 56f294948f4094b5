"""The figures on an aircraft: three views, trim, modes over speed, mode shapes along the wing, responses to de."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD, PERCENT
from testbench.page.figure import (
    AXIS,
    COLOURS,
    DASHES,
    DOTTED,
    QUIET,
    Chart,
    Curve,
    Drawn,
    Panel,
    Plate,
    Rule,
    Span,
    bode,
    grid,
    shades,
    unwrapped,
)
from testbench.page.labels import axis_label, ratio_unit, symbol
from testbench.questions.aircraft.three_view_figures import three_view_plates

if TYPE_CHECKING:
    from testbench.aircraft.elastic import ElasticMode
    from testbench.core.record import FloatArray
    from testbench.evaluation.envelope import Envelope
    from testbench.questions.aircraft.ask import Survey

_UNSTABLE = "#fbe9e0"
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


def _elastic_looks(envelope: Envelope, motion: str) -> dict[str, dict[str, Any]]:
    """Return mode -> its name in the legend, colour and dash."""
    return {
        n: {"name": f"{symbol(f'eta_{envelope.elastic[n]}')} {n}", "colour": COLOURS[k % 6], "dash": DASHES[k % 6]}
        for k, n in enumerate(envelope.names(motion, elastic=True))
    }


def _over_speed(envelope: Envelope, draws: Sequence[Drawn], **settings: Any) -> Panel:
    """Return a panel over the speeds of an envelope, with the design speed dotted."""
    low, high = envelope.speeds[0], envelope.speeds[-1]
    pad = 0.5 if high == low else 0.0
    design = Rule(at=envelope.speeds[envelope.design], dash=DOTTED, width=0.8)
    return Panel(draws=[*draws, design], x="V, m/s", x_range=(low - pad, high + pad), **settings)


# --- trim -------------------------------------------------------------------------------------------------------------


def _trim_plate(survey: Survey) -> Plate:
    """Return one panel per trimmed quantity, and one for all static deflections."""
    envelope = survey.envelope
    V = np.array(envelope.speeds)
    marked = [envelope.nearest(v) for v in survey.tabled]
    curves = {"alpha": np.array([t.alpha for t in envelope.trims]) / DEG_RAD}
    for name, unit in (("de", DEG_RAD), ("thr", PERCENT)):
        if name in envelope.aircraft.controls:
            curves[name] = np.array([t.controls[name] for t in envelope.trims]) / unit
    panels = []
    for name, y in curves.items():
        draws = [Curve(x=V, y=y), Curve(x=V[marked], y=y[marked], marker="o", size=3.0, clip=False)]
        panels.append(_over_speed(envelope, [*draws, *_zero(y)], y=axis_label(name), tall_in=1.6))
    looks = _elastic_looks(envelope, "longitudinal")
    if looks:
        eta = {n: np.array([t.state[f"eta_{envelope.elastic[n]}"] for t in envelope.trims]) for n in looks}
        lines = [Curve(x=V, y=eta[n], **look) for n, look in looks.items()]
        zero = _zero(np.concatenate(list(eta.values())))
        panels.append(_over_speed(envelope, [*lines, *zero], y="static deflection η", tall_in=1.6))
    caption = (
        f"Steady level flight at {envelope.h_m:g} m; dots: the speeds of the table. Dotted: the design speed."
        f"{' Deflections of the symmetric modes, in the unit of each mode.' if looks else ''}"
    )
    columns = 2 if len(panels) == 4 else len(panels)
    return Plate("trim", "Trim over speed", caption, grid(panels, columns, share_x=True))


def _zero(y: FloatArray) -> list[Drawn]:
    """Return the line at zero where curves pass it."""
    return [Rule(at=0.0, of="y", colour=AXIS, width=0.7)] if y.min() < 0.0 < y.max() else []


# --- modes over speed -------------------------------------------------------------------------------------------------


def _mode_plate(survey: Survey, motion: str) -> Plate:
    """Return damping ratio above frequency, rigid modes beside elastic ones; those of a rigid aircraft in one row."""
    envelope = survey.envelope
    dashes = (DASHES[0], DASHES[1], DASHES[4])
    rigid = {n: {"name": n, "dash": d} for n, d in zip(envelope.names(motion, elastic=False), dashes, strict=False)}
    elastic = _elastic_looks(envelope, motion)
    pairs = [_damping_and_frequency(envelope, "rigid modes", rigid, {})]
    onsets = [envelope.onset(n) for n in elastic]
    unstable = [o for o in onsets if o.V_m_s is not None]
    if elastic:
        found = {n: o.V_m_s for n, o in zip(elastic, onsets, strict=True) if o.V_m_s is not None}
        pairs.append(_damping_and_frequency(envelope, "elastic modes", elastic, found))
    rows = list(zip(*pairs, strict=True)) if elastic else pairs
    said = "; ".join(o.sentence for o in unstable) or (
        f"none up to {envelope.speeds[-1]:g} m/s" if elastic else "no elastic modes in this motion"
    )
    caption = (
        "Damping ratio (above) and frequency (below) of all poles over speed, each mode followed by the similarity of "
        "its eigenvector. A real root has ratio 1 if it decays, −1 if it grows; a mode that splits into two real "
        f"roots is drawn as two lines. Shaded: unstable. Onset of instability of an elastic mode: {said}."
        f"{' Drawn is the quasi-steady air that flies; it is no flutter clearance.' if elastic else ''}"
    )
    name = f"modes_{motion.replace('-', '_')}"
    return Plate(name, f"{motion.capitalize()} modes over speed", caption, Chart(rows, share_x=bool(elastic)))


def _damping_and_frequency(
    envelope: Envelope, title: str, looks: Mapping[str, dict[str, Any]], onsets: Mapping[str, float]
) -> tuple[Panel, Panel]:
    """Return damping ratio and frequency of modes over speed; ``onsets`` are the speeds at which they lose damping."""
    V, zetas, sizes = np.array(envelope.speeds), list[Curve](), list[Curve]()
    for name, look in looks.items():
        f, zeta = envelope.history(name)
        for j in (0, 1):
            x, y = _broken(V, zeta[:, j])
            zetas.append(Curve(x=x, y=y, width=1.4, **look))
            sizes.append(Curve(x=V, y=f[:, j], width=1.4, **look))
    every = [np.concatenate([np.asarray(c.y) for c in curves] or [np.ones(1)]) for curves in (zetas, sizes)]
    shown, values = (y[np.isfinite(y)] for y in every)
    low, high = float(shown.min(initial=0.0)), float(shown.max(initial=0.02))
    low, high = low - 0.06 * (high - low), high + 0.05 * (high - low)
    marks: list[Drawn] = [Rule(at=at, colour=looks[n]["colour"], dash=(2, 2)) for n, at in onsets.items()]
    dots = [Curve(x=[at], y=[0.0], colour=looks[n]["colour"], marker="o", order=5.0) for n, at in onsets.items()]
    notes = [("onset", QUIET), *((f"{at:.3g} m/s", looks[n]["colour"]) for n, at in onsets.items())]
    if title.startswith("elastic") and not onsets:
        notes = [(f"onset: none up to {envelope.speeds[-1]:g} m/s", QUIET)]
    damping = _over_speed(
        envelope, [*zetas, *dots, *marks, Span(low=low, high=0.0, of="y", colour=_UNSTABLE),
                   Rule(at=0.0, of="y", colour=AXIS)],
        title=title, y="damping ratio ζ", y_range=(low, high), tall_in=2.1, notes=notes if title[0] == "e" else (),
    )  # fmt: skip
    positive = values[values > 1e-6]
    far = positive.size > 0 and positive.max() > 8.0 * positive.min()
    # A root that crosses zero goes down without end.
    ends = (
        (max(0.8 * positive.min(), 1e-4 * positive.max()), 1.25 * positive.max()) if far else (0.0, 1.1 * values.max())
    )
    frequency = _over_speed(envelope, [*sizes, *marks], y="|s|/2π, Hz", log_y=far, y_range=ends, tall_in=2.1)
    return damping, frequency


def _broken(V: FloatArray, zeta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the curve with a gap where a real root changes sign, and its damping ratio jumps between 1 and -1."""
    jumps = np.flatnonzero(np.abs(np.diff(zeta)) > 1.5) + 1
    return np.insert(V, jumps, np.nan), np.insert(zeta, jumps, np.nan)


# --- mode shapes ------------------------------------------------------------------------------------------------------


def _shape_plate(survey: Survey) -> Plate:
    """Return one panel per mode: displacement on its left axis, twist on its right one."""
    flown = survey.envelope.aircraft.flown_modes()
    assert flown is not None
    y, deg_m = np.array(flown.stations_m), 1.0 / (flown.cbar_m * DEG_RAD)
    span = np.concatenate([-y[::-1], y])
    names = ("displacement, m per unit of η (left axis)", "twist, deg per unit of η (right axis)")
    looks: list[dict[str, Any]] = [
        {"name": name, "colour": COLOURS[k], "dash": DASHES[k], "width": 1.4} for k, name in enumerate(names)
    ]
    panels = []
    for i, mode in survey.shaped.items():
        bend, twist = _both_wings(mode)
        reach = 1.1 * max(float(np.abs(bend).max()), float(np.abs(twist).max()) * flown.cbar_m) or 1.0
        turn = Curve(x=span, y=twist / DEG_RAD, **looks[1])
        panels.append(
            Panel(
                draws=[Curve(x=span, y=bend, **looks[0]), Rule(at=0.0, of="y", colour=AXIS, width=0.7)],
                title=_shape_title(i, mode), x="y, m (left wing negative)", y="m per η", y_colour=COLOURS[0],
                x_range=(-y[-1], y[-1]), y_range=(-reach, reach), tall_in=1.25,
                right=Panel(draws=[turn], y="deg per η", y_range=(-reach * deg_m, reach * deg_m), y_colour=COLOURS[1]),
            )
        )  # fmt: skip
    caption = (
        "Displacement of the elastic axis, positive up, and twist, positive nose up, along both wings for one unit of "
        "each mode's coordinate, in vacuo; titles give the frequency in vacuo. Symmetric modes move both wings alike, "
        "asymmetric ones oppositely. Panels differ in scale; in each, equal height on both axes is equal displacement "
        f"at one mean chord ({flown.cbar_m:.3g} m) ahead of the elastic axis."
    )
    title = "Shapes of the elastic modes along the wing"
    return Plate("mode_shapes", title, caption, grid(panels, min(2, len(panels)), share_x=True))


def _both_wings(mode: ElasticMode) -> tuple[FloatArray, FloatArray]:
    """Return displacement, m, and twist, rad, per unit of eta from the left tip to the right one."""
    assert mode.shape is not None
    sign = 1.0 if mode.symmetry == "symmetric" else -1.0
    bend, twist = np.array(mode.shape.bend_m), np.array(mode.shape.twist_rad)
    return np.concatenate([sign * bend[::-1], bend]), np.concatenate([sign * twist[::-1], twist])


def _shape_title(i: int, mode: ElasticMode) -> str:
    """Return number, frequency and name; the frequency stands first, as names are cut."""
    name = mode.name.replace("asymmetric", "asym.").replace("symmetric", "sym.").replace(" and ", " + ")
    return f"{symbol(f'eta_{i}')}, {mode.f_hz:.3g} Hz: {name}"


# --- frequency responses ----------------------------------------------------------------------------------------------


def _response_plate(survey: Survey) -> Plate:
    """Return magnitude and phase of each output, one line per speed."""
    envelope = survey.envelope
    omega = np.geomspace(*_band(envelope), 600)
    curves = {V: _response(envelope, V, omega) for V in survey.responses}
    phases = {V: _phases(H, curves[survey.responses[0]]) for V, H in curves.items()}
    looks = {
        V: {"name": f"{V:g} m/s", "colour": colour, "dash": DASHES[k % 6]}
        for k, (V, colour) in enumerate(zip(curves, shades(len(curves)), strict=True))
    }
    panels = []
    for i, output in enumerate(_RESPONSES):
        factor, unit = ratio_unit(output, "de")
        lines = [(omega, factor * np.abs(H[:, i]), phases[V][:, i], looks[V]) for V, H in curves.items()]
        panels.append(bode(f"{symbol(output)} / {symbol('de')}", unit, lines))
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
    return Plate("bode_de", f"Frequency responses to {symbol('de')}", caption, Chart(panels, share_x=True))


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
    turned, goal = unwrapped(response), unwrapped(first)
    middle = len(turned) // 2
    start = goal - 360.0 * np.round(goal[middle] / 360.0)
    return np.asarray(turned + 360.0 * np.round((start[middle] - turned[middle]) / 360.0), np.float64)
