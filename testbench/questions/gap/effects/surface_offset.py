"""An elevator rigged off its zero."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.questions.gap.effects.base import GEARING, Effect, Parameter, Values
from testbench.questions.gap.effects.reroute import ELEVATOR, prop, reroute, value
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a constant to what the elevator servo is told."""
    offset = values["offset_rad"]
    edit = reroute(ELEVATOR, "surface-offset", f"<sum> {prop(ELEVATOR)} {value(offset)} </sum>")
    text = f"elevator rigged {offset:+.4g} rad off"
    return aircraft.amended(Amendment("surface_offset", text, (edit,))), suite


EFFECT = Effect(
    name="surface_offset",
    title="offset of the elevator's zero",
    place="elevator",
    physics=(
        "The elevator stands at an angle when its command is zero. "
        "Trim needs another command, and the motion about trim stays what it was."
    ),
    parameters=(Parameter("offset_rad", "rad", -0.2, 0.2, (0.02, -0.02), none=0.0),),
    amend=amend,
    mistaken_for="an error of Cm0, exactly; it does not show where commands are deviations from trim",
    separated_by="the absolute command at trim at several speeds, beside a weighed centre of gravity",
    upstream=GEARING,
)
