"""Tables of what was flown: aircraft and trim, manoeuvres, sensors with their noise figures and sources."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.page.labels import axis_label, shown_unit, symbol
from testbench.page.tables import Column, Table, Value

if TYPE_CHECKING:
    from testbench.evaluation.truth import Truth
    from testbench.questions.run.result import RunResult
    from testbench.sensors import Sensor, SensorSuite

_HIDDEN = {"signal", "control", "amplitude_deg", "amplitude_percent"}


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
