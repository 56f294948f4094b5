"""What an autopilot adds to aileron and rudder that nobody mentioned: roll damper, interconnect, bank and heading hold.

Each adds a gain times a quantity to what a servo is told, behind the recorded command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment
from testbench.aircraft.reroute import filtered_feedback, product, prop, reroute, value
from testbench.aircraft.seams import control_path, opened
from testbench.effects.base import AUTOPILOT, URGED, Effect, Parameter, Values
from testbench.effects.servo import WORDS
from testbench.sensors import SensorSuite


def _roll_rate(aircraft: Aircraft) -> str:
    return "velocities/p-rad_sec"


def _aileron_command(aircraft: Aircraft) -> str:
    return control_path(aircraft, "da").command


def _bank(aircraft: Aircraft) -> str:
    return prop("attitude/phi-rad")


def _heading(aircraft: Aircraft) -> str:
    return f"<sin> {prop('attitude/psi-rad')} </sin>"  # flights begin northwards; the angle itself jumps there


@dataclass(frozen=True)
class Path:
    """A quantity that moves a surface.

    Attributes:
        control: whose servo is told.
        quantity: aircraft -> XML of it.
        sign: of what is added for a positive gain; that which damps or holds.
        gain: parameter.
        text: the quantity, for people.
        flown: see :class:`Effect`.
    """

    control: str
    quantity: Callable[[Aircraft], str]
    sign: float
    gain: Parameter
    text: str
    flown: bool = False


PATHS: dict[str, Path] = {
    "roll_damper": Path(
        "da",
        lambda aircraft: prop(_roll_rate(aircraft)),
        -1.0,
        Parameter("gain_s", "s", URGED, 1.0, (0.05, 0.5 * URGED), none=0.0),
        "rad/s of roll rate",
    ),
    "interconnect": Path(
        "dr",
        lambda aircraft: prop(_aileron_command(aircraft)),
        1.0,
        Parameter("ratio", "1", -2.0, 2.0, (0.2, -0.2), none=0.0),
        "rad of aileron command",
    ),
    "bank_hold": Path("da", _bank, -1.0, Parameter("gain", "1", -0.02, 3.0, (0.2, -0.01), none=0.0), "rad of bank"),
    "heading_hold": Path(
        "da", _heading, -1.0, Parameter("gain", "1", -0.02, 3.0, (0.2, -0.01), none=0.0), "rad of heading", flown=True
    ),
}

_LATE = {"roll_damper": "filtered_roll_damper", "interconnect": "late_interconnect"}  # the same behind a lag


def amend(name: str, aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the gain times the quantity to what the servo is told."""
    path = PATHS[name]
    gain, label = values[path.gain.name], name.replace("_", "-")
    aircraft, way = opened(aircraft, path.control)
    x = path.quantity(aircraft)
    body = f"<sum> {prop(way.command)} {product(value(path.sign * gain), x)} </sum>"
    edit = reroute(way.command, label, body)
    text = f"{WORDS[path.control]} fed {path.sign * gain:+.4g} rad per {path.text}"
    return aircraft.amended(Amendment(name, text, (edit,))), suite


def amend_limited(aircraft: Aircraft, suite: SensorSuite, values: Values) -> tuple[Aircraft, SensorSuite]:
    """Add the gain times the bank angle to what the aileron servo is told, no more than the authority either way."""
    gain, most = values["gain"], value(values["most_rad"])
    aircraft, way = opened(aircraft, "da")
    wanted = product(value(-gain), _bank(aircraft))
    held = f"<max> {value(-values['most_rad'])} <min> {most} {wanted} </min> </max>"
    edit = reroute(way.command, "limited-bank-hold", f"<sum> {prop(way.command)} {held} </sum>")
    text = f"aileron fed {-gain:+.4g} rad per rad of bank, {values['most_rad']:.3g} rad at most"
    return aircraft.amended(Amendment("limited_bank_hold", text, (edit,))), suite


def amend_late(
    of: str, source: Callable[[Aircraft], str], aircraft: Aircraft, suite: SensorSuite, values: Values
) -> tuple[Aircraft, SensorSuite]:
    """Add what the path ``of`` adds, of the property that ``source`` names, behind a first-order lag."""
    path, lag = PATHS[of], values["lag_s"]
    gain, name = path.sign * values[path.gain.name], _LATE[of]
    aircraft, way = opened(aircraft, path.control)
    edit, state = filtered_feedback(way.command, name.replace("_", "-"), source(aircraft), gain, lag)
    state = replace(state, commanded=of == "interconnect")
    text = f"{WORDS[path.control]} fed {gain:+.4g} rad per {path.text} behind a lag of {lag:.3g} s"
    return aircraft.amended(Amendment(name, text, (edit,), memories=(state,))), suite


