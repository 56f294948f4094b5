"""The figures of a run: its answer, inputs and spectra, time histories, parameters, orders, Bode plots and pole maps.

Each function returns Plates; nothing is drawn before :meth:`testbench.page.figure.Plate.draw`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.identification import estimator_name
from testbench.evaluation.excitation import EXCITED_DB
from testbench.evaluation.metrics import mrse_mean
from testbench.evaluation.modes import words_of
from testbench.inputs.signal import energy_spectrum, frequency_below
from testbench.page import figure as fig
from testbench.page.explore import View
from testbench.page.labels import axis_label, number, ratio_unit, shown_unit, symbol
from testbench.questions.run.labels import case_names, elastic_names, outputs_of
from testbench.questions.run.tables import printed_poles

if TYPE_CHECKING:
    from testbench.line import Case, Flight
    from testbench.questions.run.result import RunResult
    from testbench.questions.run.seeds import Repeats

_MOST_MODES = 8
_RANGE_PERCENT = (0.1, 1000.0)  # a free run that diverges, or a copy of what was measured, is drawn at the edge
_PER_PLATE = 3  # records side by side in one figure of time histories
_MOST_DRAWN = 9  # records of one use; a second for each would keep the reader of an hour's flight waiting
_MOST_PARAMETERS = 24  # more than that is for the table
_DECADES = 5  # of energy density that are shown
_RAYS = (0.1, 0.3, 0.5, 0.7, 0.9)  # damping ratios that are drawn
_Moved = Sequence[tuple["Flight", FlightRecord, FloatArray]]
_Found = Sequence[tuple[str, list[complex], int]]  # label, poles of the upper half-plane, number of colour


def plates(result: RunResult) -> list[fig.Plate]:
    """Return every figure for which ``result`` has data, in the order of the report."""
    return [
        *answer_plates(result),
        *input_plates(result),
        *history_plates(result),
        *parameter_plates(result),
        *singular_value_plates(result),
        *bode_plates(result),
        *pole_plates(result),
    ]


def _modes(result: RunResult) -> Mapping[str, complex]:
    return {} if result.truth is None else result.truth.modes


# --- the answer -------------------------------------------------------------------------------------------------------


def answer_plates(result: RunResult) -> list[fig.Plate]:
    """Return error per output and model and, if the truth is known, what the input shows of each mode; or nothing."""
    outputs = outputs_of(result.cases)
    modes = [] if result.truth is None else sorted(result.truth.excitation, key=lambda e: abs(e.pole))[:_MOST_MODES]
    if not outputs:
        return []
    repeats = result.repeats
    if repeats is None:
        panel = _errors(result, outputs)
        caption = (
            "Error of prediction on the validation data (MRSE): further left is better; 100 % (line) is no better than "
            "predicting zero. A point at the edge means 0.1 % or less, or 1000 % or more."
        )
    else:
        panel = _intervals(result, repeats)
        caption = (
            f"Mean error over {repeats.count} seeds with its 95 % interval (thick) and nine of ten seeds (thin): "
            "further left is better. Of a mode it is "
            "the distance of its pole from the true one, relative to that; a sign is missing where the mode was found "
            "in fewer than two seeds. The error of prediction is the MRSE on validation data."
        )
    if modes:
        caption += (
            " Modes: their response to the input over the noise of the sensor that shows them best, whose name is "
            f"given. Filled: excited, from {EXCITED_DB:g} dB (line) on."
        )
    title = "Errors of the models" + (", and what the input shows of the modes" if modes else "")
    return [fig.Plate("answer", title, caption, fig.Chart([[panel, *([_excitation(modes)] if modes else [])]]))]


def _beside(k: int, count: int) -> float:
    """Return how far below its row the k-th of so many models stands."""
    return 0.6 * ((k + 0.5) / count - 0.5)


def _errors(result: RunResult, outputs: list[str]) -> fig.Panel:
    """Return one row per output, one sign per model, models of a row below each other."""
    draws: list[fig.Drawn] = []
    drawn = [200.0]
    for k, (name, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True)):
        found = dict(zip(case.model.outputs, case.evaluation.validation.mrse_percent, strict=True))
        here = [i for i, o in enumerate(outputs) if o in found]
        x = np.nan_to_num([float(found[outputs[i]]) for i in here], nan=np.inf).clip(*_RANGE_PERCENT)
        y = np.array(here) + _beside(k, len(result.cases))
        draws.append(fig.Curve(x=x, y=y, name=name, **fig.marker_look(k), size=5.5, hollow=True, clip=False))
        drawn += x.tolist()
    return fig.Panel(
        draws=[*draws, fig.Rule(at=100.0)], title="Error in validation", x="error, %", log_x=True,
        x_range=(10.0 ** np.floor(np.log10(min(drawn))), max(drawn)), **fig.rows([symbol(o) for o in outputs]),
    )  # fmt: skip


def _intervals(result: RunResult, repeats: Repeats) -> fig.Panel:
    """Return one row per quantity: the mean error of each model over the seeds with its interval."""
    draws: list[fig.Drawn] = []
    drawn: list[float] = []
    for k, (name, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True)):
        key, look = (case.suite, estimator_name(case.estimator)), fig.marker_look(k)
        for i, quantity in enumerate(repeats.quantities):
            mean = repeats.mean(key, quantity)
            if mean is None:
                continue
            y = i + _beside(k, len(result.cases))
            for ends, width in ((repeats.most(key, quantity), 0.7), ((mean.low, mean.high), 2.4)):
                shown = np.clip(ends, *_RANGE_PERCENT)
                draws.append(fig.Curve(x=shown, y=[y, y], colour=look["colour"], width=width))
                drawn += shown.tolist()
            x = [float(np.clip(mean.value, *_RANGE_PERCENT))]
            draws.append(fig.Curve(x=x, y=[y], name=name, **look, hollow="white", order=3.0))
    names = [words_of(q).removeprefix("the ") for q in repeats.quantities]
    return fig.Panel(
        draws=draws, title=f"Error over {repeats.count} seeds", x="error, %", log_x=True,
        x_range=(10.0 ** np.floor(np.log10(min(drawn))), 1.2 * max(drawn)), **fig.rows(names),
    )  # fmt: skip


def _excitation(modes: list[Any]) -> fig.Panel:
    """Return one row per mode: from the threshold to the response over noise of the sensor that shows it best."""
    best = [float(e.snr_db[e.best_sensor]) for e in modes]
    low, high = min(0.0, *best), max(2.0 * EXCITED_DB, *best)
    draws: list[fig.Drawn] = []
    for i, (e, value) in enumerate(zip(modes, best, strict=True)):
        draws.append(fig.Curve(x=[EXCITED_DB, value], y=[i, i], colour=fig.COLOURS[0], width=1.6))
        hollow = False if e.excited else "white"
        draws.append(fig.Curve(x=[value], y=[i], colour=fig.COLOURS[0], marker="o", size=6.0, hollow=hollow, order=3.0))
        draws.append(fig.Words(x=max(value, EXCITED_DB), y=i, text=symbol(e.best_sensor), shift=(7, 0)))
    return fig.Panel(
        draws=[*draws, fig.Rule(at=EXCITED_DB)], title="Is the mode excited?", x="response over noise, dB",
        x_range=(low - 0.06 * (high - low), high + 0.2 * (high - low)),
        **fig.rows([e.mode for e in modes], 0.36),
    )  # fmt: skip


# --- the input and its spectrum ---------------------------------------------------------------------------------------


def input_plates(result: RunResult) -> list[fig.Plate]:
    """Return one plate per input: its time history in every flight, and its energy spectrum among the modes."""
    return [_input_plate(result, name) for name in result.source.identification.inputs]


def _movement(flight: Flight, name: str) -> tuple[FlightRecord, FloatArray]:
    """Return the record that ``name`` is shown from, the truth if there is one, and its deviation from trim, SI."""
    if flight.truth is not None and name in flight.truth:
        return flight.truth, flight.truth[name] - flight.truth[name][0]
    record = next(r for r in flight.measured.values() if name in r)
    return record, record[name] - record[name].mean()


def _input_plate(result: RunResult, name: str) -> fig.Plate:
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
    spectrum = _spectrum(result, moved, name)
    rows = [_inputs(row, name) for row in fig.rows_of(drawn, 3)]
    times = [
        View(name=p.title, panels=[p], link=clock_of(flight))
        for p, (flight, *_) in zip((p for row in rows for p in row), drawn, strict=True)
    ]
    views = [View(name="energy spectrum", panels=[spectrum]), *times]
    keys = None if len({f.use for f, *_ in moved}) > 1 else ()
    chart = fig.Chart([*rows, [spectrum]], keys=keys)
    return fig.Plate(f"input_{name}", f"The input {symbol(name)} and its energy spectrum", caption, chart, views)


def _use_colour(use: str) -> str:
    return fig.COLOURS[4] if use == "validation" else fig.INK


def _inputs(moved: _Moved, name: str) -> list[fig.Panel]:
    factor = shown_unit(name)[0]
    reach = 1.15 * factor * max([float(np.abs(u).max()) for _, _, u in moved]) or 1.0
    return [
        fig.Panel(
            draws=[fig.Curve(name=flight.use, x=record.t_s, y=factor * u, colour=_use_colour(flight.use), width=1.0)],
            title=f"{flight.use}: {flight.name}", x="t, s", y="" if i else axis_label(name, deviation=True),
            name=axis_label(name, deviation=True), y_range=(-reach, reach), tall_in=1.0, broad=wide,
            y_ticks=[] if i else None,
        )
        for i, ((flight, record, u), wide) in enumerate(zip(moved, fig.widths([r for _, r, _ in moved]), strict=True))
    ]  # fmt: skip


def _spectrum(result: RunResult, moved: _Moved, name: str) -> fig.Panel:
    """Return the energy density of the input of each use, among modes, sampling limit and 95 % of the energy."""
    (factor, unit), modes = shown_unit(name), _modes(result)
    nyquist = float(np.pi / next(iter(result.flights[0].measured.values())).dt_s)
    low = min([0.3, *(0.5 * abs(pole) for pole in modes.values() if abs(pole) > 0.02)])
    high = 1.4 * max([nyquist, *(abs(pole) for pole in modes.values())])
    omega = np.geomspace(low, high, 1200)
    curves = []
    for use in dict.fromkeys(flight.use for flight, _, _ in moved):
        y = np.sum([energy_spectrum(factor * u, r.dt_s, omega)[:, 0] for f, r, u in moved if f.use == use], axis=0)
        curves.append(
            fig.Curve(name=use, x=omega, y=y, colour=_use_colour(use), width=1.0 if use == "validation" else 1.3)
        )
    peak = max(float(np.max(c.y)) for c in curves) or 1.0
    marks = [fig.Rule(at=nyquist, text=f"sampling limit {number(nyquist)} rad/s", dash=fig.DOTTED)]
    limits = [frequency_below(u, r.dt_s)[0] for f, r, u in moved if f.use != "validation" and np.any(u != 0.0)]
    if limits and max(limits) < high:
        marks.append(
            fig.Rule(at=max(limits), text=f"95 % below {number(max(limits))} rad/s", dash=fig.DASHED, colour=fig.INK)
        )
    return fig.Panel(
        draws=[*curves, *marks, *fig.mode_marks(modes, elastic_names(result), low, high)], x="frequency, rad/s",
        y=f"energy density, ({unit} s)²" if unit else "energy density, s²", x_too=("frequency, Hz", 0.5 / np.pi),
        log_x=True, log_y=True, x_range=(low, high), y_range=(10.0**-_DECADES * peak, 2.0 * peak), tall_in=2.4,
    )  # fmt: skip


# --- time histories ---------------------------------------------------------------------------------------------------


def history_plates(result: RunResult) -> list[fig.Plate]:
    """Return measured and predicted outputs over time, identification beside validation, all cases overlaid."""
    if not result.cases:
        return []
    first = result.cases[0]
    kept = {use: _worst(first, use) for use in ("identification", "validation")}
    parts = [(use, i) for use, chosen in kept.items() for i in chosen]
    total = len(first.identification) + len(first.validation)
    caption = (
        "Grey: measured, prepared for identification. Coloured: what each model predicts from the input alone, with "
        "its initial state fitted. The numbers above a panel are the MRSE over that data set, in the order of the "
        "legend: 0 % is perfect, 100 % is no better than predicting zero. The validation records took no part in the "
        "identification."
    )
    if len(parts) < total:
        caption += (
            f" Of {total} records {len(parts)} are drawn: of each use the {_MOST_DRAWN} that the first model predicts "
            "worst."
        )
    chunks = fig.rows_of(parts, _PER_PLATE)
    return [_history_plate(result, chunk, k if len(chunks) > 1 else 0, caption) for k, chunk in enumerate(chunks, 1)]


def _worst(case: Case, use: str) -> list[int]:
    """Return which records of one use to draw, in their order: all, or of many those that are predicted worst."""
    records = getattr(case, use)
    if len(records) <= _MOST_DRAWN:
        return list(range(len(records)))
    names = list(case.model.outputs)
    predictions = getattr(case.evaluation, use).predictions
    errors = [mrse_mean(np.column_stack([r[n] for n in names]), y) for r, y in zip(records, predictions, strict=True)]
    return sorted(np.argsort(np.nan_to_num(errors, nan=np.inf))[-_MOST_DRAWN:].tolist())


def _history_plate(result: RunResult, parts: Sequence[tuple[str, int]], part: int, caption: str) -> fig.Plate:
    channels = [*result.cases[0].model.inputs, *outputs_of(result.cases)]
    broad = fig.widths([getattr(result.cases[0], use)[i] for use, i in parts])
    titles = [_part_title(result, use, i) for use, i in parts]
    panels = [
        [
            _history(result, name, use, i, broad=wide, title=title)
            for (use, i), wide, title in zip(parts, broad, titles, strict=True)
        ]
        for name in channels
    ]
    views = [
        View(name=title, panels=[row[c] for row in panels], reference="measured",
             link=clock_of(flight_of(result, *parts[c])))
        for c, title in enumerate(titles)
    ]  # fmt: skip
    return fig.Plate(
        f"time_histories_{part}" if part else "time_histories",
        "Measured and predicted outputs" + (f", part {part}" if part else ""),
        caption,
        fig.Chart(panels, share_x=True, share_y=True),
        views,
    )


def flight_of(result: RunResult, use: str, i: int) -> Flight:
    """Return the flight of the i-th record of a use; those of split flights come after the others."""
    whole = [f for f in result.flights if f.use == use]
    return [*whole, *(f for f in result.flights if f.use == "split")][i]


def clock_of(flight: Flight) -> str:
    """Return the link of all views over the time of one flight: who zooms one zooms them all."""
    return f"time of {flight.name}"


def _part_title(result: RunResult, use: str, i: int) -> str:
    flights = [f for f in result.flights if f.use == use] + [f for f in result.flights if f.use == "split"]
    return f"{use}: {flights[i].name}" if i < len(flights) else use


def _history(result: RunResult, name: str, use: str, i: int, **place: Any) -> fig.Panel:
    """Return one channel of one record: measured in grey, each case's prediction in its colour."""
    factor = shown_unit(name)[0]
    record: FlightRecord = next(getattr(c, use)[i] for c in result.cases if name in getattr(c, use)[i])
    measured = factor * record[name]
    given = name in result.cases[0].model.inputs
    look: dict[str, Any] = {"colour": fig.INK, "width": 0.8} if given else {"colour": fig.MEASURED, "width": 1.2}
    curves = [fig.Curve(name="measured", x=record.t_s, y=measured, **look)]
    texts: list[tuple[str, str]] = []
    for k, (label, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True)):
        if name in case.model.outputs:
            column = case.model.outputs.index(name)
            y = factor * getattr(case.evaluation, use).predictions[i][:, column]
            curves.append(fig.Curve(name=label, x=getattr(case, use)[i].t_s, y=y, **fig.line_look(k), width=1.2))
            if i == 0:  # the figures are over all records of that use, so once
                texts.append((number(float(getattr(case.evaluation, use).mrse_percent[column])), fig.COLOURS[k % 6]))
    return fig.Panel(
        draws=curves, x="t, s", y=axis_label(name, result.source.preparation.bias != "none"),
        y_range=fig.within(float(measured.min()), float(measured.max()), [np.asarray(c.y) for c in curves[1:]]),
        tall_in=0.62 if given else 1.05, notes=[("MRSE, %", fig.QUIET), *texts] if texts else (), **place,
    )  # fmt: skip


