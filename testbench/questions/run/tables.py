"""Tables of a run: what was flown, errors of prediction, parameters, excitation, poles, responses, polynomials."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.estimators.identification import estimator_name
from testbench.evaluation.modes import frequency_and_damping
from testbench.page.labels import axis_label, number, shown_unit, superscript, symbol
from testbench.page.tables import Column, Table, Value
from testbench.questions.run.labels import case_names, failed_table, outputs_of
from testbench.questions.run.seeds_answer import seeds_table

if TYPE_CHECKING:
    from testbench.evaluation.truth import Truth
    from testbench.questions.run.result import RunResult
    from testbench.sensors import Sensor, SensorSuite


_FARTHEST = 1.0  # as in the evaluation: a factor of e in frequency, or 57 deg in the s-plane
_MODES = {"phugoid", "short period", "dutch roll"}
_WN, _ZETA = re.compile(r"wn_(?:(.+)_)?rad_s"), re.compile(r"zeta(?:_(.+))?")
_HIDDEN = {"signal", "control", "amplitude_deg", "amplitude_percent"}


def result_tables(result: RunResult) -> list[Table]:
    """Return every table for which ``result`` has data, in the order of the report."""
    made = [
        seeds_table(result.repeats),
        mrse_table(result),
        fit_table(result),
        parameter_table(result),
        excitation_table(result),
        mode_table(result),
        bode_table(result),
        *reference_tables(result),
        pole_table(result),
        transfer_function_table(result),
        failed_table(result.failed),
    ]
    return [table for table in made if table is not None and table.rows]


def mrse_table(result: RunResult) -> Table:
    """Return the MRSE of every output and its mean, cases side by side, as in the EOLO paper's Tables 3 and 4."""
    return _score_table(
        result,
        "mrse",
        "MRSE",
        "Mean relative squared error (EOLO paper, equation 4): 100 % times the root of the error's energy over that of "
        "the measured output, in free run. 0 % is perfect, 100 % no better than predicting zero. Noise alone: what a "
        "perfect model would get, because the measured output is noisy. A dash: the suite does not sense that output. "
        "Means over different outputs cannot be compared.",
    )


def fit_table(result: RunResult) -> Table:
    """Return the fit in percent of every output, cases side by side; the Taurus paper's measure (Figures 5 to 8)."""
    return _score_table(
        result,
        "fit",
        "Fit",
        "Goodness of fit, 100 % times one minus the norm of the error over the norm of the measured output about its "
        "mean, in free run. 100 % is perfect, 0 % no better than the mean, negative is worse.",
    )


def _score_table(result: RunResult, kind: str, head: str, caption: str) -> Table:
    columns = [Column("output", "output")]
    names = case_names(result.cases)
    floor = _noise_floor(result) if kind == "mrse" else {}
    if floor:
        for use, short in (("identification", "id. set"), ("validation", "val. set")):
            columns.append(Column(f"noise alone {use}", short, "%", "noise alone", decimals=2))
    for name in names:
        for use, short in (("identification", "id. set"), ("validation", "val. set")):
            columns.append(Column(f"{name} {use}", short, "%", name, decimals=2))
    rows: list[tuple[Value, ...]] = []
    outputs = outputs_of(result.cases)
    for output in outputs:
        scores = (_score(case, use, kind, output) for case, use in _sets(result))
        rows.append((symbol(output), *(floor[output] if floor else ()), *scores))
    rows.append(
        ("mean", *((None, None) if floor else ()), *(_mean_score(case, use, kind) for case, use in _sets(result)))
    )
    return Table(kind, f"{head} per output", caption, tuple(columns), tuple(rows), total=True)


