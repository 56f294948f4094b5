"""Hidden feedbacks of a rate to a surface, through its trim input: the recorded command knows nothing of them.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from testbench.aircraft import Insert
from testbench.questions.gap.hidden.aircraft import ELEVATOR_FULL
from testbench.questions.gap.hidden.terms import prop, state
from testbench.questions.gap.hidden.truth import Size, Truth


def pitch_feedback(gain_s: float, full_rad: float, source: str) -> Insert:
    """Return the edit that feeds a property to the trim input of an elevator of that throw, rad per unit of it."""
    gain = gain_s / full_rad
    return Insert(
        "flight_control",
        f'<channel name="feedback"><pure_gain name="feedback/pitch"><input>{source}</input>'
        f"<gain>{gain!r}</gain><output>fcs/pitch-trim-cmd-norm</output></pure_gain></channel>",
        0,
    )


def washed_damper(s: Size, aircraft: str) -> Truth:
    """A pitch damper that lets slow rates pass."""
    states = state("hidden/washed", prop("velocities/q-rad_sec"), 1.5)
    high = (
        '<channel name="washout"><fcs_function name="hidden/high-f"><function><difference>'
        f"{prop('velocities/q-rad_sec')}{prop('hidden/washed')}</difference></function><output>hidden/high</output>"
        "</fcs_function></channel>"
    )
    edits = (
        pitch_feedback(s["gain_s"], ELEVATOR_FULL[aircraft], "hidden/high"),
        Insert("flight_control", high, 0),
        *reversed(states),
    )
    declared = Insert("flight_control", '<property value="0">hidden/high</property>', 0)
    return Truth(changes=(*edits, declared))


def filtered_damper(s: Size, aircraft: str) -> Truth:
    """A pitch damper behind a noise filter of 0.08 s."""
    states = state("hidden/filtered", prop("velocities/q-rad_sec"), 0.08)
    return Truth(changes=(pitch_feedback(s["gain_s"], ELEVATOR_FULL[aircraft], "hidden/filtered"), *reversed(states)))


def yaw_feedback(gain_s: float, washout_s: float, full_rad: float) -> Insert:
    """Return the edit that feeds the yaw rate, washed out, to the trim input of a rudder of that throw."""
    return Insert(
        "flight_control",
        '<channel name="feedback"> <washout_filter name="feedback/yaw-rate"> <input>velocities/r-rad_sec</input> '
        f"<c1>{1.0 / washout_s!r}</c1> </washout_filter> <pure_gain name='feedback/rudder'> "
        f"<input>feedback/yaw-rate</input> <gain>{gain_s / full_rad!r}</gain> "
        "<output>fcs/yaw-trim-cmd-norm</output> </pure_gain> </channel>",
        0,
    )
