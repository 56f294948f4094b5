"""The laws of aircraft, packaged or brought, tried in a few seconds of flight in JSBSim."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, PERCENT
from testbench.core.contract import Law
from testbench.core.errors import Refusal
from testbench.core.record import FlightRecord
from testbench.flight import FlightCondition, TrimmedFlight, linearise, trim
from testbench.flight.batch.jobs import Job
from testbench.flight.load import DEPARTED
from testbench.flight.simulate import Manoeuvre
from testbench.inputs import InputSignal
from testbench.line import fly_and_measure

Made = TypeVar("Made")

_SECONDS = 2.0
_RATE_HZ = 50.0
_SURFACE_RAD, _THROTTLE = 1.0 * DEG_RAD, 5.0 * PERCENT  # small steps
# Control -> what a positive step of it moves first, and in which direction; see the sign conventions of the channels.
_MOVES = {"de": ("q", -1.0), "da": ("p", 1.0), "dr": ("r", -1.0), "thr": ("V", 1.0)}


def aircraft_laws(aircraft: Aircraft) -> list[Law]:
    """Return every law of aircraft and whether this one keeps it; a law that cannot be tried is broken."""
    laws = [Law("has a title", bool(aircraft.title), "give title in aircraft.toml")]
    condition = FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m)
    trimmed, why = _tried(lambda: trim(aircraft, condition))
    laws.append(Law(f"trims at its design condition, {condition}", trimmed is not None, why))
    if trimmed is None:
        return laws
    linear, why = _tried(lambda: linearise(aircraft, trimmed))
    laws.append(Law("can be linearised there", linear is not None and bool(np.isfinite(linear.A).all()), why))
    still, why = _tried(lambda: _flight(aircraft, trimmed))
    law = f"stays at its trim for {_SECONDS:g} s when nothing moves"
    laws.append(Law(law, still is not None and _rests(still), why or "it departs"))
    if still is None:
        return laws
    for control in aircraft.controls:
        laws.append(_answer(aircraft, trimmed, control, still))
    again = _flight(aircraft, trimmed)
    laws.append(Law("flies the same bytes twice", again.data.tobytes() == still.data.tobytes(), "two flights differ"))
    return laws


def _tried(action: Callable[[], Made]) -> tuple[Made | None, str]:
    try:
        return action(), ""
    except Refusal as error:
        return None, error.message


def _flight(aircraft: Aircraft, trimmed: TrimmedFlight, control: str | None = None) -> FlightRecord:
    """Return a flight of two seconds from trim, with a small step of one control or of none."""
    n = round(_SECONDS * trimmed.rate_hz)
    u = np.full((n, 1), 0.0 if control is None else _THROTTLE if control == "thr" else _SURFACE_RAD)
    signal = InputSignal(np.arange(n) / trimmed.rate_hz, u, (control or next(iter(aircraft.controls)),))
    log = trimmed.rate_hz / max(1, int(trimmed.rate_hz // _RATE_HZ))
    return fly_and_measure(Job(aircraft, trimmed, Manoeuvre(control or "nothing", signal, 0.0), log)).flown


def _rests(still: FlightRecord) -> bool:
    return all(np.abs(still[name] - still[name][0]).max() < most for name, most in DEPARTED.items())


def _answer(aircraft: Aircraft, trimmed: TrimmedFlight, control: str, still: FlightRecord) -> Law:
    channel, sign = _MOVES[control]
    law = f"a positive step of {control} makes {channel} {'rise' if sign > 0.0 else 'fall'} first"
    stepped, why = _tried(lambda: _flight(aircraft, trimmed, control))
    if stepped is None:
        return Law(law, False, why)
    change = stepped[channel] - still[channel]
    largest = float(np.abs(change).max())
    if largest < 1e-9:
        return Law(law, False, f"{channel} does not move")
    first = float(change[np.argmax(np.abs(change) > 0.2 * largest)])
    return Law(law, sign * first > 0.0, f"it {'falls' if sign > 0.0 else 'rises'}: check the sign of {control}")
