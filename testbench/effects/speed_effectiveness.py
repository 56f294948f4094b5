"""An elevator whose effectiveness depends on speed."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import product, prop, value
from testbench.aircraft.seams import control_path
from testbench.core.constants import FT_M
from testbench.effects.aero import excess, pitching_moment
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply the elevator's moment by 1 + k s + curve s^2 with s = V / V0 - 1, V0 the design speed."""
    over = excess(product(value(FT_M / aircraft.design_V_m_s), prop("velocities/vt-fps")), 1.0)
    factor = f"<sum> {value(values['k'])} {product(value(values['curve']), over)} </sum>"
    moment = product(value(aircraft.coefficient("Cm_de")), prop(control_path(aircraft, "de").servo))
    edit = pitching_moment("speed-effectiveness", factor, over, moment)
    text = (
        f"elevator effectiveness changes by {values['k']:+.3g} times the relative change of speed, "
        f"{values['curve']:+.3g} times its square"
    )
    return aircraft.amended(Amendment("speed_effectiveness", text, (edit,))), suite


EFFECT = Effect(
    name="speed_effectiveness",
    title="elevator effectiveness that depends on speed",
    place="pitching moment",
    physics=(
        "Compressibility, Reynolds number or a tail that twists under load changes the elevator's effectiveness with "
        "speed. Its moment then follows speed otherwise than the dynamic pressure does, along a line or a curve."
    ),
    parameters=(
        Parameter("k", "1", -5.0, 5.0, (0.5, -0.5), none=0.0),
        Parameter("curve", "1", -10.0, 10.0, (0.0,)),
    ),
    amend=amend,
    mistaken_for="an error of Cm_de at one speed; slipstream, since thrust falls with speed",
    separated_by="the same elevator input at two speeds with the same throttle",
    flown=True,
)