def _effect(name: str, title: str, physics: str, mistaken_for: str, separated_by: str) -> Effect:
    path = PATHS[name]
    return Effect(
        name=name,
        title=title,
        place=WORDS[path.control],
        physics=physics,
        parameters=(path.gain,),
        amend=partial(amend, name),
        mistaken_for=mistaken_for,
        separated_by=separated_by,
        flown=path.flown,
        lateral=True,
        upstream=AUTOPILOT,
        part="" if name == "interconnect" else "autopilot",
        ground_check="move the aileron and look at the rudder: what is joined moves with it"
        if name == "interconnect"
        else "",
    )


EFFECTS = (
    _effect(
        "roll_damper",
        "roll damper",
        "An autopilot turns the ailerons against the roll rate, behind the recorded command and through the servo. The "
        "aircraft rolls less far for the same command, and its roll mode is faster, or slower with the other sign.",
        "errors of Cl_p and Cl_da together, within their priors, where the servo is much faster than the roll mode",
        "a measured aileron deflection, a flight with the autopilot off, or another speed: the damper's moment grows "
        "with dynamic pressure, that of Cl_p with speed",
    ),
    Effect(
        name="filtered_roll_damper",
        title="roll damper with filter",
        place=WORDS["da"],
        physics=(
            "An autopilot turns the ailerons against the roll rate, but behind a filter that keeps out the gyro's "
            "noise and vibration. Late feedback damps less, and the roll may overshoot."
        ),
        parameters=(PATHS["roll_damper"].gain, Parameter("lag_s", "s", 0.0, 0.5, (0.06,), none=0.0)),
        amend=partial(amend_late, "roll_damper", _roll_rate),
        mistaken_for="a plain roll damper where the filter is faster than the servo; errors of Cl_p and Cl_da",
        separated_by="a measured aileron deflection, a sweep of the aileron, or a flight with the autopilot off",
        flown=True,  # the filter does not show in a linearisation, in which time stands still
        lateral=True,
        contains=("roll_damper",),
        upstream=AUTOPILOT,
        part="autopilot",
    ),
    _effect(
        "interconnect",
        "aileron-rudder interconnect",
        "A spring, or a mixer of the transmitter, turns the rudder with the ailerons to take their adverse yaw out. "
        "Yaw answers the aileron command as if the rudder had moved, and through the rudder's servo.",
        "an error of Cn_da (with Cl_da and a side force), where the rudder's servo is fast",
        "a measured rudder deflection; moving the ailerons by hand on the ground and looking at the rudder",
    ),
    Effect(
        name="late_interconnect",
        title="aileron-rudder interconnect that is late",
        place=WORDS["dr"],
        physics=(
            "A spring, or a mixer behind the ailerons' own servo, turns the rudder with the ailerons, but later than "
            "they are commanded. Yaw follows the ailerons as if the rudder had moved after them."
        ),
        parameters=(
            PATHS["interconnect"].gain,
            Parameter("lag_s", "s", 0.0, 0.5, (0.1,), none=0.0),
        ),
        amend=partial(amend_late, "interconnect", _aileron_command),
        mistaken_for=(
            "an interconnect that is not late, where the rudder's servo is slow; a roll rate that the yaw gyro feels, "
            "beside an error of Cn_da"
        ),
        separated_by="a measured rudder deflection; moving the ailerons by hand and looking at the rudder",
        flown=True,  # the lag does not show in a linearisation, in which time stands still
        lateral=True,
        contains=("interconnect",),
        upstream=AUTOPILOT,
        ground_check="move the aileron and look at the rudder: what is joined moves with it",
    ),
    _effect(
        "bank_hold",
        "bank hold",
        "An autopilot turns the ailerons against the bank angle. The spiral mode becomes "
        "fast, and the aircraft rolls back to level after every input.",
        "an error of Cl_beta, Cl_r or Cn_beta as far as they set the spiral mode; a roll damper in short inputs",
        "a bank held for some seconds; a measured aileron deflection, or a flight with the autopilot off",
    ),
    Effect(
        name="limited_bank_hold",
        title="bank hold with little authority",
        place=WORDS["da"],
        physics=(
            "An autopilot turns the ailerons against the bank angle, by no more than its authority. The aircraft rolls "
            "back to level after small inputs; beyond, a constant aileron is all that brings it back."
        ),
        parameters=(
            Parameter("gain", "1", 0.0, 3.0, (0.2,), none=0.0),
            Parameter("most_rad", "rad", 0.001, 0.5, (0.01, 0.04)),
        ),
        amend=amend_limited,
        mistaken_for="a bank hold, where banks are small",
        separated_by="banks of several sizes, each held for some seconds; a measured aileron deflection",
        flown=True,
        lateral=True,
        contains=("bank_hold",),
        upstream=AUTOPILOT,
        part="autopilot",
    ),
    _effect(
        "heading_hold",
        "heading hold",
        "An autopilot turns the ailerons against the change of heading since the beginning. Aircraft that were "
        "disturbed bank back to their heading and may overshoot it, over many seconds.",
        "a bank hold in records shorter than the return to the heading",
        "ten seconds without input after a turn; a measured aileron deflection, or a flight with the autopilot off",
    ),
)
