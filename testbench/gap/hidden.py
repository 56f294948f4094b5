"""Measured records with a hidden truth, to test the workflow with: what flies here is not told to what names it.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from testbench.aircraft import Aircraft, Amendment, SetProperty, SetText, load_aircraft
from testbench.flight import FlightCondition, Manoeuvre, fly, trim
from testbench.inputs import build
from testbench.inputs.signal import InputSignal
from testbench.record import FlightRecord
from testbench.scenario import Manoeuvre as ManoeuvreSpec
from testbench.schema import Positive, Strict
from testbench.sensors import SensorSuite


class FlexibleWings(Strict):
    """The aircraft flies with all its elastic modes."""

    kind: Literal["flexible_wings"]


class SlowServo(Strict):
    """The elevator servo lags with the given corner frequency."""

    kind: Literal["slow_servo"]
    corner_rad_s: Positive


class HighThrust(Strict):
    """The thruster sits above the centre of gravity."""

    kind: Literal["high_thrust"]
    offset_m: float


class VaneGain(Strict):
    """The alpha vane reads ``gain`` times the truth."""

    kind: Literal["vane_gain"]
    gain: Positive


class Nothing(Strict):
    """The believed model is right."""

    kind: Literal["nothing"]


Hidden = Annotated[FlexibleWings | SlowServo | HighThrust | VaneGain | Nothing, Field(discriminator="kind")]


def measure_hidden(
    aircraft: str,
    wings: str,
    hidden: Hidden,
    suite: SensorSuite,
    condition: FlightCondition,
    manoeuvres: Sequence[ManoeuvreSpec],
    seed: int,
    rate_hz: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Mapping[str, FlightRecord]:
    """Fly the aircraft with its hidden truth and return name -> measured record; provenance is left out.

    Commands are issued at the rate of the suite's log and held, as an on-board computer does.

    Raises:
        TrimError, FlightAborted, LimitError: the hidden aircraft cannot fly these manoeuvres.
    """
    real, sensors = _real(load_aircraft(aircraft, wings), hidden, suite, aircraft)
    rate = rate_hz or real.rate_hz
    trimmed = trim(real, condition, rate)
    out = {}
    for i, spec in enumerate(manoeuvres):
        if progress:
            progress(f"fly {spec.name}")
        coarse = build(spec.input, spec.duration_s, suite.rate_hz)
        u = np.repeat(coarse.u, round(rate / suite.rate_hz), axis=0)
        signal = InputSignal(np.arange(u.shape[0]) / rate, u, coarse.channels)
        truth = fly(real, trimmed, Manoeuvre(spec.name, signal, spec.settle_s), suite.rate_hz)
        out[spec.name] = replace(sensors.measure(truth, seed + i), provenance={"manoeuvre": spec.name})
    return out


def _real(believed: Aircraft, hidden: Hidden, suite: SensorSuite, name: str) -> tuple[Aircraft, SensorSuite]:
    if isinstance(hidden, FlexibleWings):
        return load_aircraft(name, "flexible"), suite
    if isinstance(hidden, SlowServo):
        change = SetProperty("fcs/elevator-lag-rad_sec", hidden.corner_rad_s)
        return believed.amended(Amendment("hidden", "hidden", (change,))), suite
    if isinstance(hidden, HighThrust):
        change_z = SetText("propulsion/engine/thruster/location/z", hidden.offset_m)
        return believed.amended(Amendment("hidden", "hidden", (change_z,))), suite
    if isinstance(hidden, VaneGain):
        sensors = [replace(s, scale=hidden.gain) if s.channel == "alpha" else s for s in suite.sensors]
        return believed, replace(suite, sensors=tuple(sensors))
    return believed, suite