def validation_table(result: RunResult) -> Table:
    """Return the MRSE on the validation data, one row per case and one column per output, as a terminal shows it."""
    outputs = outputs_of(result.cases)
    columns = (Column("model", "model"), *(Column(o, symbol(o)) for o in outputs), Column("mean", "mean"))
    rows: list[tuple[Value, ...]] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        scores = (_score(case, "validation", "mrse", output) for output in outputs)
        rows.append((name, *scores, float(case.evaluation.validation.mrse_mean)))
    return Table("validation", "MRSE on the validation records, %", "", columns, tuple(rows))


def _noise_floor(result: RunResult) -> dict[str, tuple[float, float]]:
    """Return output -> MRSE of a perfect model on identification and validation data; empty where it is not known."""
    out = {}
    for case in result.cases:
        sets = (case.evaluation.identification.noise_percent, case.evaluation.validation.noise_percent)
        if sets[0] is not None and sets[1] is not None:
            for k, output in enumerate(case.model.outputs):
                out[output] = (float(sets[0][k]), float(sets[1][k]))
    return out


def _sets(result: RunResult) -> list[tuple[Any, str]]:
    return [(case, use) for case in result.cases for use in ("identification", "validation")]


def _score(case: Any, use: str, kind: str, output: str) -> float | None:
    if output not in case.model.outputs:
        return None
    values = getattr(getattr(case.evaluation, use), f"{kind}_percent")
    return float(values[case.model.outputs.index(output)])


def _mean_score(case: Any, use: str, kind: str) -> float:
    scores = getattr(case.evaluation, use)
    return scores.mrse_mean if kind == "mrse" else float(np.mean(scores.fit_percent))


def parameter_table(result: RunResult) -> Table | None:
    """Return the parameters of every model that has some, one row each; None without such a model."""
    known = any(p.true is not None for case in result.cases for p in case.evaluation.parameters)
    columns = [
        Column("model", "model"),
        Column("parameter", "parameter"),
        Column("estimate", "estimate", digits=4),
        Column("standard_error", "± std", digits=2),
        Column("standard_error_white", "± if white", digits=2),
    ]
    if known:
        columns += [Column("true", "true", digits=4), Column("error_in_std", "off by", "std", decimals=1)]
    rows: list[tuple[Value, ...]] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        for p in case.evaluation.parameters:
            if not p.free:
                continue
            rows.append((name, p.name, p.value, p.std, p.std_white, *((p.true, p.deviations) if known else ())))
    if not rows:
        return None
    caption = (
        "Standard errors are corrected for residuals that are correlated in time. The next column gives the errors "
        "for white residuals. Held parameters are in the model files. SI units and radians."
    )
    if known:
        caption += (
            " True: derivatives of the linearised aircraft at trim; its elastic modes follow statically unless the "
            "model has modes of its own. The values of a model that is too simple may be many standard errors off: "
            "standard errors measure scatter, not the form of a model."
        )
    return Table("parameters", "Estimated parameters", caption, tuple(columns), tuple(rows))


def excitation_table(result: RunResult) -> Table | None:
    """Return how the identification input excites every true mode, with the verdict; None without truth."""
    if result.truth is None or not result.truth.excitation:
        return None
    from testbench.evaluation.excitation import EXCITED_DB

    sensors = list(dict.fromkeys(s for e in result.truth.excitation for s in e.snr_db))

    def snr(sensor: str) -> Column:
        """Return what one sensor shows of each mode."""
        head, group = symbol(sensor), "response over noise"
        return Column(f"snr {sensor}", head, "dB", group, decimals=0,
                      get=lambda e: float(e.snr_db[sensor]) if sensor in e.snr_db else None)  # fmt: skip

    columns = (
        Column("mode", "mode"),
        Column("wn", "ωn", "rad/s", get=lambda e: abs(e.pole)),
        Column("f", "f", "Hz", get=lambda e: abs(e.pole) / (2 * np.pi)),
        Column("zeta", "ζ", "", digits=2, get=lambda e: -e.pole.real / abs(e.pole)),
        Column("input share", "input energy in its band", "%", digits=2, get=lambda e: 100.0 * e.input_share),
        *map(snr, sensors),
        Column("verdict", "verdict", get=lambda e: "excited" if e.excited else "NOT excited"),
    )
    caption = (
        f"A mode counts as excited when its response at the sensor that shows it best is {EXCITED_DB:g} dB or more "
        "above the noise, both inside the mode's half-power band. Computed from the true linear model, the input as "
        "flown and the noise of the suites."
    )
    return Table.of("excitation", "Does the input excite each mode?", caption, columns, result.truth.excitation)


