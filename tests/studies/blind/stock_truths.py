"""The kinds of hidden truth that the draw of stock aircraft knows: names that are right, how sizes are drawn.

What flies is made by testbench/questions/gap/hidden/stock.py. The names are strings, compared with what the workflow
says only when a case is scored.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

from studies.blind import lateral_truths

from testbench.questions.gap.sealed import truths
from testbench.questions.gap.sealed.kinds import Kind, between, either, kind

_BEFORE = {"elevator": "", "aileron": "aileron_", "rudder": "rudder_"}
_GAINS = "stronger motor", "vane gain", "gyro gain", "vane with a bent scale"
_LATERAL_GAINS = (
    "sideslip gain",
    "roll gyro gain",
    "yaw gyro gain",
    "sideslip with a bent scale",
    "yaw gyro with a bent scale",
)
# Times, which are longer than those of small aircraft as the motions are slower.
_TIMES: Mapping[str, Kind] = {
    "slow motor": kind("library", "thrust_lag", between(lag_s=(1.0, 4.0)), "lag_s"),
    "vane lag": kind("library", "alpha_lag", between(lag_s=(0.25, 0.8)), "lag_s"),
    "late attitude": kind("library", "theta_delay", between(delay_s=(0.15, 0.5)), "delay_s"),
    "airspeed lag": kind("library", "V_lag", between(lag_s=(1.0, 3.0)), "lag_s"),
    "sideslip lag": kind("library", "beta_lag", between(lag_s=(0.15, 0.6)), "lag_s"),
    "late bank angle": kind("library", "phi_delay", between(delay_s=(0.15, 0.5)), "delay_s"),
    "motor of two stages": kind("other", "thrust_lag second_order_thrust_lag", between(lag_s=(1.0, 4.0)), "lag_s"),
    "vane of second order": kind("other", "alpha_lag alpha_delay", between(omega_rad_s=(2.0, 5.0))),
    "sideslip vane of second order": kind("other", "beta_lag beta_delay", between(omega_rad_s=(2.0, 5.0))),
    "bank angle of two stages": kind("other", "phi_lag phi_delay", between(lag_s=(0.2, 0.6))),
}


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
    **{n: truths.KINDS[n] for n in _GAINS},
    **{n: lateral_truths.LATERAL_KINDS[n] for n in _LATERAL_GAINS},
    **_TIMES,
}
