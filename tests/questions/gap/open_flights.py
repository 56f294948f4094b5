"""Flights with a hidden force or moment of any aircraft, whose sensors record all that forces are found from.

Hidden truths are made of raw JSBSim terms, and share no code with the vocabulary.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from studies.blind.truth import coefficient

from testbench.aircraft import Aircraft, Amendment, Increment
from testbench.core.constants import DEG_RAD
from testbench.core.record import FlightRecord
from testbench.flight import FlightCondition, Manoeuvre, fly, load_aircraft, trim
from testbench.inputs.signal import InputSignal
from testbench.questions.gap.believed import Believed
from testbench.sensors import Sensor, SensorSuite

_AXES = {"Cl": "ROLL", "Cm": "PITCH", "Cn": "YAW", "CL": "LIFT", "CD": "DRAG", "CY": "SIDE"}


@dataclass(frozen=True)
class Flown:
    """How an aircraft is flown: sizes of inputs (deg, share), time unit of a 3-2-1-1, rate and length of records."""

    V_m_s: float | None
    h_m: float | None
    de: float
    da: float
    dr: float
    thr: float
    unit_s: float
    rate_hz: float
    length_s: float
    noise: tuple[float, float, float, float] = (0.2, 0.25, 0.2, 0.2)  # V, angles (deg), rates (deg/s), accelerations


FLOWN = {
    "eolo": Flown(16.0, 547.0, 2.0, 3.0, 10.0, 0.15, 0.35, 100.0, 12.0),
    "taurus": Flown(13.0, 100.0, 2.0, 1.5, 3.0, 0.15, 0.35, 60.0, 12.0),
    "b1": Flown(200.0, 3000.0, 1.5, 3.0, 3.0, 0.2, 1.0, 50.0, 20.0, (0.5, 0.1, 0.05, 0.05)),
    "c172p": Flown(None, None, 2.0, 3.0, 4.0, 0.15, 0.6, 60.0, 15.0, (0.3, 0.2, 0.1, 0.1)),
    "f16": Flown(None, None, 0.8, 1.5, 2.0, 0.1, 0.5, 40.0, 12.0, (0.5, 0.1, 0.1, 0.1)),
}


@cache
def believe(name: str) -> Believed:
    """Return the believed aircraft with sensors of all axes."""
    how = FLOWN[name]
    V, angle, rate, acceleration = how.noise
    sensors = [Sensor("V", noise_std=V), Sensor("h", noise_std=0.5)]
    sensors += [Sensor(n, noise_std=angle * DEG_RAD) for n in ("alpha", "beta", "phi", "theta")]
    sensors += [Sensor(n, noise_std=rate * DEG_RAD) for n in "pqr"]
    sensors += [Sensor(n, noise_std=acceleration) for n in ("ax", "ay", "az")]
    sensors += [Sensor(f"{n}_cmd") for n in ("de", "da", "dr", "thr")]
    aircraft = load_aircraft(name, "rigid") if name == "eolo" else load_aircraft(name)
    at = FlightCondition(how.V_m_s or aircraft.design_V_m_s, aircraft.design_h_m if how.h_m is None else how.h_m)
    frames = np.ceil(aircraft.rate_hz / how.rate_hz - 0.01) * how.rate_hz
    return Believed(aircraft, SensorSuite("all axes", "all axes", how.rate_hz, tuple(sensors)), at, float(frames))


def lacking(believed: Believed, name: str, *terms: str) -> Aircraft:
    """Return an aircraft that has one term of a coefficient more than is believed, given as XML."""
    aircraft = believed.aircraft
    if aircraft.adapter is not None:
        return aircraft.amended(Amendment("hidden", "hidden", (Increment(name, "hidden", terms),)))
    arm = ("<property>metrics/bw-ft</property>",) if name in ("Cl", "Cn") else ()
    return aircraft.amended(Amendment("hidden", "hidden", (coefficient(_AXES[name], *arm, *terms),)))


def prop(believed: Believed, channel: str) -> str:
    """Return the XML of a channel's property."""
    return f"<property>{believed.aircraft.source_of(channel)[0]}</property>"


def _multistep(size: float, unit_s: float, start_s: float = 0.5):
    def at(t):
        edges = start_s + unit_s * np.cumsum([0, 3, 2, 1, 1])
        return sum(s * size * ((t >= a) & (t < b)) for s, a, b in zip((1, -1, 1, -1), edges, edges[1:], strict=False))

    return at


def _doublet(size: float, period_s: float, start_s: float = 0.5):
    return lambda t: (
        size
        * (
            ((t >= start_s) & (t < start_s + period_s / 2)).astype(float)
            - ((t >= start_s + period_s / 2) & (t < start_s + period_s))
        )
    )


def _step(size: float, start_s: float, end_s: float):
    return lambda t: size * ((t >= start_s) & (t < end_s))


def manoeuvres(name: str):
    """Return six manoeuvres: control -> function of time."""
    f, s = FLOWN[name], FLOWN[name].unit_s
    de, da, dr = (x * DEG_RAD for x in (f.de, f.da, f.dr))
    return [
        {"de": _multistep(de, s)},
        {"thr": _doublet(f.thr, 6.0)},
        {"da": _multistep(da, s), "dr": _doublet(dr, 3 * s, 4 * s + 4.0)},
        {"dr": _multistep(dr, 1.3 * s)},
        {"de": _doublet(-1.2 * de, 4 * s), "thr": _step(f.thr, 2.0, 8.0), "da": _doublet(da, 2 * s, 5.0)},
        {"de": _multistep(-de, 0.7 * s), "dr": _doublet(dr, 4 * s, 3.0), "thr": _step(-0.7 * f.thr, 3.0, 9.0)},
    ]


def truths(name: str, aircraft: Aircraft) -> list[FlightRecord]:
    """Fly every manoeuvre."""
    believed, how = believe(name), FLOWN[name]
    trimmed = trim(aircraft, believed.condition, believed.rate_hz)
    t = np.arange(round(how.length_s * how.rate_hz)) / how.rate_hz
    out = []
    for i, inputs in enumerate(manoeuvres(name)):
        u = np.column_stack([at(t) for at in inputs.values()])
        u = np.repeat(u, round(believed.rate_hz / how.rate_hz), axis=0)
        signal = InputSignal(np.arange(len(u)) / believed.rate_hz, u, tuple(inputs))
        out.append(fly(aircraft, trimmed, Manoeuvre(f"m{i}", signal, 2.0), how.rate_hz))
    return out


def measured(name: str, flown: list[FlightRecord], seed: int) -> dict[str, FlightRecord]:
    """Measure flights."""
    return {f"m{i}": believe(name).suite.measure(truth, 10 * seed + i) for i, truth in enumerate(flown)}
