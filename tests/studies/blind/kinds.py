"""The kinds of hidden truth that are drawn: the names that are right, how sizes are drawn, and which sizes compare.

What flies under a name is made by :mod:`.truths`. The names that are right are strings,
compared with what the workflow says only when a case is scored.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Kind:
    """One kind of hidden truth.

    Attributes:
        form: "library" (the library's own mathematics), "other" (another form of one of its effects) or "unseen".
        names: names that are right; the first one is the effect itself.
        draw: sizes from a generator.
        size: (own size -> parameter of the library's effect) for the comparison of sizes.
        near: for "unseen", whether it resembles an effect of the library.
    """

    form: str
    names: tuple[str, ...]
    draw: Draw
    size: tuple[str, str] | None = None
    near: bool = False


def between(**ranges: tuple[float, float]) -> Draw:
    """Return a draw of every size, log-uniform between bounds; one whose name ends in ``_`` gets a random sign."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        out = {}
        for name, (low, high) in ranges.items():
            x = float(math.exp(rng.uniform(math.log(low), math.log(high))))
            out[name.rstrip("_")] = x * (float(rng.choice([-1.0, 1.0])) if name.endswith("_") else 1.0)
        return out

    return draw


def either(**ranges: tuple[float, float, float, float]) -> Draw:
    """Return a draw of every size from one of two intervals."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        return {n: float(rng.uniform(*(r[:2] if rng.random() < 0.5 else r[2:]))) for n, r in ranges.items()}

    return draw


def kind(form: str, names: str, draw: Draw, size: str = "", near: bool = False) -> Kind:
    """Return a kind; ``names`` with spaces between them, ``size`` as "own" or "own -> parameter of the library"."""
    own, _, parameter = size.partition(" -> ")
    return Kind(form, tuple(names.split()), draw, (own, parameter or own) if own else None, near)


# --- one aircraft, elevator and throttle ------------------------------------------------------------------------------

# Hidden truths in the library's own mathematics.
LIBRARY_FORM: Mapping[str, Kind] = {
    "slow servo": kind("library", "actuator_lag", between(lag_rad_s=(7.0, 22.0)), "lag_rad_s"),
    "servo of second order": kind(
        "library", "second_order_actuator", between(omega_rad_s=(10.0, 30.0), zeta=(0.4, 1.1)), "omega_rad_s"
    ),
    "slew limit": kind("library", "rate_limit", between(limit_rad_s=(0.12, 0.35)), "limit_rad_s"),
    "two slew limits": kind(
        "library", "asymmetric_rate_limit", between(down_rad_s=(0.2, 0.28), up_rad_s=(0.35, 0.55)), "down_rad_s"
    ),
    "late link": kind("library", "transport_delay", between(delay_s=(0.03, 0.12)), "delay_s"),
    "play": kind("library", "free_play", between(width_rad=(0.012, 0.035)), "width_rad"),
    "sleepy servo": kind("library", "dead_band", between(half_rad=(0.005, 0.015)), "half_rad -> half_width_rad"),
    "linkage ratio": kind("library", "surface_scale", either(gain=(0.45, 0.65, 1.3, 1.5)), "gain -> scale"),
    "high thrust": kind("library", "thrust_line", between(z_m_=(0.015, 0.06)), "z_m"),
    "slow motor": kind("library", "thrust_lag", between(lag_s=(0.3, 1.5)), "lag_s"),
    "slipstream": kind("library", "slipstream", between(k=(1.5, 4.0)), "k"),
    "shifted centre of gravity": kind("library", "cg_shift", between(aft_chords_=(0.02, 0.06)), "aft_chords"),
    "ballast": kind("library", "mass_error payload", between(ratio=(0.15, 0.5))),
    "roughness": kind("library", "drag_increment", between(CD0=(0.02, 0.06)), "CD0 -> CD"),
    "alpha-dot moment": kind(
        "library", "alpha_dot wake_lag", either(cm=(-14.0, -6.0, -14.0, -6.0)), "cm -> Cm_alphadot"
    ),
    "rate feedback": kind("library", "pitch_damper", between(gain_s=(0.08, 0.3)), "gain_s"),
    "damper with washout": kind("library", "washed_pitch_damper pitch_damper", between(gain_s=(0.1, 0.3)), "gain_s"),
    "separation": kind(
        "library", "stall stall_hysteresis", between(alpha_rad=(0.11, 0.15), sharpness=(12.0, 30.0)), "alpha_rad"
    ),
    "bent lift line": kind("library", "nonlinear_lift", between(curve_=(3.0, 8.0)), "curve -> CL_alpha2"),
    "effectiveness with speed": kind("library", "speed_effectiveness", between(k_=(0.4, 1.2)), "k"),
    "boom": kind("library", "elevator_mode", between(f_hz=(3.0, 8.0), Cm_=(0.1, 0.3)), "f_hz"),
    "vane gain": kind("library", "alpha_scale", either(gain=(0.8, 0.9, 1.1, 1.25)), "gain -> scale"),
    "vane lag": kind("library", "alpha_lag", between(lag_s=(0.06, 0.25)), "lag_s"),
    "gyro gain": kind("library", "q_scale", either(gain=(0.8, 0.93, 1.07, 1.25)), "gain -> scale"),
    "late attitude": kind("library", "theta_delay", between(delay_s=(0.05, 0.2)), "delay_s"),
    "airspeed lag": kind("library", "V_lag", between(lag_s=(0.2, 0.9)), "lag_s"),
    "accelerometer ahead": kind("library", "az_position", between(ahead_m_=(0.15, 0.5)), "ahead_m"),
    "stronger motor": kind("library", "thrust_scale", either(gain=(0.6, 0.75, 1.35, 1.6)), "gain -> scale"),
    "moment curved in alpha": kind("library", "curved_moment", between(curve_=(0.5, 1.5))),
    "gust": kind(
        "library", "gust", between(amplitude_=(1.5, 4.0), duration_s=(0.6, 2.0)), "amplitude -> amplitude_m_s"
    ),
}
# Hidden truths in other forms of the library's effects.
OTHER_FORM: Mapping[str, Kind] = {
    "servo of two stages": kind("other", "second_order_actuator actuator_lag", between(lag_rad_s=(15.0, 35.0))),
    "servo of three stages": kind(
        "other", "delayed_servo second_order_actuator actuator_lag", between(lag_rad_s=(25.0, 50.0))
    ),
    "soft slew limit": kind(
        "other", "rate_limit asymmetric_rate_limit", between(limit_rad_s=(0.12, 0.35)), "limit_rad_s"
    ),
    "link with jitter": kind("other", "transport_delay", between(delay_s=(0.04, 0.12)), "delay_s"),
    "soft play": kind("other", "free_play creeping_free_play dead_band", between(width_rad=(0.015, 0.04))),
    "linkage that loses": kind("other", "surface_scale", either(gain=(0.45, 0.6, 1.3, 1.5)), "gain -> scale"),
    "high and tilted thrust": kind("other", "thrust_line", between(z_m_=(0.02, 0.06)), "z_m"),
    "motor of two times": kind("other", "thrust_lag second_order_thrust_lag", between(lag_s=(0.4, 1.5)), "lag_s"),
    "motor of two stages": kind("other", "thrust_lag second_order_thrust_lag", between(lag_s=(0.4, 1.5)), "lag_s"),
    "slipstream by momentum": kind(
        "other", "slipstream elevator_slipstream", between(share=(0.3, 0.8), power=(0.8, 1.0))
    ),
    "thrust that falls with speed": kind("other", "thrust_lapse", between(k=(0.5, 1.0))),
    "load off the centre": kind("other", "payload mass_error", between(ratio=(0.15, 0.4), aft=(0.02, 0.06))),
    "open door": kind("other", "drag_increment", between(CD0=(0.02, 0.06)), "CD0 -> CD"),
    "late wake": kind("other", "wake_lag alpha_dot", between(time_s=(0.1, 0.3), Cm=(0.5, 1.2))),
    "damper that filters": kind("other", "filtered_pitch_damper pitch_damper", between(gain_s=(0.1, 0.3)), "gain_s"),
    "sigmoid stall": kind(
        "other", "stall stall_hysteresis", between(alpha_rad=(0.10, 0.13), slope=(60.0, 120.0), loss=(0.4, 0.7))
    ),
    "tail that twists": kind("other", "speed_effectiveness", between(k=(0.6, 1.5))),
    "flexible wings": kind("other", "wing_bending wing_torsion", between()),
    "vane of second order": kind("other", "alpha_lag alpha_delay", between(omega_rad_s=(6.0, 14.0))),
    "vane with a bent scale": kind("other", "alpha_scale", either(gain=(0.75, 0.88, 1.12, 1.3)), "gain -> scale"),
    "airspeed with a bent scale": kind("other", "V_scale", either(gain=(0.8, 0.9, 1.1, 1.25)), "gain -> scale"),
}
# Hidden truths that the library does not hold, near and far.
UNSEEN: Mapping[str, Kind] = {
    "sticky vane": kind("unseen", "", between(width_rad=(0.015, 0.04)), near=True),
    "coarse command": kind("unseen", "", between(step_rad=(0.015, 0.03)), near=True),
    "lift of the thrust": kind("unseen", "", between(lift=(0.3, 0.8)), near=True),
    "motor with a bent curve": kind("unseen", "", between(bend_=(0.3, 0.6)), near=True),
    "elevator that fades": kind("unseen", "", between(loss=(0.05, 0.15)), near=True),
    "damping curved in alpha": kind("unseen", "", between(k_=(0.5, 1.2)), near=True),
    "gyro that saturates on one side": kind("unseen", "", between(most_rad_s=(0.05, 0.09)), near=True),
    "stuck link": kind("unseen", "", between(length_s=(0.3, 0.8))),
    "vibration": kind("unseen", "", between(amplitude=(0.3, 1.0), f_hz=(6.0, 20.0))),
    "frozen attitude": kind("unseen", "", between(length_s=(0.5, 1.5))),
    "wandering attitude": kind("unseen", "", between(amplitude_rad=(0.01, 0.04))),
}
KINDS: Mapping[str, Kind] = {**LIBRARY_FORM, **OTHER_FORM, **UNSEEN}


# --- what is believed of coefficients ---------------------------------------------------------------------------------

# Standard deviations by which the believed coefficients are off in every case (the priors that the workflow states).
PARAMETER_ERRORS = {"CL_alpha": 0.05, "CD": 0.10, "Cm_alpha": 0.10, "Cm_q": 0.15, "Cm_de": 0.10}


def parameter_errors(rng: np.random.Generator) -> dict[str, float]:
    """Return a factor per coefficient: normal about 1, cut at two standard deviations."""
    return {n: 1.0 + s * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for n, s in PARAMETER_ERRORS.items()}
