"""A motor stronger or weaker than believed."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.amend import Change, Thrust
from testbench.aircraft.reroute import product, prop, reroute, value
from testbench.aircraft.seams import control_path
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply what the motor is told, to which thrust is proportional at every speed; of a foreign model, whose thrust
    may be any function of the throttle, multiply all forces and moments of the engines."""
    return scaled(aircraft, values["scale"], "thrust_scale"), suite


def scaled(aircraft: Aircraft, scale: float, name: str, text: str = "") -> Aircraft:
    """Return an aircraft with its thrust multiplied by the amendment ``name``, whose description ``text`` ends."""
    throttle = control_path(aircraft, "thr").command
    edit: Change = reroute(throttle, name.replace("_", "-"), product(value(scale), prop(throttle)))
    if aircraft.adapter is not None:
        edit = Thrust(value(scale - 1.0))
    return aircraft.amended(Amendment(name, f"throttle gives {scale:.4g} times the thrust{text}", (edit,)))


EFFECT = Effect(
    name="thrust_scale",
    title="scale of the thrust",
    place="thrust",
    physics=(
        "Motor, battery and propeller give more or less thrust than on the bench. The same throttle step changes speed "
        "and climb by a multiple of what is believed, and trim needs another throttle for the same thrust."
    ),
    parameters=(Parameter("scale", "1", 0.3, 3.0, (0.8, 1.3), none=1.0),),
    amend=amend,
    mistaken_for="a mass error in throttle steps alone; a scale error of the airspeed sensor",
    separated_by="elevator manoeuvres beside the throttle steps, which feel the mass and not the thrust",
)
