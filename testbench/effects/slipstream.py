"""The tail in the propeller's slipstream."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment, Increment
from testbench.aircraft.reroute import product, prop, value
from testbench.aircraft.seams import control_path
from testbench.effects.aero import pitching_moment, thrust_coefficient
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add k T / (qbar S) times the tail's moments: of the elevator and of pitch rate."""
    edit = blown(aircraft, "slipstream", values["k"], 1.0)
    return aircraft.amended(Amendment("slipstream", f"slipstream on the tail, k = {values['k']:.3g}", (edit,))), suite


def blown(aircraft: Aircraft, label: str, k: float, damping_share: float) -> Increment:
    """Return the edit that adds k T / (qbar S) times the moment of the elevator plus a share of that of pitch rate.

    Raises:
        ModelError: the aircraft has no engine or no elevator.
    """
    of_elevator = product(value(aircraft.coefficient("Cm_de")), prop(control_path(aircraft, "de").servo))
    cm_q = value(damping_share * aircraft.coefficient("Cm_q"))
    of_rate = product(cm_q, prop("velocities/q-aero-rad_sec"), prop("aero/ci2vel"))
    return pitching_moment(label, value(k), thrust_coefficient(aircraft), f"<sum> {of_elevator} {of_rate} </sum>")


EFFECT = Effect(
    name="slipstream",
    title="slipstream on the tail",
    place="thrust",
    physics=(
        "The propeller's slipstream raises the dynamic pressure at the tail in proportion to thrust. "
        "Elevator power and pitch damping grow with throttle and fall with airspeed."
    ),
    parameters=(Parameter("k", "1", -5.0, 30.0, (3.0, -1.0), none=0.0),),
    amend=amend,
    mistaken_for="a thrust line off the centre of gravity, where throttle moves and the elevator rests",
    separated_by="the same elevator input at two throttle settings, and throttle steps with the elevator at trim",
    flown=True,
)
