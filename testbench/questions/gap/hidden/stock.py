"""Hidden truths of any aircraft, by name: what acts on commands and on readings. They edit no model.

Models that are not the testbench's own have other names for everything, and often no servos: a servo is then a law
between command and surface.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from testbench.questions.gap.hidden import servos
from testbench.questions.gap.hidden.entries import TRUTHS, Make
from testbench.questions.gap.hidden.lateral import LATERAL
from testbench.questions.gap.hidden.truth import Law, Size, Truth

_WORDS = {"de": "elevator", "da": "aileron", "dr": "rudder"}
_LAWS: Mapping[str, Callable[[Size], Law]] = {
    "slow {} servo": lambda s: servos.stages(s["lag_rad_s"], 1),
    "{} servo of two stages": lambda s: servos.stages(s["lag_rad_s"], 2),
    "late {} link": lambda s: servos.late(s["delay_s"]),
    "{} link with jitter": lambda s: servos.late(s["delay_s"], 0.3, 5),
    "{} linkage ratio": lambda s: servos.scaled(s["gain"]),
    "{} linkage that loses": lambda s: servos.scaled(s["gain"], 0.08),
}
_READINGS = (
    "vane gain", "vane lag", "gyro gain", "late attitude", "airspeed lag", "vane of second order",
    "vane with a bent scale",
)  # fmt: skip
_LATERAL_READINGS = (
    "sideslip gain", "sideslip lag", "roll gyro gain", "yaw gyro gain", "late bank angle",
    "sideslip vane of second order", "sideslip with a bent scale", "yaw gyro with a bent scale",
    "bank angle of two stages",
)  # fmt: skip


def _on(control: str, make: Callable[[Size], Law]) -> Make:
    return lambda s, a: Truth(surfaces={control: make(s)})


STOCK: Mapping[str, Make] = {
    **{name.format(word): _on(c, make) for name, make in _LAWS.items() for c, word in _WORDS.items()},
    **{n: TRUTHS[n] for n in (*_READINGS, "slow motor", "stronger motor", "motor of two stages")},
    **{n: LATERAL[n] for n in _LATERAL_READINGS},
}