# --- parameters and orders --------------------------------------------------------------------------------------------


def parameter_plates(result: RunResult) -> list[fig.Plate]:
    """Return one panel per parameter with every model's estimate and 95 % interval; nothing without such models."""
    models = [
        (name, k, {p.name: p for p in case.evaluation.parameters if p.free})
        for k, (name, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True))
    ]
    models = [m for m in models if m[2]]
    if not models:
        return []
    chosen = list(dict.fromkeys(p for _, _, found in models for p in found if not p.endswith("_0")))[:_MOST_PARAMETERS]
    known = any(p.true is not None for _, _, found in models for p in found.values())
    caption = (
        "Estimates with 95 % intervals, corrected for coloured residuals."
        f"{' Vertical line: true derivative of the linearised aircraft.' if known else ''} SI units and radians. "
        "Constants are in the table only."
    )
    panels = []
    for name in chosen:
        found = [(model, k, row, ps[name]) for row, (model, k, ps) in enumerate(models) if name in ps]
        true = next((p.true for *_, p in found if p.true is not None), None)
        draws: list[fig.Drawn] = [] if true is None else [fig.Rule(at=true, name="true", colour=fig.INK, width=1.0)]
        for model, k, row, p in found:
            draws.append(
                fig.Curve(
                    x=[p.value], y=[-row], x_error=fig.INTERVAL * p.std, name=model, **fig.marker_look(k), size=4.5
                )
            )
        panels.append(
            fig.Panel(draws=draws, title=name, y_ticks=[], y_range=(0.4 - len(models), 0.6),
                  tall_in=0.32 + 0.16 * len(models))
        )  # fmt: skip
    return [fig.Plate("parameters", "Estimated parameters", caption, fig.grid(panels, min(4, len(panels)), narrow=2))]