def transfer_function_table(result: RunResult) -> Table:
    """Return numerator and denominator of every discrete model, output by input."""
    columns = (
        Column("model", "model"),
        Column("response", "response"),
        Column("numerator", "numerator"),
        Column("denominator", "denominator"),
    )
    rows: list[tuple[Value, ...]] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        for output, given, above, below in polynomials(case.model.to_dict()):
            rows.append((name, f"{symbol(output)} / {symbol(given)}", polynomial(above), polynomial(below)))
    caption = (
        "Discrete-time models in powers of the delay z⁻¹, at the sample time of the record; SI units and radians. All "
        "responses of a state-space model share one denominator. The model files hold all digits."
    )
    return Table("transfer_functions", "Identified transfer functions", caption, columns, tuple(rows), wide=True)


def polynomials(model: Mapping[str, Any]) -> list[tuple[str, str, list[float], list[float]]]:
    """Return (output, input, numerator, denominator) in powers 0, -1, ... of z, from a model's ``to_dict``.

    Discrete state-space models (A, B, C, D) and sets of transfer functions (numerators, denominators) are understood;
    of any other model nothing is returned.
    """
    out: list[tuple[str, str, list[float], list[float]]] = []
    if model.get("time") == "continuous":
        return out
    if {"A", "B", "C", "D"} <= set(model):
        from scipy.signal import ss2tf

        A, B, C, D = (np.asarray(model[k], float) for k in "ABCD")
        for j, given in enumerate(model["inputs"]):
            above, below = ss2tf(A, B, C, D, input=j)
            out += [
                (o, given, list(map(float, b)), list(map(float, below)))
                for o, b in zip(model["outputs"], above, strict=True)
            ]
    elif {"numerators", "denominators"} <= set(model):
        given = model["inputs"][0]
        for output in model["outputs"]:
            below = [float(a) for a in model["denominators"][output]]
            above = [float(b) for b in model["numerators"][output]]
            out.append((output, given, [0.0] * (len(below) - len(above)) + above, below))
    return out


def polynomial(coefficients: Sequence[float], digits: int = 5) -> str:
    """Return "0.12 z⁻¹ − 0.3 z⁻²" for coefficients of powers 0, -1, ...; terms 1e-12 below the largest are left out."""
    largest = max((abs(c) for c in coefficients), default=0.0)
    terms: list[str] = []
    for power, c in enumerate(coefficients):
        if abs(c) <= 1e-12 * largest:
            continue
        sign = ("− " if c < 0.0 else "+ ") if terms else ("−" if c < 0.0 else "")
        size = "" if abs(c) == 1.0 and power else f"{abs(c):.{digits}g}".replace("-", "−") + " "
        terms.append(sign + size + (f"z{superscript(-power)}" if power else ""))
    return " ".join(t.strip() for t in terms) or "0"


