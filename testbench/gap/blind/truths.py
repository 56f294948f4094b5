"""Hidden truths of the blind test: what each kind of truth changes, and from which range its size is drawn.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py). The names that a
truth may rightly be given are strings here, compared with what the workflow says only when a case is scored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testbench.aircraft import SetProperty, SetText
from testbench.flight.air import Gust
from testbench.gap.blind import forms, servos
from testbench.gap.blind.flights import Plan
from testbench.gap.blind.forms import Size

Draw = Callable[[np.random.Generator], dict[str, float]]


@dataclass(frozen=True)
class Kind:
    """One kind of hidden truth.

    Attributes:
        form: "library" (the library's own mathematics), "other" (another form of one of its effects) or "unseen".
        names: names that are right; the first one is the effect itself.
        draw: sizes from a generator.
        plan: (sizes, aircraft) -> what flies.
        size: (own size -> parameter of the library's effect) for the comparison of sizes.
        near: for "unseen", whether it resembles an effect of the library.
    """

    form: str
    names: tuple[str, ...]
    draw: Draw
    plan: Callable[[Size, str], Plan]
    size: tuple[str, str] | None = None
    near: bool = False


def _between(**ranges: tuple[float, float]) -> Draw:
    """Return a draw of every size, log-uniform between bounds; one whose name ends in ``_`` gets a random sign."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        out = {}
        for name, (low, high) in ranges.items():
            x = float(math.exp(rng.uniform(math.log(low), math.log(high))))
            out[name.rstrip("_")] = x * (float(rng.choice([-1.0, 1.0])) if name.endswith("_") else 1.0)
        return out

    return draw


def _either(**ranges: tuple[float, float, float, float]) -> Draw:
    """Return a draw of every size from one of two intervals."""

    def draw(rng: np.random.Generator) -> dict[str, float]:
        return {n: float(rng.uniform(*(r[:2] if rng.random() < 0.5 else r[2:]))) for n, r in ranges.items()}

    return draw


def _kinds() -> dict[str, Kind]:
    def kind(
        form: str, names: str, draw: Draw, plan: Callable[[Size, str], Plan], size: str = "", near: bool = False
    ) -> Kind:
        own, _, parameter = size.partition(" -> ")
        return Kind(form, tuple(names.split()), draw, plan, (own, parameter or own) if own else None, near)

    def servo(make: Callable[[Size, str], servos.Law]) -> Callable[[Size, str], Plan]:
        return lambda s, a: Plan(elevator=make(s, a), whole_servo=True)

    def link(make: Callable[[Size], servos.Law]) -> Callable[[Size, str], Plan]:
        return lambda s, a: Plan(elevator=make(s))

    q_hat = (forms.prop(forms.ALPHA_DOT), forms.prop("aero/ci2vel"))
    return {
        # the library's own mathematics
        "slow servo": kind(
            "library",
            "actuator_lag",
            _between(lag_rad_s=(7.0, 22.0)),
            lambda s, a: Plan(changes=(SetProperty("fcs/elevator-lag-rad_sec", s["lag_rad_s"]),)),
            "lag_rad_s",
        ),
        "servo of second order": kind(
            "library",
            "second_order_actuator",
            _between(omega_rad_s=(10.0, 30.0), zeta=(0.4, 1.1)),
            servo(lambda s, a: servos.sprung(s["omega_rad_s"], s["zeta"])),
            "omega_rad_s",
        ),
        "slew limit": kind(
            "library",
            "rate_limit",
            _between(limit_rad_s=(0.12, 0.35)),
            lambda s, a: Plan(changes=(SetProperty("fcs/elevator-rate-limit-rad_sec", s["limit_rad_s"]),)),
            "limit_rad_s",
        ),
        "two slew limits": kind(
            "library",
            "asymmetric_rate_limit",
            _between(down_rad_s=(0.2, 0.28), up_rad_s=(0.35, 0.55)),
            servo(lambda s, a: servos.slewing(forms.SERVO_LAG[a], s["down_rad_s"], s["up_rad_s"], False)),
            "down_rad_s",
        ),
        "late link": kind(
            "library",
            "transport_delay",
            _between(delay_s=(0.03, 0.12)),
            link(lambda s: servos.late(s["delay_s"])),
            "delay_s",
        ),
        "play": kind(
            "library",
            "free_play",
            _between(width_rad=(0.012, 0.035)),
            servo(lambda s, a: servos.after_lag(forms.SERVO_LAG[a], servos.backlash(s["width_rad"]))),
            "width_rad",
        ),
        "sleepy servo": kind(
            "library",
            "dead_band",
            _between(half_rad=(0.005, 0.015)),
            servo(lambda s, a: servos.reluctant(forms.SERVO_LAG[a], s["half_rad"])),
            "half_rad -> half_width_rad",
        ),
        "linkage ratio": kind(
            "library",
            "surface_scale",
            _either(gain=(0.45, 0.65, 1.3, 1.5)),
            link(lambda s: servos.scaled(s["gain"])),
            "gain -> scale",
        ),
        "high thrust": kind(
            "library",
            "thrust_line",
            _between(z_m_=(0.015, 0.06)),
            lambda s, a: Plan(changes=(SetText("propulsion/engine/thruster/location/z", s["z_m"]),)),
            "z_m",
        ),
        "slow motor": kind(
            "library",
            "thrust_lag",
            _between(lag_s=(0.3, 1.5)),
            lambda s, a: Plan(throttle=servos.motor(s["lag_s"], s["lag_s"])),
            "lag_s",
        ),
        "slipstream": kind("library", "slipstream", _between(k=(1.5, 4.0)), forms.library_slipstream, "k"),
        "shifted centre of gravity": kind(
            "library",
            "cg_shift",
            _between(aft_chords_=(0.02, 0.06)),
            lambda s, a: forms.shifted(-abs(s["aft_chords"]), a),
            "aft_chords",
        ),
        "ballast": kind(
            "library",
            "mass_error payload",
            _between(ratio=(0.15, 0.5)),
            lambda s, a: forms.load(s["ratio"] * forms.number_of(a, "mass_kg"), 0.0),
        ),
        "roughness": kind(
            "library",
            "drag_increment",
            _between(CD0=(0.02, 0.06)),
            lambda s, a: Plan(changes=(forms.coefficient("DRAG", forms.number(s["CD0"])),)),
            "CD0 -> CD",
        ),
        "alpha-dot moment": kind(
            "library",
            "alpha_dot wake_lag",
            _either(cm=(-14.0, -6.0, -14.0, -6.0)),
            lambda s, a: Plan(changes=(forms.coefficient("PITCH", forms.number(s["cm"]), *q_hat),)),
            "cm -> Cm_alphadot",
        ),
        "rate feedback": kind(
            "library",
            "pitch_damper",
            _between(gain_s=(0.08, 0.3)),
            lambda s, a: Plan(changes=(forms.feedback(s["gain_s"], a, "velocities/q-rad_sec"),)),
            "gain_s",
        ),
        "damper with washout": kind(
            "library", "washed_pitch_damper pitch_damper", _between(gain_s=(0.1, 0.3)), forms.washed_damper, "gain_s"
        ),
        "separation": kind(
            "library",
            "stall stall_hysteresis",
            _between(alpha_rad=(0.11, 0.15), sharpness=(12.0, 30.0)),
            forms.separation,
            "alpha_rad",
        ),
        "bent lift line": kind(
            "library",
            "nonlinear_lift",
            _between(curve_=(3.0, 8.0)),
            lambda s, a: Plan(
                changes=(
                    forms.coefficient(
                        "LIFT", forms.number(-abs(s["curve"])), forms.prop(forms.ALPHA), forms.prop(forms.ALPHA)
                    ),
                )
            ),
            "curve -> CL_alpha2",
        ),
        "effectiveness with speed": kind(
            "library", "speed_effectiveness", _between(k_=(0.4, 1.2)), forms.speed_power, "k"
        ),
        "boom": kind("library", "elevator_mode", _between(f_hz=(3.0, 8.0), Cm_=(0.1, 0.3)), forms.boom, "f_hz"),
        "vane gain": kind(
            "library",
            "alpha_scale",
            _either(gain=(0.8, 0.9, 1.1, 1.25)),
            lambda s, a: forms.sensor("alpha", lambda r: replace(r, scale=r.scale * s["gain"])),
            "gain -> scale",
        ),
        "vane lag": kind(
            "library",
            "alpha_lag",
            _between(lag_s=(0.06, 0.25)),
            lambda s, a: forms.sensor("alpha", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
            "lag_s",
        ),
        "gyro gain": kind(
            "library",
            "q_scale",
            _either(gain=(0.8, 0.93, 1.07, 1.25)),
            lambda s, a: forms.sensor("q", lambda r: replace(r, scale=s["gain"])),
            "gain -> scale",
        ),
        "late attitude": kind(
            "library",
            "theta_delay",
            _between(delay_s=(0.05, 0.2)),
            lambda s, a: forms.sensor("theta", lambda r: replace(r, delay_s=s["delay_s"])),
            "delay_s",
        ),
        "airspeed lag": kind(
            "library",
            "V_lag",
            _between(lag_s=(0.2, 0.9)),
            lambda s, a: forms.sensor("V", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
            "lag_s",
        ),
        "accelerometer ahead": kind(
            "library",
            "az_position",
            _between(ahead_m_=(0.15, 0.5)),
            lambda s, a: forms.sensor("az", lambda r: replace(r, position_m=(s["ahead_m"], 0.0, 0.0))),
            "ahead_m",
        ),
        "stronger motor": kind(
            "library",
            "thrust_scale",
            _either(gain=(0.6, 0.75, 1.35, 1.6)),
            lambda s, a: Plan(throttle=servos.scaled(s["gain"])),
            "gain -> scale",
        ),
        "moment curved in alpha": kind(
            "library",
            "curved_moment",
            _between(curve_=(0.5, 1.5)),
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
            _between(amplitude_=(1.5, 4.0), duration_s=(0.6, 2.0)),
            lambda s, a: Plan(gust=Gust("down", s["amplitude"], 4.0, s["duration_s"])),
            "amplitude -> amplitude_m_s",
        ),
        # other forms of the library's effects
        "servo of two stages": kind(
            "other",
            "second_order_actuator actuator_lag",
            _between(lag_rad_s=(15.0, 35.0)),
            servo(lambda s, a: servos.stages(s["lag_rad_s"], 2)),
        ),
        "servo of three stages": kind(
            "other",
            "delayed_servo second_order_actuator actuator_lag",
            _between(lag_rad_s=(25.0, 50.0)),
            servo(lambda s, a: servos.stages(s["lag_rad_s"], 3)),
        ),
        "soft slew limit": kind(
            "other",
            "rate_limit asymmetric_rate_limit",
            _between(limit_rad_s=(0.12, 0.35)),
            servo(lambda s, a: servos.slewing(forms.SERVO_LAG[a], s["limit_rad_s"], s["limit_rad_s"], True)),
            "limit_rad_s",
        ),
        "link with jitter": kind(
            "other",
            "transport_delay",
            _between(delay_s=(0.04, 0.12)),
            link(lambda s: servos.late(s["delay_s"], 0.3, 5)),
            "delay_s",
        ),
        "soft play": kind(
            "other",
            "free_play creeping_free_play dead_band",
            _between(width_rad=(0.015, 0.04)),
            servo(lambda s, a: servos.after_lag(forms.SERVO_LAG[a], servos.soft_play(s["width_rad"]))),
        ),
        "linkage that loses": kind(
            "other",
            "surface_scale",
            _either(gain=(0.45, 0.6, 1.3, 1.5)),
            link(lambda s: servos.scaled(s["gain"], 0.08)),
            "gain -> scale",
        ),
        "high and tilted thrust": kind(
            "other",
            "thrust_line",
            _between(z_m_=(0.02, 0.06)),
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
            _between(lag_s=(0.4, 1.5)),
            lambda s, a: Plan(throttle=servos.motor(s["lag_s"], 1.5 * s["lag_s"])),
            "lag_s",
        ),
        "motor of two stages": kind(
            "other",
            "thrust_lag second_order_thrust_lag",
            _between(lag_s=(0.4, 1.5)),
            lambda s, a: Plan(throttle=servos.motor(s["lag_s"], s["lag_s"], 2)),
            "lag_s",
        ),
        "slipstream by momentum": kind(
            "other",
            "slipstream elevator_slipstream",
            _between(share=(0.3, 0.8), power=(0.8, 1.0)),
            forms.momentum_slipstream,
        ),
        "thrust that falls with speed": kind("other", "thrust_lapse", _between(k=(0.5, 1.0)), forms.fading_thrust),
        "load off the centre": kind(
            "other",
            "payload mass_error",
            _between(ratio=(0.15, 0.4), aft=(0.02, 0.06)),
            lambda s, a: forms.with_moved_accelerometers(
                forms.load(s["ratio"] * forms.number_of(a, "mass_kg"), -s["aft"] * forms.number_of(a, "cbar_m")),
                -s["ratio"] / (1.0 + s["ratio"]) * s["aft"] * forms.number_of(a, "cbar_m"),
            ),
        ),
        "open door": kind(
            "other",
            "drag_increment",
            _between(CD0=(0.02, 0.06)),
            lambda s, a: Plan(
                changes=(
                    forms.coefficient("DRAG", forms.number(s["CD0"])),
                    forms.coefficient("PITCH", forms.number(0.1 * s["CD0"])),
                )
            ),
            "CD0 -> CD",
        ),
        "late wake": kind("other", "wake_lag alpha_dot", _between(time_s=(0.1, 0.3), Cm=(0.5, 1.2)), forms.wake),
        "damper that filters": kind(
            "other", "filtered_pitch_damper pitch_damper", _between(gain_s=(0.1, 0.3)), forms.filtered_damper, "gain_s"
        ),
        "sigmoid stall": kind(
            "other",
            "stall stall_hysteresis",
            _between(alpha_rad=(0.10, 0.13), slope=(60.0, 120.0), loss=(0.4, 0.7)),
            forms.sigmoid_stall,
        ),
        "tail that twists": kind("other", "speed_effectiveness", _between(k=(0.6, 1.5)), forms.aeroelastic_tail),
        "flexible wings": kind("other", "wing_bending wing_torsion", _between(), lambda s, a: Plan(flexible=True)),
        "vane of second order": kind("other", "alpha_lag alpha_delay", _between(omega_rad_s=(6.0, 14.0)), forms.vane),
        "vane with a bent scale": kind(
            "other",
            "alpha_scale",
            _either(gain=(0.75, 0.88, 1.12, 1.3)),
            lambda s, a: forms.calibrated("alpha", 0.065, s),
            "gain -> scale",
        ),
        "airspeed with a bent scale": kind(
            "other",
            "V_scale",
            _either(gain=(0.8, 0.9, 1.1, 1.25)),
            lambda s, a: forms.calibrated("V", SPEED[a], s),
            "gain -> scale",
        ),
        # what the library does not hold, near and far
        "sticky vane": kind("unseen", "", _between(width_rad=(0.015, 0.04)), forms.sticky_vane, near=True),
        "coarse command": kind(
            "unseen", "", _between(step_rad=(0.015, 0.03)), link(lambda s: servos.coarse(s["step_rad"])), near=True
        ),
        "lift of the thrust": kind(
            "unseen",
            "",
            _between(lift=(0.3, 0.8)),
            lambda s, a: Plan(
                changes=(forms.coefficient("LIFT", forms.number(s["lift"]), forms.prop("fcs/throttle-cmd-norm")),)
            ),
            near=True,
        ),
        "motor with a bent curve": kind(
            "unseen", "", _between(bend_=(0.3, 0.6)), lambda s, a: Plan(throttle=servos.bent(s["bend"])), near=True
        ),
        "elevator that fades": kind("unseen", "", _between(loss=(0.05, 0.15)), forms.fading_elevator, near=True),
        "damping curved in alpha": kind("unseen", "", _between(k_=(0.5, 1.2)), forms.curved_damping, near=True),
        "gyro that saturates on one side": kind(
            "unseen",
            "",
            _between(most_rad_s=(0.05, 0.09)),
            lambda s, a: Plan(spoil=lambda n, y, t: np.minimum(y, s["most_rad_s"]) if n == "q" else y),
            near=True,
        ),
        "stuck link": kind(
            "unseen", "", _between(length_s=(0.3, 0.8)), link(lambda s: servos.stuck(0.9, s["length_s"]))
        ),
        "vibration": kind("unseen", "", _between(amplitude=(0.3, 1.0), f_hz=(6.0, 20.0)), forms.vibration),
        "frozen attitude": kind("unseen", "", _between(length_s=(0.5, 1.5)), forms.freezing),
        "wandering attitude": kind("unseen", "", _between(amplitude_rad=(0.01, 0.04)), forms.wandering),
    }


SPEED = {"eolo": 16.0, "taurus": 15.0}
KINDS = _kinds()
# Standard deviations by which the believed coefficients are off in every case (the priors that the workflow states).
PARAMETER_ERRORS = {"CL_alpha": 0.05, "CD": 0.10, "Cm_alpha": 0.10, "Cm_q": 0.15, "Cm_de": 0.10}


def parameter_errors(rng: np.random.Generator) -> dict[str, float]:
    """Return a factor per coefficient: normal about 1, cut at two standard deviations."""
    return {n: 1.0 + s * float(np.clip(rng.standard_normal(), -2.0, 2.0)) for n, s in PARAMETER_ERRORS.items()}
