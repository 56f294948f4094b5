"""A servo slower than believed."""

from __future__ import annotations

from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.seams import with_servo
from testbench.effects.base import Effect, Parameter, Values
from testbench.effects.servo import WORDS
from testbench.sensors import SensorSuite

NAMES = {"de": "actuator_lag", "da": "aileron_lag", "dr": "rudder_lag"}
_LOST = {
    "de": "Fast inputs arrive late and reduced, slow ones hardly changed.",
    "da": "The roll rate builds up late, and fast reversals of the aileron move the aircraft less.",
    "dr": "The yaw rate builds up late, and fast reversals of the rudder move the aircraft less.",
}
_MISTAKEN = {
    "de": "a transport delay or a rate limit at low frequency",
    "da": "errors of Cl_p and Cl_da together where the ailerons move slowly; a delay of their command",
    "dr": "an error of Cn_dr where the rudder moves slowly; a delay of its command",
}
_SEPARATED = {
    "de": "a sweep beyond 6 Hz, which shows the loss of amplitude, at two amplitudes",
    "da": "aileron doublets shorter than the roll mode's time constant, at two amplitudes",
    "dr": "rudder doublets much shorter than the Dutch roll's period, at two amplitudes",
}


def amend(control: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Give the servo of a surface another first-order lag; a surface without a servo gets one."""
    lag = values["lag_rad_s"]
    aircraft, changes = with_servo(aircraft, control, lag)
    amendment = Amendment(NAMES[control], f"{WORDS[control]} servo lag {lag:.3g} rad/s", changes)
    return aircraft.amended(amendment), suite


def effect(control: str) -> Effect:
    """Return the effect for a control."""
    word = WORDS[control]
    return Effect(
        name=NAMES[control],
        title=f"lag of the {word} servo",
        place=word,
        physics=(
            f"The {word} follows its command through a first-order lag that is slower than the model believes. "
            f"{_LOST[control]}"
        ),
        parameters=(Parameter("lag_rad_s", "rad/s", 2.0, 200.0, (30.0, 8.0)),),
        amend=partial(amend, control),
        mistaken_for=_MISTAKEN[control],
        separated_by=_SEPARATED[control],
        lateral=control in ("da", "dr"),
    )


EFFECT = effect("de")
