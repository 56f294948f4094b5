"""A stabiliser that is stated: angles and rates fed back to the controls, for aircraft that need one."""

from __future__ import annotations

from testbench.aircraft.amend import Amendment
from testbench.aircraft.model import Aircraft
from testbench.aircraft.seams import control_path, opened, product, prop, reroute, value, with_servo

FED_BACK = {
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "p": "velocities/p-rad_sec",
    "q": "velocities/q-rad_sec",
    "r": "velocities/r-rad_sec",
    "phi": "attitude/phi-rad",
    "theta": "attitude/theta-rad",
}
"""What can be fed back -> its JSBSim property, rad or rad/s."""
SERVO_RAD_S = 100.0
"""Corner frequency of the servo that a stabiliser works through in an aircraft that has none."""
_UPSTREAM = 4  # between the recorded command and the servo


def stabilised(aircraft: Aircraft) -> Aircraft:
    """Return the aircraft with its stabiliser, one amendment per control: command + sum of gain times motion.

    It acts behind the recorded command and through the servo, so that a record of the surface shows it and the linear
    model has it in the states of its servos; derivatives stay those of the aircraft alone.

    Raises:
        ModelError: it moves a control that the aircraft does not have.
    """
    for control, gains in aircraft.stabiliser.items():
        if control_path(aircraft, control).lag is None or not aircraft.has_servo(control):
            aircraft, _ = with_servo(aircraft, control, SERVO_RAD_S)
        aircraft, path = opened(aircraft, control)
        terms = " ".join(product(value(gain), prop(FED_BACK[motion])) for motion, gain in gains.items())
        edit = reroute(path.command, f"stabiliser-{control}", f"<sum> {prop(path.command)} {terms} </sum>")
        said = ", ".join(f"{gain:+.3g} {motion}" for motion, gain in gains.items())
        amendment = Amendment(f"stabiliser_{control}", f"{control} is fed back {said}", (edit,), upstream=_UPSTREAM)
        aircraft = aircraft.amended(amendment)
    return aircraft
