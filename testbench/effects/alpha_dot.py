"""Pitch damping due to alpha-dot: the downwash that reaches the tail late."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment, Increment
from testbench.aircraft.reroute import prop, value
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add a pitching moment in proportion to alphadot cbar / 2V."""
    cm = values["Cm_alphadot"]
    edit = Increment("Cm", "gap/Cm_alphadot", (prop("aero/alphadot-rad_sec"), prop("aero/ci2vel"), value(cm)))
    return aircraft.amended(Amendment("alpha_dot", f"Cm_alphadot {cm:+.4g} more", (edit,))), suite


EFFECT = Effect(
    name="alpha_dot",
    title="pitching moment due to alpha-dot",
    place="pitching moment",
    physics=(
        "The downwash of the wing takes time to reach the tail, so that the tail's moment lags behind alpha. "
        "To first order this is a moment in proportion to alpha-dot, which damps the short period like pitch rate."
    ),
    parameters=(Parameter("Cm_alphadot", "1", -40.0, 20.0, (-4.0, 4.0), none=0.0),),
    amend=amend,
    mistaken_for="an error of Cm_q: in the short period q and alpha-dot are nearly the same",
    separated_by="manoeuvres in which pitch rate and alpha-dot part: throttle with elevator, or pull-ups held for long",
)
