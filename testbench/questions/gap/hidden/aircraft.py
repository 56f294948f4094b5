"""What hidden truths must know of the packaged aircraft that they are made for.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from functools import cache

from testbench.flight import load_aircraft

RATE_HZ = 100.0  # frames a second of truths that count them
SPEEDS_M_S = {"eolo": 16.0, "taurus": 15.0}
SERVO_LAG = {"eolo": 50.0, "taurus": 33.0}  # corner of the elevator servo, rad/s
ELEVATOR_FULL = {"eolo": 0.4363323, "taurus": 0.2181662}  # rad


@cache
def number_of(aircraft: str, name: str) -> float:
    """Return a coefficient of an aircraft, its mass "mass_kg" or its chord "cbar_m"."""
    model = load_aircraft(aircraft, "rigid")
    if name == "mass_kg":
        return model.mass.mass_kg
    return model.geometry.cbar_m if name == "cbar_m" else model.coefficient(name)