def bode_table(result: RunResult) -> Table | None:
    """Return the errors of every frequency response over the band that the input excites; None without truth."""
    if not any(case.evaluation.bode is not None for case in result.cases):
        return None
    columns = [Column("output", "output")]
    bands = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        columns += [
            Column(f"{name} magnitude", "magnitude", "dB", name, decimals=2),
            Column(f"{name} complex", "complex", "%", name, decimals=1),
        ]
        omega = case.evaluation.omega_rad_s
        if omega is not None and len(omega):
            bands.append(f"{name}: {number(float(omega[0]))} to {number(float(omega[-1]))} rad/s")
    rows: list[tuple[Value, ...]] = []
    for output in outputs_of(result.cases):
        row: list[Value] = [symbol(output)]
        for case in result.cases:
            bode = case.evaluation.bode
            known = bode is not None and output in case.model.outputs
            k = case.model.outputs.index(output) if known else 0
            row += [float(bode.magnitude_db[k]), float(bode.relative_percent[k])] if known and bode else [None, None]
        rows.append(tuple(row))
    caption = (
        "Root mean square over the band that the identification input excites. Magnitude: ratio of the magnitudes in "
        f"dB. Complex: complex error over the true magnitude, which counts phase too. {'; '.join(bands)}."
    )
    return Table("bode", "Frequency response against the true aircraft", caption, tuple(columns), tuple(rows))


# --- poles ------------------------------------------------------------------------------------------------------------


def _of_pole(pole: complex) -> tuple[Value, Value]:
    """Return |s| in rad/s and the damping ratio, which a real root alone has not."""
    wn, zeta = frequency_and_damping(pole)
    return wn, zeta if pole.imag else None


def mode_table(result: RunResult) -> Table | None:
    """Return frequency and damping of every true mode and of the pole found for it, cases side by side."""
    if not any(case.evaluation.poles for case in result.cases):
        return None
    names = case_names(result.cases)
    columns = [
        Column("mode", "mode"),
        Column("outputs", "from"),
        Column("true wn", "ωn", "rad/s", "true"),
        Column("true zeta", "ζ", "", "true", decimals=3),
    ]
    for name in names:
        columns += [
            Column(f"{name} wn", "ωn", "rad/s", name),
            Column(f"{name} zeta", "ζ", "", name, decimals=3),
            Column(f"{name} wn error", "Δωn", "%", name, decimals=1),
        ]
    found: dict[tuple[str, str], dict[int, Any]] = {}
    for k, case in enumerate(result.cases):
        for match in case.evaluation.poles:
            whole = len(match.outputs.split(", ")) == len(case.model.outputs)
            source = "all outputs" if whole else _symbols(match.outputs)
            found.setdefault((match.name, source), {})[k] = match
    rows: list[tuple[Value, ...]] = []
    for (mode, outputs), matches in sorted(found.items(), key=lambda item: abs(next(iter(item[1].values())).true)):
        row: list[Value] = [mode, outputs, *_of_pole(next(iter(matches.values())).true)]
        for k in range(len(names)):
            own = matches.get(k)
            if own is None or own.found is None:
                row += [None, None, None]
            else:
                row += [*_of_pole(own.found), own.wn_error_percent]
        rows.append(tuple(row))
    known = {row[0] for row in rows if any(v is not None for v in row[4:])}
    empty = {row[0]: row for row in reversed(rows) if row[0] not in known}  # one row for a mode that nothing found
    rows = [row for row in rows if any(v is not None for v in row[4:]) or empty.get(row[0]) is row]
    if all(row[1] == "all outputs" for row in rows):
        columns, rows = [columns[0], *columns[2:]], [(row[0], *row[2:]) for row in rows]
    caption = (
        "Each true mode and the pole of each model that stands for it. A dash: no pole lies near (within a factor of e "
        "in frequency or 57 deg of angle in the s-plane)."
    )
    return Table("modes", "Modes found and true", caption, tuple(columns), tuple(rows))


def _symbols(outputs: str) -> str:
    return ", ".join(symbol(name) for name in outputs.split(", ") if name)