def singular_value_plates(result: RunResult) -> list[fig.Plate]:
    """Return the singular values of every case that has them, with the chosen order."""
    panels = []
    for k, (name, case) in enumerate(zip(case_names(result.cases), result.cases, strict=True)):
        found = case.model.diagnostics
        if found.get("singular_values") is not None:
            panels.append(
                _singular_values(name, found["singular_values"], int(found.get("order") or 0), fig.COLOURS[k % 6])
            )
    if not panels:
        return []
    caption = (
        "Singular values from which the model order was chosen. Filled: kept; hollow: left out. Look for the step down "
        "to the noise floor at 1 (dotted). Values near that floor carry no information; hollow ones well above it say "
        "that the data hold more than the model."
    )
    chart = fig.grid(panels, min(len(panels), 3), share_y=True)
    return [fig.Plate("singular_values", "Singular values and model order", caption, chart)]


def _singular_values(name: str, every: Any, order: int, colour: str) -> fig.Panel:
    values = np.asarray(every, float)[:20]
    values = values[values > 0.0]
    n, low = np.arange(1, values.size + 1), min(0.5, 0.5 * float(values.min()))
    stems = np.column_stack([np.full_like(values, low), values, np.full_like(values, np.nan)])
    draws: list[fig.Drawn] = [fig.Curve(x=np.repeat(n, 3), y=stems.ravel(), colour=fig.FAINT, width=0.8)]
    for part, hollow in ((n <= order, False), (n > order, "white")):
        draws.append(fig.Curve(x=n[part], y=values[part], colour=colour, marker="o", size=5.5, hollow=hollow))
    return fig.Panel(
        draws=[*draws, fig.Rule(at=1.0, of="y", dash=fig.DOTTED, width=1.0)], whole="x",
        x="number of the singular value", y="size over the noise floor", log_y=True, tall_in=2.0,
        title=f"{name}: order {order}" if order else name,
        x_range=(0.3, values.size + 0.7), y_range=(low, 2.5 * float(values.max())),
    )  # fmt: skip


