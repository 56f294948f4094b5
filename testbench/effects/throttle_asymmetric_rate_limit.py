"""A throttle that opens slower than it closes, or the other way."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import control_path
from testbench.core.record import FloatArray
from testbench.effects.base import SERVO, Effect, Parameter, Values
from testbench.effects.throttle_rate_limit import GROUND_CHECK, slewed, slewing
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give what the engine is told one rate limit per direction."""
    fall, rise = values["fall_1_s"], values["rise_1_s"]
    edit = slewing(control_path(aircraft, "thr").command, "throttle-rates", fall, rise)
    text = f"throttle opens by {rise:.3g} and closes by {fall:.3g} of full throttle a second at most"
    return aircraft.amended(Amendment("throttle_asymmetric_rate_limit", text, (edit,))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the throttle's within both limits, the mean over each sample."""
    return slewed(names, u, dt_s, values["fall_1_s"], values["rise_1_s"])


EFFECT = Effect(
    name="throttle_asymmetric_rate_limit",
    title="rate limit of the throttle, another one each way",
    place="thrust",
    physics=(
        "An engine is accelerated with care, lest it stalls or surges, and a propeller slows down by itself. Large "
        "throttle steps arrive as ramps of two slopes and leave a mean thrust behind."
    ),
    parameters=(
        Parameter("rise_1_s", "1/s", 0.01, 20.0, (0.5, 0.1)),
        Parameter("fall_1_s", "1/s", 0.01, 20.0, (0.5, 0.1)),
    ),
    amend=amend,
    mistaken_for="a symmetric rate limit, where only one of the two is ever met",
    separated_by="throttle steps of both signs and two sizes, the larger one beyond both limits",
    shape=shape,
    contains=("throttle_rate_limit",),
    upstream=SERVO,
    ground_check=GROUND_CHECK,
)
