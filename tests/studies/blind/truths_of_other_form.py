"""Hidden truths of the blind test in other forms of the library's effects.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Mapping

from studies.blind import forms, servos
from studies.blind.flights import SPEEDS_M_S, Plan
from studies.blind.kinds import Kind, between, either, kind, link, servo

from testbench.aircraft import SetText

OTHER_FORM: Mapping[str, Kind] = {
    "servo of two stages": kind(
        "other",
        "second_order_actuator actuator_lag",
        between(lag_rad_s=(15.0, 35.0)),
        servo(lambda s, a: servos.stages(s["lag_rad_s"], 2)),
    ),
    "servo of three stages": kind(
        "other",
        "delayed_servo second_order_actuator actuator_lag",
        between(lag_rad_s=(25.0, 50.0)),
        servo(lambda s, a: servos.stages(s["lag_rad_s"], 3)),
    ),
    "soft slew limit": kind(
        "other",
        "rate_limit asymmetric_rate_limit",
        between(limit_rad_s=(0.12, 0.35)),
        servo(lambda s, a: servos.slewing(forms.SERVO_LAG[a], s["limit_rad_s"], s["limit_rad_s"], True)),
        "limit_rad_s",
    ),
    "link with jitter": kind(
        "other",
        "transport_delay",
        between(delay_s=(0.04, 0.12)),
        link(lambda s: servos.late(s["delay_s"], 0.3, 5)),
        "delay_s",
    ),
    "soft play": kind(
        "other",
        "free_play creeping_free_play dead_band",
        between(width_rad=(0.015, 0.04)),
        servo(lambda s, a: servos.after_lag(forms.SERVO_LAG[a], servos.soft_play(s["width_rad"]))),
    ),
    "linkage that loses": kind(
        "other",
        "surface_scale",
        either(gain=(0.45, 0.6, 1.3, 1.5)),
        link(lambda s: servos.scaled(s["gain"], 0.08)),
        "gain -> scale",
    ),
    "high and tilted thrust": kind(
        "other",
        "thrust_line",
        between(z_m_=(0.02, 0.06)),
        lambda s, a: Plan(
            changes=(
                SetText("propulsion/engine/thruster/location/z", s["z_m"]),
                SetText("propulsion/engine/thruster/orient/pitch", 2.0),
            )
        ),
        "z_m",
    ),
    "motor of two times": kind(
        "other",
        "thrust_lag second_order_thrust_lag",
        between(lag_s=(0.4, 1.5)),
        lambda s, a: Plan(throttle=servos.motor(s["lag_s"], 1.5 * s["lag_s"])),
        "lag_s",
    ),
    "motor of two stages": kind(
        "other",
        "thrust_lag second_order_thrust_lag",
        between(lag_s=(0.4, 1.5)),
        lambda s, a: Plan(throttle=servos.motor(s["lag_s"], s["lag_s"], 2)),
        "lag_s",
    ),
    "slipstream by momentum": kind(
        "other",
        "slipstream elevator_slipstream",
        between(share=(0.3, 0.8), power=(0.8, 1.0)),
        forms.momentum_slipstream,
    ),
    "thrust that falls with speed": kind("other", "thrust_lapse", between(k=(0.5, 1.0)), forms.fading_thrust),
    "load off the centre": kind(
        "other",
        "payload mass_error",
        between(ratio=(0.15, 0.4), aft=(0.02, 0.06)),
        lambda s, a: forms.with_moved_accelerometers(
            forms.load(s["ratio"] * forms.number_of(a, "mass_kg"), -s["aft"] * forms.number_of(a, "cbar_m")),
            -s["ratio"] / (1.0 + s["ratio"]) * s["aft"] * forms.number_of(a, "cbar_m"),
        ),
    ),
    "open door": kind(
        "other",
        "drag_increment",
        between(CD0=(0.02, 0.06)),
        lambda s, a: Plan(
            changes=(
                forms.coefficient("DRAG", forms.number(s["CD0"])),
                forms.coefficient("PITCH", forms.number(0.1 * s["CD0"])),
            )
        ),
        "CD0 -> CD",
    ),
    "late wake": kind("other", "wake_lag alpha_dot", between(time_s=(0.1, 0.3), Cm=(0.5, 1.2)), forms.wake),
    "damper that filters": kind(
        "other", "filtered_pitch_damper pitch_damper", between(gain_s=(0.1, 0.3)), forms.filtered_damper, "gain_s"
    ),
    "sigmoid stall": kind(
        "other",
        "stall stall_hysteresis",
        between(alpha_rad=(0.10, 0.13), slope=(60.0, 120.0), loss=(0.4, 0.7)),
        forms.sigmoid_stall,
    ),
    "tail that twists": kind("other", "speed_effectiveness", between(k=(0.6, 1.5)), forms.aeroelastic_tail),
    "flexible wings": kind("other", "wing_bending wing_torsion", between(), lambda s, a: Plan(flexible=True)),
    "vane of second order": kind("other", "alpha_lag alpha_delay", between(omega_rad_s=(6.0, 14.0)), forms.vane),
    "vane with a bent scale": kind(
        "other",
        "alpha_scale",
        either(gain=(0.75, 0.88, 1.12, 1.3)),
        lambda s, a: forms.calibrated("alpha", 0.065, s),
        "gain -> scale",
    ),
    "airspeed with a bent scale": kind(
        "other",
        "V_scale",
        either(gain=(0.8, 0.9, 1.1, 1.25)),
        lambda s, a: forms.calibrated("V", SPEEDS_M_S[a], s),
        "gain -> scale",
    ),
}
