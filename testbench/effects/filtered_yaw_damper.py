"""A yaw damper that nobody mentioned, behind a noise filter."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import band_feedback
from testbench.aircraft.seams import opened
from testbench.effects import yaw_damper
from testbench.effects.base import AUTOPILOT, Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add gain times filtered and washed-out yaw rate, s / ((s + washout) (1 + lag s)) r, to what the servo is told."""
    gain, washout, lag = values["gain_s"], values["washout_rad_s"], values["lag_s"]
    aircraft, path = opened(aircraft, "dr")
    edit, states = band_feedback(path.command, "filtered-yaw-damper", "velocities/r-rad_sec", gain, washout, lag)
    text = (
        f"rudder fed back {gain:+.4g} rad per rad/s of yaw rate, washed out below {washout:.3g} rad/s, behind a filter "
        f"of {lag:.3g} s"
    )
    return aircraft.amended(Amendment("filtered_yaw_damper", text, (edit,), memories=states)), suite


EFFECT = Effect(
    name="filtered_yaw_damper",
    title="yaw damper with filter",
    place="rudder",
    part="autopilot",
    physics=(
        "An autopilot turns the rudder in proportion to yaw rate, but behind a filter that keeps out the gyro's noise "
        "and vibration; a washout lets a steady turn pass. Late feedback damps the Dutch roll less and changes its "
        "frequency."
    ),
    parameters=(*yaw_damper.EFFECT.parameters, Parameter("lag_s", "s", 0.0, 0.5, (0.1,), none=0.0)),
    amend=amend,
    mistaken_for="a plain yaw damper where the filter is faster than the servo; errors of Cn_r and Cn_beta",
    separated_by="a measured rudder deflection, a sweep through the Dutch roll, or a flight with the autopilot off",
    flown=True,  # filter and washout do not show in a linearisation, in which time stands still
    lateral=True,
    contains=("yaw_damper",),
    upstream=AUTOPILOT,
)
