"""THE table of what a data set hides: effects of the library, and the range that the sizes of each are drawn from.

Levels name them in ``hidden``. Of effects without a row, each size is drawn about one that the library starts from.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from testbench.effects import Effect

Ranges = tuple[float, ...]
"""Low, high; or low, high, low, high of two intervals, of which each draw takes one."""
_ABOUT = 0.7, 1.4  # times a size that the library starts from, counted from where the effect vanishes


@dataclass(frozen=True)
class Kind:
    """One row.

    Attributes:
        sizes: parameter of the effect -> range of its values (SI), uniform.
        also: names that are as right as the effect's own, as such flights do not tell them apart.
    """

    sizes: Mapping[str, Ranges]
    also: tuple[str, ...] = ()


def _row(also: str = "", **sizes: Ranges) -> Kind:
    return Kind(sizes, tuple(also.split()))


KINDS: Mapping[str, Kind] = {
    "actuator_lag": _row(lag_rad_s=(7.0, 22.0)),
    "second_order_actuator": _row(omega_rad_s=(10.0, 30.0), zeta=(0.4, 1.1)),
    "rate_limit": _row(limit_rad_s=(0.12, 0.35)),
    "asymmetric_rate_limit": _row(down_rad_s=(0.2, 0.28), up_rad_s=(0.35, 0.55)),
    "transport_delay": _row(delay_s=(0.03, 0.12)),
    "free_play": _row(width_rad=(0.012, 0.035)),
    "dead_band": _row(half_width_rad=(0.005, 0.015)),
    "surface_scale": _row(scale=(0.45, 0.65, 1.3, 1.5)),
    "thrust_line": _row(z_m=(-0.06, -0.015, 0.015, 0.06)),
    "thrust_lag": _row(lag_s=(0.3, 1.5)),
    "thrust_scale": _row(scale=(0.6, 0.75, 1.35, 1.6)),
    "throttle_scale": _row(scale=(0.6, 0.75, 1.35, 1.6)),
    "thrust_lapse": _row(scale=(0.95, 1.05), k=(0.5, 1.0)),
    "slipstream": _row(k=(1.5, 4.0)),
    "cg_shift": _row(aft_chords=(0.02, 0.06)),
    "mass_error": _row("payload", factor=(1.15, 1.5)),
    "drag_increment": _row(CD=(0.02, 0.06)),
    "alpha_dot": _row("wake_lag", Cm_alphadot=(-14.0, -6.0)),
    "pitch_damper": _row(gain_s=(0.08, 0.3)),
    "washed_pitch_damper": _row("pitch_damper", gain_s=(0.1, 0.3), washout_rad_s=(0.5, 1.0)),
    "filtered_pitch_damper": _row("pitch_damper", gain_s=(0.1, 0.3), lag_s=(0.05, 0.12)),
    "stall": _row("stall_hysteresis", alpha_rad=(0.11, 0.15), sharpness=(12.0, 30.0), CD=(0.01, 0.03)),
    "nonlinear_lift": _row(CL_alpha2=(-8.0, -3.0)),
    "curved_moment": _row(Cm_alpha2=(-1.5, -0.5)),
    "speed_effectiveness": _row(k=(-1.2, -0.4, 0.4, 1.2), curve=(-0.1, 0.1)),
    "elevator_mode": _row(f_hz=(3.0, 8.0), Cm_eta=(0.1, 0.3)),
    "alpha_scale": _row(scale=(0.8, 0.9, 1.1, 1.25)),
    "alpha_lag": _row(lag_s=(0.06, 0.25)),
    "q_scale": _row(scale=(0.8, 0.93, 1.07, 1.25)),
    "theta_delay": _row(delay_s=(0.05, 0.2)),
    "V_lag": _row(lag_s=(0.2, 0.9)),
    "V_scale": _row(scale=(0.8, 0.9, 1.1, 1.25)),
    "az_position": _row(ahead_m=(-0.5, -0.15, 0.15, 0.5)),
    "gust": _row(amplitude_m_s=(-4.0, -1.5, 1.5, 4.0), start_s=(1.0, 4.0), duration_s=(0.6, 2.0)),
}


def right_names(effect: str) -> tuple[str, ...]:
    """Return the names that are right where an effect is hidden, its own first."""
    return effect, *(KINDS[effect].also if effect in KINDS else ())


def draw_sizes(effect: Effect, rng: np.random.Generator) -> dict[str, float]:
    """Return a value (SI) of every parameter of an effect, by its row or about one that the library starts from."""
    row, out = KINDS.get(effect.name, Kind({})).sizes, {}
    for p in effect.parameters:
        if p.name not in row:
            zero, start = p.none or 0.0, float(rng.choice(p.starts))
            x = zero + float(rng.uniform(*_ABOUT)) * (start - zero)
        else:
            ranges = row[p.name]
            low, high = ranges[:2] if len(ranges) == 2 or rng.random() < 0.5 else ranges[2:]
            x = float(rng.uniform(low, high))
        out[p.name] = min(max(x, p.low), p.high)
    return out
