"""What empties during a flight: one parameter over all records, whose times after take-off are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import scaled_mass
from testbench.questions.gap.effects.base import Effect, Parameter, Values
from testbench.questions.gap.effects.thrust_scale import scaled
from testbench.sensors import SensorSuite

_AMENDED_S = 600.0  # time after take-off of an aircraft that is amended without a record
_LEAST = 0.05  # of what there was, which is left at any time


def left(values: Values, at_s: float) -> float:
    """Return the share that is left so many s after take-off."""
    return max(1.0 - values["per_min"] * at_s / 60.0, _LEAST)


def faded(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Multiply the thrust by what is left of it."""
    return scaled(aircraft, left(values, at_s), "thrust_fade", f" {at_s:.4g} s after take-off"), suite


def burnt(aircraft: Aircraft, suite: SensorSuite, values: Values, at_s: float) -> tuple[Aircraft, SensorSuite]:
    """Multiply the mass by what is left of it; the moments of inertia stay, as for a tank at the centre of gravity."""
    factor = left(values, at_s)
    changes, mass = scaled_mass(aircraft, {"mass_kg": factor})
    text = f"mass {factor:.4g} times the believed one {at_s:.4g} s after take-off"
    return replace(aircraft.amended(Amendment("fuel_burn", text, changes)), mass=mass), suite


def _after(
    grown: Callable[[Aircraft, SensorSuite, Values, float], tuple[Aircraft, SensorSuite]],
    aircraft: Aircraft,
    suite: SensorSuite,
    values: Values,
) -> tuple[Aircraft, SensorSuite]:
    return grown(aircraft, suite, values, _AMENDED_S)


_PER_MIN = Parameter("per_min", "1/min", -0.02, 0.2, (0.01,), none=0.0)
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
        parameters=(replace(_PER_MIN, low=-0.005, high=0.05, starts=(0.004,)),),
        amend=partial(_after, burnt),
        over_time=burnt,
        mistaken_for="a mass other than believed, where all records were flown at about one time",
        separated_by="the same manoeuvre at the beginning and at the end of the flight; weighing after landing",
    ),
)
