"""Flow separation that follows alpha late: dynamic stall."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.amend import Change
from testbench.aircraft.reroute import prop
from testbench.effects.aero import followed, force
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.stall import attached, lost_lift, won_drag
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the separation point follow its static value with a lag; lift and drag as in a static stall."""
    X = attached(values["alpha_rad"], values["sharpness"])
    edits, separation = followed("separation", X, values["time_s"], aircraft.rate_hz)
    lift = force("CL", "stall-hysteresis", lost_lift(aircraft, prop("gap/separation")))
    drag = force("CD", "stall-hysteresis-drag", won_drag(values["CD"], prop("gap/separation")))
    text = (
        f"flow separates about alpha = {values['alpha_rad']:.3g} rad, late by {values['time_s']:.2g} s, CD rises by "
        f"{values['CD']:.3g} at most"
    )
    changes: tuple[Change, ...] = (*edits, lift, drag)
    amendment = Amendment("stall_hysteresis", text, changes, memories=(separation,), rate_hz=aircraft.rate_hz)
    return aircraft.amended(amendment), suite


EFFECT = Effect(
    name="stall_hysteresis",
    title="stall with hysteresis",
    place="lift",
    physics=(
        "The point of separation takes time to move, so that lift is higher while alpha rises than while it falls. "
        "Lift over alpha runs through loops that grow with the rate of alpha."
    ),
    parameters=(
        Parameter("alpha_rad", "rad", 0.03, 0.6, (0.1, 0.14, 0.22)),
        Parameter("sharpness", "1/rad", 5.0, 80.0, (20.0,)),
        Parameter("CD", "1", -0.2, 0.5, (0.0,)),
        Parameter("time_s", "s", 0.0, 1.0, (0.1,)),
    ),
    amend=amend,
    mistaken_for="a static stall, where alpha moves slowly",
    separated_by="pull-ups beyond the break at two rates",
    flown=True,
    contains=("stall",),
)
