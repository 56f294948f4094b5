"""A servo of second order that hears its command late."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from testbench.aircraft import Aircraft
from testbench.core.record import FloatArray
from testbench.effects import actuator_lag, second_order_actuator, transport_delay
from testbench.effects.base import SERVO, Effect, Parameter, Values
from testbench.effects.servo import WORDS, named
from testbench.sensors import SensorSuite


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let the command wait, and replace the first-order servo by one of second order."""
    return second_order_actuator.amend(control, *transport_delay.amend(control, aircraft, suite, values), values)


def shape(
    control: str, names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values
) -> FloatArray:
    """Return commands that take the believed servo where the commands ``u`` (n, m), late, take the other one."""
    late = transport_delay.shape(control, names, u, dt_s, aircraft, values)
    return second_order_actuator.shape(control, names, late, dt_s, aircraft, values)


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=named(control, "delayed_servo"),
        title=f"{word} servo of second order behind a delay",
        place=word,
        physics=(
            "The command waits in links and sampled loops, or passes further stages, before motor and surface follow "
            "it as a mass on a spring. A delay stands for all that loses phase beyond what two orders do."
        ),
        parameters=(
            Parameter("delay_s", "s", 0.0, 0.5, (0.02,)),
            Parameter("omega_rad_s", "rad/s", 4.0, 300.0, (30.0,)),
            Parameter("zeta", "1", 0.1, 2.0, (0.8,)),
        ),
        amend=partial(amend, control),
        mistaken_for="a servo of third order or more; its parts alone, where commands are slow",
        separated_by="a sweep through the servo's frequency; a measured deflection",
        shape=partial(shape, control),
        lateral=control in ("da", "dr"),
        contains=(
            actuator_lag.NAMES[control],
            named(control, "second_order_actuator"),
            named(control, "transport_delay"),
        ),
        upstream=SERVO,
    )


EFFECT = effect("de")