# --- Bode plots -------------------------------------------------------------------------------------------------------


def bode_plates(result: RunResult) -> list[fig.Plate]:
    """Return one plate per input: magnitude and phase of every model and of the truth, the excited band shaded."""
    inputs = list(dict.fromkeys(name for case in result.cases for name in case.model.inputs))
    return [_bode_plate(result, name) for name in inputs]


def _bode_plate(result: RunResult, given: str) -> fig.Plate:
    from testbench.evaluation.truth import excited_band

    cases = [c for c in result.cases if given in c.model.inputs]
    outputs = outputs_of(cases)
    band = excited_band(cases[0].identification, [given])
    low, high = 0.3 * band[0], min(3.0 * band[-1], 0.97 * np.pi / min(c.model.dt_s for c in cases))
    truth = (
        "" if result.truth is None else " Uncoloured: the true aircraft, linearised about trim, without sensor lags."
    )
    caption = (
        f"Response of each output to {symbol(given)}.{truth} Coloured: the identified models, up to half the sample "
        "rate. Shaded: the band that the identification input excites (at least 1 % of its peak energy density). "
        "Outside that band a model extrapolates, whatever its curve looks like."
        f"{' Dotted: true modes.' if result.truth else ''}"
    )
    behind = [
        fig.Span(low=float(band[0]), high=float(band[-1])),
        *(fig.Rule(at=abs(p), dash=fig.DOTTED, width=0.7) for p in _modes(result).values() if low < abs(p) < high),
    ]
    omega = np.geomspace(low, high, 300)
    pairs = {
        f"{symbol(o)} / {symbol(given)}": (ratio_unit(o, given)[1], _responses(result, o, given, omega, band))
        for o in outputs
    }
    panels = [fig.bode(name, *pair, draws=behind, x_range=(low, high)) for name, pair in pairs.items()]
    views = [View(name=name, panels=panels[k]) for k, name in enumerate(pairs)]
    return fig.Plate(
        f"bode_{given}", f"Frequency responses to {symbol(given)}", caption, fig.Chart(panels, share_x=True), views
    )


