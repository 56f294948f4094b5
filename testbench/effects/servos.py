"""Servo effects of every control, as one table: each is written once and made for every control it suits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from testbench.effects import (
    actuator_lag,
    asymmetric_rate_limit,
    creeping_free_play,
    curved_linkage,
    dead_band,
    delayed_servo,
    free_play,
    one_sided_linkage,
    rate_limit,
    second_order_actuator,
    second_order_thrust_lag,
    surface_offset,
    surface_scale,
    throttle_asymmetric_rate_limit,
    throttle_dead_band,
    throttle_free_play,
    throttle_rate_limit,
    thrust_lag,
    thrust_scale,
    transport_delay,
)
from testbench.effects.base import Effect

CONTROLS = ("de", "da", "dr", "thr")
_SURFACES = CONTROLS[:3]
_KINDS: dict[str, tuple[Callable[[str], Effect], Sequence[str]]] = {
    "lag": (actuator_lag.effect, _SURFACES),
    "second order": (second_order_actuator.effect, _SURFACES),
    "rate limit": (rate_limit.effect, _SURFACES),
    "rate limit, another one each way": (asymmetric_rate_limit.effect, _SURFACES),
    "delay": (transport_delay.effect, CONTROLS),
    "delay and second order": (delayed_servo.effect, _SURFACES),
    "free play": (free_play.effect, _SURFACES),
    "creeping free play": (creeping_free_play.effect, _SURFACES),
    "dead band": (dead_band.effect, _SURFACES),
    "gain": (surface_scale.effect, _SURFACES),
    "offset": (surface_offset.effect, _SURFACES),
    "one-sided linkage": (one_sided_linkage.effect, CONTROLS),
    "curved linkage": (curved_linkage.effect, CONTROLS),
}
_OF_THRUST = {
    "lag": thrust_lag.EFFECT,
    "second order": second_order_thrust_lag.EFFECT,
    "gain": thrust_scale.EFFECT,
    "rate limit": throttle_rate_limit.EFFECT,
    "rate limit, another one each way": throttle_asymmetric_rate_limit.EFFECT,
    "free play": throttle_free_play.EFFECT,
    "dead band": throttle_dead_band.EFFECT,
}
SERVOS: Mapping[tuple[str, str], Effect] = {
    (kind, control): make(control) for kind, (make, controls) in _KINDS.items() for control in controls
} | {(kind, "thr"): effect for kind, effect in _OF_THRUST.items()}
"""(kind, control) -> effect. The throttle has no servo and no surface: what surfaces have there acts on its command,
and its lags and gain are those of the thrust."""
