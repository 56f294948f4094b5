"""An elevator servo that turns slower one way than the other."""

from __future__ import annotations

from collections.abc import Sequence

from testbench.aircraft import Aircraft, Amendment, SetProperty
from testbench.core.record import FloatArray
from testbench.questions.gap.effects.base import Effect, Parameter, Values
from testbench.questions.gap.effects.rate_limit import limited
from testbench.questions.gap.effects.servo import LAG, LIMIT, OneSidedLimit, declared
from testbench.sensors import SensorSuite


def amend(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give the elevator servo one rate limit per direction."""
    down, up = values["down_rad_s"], values["up_rad_s"]
    edits = (OneSidedLimit(".", "", None, up), SetProperty(LIMIT, down))
    text = f"elevator servo turns at {down:.3g} rad/s down and {up:.3g} rad/s up at most"
    return aircraft.amended(Amendment("asymmetric_rate_limit", text, edits)), suite


def shape(names: Sequence[str], u: FloatArray, dt_s: float, aircraft: Aircraft, values: Values) -> FloatArray:
    """Return commands that take the servo without limit where the commands ``u`` (n, m) take the limited one."""
    return limited(names, u, dt_s, declared(aircraft, LAG), values["down_rad_s"], values["up_rad_s"])


EFFECT = Effect(
    name="asymmetric_rate_limit",
    title="rate limit of the elevator servo, another one each way",
    place="elevator",
    physics=(
        "The air load helps the servo one way and holds it back the other, so that it turns slower against the load. "
        "Large fast inputs arrive as ramps of two slopes and leave a mean deflection behind."
    ),
    parameters=(
        Parameter("down_rad_s", "rad/s", 0.02, 10.0, (1.0, 0.3)),
        Parameter("up_rad_s", "rad/s", 0.02, 10.0, (1.0, 0.3)),
    ),
    amend=amend,
    mistaken_for="a symmetric rate limit, where only one of the two is ever met",
    separated_by="inputs of both signs at two amplitudes, the larger one beyond both limits",
    shape=shape,
    contains=("rate_limit",),
)
