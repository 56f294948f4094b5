"""The library of physical effects, one file each; this table is the whole of it."""

from __future__ import annotations

from collections.abc import Mapping

from testbench.aircraft import Aircraft
from testbench.core.errors import ModelError
from testbench.questions.gap.effects import (
    actuator_lag,
    aileron_lag,
    alpha_dot,
    asymmetric_rate_limit,
    cg_shift,
    clock_offset,
    creeping_free_play,
    curved_moment,
    dead_band,
    delayed_servo,
    drag_increment,
    elevator_mode,
    elevator_slipstream,
    filtered_pitch_damper,
    free_play,
    ground_effect,
    gust,
    inertia_error,
    mass_error,
    nonlinear_lift,
    payload,
    pitch_damper,
    rate_limit,
    rudder_lag,
    second_order_actuator,
    second_order_thrust_lag,
    slipstream,
    speed_effectiveness,
    stall,
    stall_hysteresis,
    steady_wind,
    surface_offset,
    surface_scale,
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
from testbench.questions.gap.effects.base import Effect, Parameter
from testbench.questions.gap.effects.sensor import sensor_effects
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
        aileron_lag,
        rudder_lag,
        steady_wind,
        gust,
        clock_offset,
    )
}

OTHER_SERVOS: dict[str, Effect] = {
    made.name: made
    for control in ("da", "dr")
    for made in (
        module.effect(control)
        for module in (
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
        )
    )
} | {made.name: made for made in (transport_delay.effect("thr"),)}
"""What the elevator's servo has in the library, for aileron and rudder, and a delay for the throttle.

They are searched only if a scenario asks for them by name (``more_effects``). In the library they would be twenty
further things that a record of aileron and rudder may be mistaken for, each of which costs a search, while most
records hold no input that tells one servo effect from another; their lags are in it.
"""

# The sensor errors listed here are those of the longitudinal channels; `library` makes those of any suite.
EFFECTS: dict[str, Effect] = _OF_AIRCRAFT | sensor_effects(("V", "alpha", "q", "theta", "az"))


def library(suite: SensorSuite, aircraft: Aircraft | None = None) -> dict[str, Effect]:
    """Return every effect that a belief with this suite may lack, by name.

    Those that ``aircraft`` cannot have, if it is given, are left out: a glider has no thrust that may lag.
    """
    known = _OF_AIRCRAFT | sensor_effects(suite.outputs)
    without = {} if aircraft is None else left_out(known, aircraft, suite)
    return {n: e for n, e in known.items() if n not in without}


def catalogue(suite: SensorSuite) -> dict[str, Effect]:
    """Return every effect that can be asked for by name."""
    return library(suite) | OTHER_SERVOS


def left_out(effects: Mapping[str, Effect], aircraft: Aircraft, suite: SensorSuite) -> dict[str, str]:
    """Return the effects that an aircraft cannot have -> why, in one sentence."""
    out = {}
    for name, effect in effects.items():
        try:
            start = {p.name: p.starts[0] for p in effect.parameters}
            effect.amend(aircraft, suite, start)
        except ModelError as error:
            out[name] = error.message
    return out


__all__ = ["EFFECTS", "OTHER_SERVOS", "Effect", "Parameter", "catalogue", "left_out", "library"]
