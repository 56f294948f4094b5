"""Fly a hidden truth through manoeuvres and measure it: records that do not say what was hidden.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import Aircraft, Amendment, ScaleCoefficient, SetProperty
from testbench.aircraft.amend import Change
from testbench.aircraft.seams import added_load, with_servo
from testbench.core.record import FlightRecord, FloatArray
from testbench.flight import FlightCondition, TrimmedFlight, load_aircraft, trim
from testbench.flight.air import Air
from testbench.inputs.signal import InputSignal
from testbench.line import fly_and_measure
from testbench.questions.gap.hidden.mass import with_moved_accelerometers
from testbench.questions.gap.hidden.truth import Truth
from testbench.sensors import SensorSuite

_LAG = "fcs/elevator-lag-rad_sec"  # of the packaged aircraft


_Start = tuple[FlightCondition, float, float, float | None]


@dataclass(frozen=True, eq=False)
class Commands:
    """One manoeuvre, as the on-board computer issues it.

    Attributes:
        name: of the manoeuvre.
        controls: "de", "thr", ...
        u: (n, controls) deviations from trim at the rate of the log, each held to the next.
        settle_s: flight at trim before the first one.
        seed: of the sensors' noise.
        air: that it flies through; still air if None.
        condition: that it starts from; that of all if None.
        load_kg, load_aft_m: known load in this flight alone, and its place on the centre line.
        at_s: time after take-off; None where that does not matter.
    """

    name: str
    controls: tuple[str, ...]
    u: FloatArray
    settle_s: float
    seed: int
    air: Air | None = None
    condition: FlightCondition | None = None
    load_kg: float = 0.0
    load_aft_m: float = 0.0
    at_s: float | None = None


def fly_hidden(
    aircraft: str,
    wings: str,
    truth: Truth,
    suite: SensorSuite,
    condition: FlightCondition,
    flights: Iterable[Commands],
    rate_hz: float | None = None,
    as_issued: bool = True,
    progress: Callable[[str], None] | None = None,
) -> dict[str, FlightRecord]:
    """Fly a truth through manoeuvres; return name -> measured record, provenance left out.

    Args:
        aircraft: that is believed, by name.
        wings: as believed, "rigid" or "flexible".
        truth: what really flies.
        suite: as believed.
        condition: that all manoeuvres start from.
        flights: the manoeuvres.
        rate_hz: frames a second; the aircraft's own if not given.
        as_issued: record commands as they were issued. Otherwise they are recorded as they reached the servos.
        progress: called with a few words as each manoeuvre begins.

    Raises:
        TrimError, FlightAborted, LimitError: this truth cannot fly the manoeuvres.
    """
    base = load_aircraft(aircraft, "flexible" if truth.flexible else wings)
    starts: dict[_Start, tuple[Aircraft, SensorSuite, TrimmedFlight]] = {}
    out = {}
    for commands in flights:
        if progress:
            progress(f"fly {commands.name}")
        start = (commands.condition or condition, commands.load_kg, commands.load_aft_m, commands.at_s)
        there = truth if truth.later is None else truth.with_(truth.later(commands.at_s or 0.0))
        if start not in starts:
            starts[start] = _ready(base, there, suite, start, rate_hz)
        real, sensors, trimmed = starts[start]
        rate = trimmed.rate_hz
        u = np.repeat(commands.u, round(rate / suite.rate_hz), axis=0)
        signal = InputSignal(np.arange(len(u)) / rate, sent(there, u, commands.controls, 1.0 / rate), commands.controls)
        flight = fly_and_measure(
            real,
            trimmed,
            commands.name,
            signal,
            log_rate_hz=suite.rate_hz,
            settle_s=commands.settle_s,
            suites=[sensors],
            seed=commands.seed,
            air=commands.air,
        )
        measured = replace(flight.measured[sensors.name], provenance={"manoeuvre": commands.name})
        if as_issued:
            measured = as_issued_in(measured, u, commands.controls, trimmed, commands.settle_s)
        out[commands.name] = measured if truth.spoil is None else spoiled(measured, truth)
    return out


def _ready(
    base: Aircraft,
    truth: Truth,
    suite: SensorSuite,
    start: _Start,
    rate_hz: float | None,
) -> tuple[Aircraft, SensorSuite, TrimmedFlight]:
    """Return what flies from a condition with a load, what reads it, and its trim."""
    condition, kg, aft_m, _ = start
    if kg:
        ahead = kg / (base.mass.mass_kg + truth.extra_kg + kg) * aft_m  # places are told from the centre of gravity
        suite = read_through(suite, with_moved_accelerometers(Truth(), ahead))
        truth = truth.with_(Truth(changes=added_load(base, kg, aft_m), extra_kg=kg))
    real = real_aircraft(base, truth)
    return real, read_through(suite, truth), trim(real, condition, rate_hz or real.rate_hz)


def read_through(suite: SensorSuite, truth: Truth) -> SensorSuite:
    """Return the sensors as they really read."""
    return suite if truth.read is None else replace(suite, sensors=tuple(truth.read(s) for s in suite.sensors))


def _lags(changes: Sequence[Change]) -> list[SetProperty]:
    """Return the changes of the corner frequency of the elevator's servo."""
    return [c for c in changes if isinstance(c, SetProperty) and c.name == _LAG]


