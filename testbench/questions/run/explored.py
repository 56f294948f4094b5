"""The figures of a run as numbers that a reader explores: inputs, time histories with residuals, responses, poles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.page.explore import Curve, Explorable, Panel, View, line_style
from testbench.page.labels import axis_label, ratio_unit, shown_unit, symbol
from testbench.page.plot import INK, MEASURED, marker_look
from testbench.questions.run.labels import case_names

if TYPE_CHECKING:
    from testbench.core.record import FlightRecord, FloatArray
    from testbench.line import Flight
    from testbench.questions.run.result import RunResult

MEASURED_NAME = "measured"


def histories(
    result: RunResult, parts: Sequence[tuple[str, int]], channels: Sequence[str], reach: float, titles: Sequence[str]
) -> Explorable:
    """Return measured and predicted channels over time, a view per record; residuals are differences to measured.

    Args:
        result: of the run.
        parts: (use, number) of each record.
        channels: inputs and outputs, in the order of the panels.
        reach: share of the measured range by which a prediction may widen an axis, on either side.
        titles: of the records.
    """
    return Explorable(
        [
            View(
                name=title,
                panels=[_history(result, name, use, i, reach) for name in channels],
                reference=MEASURED_NAME,
                link=clock_of(flight_of(result, use, i)),
            )
            for (use, i), title in zip(parts, titles, strict=True)
        ]
    )


def flight_of(result: RunResult, use: str, i: int) -> Flight:
    """Return the flight of the i-th record of a use; those of split flights come after the others."""
    whole = [f for f in result.flights if f.use == use]
    return [*whole, *(f for f in result.flights if f.use == "split")][i]


def clock_of(flight: Flight) -> str:
    """Return the link of all views over the time of one flight: who zooms one zooms them all."""
    return f"time of {flight.name}"


def _history(result: RunResult, name: str, use: str, i: int, reach: float) -> Panel:
    factor = shown_unit(name)[0]
    record: FlightRecord = next(getattr(c, use)[i] for c in result.cases if name in getattr(c, use)[i])
    measured = factor * record[name]
    given = name in result.cases[0].model.inputs
    curves = [Curve(name=MEASURED_NAME, x=record.t_s, y=measured, colour=INK if given else MEASURED)]
    lows, highs = [float(measured.min())], [float(measured.max())]
    span = reach * max(highs[0] - lows[0], 1e-12)
    for k, (label, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True)):
        if name in case.model.outputs:
            column = case.model.outputs.index(name)
            y = factor * getattr(case.evaluation, use).predictions[i][:, column]
            curves.append(Curve(name=label, x=getattr(case, use)[i].t_s, y=y, **line_style(k)))
            finite = y[np.isfinite(y)]
            lows.append(max(float(finite.min(initial=lows[0])), lows[0] - span))
            highs.append(min(float(finite.max(initial=highs[0])), highs[0] + span))
    pad = 0.08 * (max(highs) - min(lows) or 1.0)
    return Panel(
        title=axis_label(name, result.source.preparation.bias != "none"),
        x="t, s",
        curves=curves,
        limits=(min(lows) - pad, max(highs) + pad),
    )


def movement(
    moved: Sequence[tuple[Flight, FlightRecord, FloatArray]],
    name: str,
    spectra: Mapping[str, FloatArray],
    omega: FloatArray,
    marks: Sequence[tuple[float, str]],
    colours: Mapping[str, str],
) -> Explorable:
    """Return an input's energy spectrum with the modes, and its time history in every flight.

    Args:
        moved: each flight, its record and the deviation from trim, SI.
        name: of the input.
        spectra: use -> energy density in shown units.
        omega: of the spectra, rad/s.
        marks: (frequency, rad/s, name).
        colours: use -> colour.
    """
    factor, unit = shown_unit(name)
    top = max(float(e.max()) for e in spectra.values()) or 1.0
    spectrum = Panel(
        title=f"energy density, ({unit} s)²" if unit else "energy density, s²",
        x="frequency, rad/s",
        curves=[Curve(name=use, x=omega, y=energy, colour=colours[use]) for use, energy in spectra.items()],
        log_x=True,
        log_y=True,
        limits=(1e-5 * top, 2.0 * top),
        marks=marks,
    )
    times = [
        View(
            name=f"{flight.use}: {flight.name}",
            panels=[
                Panel(
                    title=axis_label(name, deviation=True),
                    x="t, s",
                    curves=[Curve(name=flight.use, x=record.t_s, y=factor * u, colour=colours[flight.use])],
                )
            ],
            link=clock_of(flight),
        )
        for flight, record, u in moved
    ]
    return Explorable([View(name="energy spectrum", panels=[spectrum]), *times])


def responses(
    outputs: Sequence[str],
    given: str,
    curves: Mapping[str, Sequence[tuple[str, Any, Mapping[str, Any]]]],
    band: tuple[float, float],
    marks: Sequence[tuple[float, str]],
) -> Explorable:
    """Return magnitude and phase of each output over frequency, a view per output.

    Args:
        outputs: in the order of the views.
        given: the input.
        curves: output -> (name, object with ``omega``, ``magnitude`` and ``phase_deg``, look) of each curve.
        band: that the input excites, rad/s.
        marks: (frequency, rad/s, name).
    """

    def panel(output: str, what: str, values: str, log: bool, unit: str) -> Panel:
        return Panel(
            title=f"{what}, {unit}",
            x="frequency, rad/s",
            curves=[
                Curve(name=name, x=c.omega, y=getattr(c, values), **look) for name, c, look in curves[output]
            ],
            log_x=True,
            log_y=log,
            band=band,
            marks=marks if log else [(x, "") for x, _ in marks],
        )  # fmt: skip

    return Explorable(
        [
            View(
                name=f"{symbol(output)} / {symbol(given)}",
                panels=[
                    panel(output, "magnitude", "magnitude", True, ratio_unit(output, given)[1]),
                    panel(output, "phase", "phase_deg", False, "deg"),
                ],
            )
            for output in outputs
        ]
    )


def pole_map(
    found: Sequence[tuple[str, Sequence[complex], int]],
    true: Mapping[str, complex],
    word: str,
    reaches: Sequence[float],
) -> Explorable:
    """Return the poles in the plane, a view per reach: found ones by model, true or printed ones by crosses."""

    def curve(name: str, poles: Sequence[complex], colour: str, marker: str) -> Curve:
        points = np.array(sorted(poles, key=lambda p: (p.real, p.imag)), complex)
        return Curve(name=name, x=points.real, y=points.imag, colour=colour, marker=marker)

    views = []
    for i, reach in enumerate(reaches):
        near = [(name, [p for p in poles if abs(p) <= reach], k) for name, poles, k in found]
        curves = [curve(name, poles, *marker_look(k)) for name, poles, k in near]
        crosses = [p for p in true.values() if abs(p) <= reach]
        if crosses:
            curves.insert(0, curve(word, crosses, INK, "+"))
        panel = Panel(title="Im s, rad/s", x="Re s, rad/s", curves=curves, limits=(-0.05 * reach, 1.05 * reach))
        views.append(View(name="near the origin" if i else "all", panels=[panel], plane=True))
    return Explorable(views)
