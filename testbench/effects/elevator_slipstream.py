"""The elevator in the propeller's slipstream, the rest of the tail in part of it."""

from __future__ import annotations

from testbench.aircraft import Aircraft, Amendment
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.slipstream import blown
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add k T / (qbar S) times the moment of the elevator, and a share of that times the moment of pitch rate."""
    k, share = values["k"], values["damping_share"]
    text = f"slipstream on the elevator, k = {k:.3g}, and {share:.2g} of it on the tail's damping"
    edit = blown(aircraft, "elevator-slipstream", k, share)
    return aircraft.amended(Amendment("elevator_slipstream", text, (edit,))), suite


EFFECT = Effect(
    name="elevator_slipstream",
    title="slipstream on the elevator",
    place="thrust",
    physics=(
        "The contracted slipstream covers the elevator and only part of the tail. "
        "Elevator power grows with throttle, pitch damping by less."
    ),
    parameters=(
        Parameter("k", "1", -5.0, 30.0, (3.0, -1.0), none=0.0),
        Parameter("damping_share", "1", 0.0, 1.0, (0.3,)),
    ),
    amend=amend,
    mistaken_for="a slipstream on the whole tail, where the aircraft pitches slowly",
    separated_by="doublets as fast as the short period at two throttle settings",
    flown=True,
    contains=("slipstream",),
)