def real_aircraft(believed: Aircraft, truth: Truth) -> Aircraft:
    """Return what flies in place of a believed aircraft."""
    changes: list[Change] = [*truth.changes, *(ScaleCoefficient(n, f) for n, f in truth.factors.items())]
    if truth.whole_servo:
        changes.append(SetProperty(_LAG, 1e5))  # its slew limit stays
    base = believed
    for change in _lags(changes) if believed.adapter is not None else []:
        # a foreign model has no servo of that name: it gets one, or another corner frequency
        base, more = with_servo(base, "de", change.value)
        changes = [*(c for c in changes if c is not change), *more]
    real = base.amended(Amendment("hidden", "hidden", tuple(changes))) if changes else base
    return replace(real, mass=replace(real.mass, mass_kg=real.mass.mass_kg + truth.extra_kg))


def sent(truth: Truth, u: FloatArray, controls: Sequence[str], dt_s: float) -> FloatArray:
    """Return what reaches the servos of the commands ``u`` (frames, m)."""
    out = u.copy()
    for control, law in (("de", truth.elevator), ("thr", truth.throttle), *truth.surfaces.items()):
        if law is not None and control in controls:
            column = list(controls).index(control)
            out[:, column] = law(u[:, column], dt_s)
    return out


def as_issued_in(
    record: FlightRecord, u: FloatArray, controls: Sequence[str], trimmed: TrimmedFlight, settle_s: float
) -> FlightRecord:
    """Return the record with the commands as they were issued, not as they reached the servos."""
    data = record.data.copy()
    frames = round(settle_s * trimmed.rate_hz)
    issued = np.concatenate([np.zeros((frames, u.shape[1])), u, u[-1:]])[:: round(trimmed.rate_hz * record.dt_s)]
    for i, name in enumerate(controls):
        if f"{name}_cmd" not in record:
            continue  # of a suite that reads surfaces only
        data[:, record.channels.index(f"{name}_cmd")] = trimmed.controls[name] + issued[: len(record), i]
    for name in ("de", "dr"):
        if name not in controls and f"{name}_cmd" in record:  # a feedback moves it all the same
            data[:, record.channels.index(f"{name}_cmd")] = trimmed.controls[name]
    return replace(record, data=data)


def spoiled(record: FlightRecord, truth: Truth) -> FlightRecord:
    """Return the record with readings spoiled after the sensors."""
    data = record.data.copy()
    for i, name in enumerate(record.channels):
        if truth.spoil is not None:
            data[:, i] = truth.spoil(name, data[:, i], record.t_s)
    return replace(record, data=data)
