"""The wing's wake that reaches the tail late, as a state of its own."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import prop, value
from testbench.effects.aero import ALPHA, followed, pitching_moment
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add Cm_wake (alpha lagged - alpha)."""
    edits, wake = followed("wake", prop(ALPHA), values["time_s"], aircraft.rate_hz)
    late = f"<difference> {prop('gap/wake')} {prop(ALPHA)} </difference>"
    edit = pitching_moment("wake-lag", value(values["Cm_wake"]), late)
    text = f"downwash at the tail late by {values['time_s']:.3g} s"
    amendment = Amendment("wake_lag", text, (*edits, edit), memories=(wake,), rate_hz=aircraft.rate_hz)
    return aircraft.amended(amendment), suite


EFFECT = Effect(
    name="wake_lag",
    title="wake that reaches the tail late",
    place="pitching moment",
    physics=(
        "The downwash at the tail follows alpha with a lag, that of the wake's way to the tail or of its build-up. "
        "Slow motion feels the damping of an alpha-dot term, fast motion does not."
    ),
    parameters=(
        Parameter("time_s", "s", 0.005, 2.0, (0.3,)),
        Parameter("Cm_wake", "1/rad", -4.0, 4.0, (0.3, -0.3), none=0.0),
    ),
    amend=amend,
    mistaken_for="an alpha-dot term, where all motion is slow against the lag",
    separated_by="inputs beyond the lag's corner frequency",
    flown=True,
    contains=("alpha_dot",),
)
