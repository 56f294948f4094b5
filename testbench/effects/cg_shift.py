"""A centre of gravity that is not where it is believed."""

from __future__ import annotations

from dataclasses import replace

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import moved_centre
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import Sensor, SensorSuite
from testbench.sensors.sensor import ACCELEROMETERS


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Move the centre of gravity aft (positive) or forward; accelerometers stay where they are in the airframe.

    Raises:
        ModelError: the model does not say where the centre of gravity is.
    """
    shift = values["aft_chords"] * aircraft.geometry.cbar_m
    text = f"centre of gravity {1000.0 * shift:+.3g} mm aft"
    amended = aircraft.amended(Amendment("cg_shift", text, moved_centre(aircraft, (shift, 0.0, 0.0))))
    return amended, left_behind(suite, shift)


def left_behind(suite: SensorSuite, aft_m: float = 0.0, right_m: float = 0.0) -> SensorSuite:
    """Return the suite whose accelerometers stay in the airframe as the centre of gravity moves aft and right."""

    def beside(s: Sensor) -> Sensor:
        ahead, right, down = s.position_m
        return replace(s, position_m=(ahead + aft_m, right - right_m, down)) if s.channel in ACCELEROMETERS else s

    return replace(suite, sensors=tuple(beside(s) for s in suite.sensors))


EFFECT = Effect(
    name="cg_shift",
    title="shift of the centre of gravity",
    place="pitching moment",
    part="mass",
    physics=(
        "The centre of gravity lies further aft or forward than believed, so that lift acts with another arm. "
        "Static stability changes by the shift times the lift slope, and accelerometers sit elsewhere beside it."
    ),
    parameters=(Parameter("aft_chords", "chords", -0.3, 0.3, (0.02, -0.02), none=0.0),),
    amend=amend,
    mistaken_for="errors of Cm_alpha and Cm0 together; only what exceeds their priors can be named",
    separated_by="weighing, or a ballast moved by a known distance between two flights",
)
