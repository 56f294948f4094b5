"""An aircraft heavier or lighter than believed."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import scaled_mass
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply the mass; the moments of inertia stay, as for a load at the centre of gravity."""
    factor = values["factor"]
    changes, mass = scaled_mass(aircraft, {"mass_kg": factor})
    amendment = Amendment("mass_error", f"mass {factor:.4g} times the believed one", changes)
    return replace(aircraft.amended(amendment), mass=mass), suite


EFFECT = Effect(
    name="mass_error",
    title="mass other than believed",
    place="mass",
    physics=(
        "The aircraft carries more or less than believed near its centre of gravity. "
        "Lift and thrust accelerate it less or more, and trim at the same speed needs another angle of attack."
    ),
    parameters=(Parameter("factor", "1", 0.5, 2.0, (1.1, 0.9), none=1.0),),
    amend=amend,
    mistaken_for="an error of CL_alpha, of thrust or of the accelerometer's scale",
    separated_by="weighing; or throttle steps beside elevator inputs, which thrust over mass and lift over mass share",
)
