"""A pitch damper that nobody mentioned, behind a noise filter."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import filtered_feedback
from testbench.aircraft.seams import opened
from testbench.effects.base import AUTOPILOT, URGED, Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add gain times filtered pitch rate, q / (1 + lag s), to what the elevator servo is told."""
    gain, lag = values["gain_s"], values["lag_s"]
    aircraft, path = opened(aircraft, "de")
    edit, state = filtered_feedback(path.command, "filtered-pitch-damper", "velocities/q-rad_sec", gain, lag)
    text = f"elevator fed back {gain:+.4g} rad per rad/s of pitch rate behind a filter of {lag:.3g} s"
    return aircraft.amended(Amendment("filtered_pitch_damper", text, (edit,), memories=(state,))), suite


EFFECT = Effect(
    name="filtered_pitch_damper",
    title="pitch damper with filter",
    place="pitching moment",
    part="autopilot",
    physics=(
        "An autopilot turns the elevator in proportion to pitch rate, but behind a filter that keeps out the gyro's "
        "noise and vibration. Late feedback damps less and stiffens more; it may set off an oscillation."
    ),
    parameters=(
        Parameter("gain_s", "s", URGED, 1.0, (0.15, 0.5 * URGED), none=0.0),
        Parameter("lag_s", "s", 0.0, 0.3, (0.06,), none=0.0),
    ),
    amend=amend,
    mistaken_for="a plain pitch damper where the filter is faster than the servo; errors of Cm_q and Cm_alpha",
    separated_by="a measured deflection, a sweep through the short period, or a flight with the autopilot off",
    flown=True,  # the filter does not show in a linearisation, in which time stands still
    contains=("pitch_damper",),
    upstream=AUTOPILOT,
)
