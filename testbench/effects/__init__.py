"""The library of physical effects, one file each; this table is the whole of it."""

from __future__ import annotations

from collections.abc import Mapping

from testbench.aircraft import Aircraft
from testbench.core.errors import ModelError
from testbench.effects import (
    actuator_lag,
    alpha_dot,
    asymmetric_rate_limit,
    asymmetry,
    cg_shift,
    clock_offset,
    condition,
    creeping_free_play,
    curved_moment,
    dead_band,
    delayed_servo,
    drag_increment,
    elevator_mode,
    elevator_slipstream,
    filtered_pitch_damper,
    filtered_yaw_damper,
    free_play,
    ground_effect,
    gust,
    inertia_error,
    lateral_feedback,
    lateral_terms,
    lost_surface,
    mass_error,
    nonlinear_lift,
    over_time,
    payload,
    pitch_damper,
    propeller,
    rate_limit,
    second_order_actuator,
    second_order_thrust_lag,
    slipstream,
    speed_effectiveness,
    stall,
    stall_hysteresis,
    stall_moment,
    steady_wind,
    surface_offset,
    surface_scale,
    throttle_scale,
    thrust_lag,
    thrust_lapse,
    thrust_line,
    thrust_scale,
    transport_delay,
    wake_lag,
    washed_pitch_damper,
    wing_bending,
    wing_torsion,
    yaw_damper,
)
from testbench.effects.base import Effect, Parameter
from testbench.effects.sensor import has_pitot, sensor_effects
from testbench.effects.servos import SERVOS
from testbench.sensors import SensorSuite

_OF_AIRCRAFT: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        wing_bending,
        wing_torsion,
        elevator_mode,
        actuator_lag,
        second_order_actuator,
        rate_limit,
        asymmetric_rate_limit,
        transport_delay,
        delayed_servo,
        free_play,
        creeping_free_play,
        dead_band,
        surface_scale,
        surface_offset,
        thrust_line,
        thrust_lag,
        second_order_thrust_lag,
        thrust_scale,
        throttle_scale,
        thrust_lapse,
        slipstream,
        elevator_slipstream,
        cg_shift,
        mass_error,
        inertia_error,
        payload,
        drag_increment,
        alpha_dot,
        wake_lag,
        stall,
        stall_hysteresis,
        nonlinear_lift,
        curved_moment,
        speed_effectiveness,
        ground_effect,
        pitch_damper,
        washed_pitch_damper,
        filtered_pitch_damper,
        yaw_damper,
        filtered_yaw_damper,
        steady_wind,
        gust,
        clock_offset,
    )
}

_PLAIN = ("lag", "delay", "gain", "rate limit")
_OF_AIRCRAFT |= {SERVOS[kind, control].name: SERVOS[kind, control] for kind in _PLAIN for control in ("da", "dr")}
_BY_NAME_ONLY = ("lost_tail", "stall_moment")
_LATERAL = (*lateral_feedback.EFFECTS, *propeller.EFFECTS, *asymmetry.EFFECTS, *lateral_terms.EFFECTS)
_NEW = (*condition.EFFECTS, *over_time.EFFECTS, *_LATERAL, *lost_surface.EFFECTS, *stall_moment.EFFECTS)
_OF_AIRCRAFT |= {e.name: e for e in _NEW if e.name not in _BY_NAME_ONLY}

OTHER_SERVOS: dict[str, Effect] = {e.name: e for e in SERVOS.values() if e.name not in _OF_AIRCRAFT}
"""Servo effects that are searched only where the search points to the path of their control (further.py), or by name.

In the library they would be two dozen further things that a record of these controls may be mistaken for, each of
which costs a search, while most records hold no input that tells one servo effect from another of its kind. Lag, delay,
gain and rate limit of aileron and rudder are in the library, and so are lags and gain of the thrust. Those of the
elevator come by name alone (``more_effects``).
"""

ON_REQUEST: dict[str, Effect] = OTHER_SERVOS | {e.name: e for e in _NEW if e.name in _BY_NAME_ONLY}
"""All that a scenario may ask for by name (``more_effects``) and the library does not hold.

A lost part of the tail is what errors of three coefficients are, and a stall that pitches is a stall beside a curved
moment: in the library they would be two more things that every longitudinal record may be mistaken for.
"""

# The sensor errors listed here are those of the longitudinal channels; `library` makes those of any suite.
EFFECTS: dict[str, Effect] = _OF_AIRCRAFT | sensor_effects(("V", "alpha", "q", "theta", "az"), pitot=True)


def library(suite: SensorSuite, aircraft: Aircraft | None = None) -> dict[str, Effect]:
    """Return every effect that a belief with this suite may lack, by name.

    Those that ``aircraft`` cannot have, if it is given, are left out: a glider has no thrust that may lag. Lengths may
    be as large as its size allows.
    """
    known = _OF_AIRCRAFT | sensor_effects(suite.outputs, has_pitot(suite))
    if aircraft is None:
        return known
    without = left_out(known, aircraft, suite)
    return {n: e.sized(aircraft) for n, e in known.items() if n not in without}


def catalogue(suite: SensorSuite) -> dict[str, Effect]:
    """Return every effect that can be asked for by name."""
    return library(suite) | ON_REQUEST


def left_out(effects: Mapping[str, Effect], aircraft: Aircraft, suite: SensorSuite) -> dict[str, str]:
    """Return the effects that an aircraft cannot have -> why, in one sentence."""
    out = {}
    for name, effect in effects.items():
        try:
            start = {p.name: p.starts[0] for p in effect.parameters}
            effect.amend(aircraft, suite, start)
        except ModelError as error:
            out[name] = error.message
            continue
        if effect.own_form and aircraft.adapter is None:
            out[name] = f"in {aircraft.name} it is what {effect.own_form} is"
    return out


__all__ = ["EFFECTS", "ON_REQUEST", "OTHER_SERVOS", "SERVOS", "Effect", "Parameter", "catalogue", "left_out", "library"]
