"""An engine that follows the throttle late."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import moving, product, prop, reroute, value
from testbench.aircraft.seams import control_path
from testbench.core.record import FloatArray
from testbench.effects.base import Effect, Parameter, Values
from testbench.sensors import SensorSuite

_SMALLEST_S = 1e-6  # below any frame time: the throttle passes unchanged


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Put a first-order lag behind the throttle command; exact for a command held from frame to frame."""
    lag = values["lag_s"]
    throttle = control_path(aircraft, "thr").command
    body = moving(lagged("gap/thrust-lag", throttle, lag), prop(throttle))
    edit = reroute(throttle, "thrust-lag", body)
    return aircraft.amended(Amendment("thrust_lag", f"thrust lags by {lag:.4g} s", (edit,))), suite


def lagged(name: str, command: str, lag_s: float) -> str:
    """Return the XML of a first-order lag behind ``command``, whose last value is that of the property ``name``."""
    decay = f"<exp> {product(value(-1.0 / max(lag_s, _SMALLEST_S)), prop('simulation/dt'))} </exp>"
    past = f"<difference> {prop(name)} {prop(command)} </difference>"
    return f"<sum> {prop(command)} {product(decay, past)} </sum>"


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return the commands ``u`` (n, m) with the throttle's lagged, the mean over each sample."""
    lag = values["lag_s"]
    if "thr" not in names or lag < _SMALLEST_S:
        return u
    from scipy.signal import lfilter

    column, out, a = list(names).index("thr"), u.copy(), math.exp(-dt_s / lag)
    commanded = u[:, column]
    begin = np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], commanded - commanded[0])) + commanded[0]
    out[:, column] = commanded + (begin - commanded) * (1.0 - a) * lag / dt_s
    return out


EFFECT = Effect(
    name="thrust_lag",
    title="lag of the thrust",
    place="thrust",
    physics=(
        "Motor, propeller and speed controller take time to follow the throttle. "
        "Thrust answers a step of the throttle as a first-order lag, and elevator inputs show nothing of it."
    ),
    parameters=(Parameter("lag_s", "s", 0.0, 5.0, (0.3, 1.0), none=0.0),),
    amend=amend,
    mistaken_for="a delay of the throttle where it moves slowly; a lag of the airspeed sensor with throttle alone",
    separated_by="throttle steps, with an accelerometer along x or speed changes by elevator beside them",
    shape=shape,
)
