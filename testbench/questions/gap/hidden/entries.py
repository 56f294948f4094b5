"""Every kind of hidden truth by name: (sizes, aircraft) -> what flies.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from testbench.aircraft import SetProperty, SetText
from testbench.flight.air import Gust
from testbench.questions.gap.hidden import servos
from testbench.questions.gap.hidden.aerodynamics import (
    aeroelastic_tail,
    curved_damping,
    fading_elevator,
    fading_thrust,
    library_slipstream,
    momentum_slipstream,
    separation,
    sigmoid_stall,
    speed_power,
    wake,
)
from testbench.questions.gap.hidden.aircraft import ELEVATOR_FULL, SERVO_LAG, SPEEDS_M_S, number_of
from testbench.questions.gap.hidden.boom import boom
from testbench.questions.gap.hidden.feedback import filtered_damper, pitch_feedback, washed_damper
from testbench.questions.gap.hidden.mass import load, shifted, with_moved_accelerometers
from testbench.questions.gap.hidden.readings import (
    calibrated,
    freezing,
    sensor,
    sticky_vane,
    vane,
    vibration,
    wandering,
)
from testbench.questions.gap.hidden.terms import ALPHA, ALPHA_DOT, coefficient, number, prop
from testbench.questions.gap.hidden.truth import Law, Size, Truth

Make = Callable[[Size, str], Truth]
_Q_HAT = (prop(ALPHA_DOT), prop("aero/ci2vel"))


def servo(make: Callable[[Size, str], Law]) -> Make:
    """Return what flies with another elevator servo in place of the believed one."""
    return lambda s, a: Truth(elevator=make(s, a), whole_servo=True)


def link(make: Callable[[Size], Law]) -> Make:
    """Return what flies with something between elevator command and servo."""
    return lambda s, a: Truth(elevator=make(s))


TRUTHS: Mapping[str, Make] = {
    "slow servo": lambda s, a: Truth(changes=(SetProperty("fcs/elevator-lag-rad_sec", s["lag_rad_s"]),)),
    "servo of second order": servo(lambda s, a: servos.sprung(s["omega_rad_s"], s["zeta"])),
    "slew limit": lambda s, a: Truth(changes=(SetProperty("fcs/elevator-rate-limit-rad_sec", s["limit_rad_s"]),)),
    "two slew limits": servo(lambda s, a: servos.slewing(SERVO_LAG[a], s["down_rad_s"], s["up_rad_s"], False)),
    "late link": link(lambda s: servos.late(s["delay_s"])),
    "play": servo(lambda s, a: servos.after_lag(SERVO_LAG[a], servos.backlash(s["width_rad"]))),
    "sleepy servo": servo(lambda s, a: servos.reluctant(SERVO_LAG[a], s["half_rad"])),
    "linkage ratio": link(lambda s: servos.scaled(s["gain"])),
    "high thrust": lambda s, a: Truth(changes=(SetText("propulsion/engine/thruster/location/z", s["z_m"]),)),
    "slow motor": lambda s, a: Truth(throttle=servos.motor(s["lag_s"], s["lag_s"])),
    "slipstream": library_slipstream,
    "shifted centre of gravity": lambda s, a: shifted(-abs(s["aft_chords"]) * number_of(a, "cbar_m")),
    "ballast": lambda s, a: load(s["ratio"] * number_of(a, "mass_kg"), 0.0),
    "roughness": lambda s, a: Truth(changes=(coefficient("DRAG", number(s["CD0"])),)),
    "alpha-dot moment": lambda s, a: Truth(changes=(coefficient("PITCH", number(s["cm"]), *_Q_HAT),)),
    "rate feedback": lambda s, a: Truth(
        changes=(pitch_feedback(s["gain_s"], ELEVATOR_FULL[a], "velocities/q-rad_sec"),)
    ),
    "damper with washout": washed_damper,
    "separation": separation,
    "bent lift line": lambda s, a: Truth(
        changes=(coefficient("LIFT", number(-abs(s["curve"])), prop(ALPHA), prop(ALPHA)),)
    ),
    "effectiveness with speed": speed_power,
    "boom": boom,
    "vane gain": lambda s, a: sensor("alpha", lambda r: replace(r, scale=r.scale * s["gain"])),
    "vane lag": lambda s, a: sensor("alpha", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
    "gyro gain": lambda s, a: sensor("q", lambda r: replace(r, scale=s["gain"])),
    "late attitude": lambda s, a: sensor("theta", lambda r: replace(r, delay_s=s["delay_s"])),
    "airspeed lag": lambda s, a: sensor("V", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
    "accelerometer ahead": lambda s, a: sensor("az", lambda r: replace(r, position_m=(s["ahead_m"], 0.0, 0.0))),
    "stronger motor": lambda s, a: Truth(throttle=servos.scaled(s["gain"])),
    "battery that empties": lambda s, a: Truth(
        later=lambda at_s: Truth(throttle=servos.scaled(1.0 - s["per_min"] * at_s / 60.0))
    ),
    "fuel that burns": lambda s, a: Truth(
        later=lambda at_s: load(-s["per_min"] * at_s / 60.0 * number_of(a, "mass_kg"), 0.0)
    ),
    "moment curved in alpha": lambda s, a: Truth(
        changes=(coefficient("PITCH", number(-abs(s["curve"])), prop(ALPHA), prop(ALPHA)),)
    ),
    "gust": lambda s, a: Truth(gust=Gust("down", s["amplitude"], 4.0, s["duration_s"])),
    "servo of two stages": servo(lambda s, a: servos.stages(s["lag_rad_s"], 2)),
    "servo of three stages": servo(lambda s, a: servos.stages(s["lag_rad_s"], 3)),
    "soft slew limit": servo(lambda s, a: servos.slewing(SERVO_LAG[a], s["limit_rad_s"], s["limit_rad_s"], True)),
    "link with jitter": link(lambda s: servos.late(s["delay_s"], 0.3, 5)),
    "soft play": servo(lambda s, a: servos.after_lag(SERVO_LAG[a], servos.soft_play(s["width_rad"]))),
    "linkage that loses": link(lambda s: servos.scaled(s["gain"], 0.08)),
    "high and tilted thrust": lambda s, a: Truth(
        changes=(
            SetText("propulsion/engine/thruster/location/z", s["z_m"]),
            SetText("propulsion/engine/thruster/orient/pitch", 2.0),
        )
    ),
    "motor of two times": lambda s, a: Truth(throttle=servos.motor(s["lag_s"], 1.5 * s["lag_s"])),
    "motor of two stages": lambda s, a: Truth(throttle=servos.motor(s["lag_s"], s["lag_s"], 2)),
    "slipstream by momentum": momentum_slipstream,
    "thrust that falls with speed": fading_thrust,
    "load off the centre": lambda s, a: with_moved_accelerometers(
        load(s["ratio"] * number_of(a, "mass_kg"), -s["aft"] * number_of(a, "cbar_m")),
        -s["ratio"] / (1.0 + s["ratio"]) * s["aft"] * number_of(a, "cbar_m"),
    ),
    "open door": lambda s, a: Truth(
        changes=(
            coefficient("DRAG", number(s["CD0"])),
            coefficient("PITCH", number(0.1 * s["CD0"])),
        )
    ),
    "late wake": wake,
    "damper that filters": filtered_damper,
    "sigmoid stall": sigmoid_stall,
    "tail that twists": aeroelastic_tail,
    "flexible wings": lambda s, a: Truth(flexible=True),
    "vane of second order": vane,
    "vane with a bent scale": lambda s, a: calibrated("alpha", 0.065, s),
    "airspeed with a bent scale": lambda s, a: calibrated("V", SPEEDS_M_S[a], s),
    "sticky vane": sticky_vane,
    "coarse command": link(lambda s: servos.coarse(s["step_rad"])),
    "lift of the thrust": lambda s, a: Truth(
        changes=(coefficient("LIFT", number(s["lift"]), prop("fcs/throttle-cmd-norm")),)
    ),
    "motor with a bent curve": lambda s, a: Truth(throttle=servos.bent(s["bend"])),
    "elevator that fades": fading_elevator,
    "damping curved in alpha": curved_damping,
    "gyro that saturates on one side": lambda s, a: Truth(
        spoil=lambda n, y, t: np.minimum(y, s["most_rad_s"]) if n == "q" else y
    ),
    "stuck link": link(lambda s: servos.stuck(0.9, s["length_s"])),
    "vibration": vibration,
    "frozen attitude": freezing,
    "wandering attitude": wandering,
}
