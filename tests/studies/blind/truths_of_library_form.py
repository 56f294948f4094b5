"""Hidden truths of the blind test in the library's own mathematics.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from studies.blind import forms, servos
from studies.blind.flights import Plan
from studies.blind.kinds import Kind, between, either, kind, link, servo

from testbench.aircraft import SetProperty, SetText
from testbench.flight.air import Gust

_Q_HAT = (forms.prop(forms.ALPHA_DOT), forms.prop("aero/ci2vel"))
LIBRARY_FORM: Mapping[str, Kind] = {
    "slow servo": kind(
        "library",
        "actuator_lag",
        between(lag_rad_s=(7.0, 22.0)),
        lambda s, a: Plan(changes=(SetProperty("fcs/elevator-lag-rad_sec", s["lag_rad_s"]),)),
        "lag_rad_s",
    ),
    "servo of second order": kind(
        "library",
        "second_order_actuator",
        between(omega_rad_s=(10.0, 30.0), zeta=(0.4, 1.1)),
        servo(lambda s, a: servos.sprung(s["omega_rad_s"], s["zeta"])),
        "omega_rad_s",
    ),
    "slew limit": kind(
        "library",
        "rate_limit",
        between(limit_rad_s=(0.12, 0.35)),
        lambda s, a: Plan(changes=(SetProperty("fcs/elevator-rate-limit-rad_sec", s["limit_rad_s"]),)),
        "limit_rad_s",
    ),
    "two slew limits": kind(
        "library",
        "asymmetric_rate_limit",
        between(down_rad_s=(0.2, 0.28), up_rad_s=(0.35, 0.55)),
        servo(lambda s, a: servos.slewing(forms.SERVO_LAG[a], s["down_rad_s"], s["up_rad_s"], False)),
        "down_rad_s",
    ),
    "late link": kind(
        "library",
        "transport_delay",
        between(delay_s=(0.03, 0.12)),
        link(lambda s: servos.late(s["delay_s"])),
        "delay_s",
    ),
    "play": kind(
        "library",
        "free_play",
        between(width_rad=(0.012, 0.035)),
        servo(lambda s, a: servos.after_lag(forms.SERVO_LAG[a], servos.backlash(s["width_rad"]))),
        "width_rad",
    ),
    "sleepy servo": kind(
        "library",
        "dead_band",
        between(half_rad=(0.005, 0.015)),
        servo(lambda s, a: servos.reluctant(forms.SERVO_LAG[a], s["half_rad"])),
        "half_rad -> half_width_rad",
    ),
    "linkage ratio": kind(
        "library",
        "surface_scale",
        either(gain=(0.45, 0.65, 1.3, 1.5)),
        link(lambda s: servos.scaled(s["gain"])),
        "gain -> scale",
    ),
    "high thrust": kind(
        "library",
        "thrust_line",
        between(z_m_=(0.015, 0.06)),
        lambda s, a: Plan(changes=(SetText("propulsion/engine/thruster/location/z", s["z_m"]),)),
        "z_m",
    ),
    "slow motor": kind(
        "library",
        "thrust_lag",
        between(lag_s=(0.3, 1.5)),
        lambda s, a: Plan(throttle=servos.motor(s["lag_s"], s["lag_s"])),
        "lag_s",
    ),
    "slipstream": kind("library", "slipstream", between(k=(1.5, 4.0)), forms.library_slipstream, "k"),
    "shifted centre of gravity": kind(
        "library",
        "cg_shift",
        between(aft_chords_=(0.02, 0.06)),
        lambda s, a: forms.shifted(-abs(s["aft_chords"]), a),
        "aft_chords",
    ),
    "ballast": kind(
        "library",
        "mass_error payload",
        between(ratio=(0.15, 0.5)),
        lambda s, a: forms.load(s["ratio"] * forms.number_of(a, "mass_kg"), 0.0),
    ),
    "roughness": kind(
        "library",
        "drag_increment",
        between(CD0=(0.02, 0.06)),
        lambda s, a: Plan(changes=(forms.coefficient("DRAG", forms.number(s["CD0"])),)),
        "CD0 -> CD",
    ),
    "alpha-dot moment": kind(
        "library",
        "alpha_dot wake_lag",
        either(cm=(-14.0, -6.0, -14.0, -6.0)),
        lambda s, a: Plan(changes=(forms.coefficient("PITCH", forms.number(s["cm"]), *_Q_HAT),)),
        "cm -> Cm_alphadot",
    ),
    "rate feedback": kind(
        "library",
        "pitch_damper",
        between(gain_s=(0.08, 0.3)),
        lambda s, a: Plan(changes=(forms.feedback(s["gain_s"], a, "velocities/q-rad_sec"),)),
        "gain_s",
    ),
    "damper with washout": kind(
        "library", "washed_pitch_damper pitch_damper", between(gain_s=(0.1, 0.3)), forms.washed_damper, "gain_s"
    ),
    "separation": kind(
        "library",
        "stall stall_hysteresis",
        between(alpha_rad=(0.11, 0.15), sharpness=(12.0, 30.0)),
        forms.separation,
        "alpha_rad",
    ),
    "bent lift line": kind(
        "library",
        "nonlinear_lift",
        between(curve_=(3.0, 8.0)),
        lambda s, a: Plan(
            changes=(
                forms.coefficient(
                    "LIFT", forms.number(-abs(s["curve"])), forms.prop(forms.ALPHA), forms.prop(forms.ALPHA)
                ),
            )
        ),
        "curve -> CL_alpha2",
    ),
    "effectiveness with speed": kind("library", "speed_effectiveness", between(k_=(0.4, 1.2)), forms.speed_power, "k"),
    "boom": kind("library", "elevator_mode", between(f_hz=(3.0, 8.0), Cm_=(0.1, 0.3)), forms.boom, "f_hz"),
    "vane gain": kind(
        "library",
        "alpha_scale",
        either(gain=(0.8, 0.9, 1.1, 1.25)),
        lambda s, a: forms.sensor("alpha", lambda r: replace(r, scale=r.scale * s["gain"])),
        "gain -> scale",
    ),
    "vane lag": kind(
        "library",
        "alpha_lag",
        between(lag_s=(0.06, 0.25)),
        lambda s, a: forms.sensor("alpha", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
        "lag_s",
    ),
    "gyro gain": kind(
        "library",
        "q_scale",
        either(gain=(0.8, 0.93, 1.07, 1.25)),
        lambda s, a: forms.sensor("q", lambda r: replace(r, scale=s["gain"])),
        "gain -> scale",
    ),
    "late attitude": kind(
        "library",
        "theta_delay",
        between(delay_s=(0.05, 0.2)),
        lambda s, a: forms.sensor("theta", lambda r: replace(r, delay_s=s["delay_s"])),
        "delay_s",
    ),
    "airspeed lag": kind(
        "library",
        "V_lag",
        between(lag_s=(0.2, 0.9)),
        lambda s, a: forms.sensor("V", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
        "lag_s",
    ),
    "accelerometer ahead": kind(
        "library",
        "az_position",
        between(ahead_m_=(0.15, 0.5)),
        lambda s, a: forms.sensor("az", lambda r: replace(r, position_m=(s["ahead_m"], 0.0, 0.0))),
        "ahead_m",
    ),
    "stronger motor": kind(
        "library",
        "thrust_scale",
        either(gain=(0.6, 0.75, 1.35, 1.6)),
        lambda s, a: Plan(throttle=servos.scaled(s["gain"])),
        "gain -> scale",
    ),
    "moment curved in alpha": kind(
        "library",
        "curved_moment",
        between(curve_=(0.5, 1.5)),
        lambda s, a: Plan(
            changes=(
                forms.coefficient(
                    "PITCH", forms.number(-abs(s["curve"])), forms.prop(forms.ALPHA), forms.prop(forms.ALPHA)
                ),
            )
        ),
    ),
    "gust": kind(
        "library",
        "gust",
        between(amplitude_=(1.5, 4.0), duration_s=(0.6, 2.0)),
        lambda s, a: Plan(gust=Gust("down", s["amplitude"], 4.0, s["duration_s"])),
        "amplitude -> amplitude_m_s",
    ),
}
