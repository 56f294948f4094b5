"""A thrust line that misses the centre of gravity."""

from __future__ import annotations

from collections.abc import Mapping

from testbench.aircraft import Aircraft, Amendment, SetText
from testbench.aircraft.amend import Change, ThrustLine
from testbench.effects.aero import need_engine
from testbench.effects.base import Effect, Parameter
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Mapping[str, float]) -> tuple[Aircraft, SensorSuite]:
    """Move the thruster up (positive) or down from the centre of gravity; of a foreign model, from where it is."""
    need_engine(aircraft)
    z, above = values["z_m"], "the centre of gravity"
    edit: Change = SetText("propulsion/engine/thruster/location/z", z)
    if aircraft.adapter is not None:
        edit, above = ThrustLine(z), "the believed one"
    return aircraft.amended(Amendment("thrust_line", f"thrust line {1000 * z:+.1f} mm above {above}", (edit,))), suite


EFFECT = Effect(
    name="thrust_line",
    title="thrust line off the centre of gravity",
    place="thrust",
    physics=(
        "Thrust acts above or below the centre of gravity and pitches the aircraft with every change of throttle. "
        "Since thrust falls with airspeed, it also adds a pitching moment due to speed."
    ),
    parameters=(Parameter("z_m", "m", -0.2, 0.2, (0.02, -0.02), none=0.0, of_span=0.05),),
    amend=amend,
    mistaken_for="a CG shift or a speed derivative of Cm, without throttle motion",
    separated_by="throttle steps, which single it out",
)
