"""The kinds of hidden truth that are drawn: the names that are right, how sizes are drawn, and which sizes compare.

What flies under a name is made by :mod:`.truths` and :mod:`.lateral_truths`. The names that are right are strings,
compared with what the workflow says only when a case is scored.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

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
        "library",
        "second_order_actuator",
        between(omega_rad_s=(10.0, 30.0), zeta=(0.4, 1.1)),
        "omega_rad_s",
    ),
    "slew limit": kind("library", "rate_limit", between(limit_rad_s=(0.12, 0.35)), "limit_rad_s"),
    "two slew limits": kind(
        "library",
        "asymmetric_rate_limit",
        between(down_rad_s=(0.2, 0.28), up_rad_s=(0.35, 0.55)),
        "down_rad_s",
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
        "library",
        "stall stall_hysteresis",
        between(alpha_rad=(0.11, 0.15), sharpness=(12.0, 30.0)),
        "alpha_rad",
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
        "other",
        "delayed_servo second_order_actuator actuator_lag",
        between(lag_rad_s=(25.0, 50.0)),
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
        "other",
        "stall stall_hysteresis",
        between(alpha_rad=(0.10, 0.13), slope=(60.0, 120.0), loss=(0.4, 0.7)),
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


# --- roll and yaw -----------------------------------------------------------------------------------------------------

# Hidden truths in the library's own mathematics.
_LATERAL_LIBRARY: Mapping[str, Kind] = {
    "slow aileron servo": kind("library", "aileron_lag", between(lag_rad_s=(5.0, 15.0)), "lag_rad_s"),
    "slow rudder servo": kind("library", "rudder_lag", between(lag_rad_s=(4.0, 12.0)), "lag_rad_s"),
    "late aileron link": kind("library", "aileron_transport_delay", between(delay_s=(0.05, 0.15)), "delay_s"),
    "late rudder link": kind("library", "rudder_transport_delay", between(delay_s=(0.06, 0.18)), "delay_s"),
    "aileron linkage ratio": kind(
        "library", "aileron_surface_scale", either(gain=(0.45, 0.62, 1.4, 1.6)), "gain -> scale"
    ),
    "rudder linkage ratio": kind(
        "library", "rudder_surface_scale", either(gain=(0.45, 0.62, 1.4, 1.6)), "gain -> scale"
    ),
    "roll-rate feedback": kind("library", "roll_damper", between(share=(0.5, 1.6))),
    "roll damper that filters": kind("library", "filtered_roll_damper roll_damper", between(share=(0.5, 1.6))),
    "yaw-rate feedback": kind("library", "yaw_damper", between(share=(1.2, 4.0), washout_s=(1.0, 4.0))),
    "interconnect": kind("library", "interconnect", between(ratio_=(0.3, 0.8)), "ratio"),
    "bank hold": kind("library", "bank_hold", between(time_s=(1.0, 4.0))),
    "weak bank hold": kind("library", "limited_bank_hold bank_hold", between(time_s=(1.0, 2.5))),
    "heading hold": kind("library", "heading_hold", between(omega_rad_s=(0.4, 0.9))),
    "lateral centre of gravity": kind("library", "lateral_cg", between(right_spans_=(0.01, 0.03)), "right_spans"),
    "pod under a wing": kind("library", "side_payload lateral_cg", between(ratio=(0.04, 0.12), side_=(1.0, 1.0))),
    "uneven lift": kind("library", "asymmetric_lift", between(Cl_alpha_=(0.06, 0.2)), "Cl_alpha"),
    "lost fin": kind("library", "lost_fin", between(share=(0.3, 0.5)), "share"),
    "lost wing": kind("library", "lost_wing", between(share=(0.1, 0.25), side_=(1.0, 1.0))),
    "curved weathercock": kind("library", "cubic_weathercock", between(share=(0.4, 1.0))),
    "sideslip gain": kind("library", "beta_scale", either(gain=(0.75, 0.88, 1.12, 1.3)), "gain -> scale"),
    "sideslip lag": kind("library", "beta_lag", between(lag_s=(0.06, 0.25)), "lag_s"),
    "roll gyro gain": kind("library", "p_scale", either(gain=(0.8, 0.93, 1.07, 1.25)), "gain -> scale"),
    "yaw gyro gain": kind("library", "r_scale", either(gain=(0.8, 0.93, 1.07, 1.25)), "gain -> scale"),
    "late bank angle": kind("library", "phi_delay", between(delay_s=(0.08, 0.25)), "delay_s"),
    "lateral accelerometer ahead": kind("library", "ay_position", between(ahead_m_=(0.4, 1.0)), "ahead_m"),
}
# Hidden truths in other forms of the library's effects.
_LATERAL_OTHER: Mapping[str, Kind] = {
    "aileron servo of two stages": kind(
        "other", "aileron_second_order_actuator aileron_lag", between(lag_rad_s=(10.0, 22.0))
    ),
    "rudder servo of two stages": kind(
        "other", "rudder_second_order_actuator rudder_lag", between(lag_rad_s=(8.0, 18.0))
    ),
    "soft aileron slew limit": kind("other", "aileron_rate_limit", between(slew_s=(0.2, 0.5))),
    "soft rudder slew limit": kind("other", "rudder_rate_limit", between(slew_s=(0.25, 0.6))),
    "aileron link with jitter": kind("other", "aileron_transport_delay", between(delay_s=(0.06, 0.15)), "delay_s"),
    "rudder link with jitter": kind("other", "rudder_transport_delay", between(delay_s=(0.08, 0.18)), "delay_s"),
    "aileron linkage that loses": kind(
        "other", "aileron_surface_scale aileron_curved_linkage", either(gain=(0.45, 0.6, 1.4, 1.6))
    ),
    "rudder linkage that loses": kind(
        "other", "rudder_surface_scale rudder_curved_linkage", either(gain=(0.45, 0.6, 1.4, 1.6))
    ),
    "yaw damper that filters": kind("other", "filtered_yaw_damper yaw_damper", between(share=(1.2, 4.0))),
    "springy interconnect": kind("other", "interconnect late_interconnect", between(ratio_=(0.3, 0.8))),
    "uneven lift and drag": kind("other", "asymmetric_lift", between(Cl_alpha_=(0.06, 0.2)), "Cl_alpha"),
    "fin that fades": kind("other", "cubic_weathercock", between(share=(0.4, 0.9))),
    "sideslip vane of second order": kind("other", "beta_lag beta_delay", between(omega_rad_s=(5.0, 12.0))),
    "sideslip with a bent scale": kind("other", "beta_scale", either(gain=(0.75, 0.88, 1.12, 1.3)), "gain -> scale"),
    "yaw gyro with a bent scale": kind("other", "r_scale", either(gain=(0.8, 0.92, 1.08, 1.25)), "gain -> scale"),
    "bank angle of two stages": kind("other", "phi_lag phi_delay", between(lag_s=(0.1, 0.3))),
}
LATERAL_KINDS: Mapping[str, Kind] = {**_LATERAL_LIBRARY, **_LATERAL_OTHER}
PATHS = (
    # of the elevator
    "slow servo", "slew limit", "late link", "play", "linkage ratio", "rate feedback", "damper with washout",
    "servo of two stages", "soft slew limit", "link with jitter", "soft play", "linkage that loses",
    "damper that filters",
    # of aileron and rudder
    "slow aileron servo", "slow rudder servo", "late aileron link", "late rudder link", "aileron linkage ratio",
    "rudder linkage ratio", "roll-rate feedback", "roll damper that filters", "yaw-rate feedback", "interconnect",
    "bank hold", "weak bank hold", "heading hold", "aileron servo of two stages", "rudder servo of two stages",
    "soft aileron slew limit", "soft rudder slew limit", "aileron link with jitter", "rudder link with jitter",
    "aileron linkage that loses", "rudder linkage that loses", "yaw damper that filters", "springy interconnect",
)  # fmt: skip
PATH_KINDS: Mapping[str, Kind] = {n: (KINDS | LATERAL_KINDS)[n] for n in PATHS}
"""Kinds that act in the path of one control."""


# --- what grows with time ---------------------------------------------------------------------------------------------

_GYROS = {"p": "roll", "q": "pitch", "r": "yaw"}
OVER_TIME_KINDS: Mapping[str, Kind] = {
    "battery that empties": kind("library", "thrust_fade", between(per_min=(0.006, 0.02)), "per_min"),
    "fuel that burns": kind("library", "fuel_burn", between(per_min=(0.003, 0.01)), "per_min"),
    **{
        f"{word} gyro that drifts": kind(
            "library", f"{c}_drift", between(per_s_=(0.0006, 0.003)), "per_s -> drift_per_s"
        )
        for c, word in _GYROS.items()
    },
    "airspeed that drifts": kind("library", "V_drift", between(per_s_=(0.03, 0.12)), "per_s -> drift_per_s"),
    "tank ahead that empties": kind(
        "library", "tank_burn fuel_burn", between(ratio=(0.1, 0.25), ahead_chords_=(0.05, 0.3))
    ),
    "battery that droops": kind("other", "thrust_fade uneven_thrust_fade", between(lost=(0.2, 0.5))),
    "thirsty climb": kind("other", "fuel_burn uneven_fuel_burn", between(ratio=(0.1, 0.25))),
    **{
        f"{word} gyro that warms up": kind("other", f"{c}_drift", between(per_s_=(0.0008, 0.004)))
        for c, word in _GYROS.items()
    },
    "airspeed port that ices": kind("other", "V_drift", between(per_s_=(0.03, 0.12))),
}


# --- any aircraft -----------------------------------------------------------------------------------------------------

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
    **{n: KINDS[n] for n in _GAINS},
    **{n: LATERAL_KINDS[n] for n in _LATERAL_GAINS},
    **_TIMES,
}


# --- what is believed of coefficients ---------------------------------------------------------------------------------

# Standard deviations by which the believed coefficients are off in every case (the priors that the workflow states).
PARAMETER_ERRORS = {"CL_alpha": 0.05, "CD": 0.10, "Cm_alpha": 0.10, "Cm_q": 0.15, "Cm_de": 0.10}
LATERAL_ERRORS = {
    **PARAMETER_ERRORS,
    "CY_beta": 0.15,
    "Cl_beta": 0.15,
    "Cl_p": 0.10,
    "Cl_r": 0.20,
    "Cl_da": 0.10,
    "Cn_beta": 0.15,
    "Cn_p": 0.30,
    "Cn_r": 0.20,
    "Cn_da": 0.30,
    "Cn_dr": 0.10,
}


def parameter_errors(rng: np.random.Generator, deviations: Mapping[str, float] = PARAMETER_ERRORS) -> dict[str, float]:
    """Return a factor per coefficient: normal about 1, cut at two standard deviations."""
    return {n: 1.0 + s * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for n, s in deviations.items()}