def pole_table(result: RunResult) -> Table:
    """Return every continuous-time pole of every model, conjugates once, slowest first."""
    columns = (
        Column("model", "model"),
        Column("outputs", "from"),
        Column("real", "Re s", "rad/s", digits=4),
        Column("imaginary", "Im s", "rad/s", digits=4),
        Column("wn", "ωn", "rad/s"),
        Column("zeta", "ζ", "", decimals=3),
        Column("f", "f", "Hz"),
    )
    rows: list[tuple[Value, ...]] = []
    for name, case in zip(case_names(result.cases), result.cases, strict=True):
        for outputs, poles in case.model.poles().items():
            for pole in sorted((complex(p) for p in poles if p.imag >= -1e-12), key=abs):
                f = abs(pole) / (2.0 * math.pi)
                rows.append((name, _symbols(outputs), pole.real, abs(pole.imag), *_of_pole(pole), f))
    caption = (
        "Continuous-time poles, ln(z) over the sample time, in rad/s; Im s stands for both poles of a pair. A positive "
        "Re s is unstable."
    )
    return Table("poles", "Every pole of every model", caption, columns, tuple(rows))


def reference_tables(result: RunResult) -> list[Table]:
    """Return the printed frequencies and dampings of a recorded flight beside those found, and other printed values."""
    values = {k: v for k, v in result.reference.items() if isinstance(v, (int, float)) and not isinstance(v, bool)}
    source = str(result.reference.get("source", ""))
    modes = _printed_modes(values)
    rest = [k for k in values if not _WN.fullmatch(k) and not _ZETA.fullmatch(k)]
    out = []
    if modes:
        out.append(_reference_table(result, modes, source))
    if rest:
        out.append(_printed_values({k: float(values[k]) for k in rest}, result, source))
    return out


def _printed_values(values: Mapping[str, float], result: RunResult, source: str) -> Table:
    """Return printed values that are no modes, with what each model that has them as parameters found."""
    columns = [Column("quantity", "quantity"), Column("printed", "printed", digits=4)]
    rows: list[tuple[Value, ...]] = [(name, value) for name, value in values.items()]
    for model, case in zip(case_names(result.cases), result.cases, strict=True):
        found = {p.name: p for p in case.evaluation.parameters if p.free and p.name in values}
        if found:
            columns += [
                Column(f"{model} estimate", "estimate", "", model, digits=4),
                Column(f"{model} std", "± std", "", model, digits=2),
            ]
            own = {name: (p.value, p.std) for name, p in found.items()}
            rows = [(*row, *own.get(str(row[0]), (None, None))) for row in rows]
    none = "" if len(columns) > 2 else "; these estimators give poles and responses, not derivatives"
    caption = f"{source}. SI units and radians{none}."
    return Table("printed_values", "Other printed values", caption, tuple(columns), tuple(rows))


def printed_poles(result: RunResult) -> dict[str, complex]:
    """Return mode -> pole, rad/s, of every printed frequency that comes with a damping ratio between 0 and 1."""
    values = {k: v for k, v in result.reference.items() if isinstance(v, (int, float))}
    return {
        name: complex(-zeta * wn, wn * math.sqrt(1.0 - zeta**2))
        for name, (wn, zeta) in _printed_modes(values).items()
        if zeta is not None and 0.0 <= zeta <= 1.0
    }


def _printed_modes(values: Mapping[str, Any]) -> dict[str, tuple[float, float | None]]:
    """Return mode -> (wn, zeta) of "wn_rad_s" and "zeta" (the short period), "wn_NAME_rad_s" and "zeta_NAME"."""
    out = {}
    for key, value in values.items():
        match = _WN.fullmatch(key)
        if match is not None:
            suffix = match[1] or ""
            zeta = values.get(f"zeta_{suffix}" if suffix else "zeta")
            words = suffix.replace("_", " ")
            name = words if words in _MODES else f"short period ({words})" if words else "short period"
            out[name] = (float(value), None if zeta is None else float(zeta))
    return out


