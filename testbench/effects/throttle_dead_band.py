"""A throttle servo, or a governor, that ignores small errors and takes its time for large ones."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, product, prop, reroute, value
from testbench.aircraft.seams import control_path
from testbench.core.record import FloatArray
from testbench.effects.base import SERVO, Effect, Parameter, Values
from testbench.effects.servo import handed_on
from testbench.effects.throttle_free_play import GROUND_CHECK, WIDEST
from testbench.sensors import SensorSuite

_SHORTEST_S = 1e-6  # below any frame time: the excess is taken up at once


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Let what the engine is told follow what its error exceeds the band by, as a first-order lag; exact for a command
    held from frame to frame."""
    half, lag, command = values["half_width"], max(values["lag_s"], _SHORTEST_S), control_path(aircraft, "thr").command
    c, last = prop(command), prop("gap/throttle-band")
    error = f"<difference> {c} {last} </difference>"
    excess = f"<difference> {error} <min> <max> {error} {value(-half)} </max> {value(half)} </min> </difference>"
    left = f"<exp> {product(value(-1.0 / lag), prop('simulation/dt'))} </exp>"
    step = product(f"<difference> <value>1</value> {left} </difference>", excess)
    edit = reroute(command, "throttle-band", moving(f"<sum> {last} {step} </sum>", c))
    text = f"throttle servo with a dead band of {half:.3g} of full throttle to either side, late by {lag:.3g} s"
    return aircraft.amended(Amendment("throttle_dead_band", text, (edit,))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the throttle's behind the dead band, the mean over each sample."""
    half, lag = values["half_width"], max(values["lag_s"], _SHORTEST_S)
    left = math.exp(-dt_s / lag)
    mean = (1.0 - left) * lag / dt_s

    def law(commanded: FloatArray) -> FloatArray:
        y, out = float(commanded[0]), []
        for c in commanded.tolist():
            excess = c - y - max(-half, min(half, c - y))
            out.append(y + (1.0 - mean) * excess)
            y += (1.0 - left) * excess
        return np.array(out)

    return handed_on("thr", names, u, law)


EFFECT = Effect(
    name="throttle_dead_band",
    title="dead band of the throttle servo (hysteresis)",
    place="thrust",
    physics=(
        "Friction or a coarse control loop lets a throttle servo or governor rest until its error exceeds a band, and "
        "it takes up the rest late. Thrust stops short of every command, and where it stops depends on where it came "
        "from."
    ),
    parameters=(
        Parameter("half_width", "1", 0.0, 0.5 * WIDEST, (0.02, 0.06), none=0.0),
        Parameter("lag_s", "s", 0.0, 5.0, (0.3,), none=0.0),
    ),
    amend=amend,
    mistaken_for="free play of the throttle with a lag of the thrust; free play alone, where the servo is quick",
    separated_by="small throttle steps from the rest, in both directions; the motion of the servo's arm on the ground",
    shape=shape,
    contains=("thrust_lag", "throttle_free_play"),
    upstream=SERVO,
    ground_check=GROUND_CHECK,
)
