"""An engine that follows the throttle late in two stages."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, prop, reroute
from testbench.aircraft.seams import control_path
from testbench.core.record import FloatArray
from testbench.effects import thrust_lag
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.thrust_lag import lagged
from testbench.sensors import SensorSuite

_FIRST, _SECOND = "gap/thrust-stages-first", "gap/thrust-stages"


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Put two first-order lags in series behind the throttle command."""
    throttle = control_path(aircraft, "thr").command
    first = moving(lagged(_FIRST, throttle, values["lag_s"]), prop(throttle))
    second = moving(lagged(_SECOND, _FIRST, values["second_lag_s"]), prop(throttle))
    edit = reroute(throttle, "thrust-stages", second, (("first", first),))
    text = f"thrust lags by {values['lag_s']:.4g} s and {values['second_lag_s']:.4g} s in series"
    return aircraft.amended(Amendment("second_order_thrust_lag", text, (edit,))), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the throttle's lagged twice, the mean over each sample."""
    for lag in (values["lag_s"], values["second_lag_s"]):
        u = thrust_lag.shape(names, u, dt_s, aircraft, {"lag_s": lag})
    return u


EFFECT = Effect(
    name="second_order_thrust_lag",
    title="lag of the thrust in two stages",
    place="thrust",
    physics=(
        "The speed controller follows the throttle late and the propeller, or the spool, follows the controller. "
        "Thrust answers a step of the throttle with no slope at first, as two first-order lags in series do."
    ),
    parameters=(
        Parameter("lag_s", "s", 0.0, 5.0, (0.3, 1.0), none=0.0),
        Parameter("second_lag_s", "s", 0.0, 5.0, (0.1, 0.3), none=0.0),
    ),
    amend=amend,
    mistaken_for="a lag of one stage and a delay of the throttle",
    separated_by="throttle steps, with an accelerometer along x",
    shape=shape,
    contains=("thrust_lag",),
)