def _reference_table(result: RunResult, modes: Mapping[str, tuple[float, float | None]], source: str) -> Table:
    columns = (
        Column("printed", "printed"),
        Column("printed wn", "ωn", "rad/s", "printed value"),
        Column("printed zeta", "ζ", "", "printed value", decimals=3),
        Column("model", "estimator"),
        Column("outputs", "from"),
        Column("wn", "ωn", "rad/s", "found"),
        Column("zeta", "ζ", "", "found", decimals=3),
        Column("wn difference", "Δωn", "%", "found", decimals=1),
        Column("zeta difference", "Δζ", "", "found", decimals=3),
    )
    rows: list[tuple[Value, ...]] = []
    for mode, (wn, zeta) in modes.items():
        for name, case in zip(_estimators(result), result.cases, strict=True):
            for outputs, poles in case.model.poles().items():
                pole = _nearest([complex(p) for p in poles], wn, zeta)
                found: list[Value] = [None] * 4
                if pole is not None:
                    own_wn, own_zeta = frequency_and_damping(pole)
                    found = [own_wn, own_zeta, 100.0 * (own_wn / wn - 1.0), None if zeta is None else own_zeta - zeta]
                rows.append((mode, wn, zeta, name, _symbols(outputs), *found))
    caption = f"Printed: {source}. Found: the oscillatory pole nearest to the printed one. A dash: none lies near."
    return Table("reference", "Found and printed", caption, columns, tuple(rows))


def _estimators(result: RunResult) -> list[str]:
    """Return what to call each case by its estimator; the suite too where there are several."""
    names = case_names(result.cases)
    one = len({c.suite for c in result.cases}) == 1 and len({estimator_name(c.estimator) for c in result.cases}) == 1
    return [estimator_name(c.estimator) for c in result.cases] if one and len(names) == 1 else names


def _nearest(poles: list[complex], wn: float, zeta: float | None) -> complex | None:
    """Return the oscillatory pole nearest to frequency and damping, by |ln(s / s_printed)| <= 1, or None."""
    angle = None if zeta is None else math.acos(min(1.0, max(-1.0, -zeta)))

    def distance(pole: complex) -> float:
        """Return |ln(s / s_printed)|, by frequency alone if no damping was printed."""
        turned = 0.0 if angle is None else math.atan2(pole.imag, pole.real) - angle
        return math.hypot(math.log(abs(pole) / wn), turned)

    near = [p for p in poles if p.imag > 1e-9 and distance(p) <= _FARTHEST]
    return min(near, key=distance) if near else None


# --- what was flown ---------------------------------------------------------------------------------------------------


def flown_tables(result: RunResult) -> list[Table]:
    """Return aircraft and trim, manoeuvres and sensors of a simulated run; the records of a recorded one."""
    out = [] if result.truth is None else [condition_table(result.truth)]
    out.append(manoeuvre_table(result))
    return [*out, sensor_table(result.suites)] if result.suites else out


def condition_table(truth: Truth) -> Table:
    """Return the aircraft and the equilibrium that every manoeuvre starts from."""
    aircraft, trimmed = truth.aircraft, truth.trimmed
    rows: list[tuple[Value, ...]] = [
        ("mass", aircraft.mass.mass_kg, "kg"),
        ("Iyy", aircraft.mass.Iyy, "kg m²"),
        ("wing area S", aircraft.geometry.S_m2, "m²"),
        ("span b", aircraft.geometry.b_m, "m"),
        ("mean chord c̄", aircraft.geometry.cbar_m, "m"),
        ("true airspeed V", trimmed.condition.V_m_s, "m/s"),
        ("altitude h", trimmed.condition.h_m, "m"),
        ("flight-path angle γ", trimmed.condition.gamma_rad / DEG_RAD, "deg"),
        ("dynamic pressure q̄", trimmed.condition.qbar_Pa, "Pa"),
        ("trim α", trimmed.alpha / DEG_RAD, "deg"),
        ("trim θ", trimmed.theta / DEG_RAD, "deg"),
    ]
    for name, value in trimmed.controls.items():
        factor, unit = shown_unit(name)
        if name in {"de", "thr"} or abs(value) > 1e-9:
            rows.append((f"trim {symbol(name)}", factor * value, unit))
    rows.append(("largest acceleration left at trim", float(np.max(np.abs(trimmed.residual))), "m/s² or rad/s²"))
    rows.append(("simulation rate", trimmed.rate_hz, "Hz"))
    columns = (Column("quantity", "quantity"), Column("value", "value", digits=4, given=True), Column("unit", "unit"))
    return Table("condition", "Aircraft and trim", f"{aircraft.title}.", columns, tuple(rows))


