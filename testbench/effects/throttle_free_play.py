"""Play in the linkage of the throttle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, prop, reroute, value
from testbench.aircraft.seams import control_path
from testbench.core.record import FloatArray
from testbench.effects.base import LINKAGE, Effect, Parameter, Values
from testbench.effects.servo import handed_on
from testbench.sensors import SensorSuite

WIDEST = 0.4  # of full throttle
GROUND_CHECK = (
    "open the throttle in small steps and close it again: where play or a dead band is, motor speed or throttle arm "
    "stands elsewhere on the way back"
)


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Put a play of the given width between what is commanded and what the engine is told; in its middle at trim."""
    width, command = values["width"], control_path(aircraft, "thr").command
    c, last = prop(command), prop("gap/throttle-play")
    low, high = (f"<sum> {c} {value(s * 0.5 * width)} </sum>" for s in (-1.0, 1.0))
    edit = reroute(command, "throttle-play", moving(f"<min> <max> {last} {low} </max> {high} </min>", c))
    text = f"throttle linkage with a play of {width:.3g} of full throttle"
    return aircraft.amended(Amendment("throttle_free_play", text, (edit,))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the throttle's behind the play."""
    half = 0.5 * values["width"]

    def law(commanded: FloatArray) -> FloatArray:
        y = [float(commanded[0])]
        for c in commanded.tolist():
            y.append(min(max(y[-1], c - half), c + half))
        return np.array(y[1:])

    return handed_on("thr", names, u, law)


EFFECT = Effect(
    name="throttle_free_play",
    title="free play of the throttle",
    place="thrust",
    physics=(
        "Worn rods, a slack cable or a servo that ignores small errors let the command move by a certain share before "
        "the engine follows. Every reversal loses the play: small throttle inputs vanish in it, large ones come short "
        "by half of it."
    ),
    parameters=(Parameter("width", "1", 0.0, WIDEST, (0.04, 0.12), none=0.0),),
    amend=amend,
    mistaken_for="a lower thrust per throttle if all inputs are of one size; the dead band of a quick throttle servo, "
    "which does the same",
    separated_by="throttle steps of two sizes; for the servo, the motion of its arm on the ground",
    shape=shape,
    upstream=LINKAGE,
    ground_check=GROUND_CHECK,
)