def _responses(
    result: RunResult, output: str, given: str, omega: FloatArray, band: FloatArray
) -> list[tuple[FloatArray, FloatArray, FloatArray, Mapping[str, Any]]]:
    """Return frequency, magnitude, phase and look of the truth, if known, then of each model.

    Phases are on the same sheet at the centre of the excited band.
    """
    factor, names, known = ratio_unit(output, given)[0], case_names(result.cases), result.truth
    found: list[tuple[FloatArray, Any, dict[str, Any]]] = []
    if known is not None and output in known.linear.outputs and given in known.linear.inputs:
        H = known.response(omega, [output], [given], result.cases[0].model.dt_s)[:, 0, 0]
        found.append((omega, H, {"name": "true aircraft", "colour": fig.INK, "width": 2.2, "alpha": 0.85}))
    for k, case in enumerate(result.cases):
        if output in case.model.outputs and given in case.model.inputs:
            own = omega[omega <= 0.97 * np.pi / case.model.dt_s]
            H = case.model.frequency_response(own)[:, case.model.outputs.index(output), case.model.inputs.index(given)]
            found.append((own, H, {"name": names[k], **fig.line_look(k), "width": 1.4}))
    centre, goal = float(np.sqrt(band[0] * band[-1])), 0.0
    out: list[tuple[FloatArray, FloatArray, FloatArray, Mapping[str, Any]]] = []
    for k, (own, H, look) in enumerate(found):
        phase = fig.unwrapped(H)
        at = float(np.interp(centre, own, phase))
        phase = phase + 360.0 * np.round((goal - at) / 360.0)
        goal = float(np.interp(centre, own, phase)) if k == 0 else goal
        out.append((own, factor * np.abs(H), phase, look))
    return out


