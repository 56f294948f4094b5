"""An elevator whose effectiveness depends on speed."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.constants import FT_M
from testbench.gap.effects.aero import excess, pitching_moment
from testbench.gap.effects.base import Effect, Parameter, Values
from testbench.gap.effects.reroute import product, prop, value
from testbench.gap.effects.servo import POSITION
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply the elevator's moment by 1 + k (V / V0 - 1), V0 the design speed."""
    over = product(value(FT_M / aircraft.design_V_m_s), prop("velocities/vt-fps"))
    moment = product(value(aircraft.coefficient("Cm_de")), prop(POSITION))
    edit = pitching_moment("speed-effectiveness", value(values["k"]), excess(over, 1.0), moment)
    text = f"elevator effectiveness changes by {values['k']:+.3g} times the relative change of speed"
    return aircraft.amended(Amendment("speed_effectiveness", text, (edit,))), suite


EFFECT = Effect(
    name="speed_effectiveness",
    title="elevator effectiveness that depends on speed",
    place="pitching moment",
    physics=(
        "Compressibility, Reynolds number or a tail that twists under load changes the elevator's effectiveness with "
        "speed. Beside the dynamic pressure, its moment depends on speed once more."
    ),
    parameters=(Parameter("k", "1", -5.0, 5.0, (0.5, -0.5), none=0.0),),
    amend=amend,
    mistaken_for="an error of Cm_de at one speed; slipstream, since thrust falls with speed",
    separated_by="the same elevator input at two speeds with the same throttle",
    flown=True,
)
