"""A throttle that cannot be opened and closed as fast as commanded."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import Reroute, moving, product, prop, reroute, value
from testbench.aircraft.seams import control_path
from testbench.core.record import FloatArray
from testbench.effects.base import SERVO, Effect, Parameter, Values
from testbench.effects.servo import handed_on
from testbench.sensors import SensorSuite

GROUND_CHECK = (
    "slam the throttle open and shut on the ground and film the motor's speed or the throttle arm: ramps show"
)


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let what the engine is told move no faster than the limit."""
    limit = values["limit_1_s"]
    edit = slewing(control_path(aircraft, "thr").command, "throttle-rate", limit, limit)
    text = f"throttle moves by {limit:.3g} of full throttle a second at most"
    return aircraft.amended(Amendment("throttle_rate_limit", text, (edit,))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the throttle's within the limit, the mean over each sample."""
    return slewed(names, u, dt_s, values["limit_1_s"], values["limit_1_s"])


def slewing(command: str, label: str, fall_1_s: float, rise_1_s: float) -> Reroute:
    """Return the edit that lets a command fall and rise no faster than that, 1/s."""
    c, last = prop(command), prop(f"gap/{label}")
    most, least = (product(value(x), prop("simulation/dt")) for x in (rise_1_s, -fall_1_s))
    step = f"<max> <min> <difference> {c} {last} </difference> {most} </min> {least} </max>"
    return reroute(command, label, moving(f"<sum> {last} {step} </sum>", c))


def slewed(names: Sequence[str], u: FloatArray, dt_s: float, fall_1_s: float, rise_1_s: float) -> FloatArray:
    """Return the commands ``u`` (n, m), that of the throttle held back to these rates, the mean over each sample."""

    def law(commanded: FloatArray) -> FloatArray:
        y, out = float(commanded[0]), []
        for c in commanded.tolist():
            limit = rise_1_s if c > y else fall_1_s
            moves = min(abs(c - y) / limit, dt_s)  # s
            then = c if moves < dt_s else y + math.copysign(limit * dt_s, c - y)
            out.append(then + 0.5 * (y - then) * moves / dt_s)
            y = then
        return np.array(out)

    return handed_on("thr", names, u, law)


EFFECT = Effect(
    name="throttle_rate_limit",
    title="rate limit of the throttle",
    place="thrust",
    physics=(
        "A throttle servo, a governor or the acceleration schedule of an engine lets the throttle move no faster than "
        "a limit. Small or slow commands arrive unchanged, large fast ones become ramps."
    ),
    parameters=(Parameter("limit_1_s", "1/s", 0.01, 20.0, (0.5, 0.15, 0.05)),),
    amend=amend,
    mistaken_for="a lag or a delay of the thrust if all throttle steps are of one size",
    separated_by="throttle steps of two sizes: a lag and a delay scale with them, a rate limit does not",
    shape=shape,
    upstream=SERVO,
    ground_check=GROUND_CHECK,
)