# --- pole maps --------------------------------------------------------------------------------------------------------


def pole_plates(result: RunResult) -> list[fig.Plate]:
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
    panels = [_pole_map("near the origin" if k else "", w, found, true, word) for k, w in enumerate(windows)]
    views = [View(name=p.title or "all", panels=[p], plane=True) for p in panels]
    chart = fig.Chart([panels], share=0.5 * len(windows))
    return [fig.Plate("poles", f"Poles found and {word}" if true else "Poles found", caption, chart, views)]


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


def _pole_map(title: str, reach: float, found: _Found, true: Mapping[str, complex], word: str) -> fig.Panel:
    inside = [p for _, group, _ in found for p in group if abs(p) <= reach]
    left, right = -reach, max([0.16 * reach, *(1.25 * p.real for p in inside)])
    draws: list[fig.Drawn] = [
        *_pole_grid(reach),
        fig.Rule(at=0.0, colour=fig.AXIS),
        fig.Rule(at=0.0, of="y", colour=fig.AXIS),
    ]
    shown = {name: pole for name, pole in true.items() if abs(pole) <= reach}
    looks: list[tuple[str, Sequence[complex], dict[str, Any]]] = [
        (name, [p for p in group if abs(p) <= reach], fig.marker_look(colour) | {"size": 8.0 - k % 3, "hollow": True})
        for k, (name, group, colour) in enumerate(found)
    ]
    if shown:
        looks.insert(0, (word, list(shown.values()), {"marker": "+", "size": 11.0, "order": 3.0}))
    for name, group, look in looks:
        points = np.array(sorted(group, key=lambda p: (p.real, p.imag)), complex)
        draws.append(fig.Curve(x=points.real, y=points.imag, name=name, clip=False, **look))
    taken = [*inside, *_damping_labels(reach)]
    box = ((left, right), (-0.03 * reach, reach))
    for name, pole in shown.items():
        if abs(pole) > 0.03 * reach:  # else named in the map of what lies near the origin
            draws.append(_name(name, pole, box, [*taken, *(p for p in shown.values() if p != pole)]))
    return fig.Panel(
        draws=draws, title=title, x="Re s, rad/s", y="Im s, rad/s", x_range=box[0], y_range=box[1], tall_in=3.2,
        plain=True,
    )  # fmt: skip


