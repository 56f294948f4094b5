"""The kinds of hidden truth that the draw of stock aircraft knows: names that are right, how sizes are drawn.

What flies is made by testbench/questions/gap/hidden/stock.py. The names are strings, compared with what the workflow
says only when a case is scored.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

from testbench.questions.gap.sealed import lateral_truths, truths
from testbench.questions.gap.sealed.kinds import Kind, between, either, kind

_BEFORE = {"elevator": "", "aileron": "aileron_", "rudder": "rudder_"}
_BELOW = "slow motor", "stronger motor", "vane gain", "vane lag", "gyro gain", "late attitude", "airspeed lag"
_LATERAL = "sideslip gain", "sideslip lag", "roll gyro gain", "yaw gyro gain", "late bank angle"
_OTHER = "motor of two stages", "vane of second order", "vane with a bent scale"
_LATERAL_OTHER = (
    "sideslip vane of second order",
    "sideslip with a bent scale",
    "yaw gyro with a bent scale",
    "bank angle of two stages",
)


def _of(word: str) -> dict[str, Kind]:
    """Return the kinds of one control's path."""
    p, ratio = _BEFORE[word], either(gain=(0.45, 0.62, 1.4, 1.6))
    lags = f"{p}actuator_lag {p}second_order_actuator" if not p else f"{p}lag {p}second_order_actuator"
    two = f"{p}second_order_actuator {p}delayed_servo {lags.split()[0]}"
    return {
        f"slow {word} servo": kind("library", lags, between(lag_rad_s=(4.0, 12.0))),
        f"late {word} link": kind("library", f"{p}transport_delay", between(delay_s=(0.06, 0.18)), "delay_s"),
        f"{word} linkage ratio": kind("library", f"{p}surface_scale", ratio, "gain -> scale"),
        f"{word} servo of two stages": kind("other", two, between(lag_rad_s=(8.0, 18.0))),
        f"{word} link with jitter": kind("other", f"{p}transport_delay", between(delay_s=(0.08, 0.18)), "delay_s"),
        f"{word} linkage that loses": kind("other", f"{p}surface_scale {p}curved_linkage", ratio),
    }


STOCK_KINDS: Mapping[str, Kind] = {
    **{name: k for word in _BEFORE for name, k in _of(word).items()},
    **{n: truths.KINDS[n] for n in (*_BELOW, *_OTHER)},
    **{n: lateral_truths.LATERAL_KINDS[n] for n in (*_LATERAL, *_LATERAL_OTHER)},
}
