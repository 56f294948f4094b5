"""What empties during a flight: one parameter over all records, whose times after take-off are known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import scaled_mass
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.payload import with_load
from testbench.effects.thrust_scale import scaled
from testbench.sensors import SensorSuite

_AMENDED_S = 600.0  # time after take-off of an aircraft that is amended without a record
_EVEN_S = 600.0  # after take-off, when as much is gone as at the mean rate, whatever the power
_LEAST = 0.05  # of what there was, which is left at any time


def left(values: Values, at_s: float) -> float:
    """Return the share that is left so many s after take-off.

    Where a "power" is given, the rate is the mean one of the first ten minutes, and what is gone grows as that power of
    time.
    """
    even = at_s / _EVEN_S
    gone = values["per_min"] * _EVEN_S / 60.0 * math.copysign(abs(even) ** values.get("power", 1.0), even)
    return max(1.0 - gone, _LEAST)


def faded(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Multiply the thrust by what is left of it."""
    return scaled(aircraft, left(values, at_s), "thrust_fade", f" {at_s:.4g} s after take-off"), suite


def burnt(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Multiply the mass by what is left of it; the moments of inertia stay, as for a tank at the centre of gravity."""
    factor = left(values, at_s)
    changes, mass = scaled_mass(aircraft, {"mass_kg": factor})
    text = f"mass {factor:.4g} times the believed one {at_s:.4g} s after take-off"
    return replace(aircraft.amended(Amendment("fuel_burn", text, changes)), mass=mass), suite


def drained(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Take what is burnt out of a tank: mass, centre of gravity and inertia together."""
    kg = (left(values, at_s) - 1.0) * aircraft.mass.mass_kg
    aft_m = values["aft_chords"] * aircraft.geometry.cbar_m
    return with_load(aircraft, suite, "tank_burn", kg, aft_m) if kg else (aircraft, suite)


def _after(
    grown: Callable[[Aircraft, SensorSuite, Values, float], tuple[Aircraft, SensorSuite]],
    aircraft: Aircraft,
    suite: SensorSuite,
    values: Values,
) -> tuple[Aircraft, SensorSuite]:
    return grown(aircraft, suite, values, _AMENDED_S)


_PER_MIN = Parameter("per_min", "1/min", -0.02, 0.2, (0.01,), none=0.0)
_BURNT_PER_MIN = replace(_PER_MIN, low=-0.005, high=0.05, starts=(0.004,))
_POWER = Parameter("power", "1", 0.3, 4.0, (0.6, 1.8))
EFFECTS = (
    Effect(
        name="thrust_fade",
        title="thrust that falls during the flight",
        place="thrust",
        physics=(
            "The battery empties, and its voltage falls. The same throttle gives less thrust in later records than in "
            "earlier ones, by a share that grows with the time after take-off."
        ),
        parameters=(_PER_MIN,),
        amend=partial(_after, faded),
        over_time=faded,
        mistaken_for="a scale of the thrust, where all records were flown at about one time",
        separated_by="the same throttle step at the beginning and at the end of the flight; the battery's voltage",
    ),
    Effect(
        name="fuel_burn",
        title="mass that falls during the flight",
        place="mass",
        physics=(
            "Fuel burns that the believed mass does not know of. Forces accelerate the aircraft more in later records "
            "than in earlier ones, by a share that grows with the time after take-off."
        ),
        parameters=(_BURNT_PER_MIN,),
        amend=partial(_after, burnt),
        over_time=burnt,
        mistaken_for="a mass other than believed, where all records were flown at about one time",
        separated_by="the same manoeuvre at the beginning and at the end of the flight; weighing after landing",
    ),
    Effect(
        name="tank_burn",
        title="fuel that burns from a tank away from the centre of gravity",
        place="mass",
        physics=(
            "A tank ahead of or behind the centre of gravity empties. Later records show a lighter aircraft, whose "
            "centre of gravity has moved away from the tank: forces accelerate it more, and its static stability and "
            "the elevator at trim change by shares that grow with the time after take-off."
        ),
        parameters=(
            _BURNT_PER_MIN,
            Parameter("aft_chords", "chords", -2.0, 2.0, (0.1, -0.1)),
        ),
        amend=partial(_after, drained),
        over_time=drained,
        mistaken_for="fuel that burns at the centre of gravity, where the tank is near it; mass and thrust that fall "
        "together",
        separated_by="weighing on two scales before and after the flight; the elevator at trim, early and late",
        contains=("fuel_burn",),
    ),
    Effect(
        name="uneven_thrust_fade",
        title="thrust that falls during the flight, faster early or late",
        place="thrust",
        physics=(
            "The voltage of a battery falls at first, holds, and drops when it is nearly empty. Thrust falls from "
            "record to record, not in proportion to the time after take-off but as a power of it."
        ),
        parameters=(_PER_MIN, _POWER),
        amend=partial(_after, faded),
        over_time=faded,
        mistaken_for="thrust that falls steadily, where records were flown at two times only",
        separated_by="the same throttle step at three times of the flight and more; the battery's voltage",
        contains=("thrust_fade",),
    ),
    Effect(
        name="uneven_fuel_burn",
        title="mass that falls during the flight, faster early or late",
        place="mass",
        physics=(
            "Fuel burns faster in the climb than later. The aircraft is lighter from record to record, not in "
            "proportion to the time after take-off but by a share that grows as a power of it."
        ),
        parameters=(_BURNT_PER_MIN, _POWER),
        amend=partial(_after, burnt),
        over_time=burnt,
        mistaken_for="fuel that burns steadily, where records were flown at two times only",
        separated_by="the same manoeuvre at three times of the flight and more; the fuel flow",
        contains=("fuel_burn",),
    ),
)