def manoeuvre_table(result: RunResult) -> Table:
    """Return what each record is: its use, length and rate, and the inputs where they are known."""
    specs = {m.name: m for m in getattr(result.source, "manoeuvre", ())}
    columns = (
        Column("name", "name"),
        Column("use", "use"),
        Column("duration", "length", "s", digits=4, given=True),
        Column("rate", "log rate", "Hz", digits=4, given=True),
        Column("samples", "samples"),
        Column("inputs", "inputs"),
    )
    rows: list[tuple[Value, ...]] = []
    for flight in result.flights:
        record = next(iter(flight.measured.values()))
        spec = specs.get(flight.name)
        inputs = "; ".join(_input_text(i) for i in spec.input) if spec else "recorded"
        rows.append((flight.name, flight.use, record.duration_s, 1.0 / record.dt_s, len(record), inputs))
    settling = next((f.trim_s for f in result.flights if f.trim_s > 0.0), 0.0)
    caption = (
        f"Every record begins with {settling:g} s of undisturbed flight." if settling else "Records as they were taken."
    )
    title = "Manoeuvres" if specs else "Records"
    return Table("manoeuvres", title, caption, columns, tuple(rows))


def _input_text(spec: Any) -> str:
    """Return "3211 on δe, 2 deg, step 0.6 s, start 0 s" for an input of a scenario."""
    size, unit = (spec.amplitude_deg, "deg") if spec.amplitude_deg is not None else (spec.amplitude_percent, "%")
    parts = [f"{spec.signal} on {symbol(spec.control)}", f"{size:g} {unit}"]
    for key, value in spec.model_dump(exclude_none=True).items():
        if key in _HIDDEN or value == type(spec).model_fields[key].default:
            continue
        name, _, end = key.rpartition("_")
        shown = f"{value:g}" if isinstance(value, float) else str(value)
        parts.append(
            f"{name.replace('_', ' ')} {shown} {end.capitalize() if end == 'hz' else end}"
            if end in {"s", "hz"}
            else f"{key} {shown}"
        )
    return ", ".join(parts)


def sensor_table(suites: Sequence[SensorSuite]) -> Table:
    """Return the sensors of all suites in shown units, each once, with the real part and the source of its figures."""
    columns = (
        Column("channel", "channel"),
        Column("suites", "in suite"),
        Column("noise std", "noise (1σ)", digits=4, given=True),
        Column("bias", "bias", digits=4, given=True),
        Column("quantum", "quantum", digits=4, given=True),
        Column("lag", "lag", "s", digits=4, given=True),
        Column("delay", "delay", "s", digits=4, given=True),
        Column("rate", "rate", "Hz", digits=4, given=True),
        Column("part", "part"),
        Column("source", "source of the figures"),
    )
    found: dict[tuple[Sensor, float], list[str]] = {}
    for suite in suites:
        for sensor in suite.sensors:
            found.setdefault((sensor, sensor.rate_hz or suite.rate_hz), []).append(suite.name)
    rows: list[tuple[Value, ...]] = []
    for (s, rate_hz), names in found.items():
        factor = shown_unit(s.channel)[0]
        figures = [factor * s.noise_std, factor * s.bias, factor * s.quantum, s.lag_s, s.delay_s]
        where = "all" if len(names) == len(suites) > 1 else ", ".join(names)
        rows.append((axis_label(s.channel), where, *figures, rate_hz, s.part, s.source))
    caption = " ".join(f"{suite.name}: {suite.title}." for suite in suites)
    return Table(
        "sensors", "Sensors", f"{caption} Values are in the unit of the channel.", columns, tuple(rows), wide=True
    )