def _name(name: str, pole: complex, box: Any, others: Sequence[complex]) -> fig.Words:
    """Return the name of a mode beside its pole, where it covers fewest other poles; upright on the axis."""
    if abs(pole.imag) < 1e-9:  # real roots lie side by side
        return fig.Words(x=pole.real, y=0.0, text=name, shift=(0, 9), turn=90, across="center", up="bottom", size=8.5)
    (left, right), (bottom, top) = box
    wide, tall = (5.2 * len(name) + 14.0) * (right - left) / 230.0, 20.0 * (top - bottom) / 230.0

    def cost(side: tuple[int, int]) -> float:
        """Return how many poles the name covers on that side; a side outside the axes counts as ten or more."""
        x = sorted((pole.real, pole.real + side[0] * wide))
        y = sorted((pole.imag, pole.imag + side[1] * tall))
        covered = sum(x[0] <= p.real <= x[1] and y[0] <= p.imag <= y[1] for p in others)
        return covered + 10.0 * (x[0] < left or x[1] > right or y[0] < bottom or y[1] > top)

    across, up = min(((-1, 1), (1, 1), (-1, -1), (1, -1)), key=cost)
    return fig.Words(
        x=pole.real, y=pole.imag, text=name, shift=(9 * across, 6 * up), size=8.5,
        across="left" if across > 0 else "right", up="bottom" if up > 0 else "top",
    )  # fmt: skip


def _pole_grid(reach: float) -> list[fig.Drawn]:
    """Return faint circles of equal natural frequency and rays of equal damping ratio."""
    angle = np.linspace(0.5 * np.pi, np.pi, 60)
    step = 10.0 ** np.floor(np.log10(reach / 2.0))
    step *= max(k for k in (1.0, 2.0, 5.0) if k * step <= reach / 2.0 or k == 1.0)
    look: dict[str, Any] = {"colour": fig.FAINT, "width": 0.7, "order": 0.5}
    circles = np.arange(step, reach * 1.001, step)
    out: list[fig.Drawn] = [fig.Curve(x=w * np.cos(angle), y=w * np.sin(angle), **look) for w in circles]
    for zeta, place in zip(_RAYS, _damping_labels(reach), strict=True):
        end = 2.0 * reach * complex(-zeta, float(np.sqrt(1.0 - zeta**2)))
        out.append(fig.Curve(x=[0.0, end.real], y=[0.0, end.imag], **look))
        out.append(fig.Words(x=place.real, y=place.imag, text=f"ζ {zeta:g}", size=7.0, colour="#8b929a", up="top"))
    return out


def _damping_labels(reach: float) -> list[complex]:
    """Return where the damping ratio of each ray is written."""
    rays = [complex(-zeta, float(np.sqrt(1.0 - zeta**2))) for zeta in _RAYS]
    return [0.93 * reach / max(-ray.real, ray.imag) * ray for ray in rays]
