"""A propeller whose thrust falls with speed faster, or slower, than believed."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment, Insert
from testbench.aircraft.amend import Change, Thrust
from testbench.aircraft.reroute import component, product, prop, value
from testbench.core.constants import FT_M
from testbench.effects.aero import excess, need_engine
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

THRUST = "fcs/throttle-pos-norm"  # share of the static thrust, after all that stands between command and engine


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Multiply thrust by scale - k (V / V0 - 1), V0 the design speed."""
    need_engine(aircraft)
    scale, k = values["scale"], values["k"]
    over = excess(product(value(FT_M / aircraft.design_V_m_s), prop("velocities/vt-fps")), 1.0)
    factor = f"<difference> {value(scale)} {product(value(k), over)} </difference>"
    lapse = component(THRUST, product(factor, prop(THRUST)))
    edit: Change = Insert("flight_control", f'<channel name="gap/thrust-lapse"> {lapse} </channel>')
    if aircraft.adapter is not None:
        edit = Thrust(f"<difference> {factor} {value(1.0)} </difference>")
    text = f"thrust {scale:.4g} times the believed one at design speed, less {k:.3g} times the relative rise of speed"
    return aircraft.amended(Amendment("thrust_lapse", text, (edit,))), suite


EFFECT = Effect(
    name="thrust_lapse",
    title="thrust that changes with speed",
    place="thrust",
    physics=(
        "A propeller of another pitch or diameter unloads at another speed, so its thrust falls with airspeed by more "
        "or less than believed. Speed settles faster or slower after a disturbance, the more so the higher the "
        "throttle."
    ),
    parameters=(Parameter("scale", "1", 0.3, 3.0, (1.0,)), Parameter("k", "1", -2.0, 3.0, (0.5, -0.3), none=0.0)),
    amend=amend,
    mistaken_for="drag that changes with speed, at one throttle; a mass error in throttle steps alone",
    separated_by="the same elevator input at two throttle settings, and glides",
    contains=("thrust_scale",),
    flown=True,
)
