"""Flights of aileron, rudder, elevator and throttle together that several files here share, of the rigid taurus."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from testbench.core.record import FlightRecord
from testbench.flight import FlightCondition, load_aircraft
from testbench.questions.gap.believed import Believed
from testbench.sensors import load_suite

RATE_HZ = 50.0
CONDITION = FlightCondition(15.0, 100.0)


@cache
def believe(aircraft: str = "taurus") -> Believed:
    """Return the rigid aircraft with wide limits and sensors of all axes at 50 Hz."""
    plane = load_aircraft(aircraft, "rigid")
    wide = {"V": (7.0, 400.0), "alpha": (-0.4, 0.5), "beta": (-0.7, 0.7), "theta": (-1.2, 1.2), "phi": (-1.5, 1.5)}
    plane = replace(plane, limits={**plane.limits, **wide})
    return Believed(plane, replace(load_suite("eolo_gap_lateral"), rate_hz=RATE_HZ), CONDITION, 100.0)


def commands(seconds: float = 8.0) -> tuple[FlightRecord, ...]:
    """Return records that hold commands only: rudder, aileron, and pull-up with throttle beside a short aileron."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ

    def doublet(at: float, half: float, size: float) -> np.ndarray:
        return size * ((t > at) & (t < at + half)) - size * ((t >= at + half) & (t < at + 2.0 * half))

    none = np.zeros_like(t)
    rudder = doublet(1.0, 0.5, 0.05) + doublet(4.0, 0.5, 0.02)
    aileron = doublet(1.0, 0.4, 0.06) + doublet(4.0, 0.4, 0.02)
    pull, throttle = doublet(2.0, 0.5, -0.04), 0.15 * ((t > 4.0) & (t < 6.5))
    made = ((none, none, rudder, none), (none, aileron, none, none), (pull, doublet(1.0, 0.3, 0.02), none, throttle))
    channels = ("de_cmd", "da_cmd", "dr_cmd", "thr_cmd")
    return tuple(FlightRecord(t_s=t, channels=channels, data=np.column_stack(u), kind="measured") for u in made)
