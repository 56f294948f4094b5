"""What an autopilot adds to elevator, aileron and rudder that nobody mentioned: dampers, interconnect, holds.

Each adds a gain times a quantity to what a servo is told, behind the recorded command.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

from testbench.aircraft import Aircraft, Amendment, Memory
from testbench.aircraft.paths import ControlPath
from testbench.aircraft.seams import (
    band_feedback,
    control_path,
    filtered_feedback,
    product,
    prop,
    reroute,
    value,
    washed_feedback,
)
from testbench.effects.base import AUTOPILOT, FORCES, Effect, Parameter, Values, on_path
from testbench.effects.servo import WORDS

# Least gain, s, of a rate feedback: one of the wrong sign takes damping away, and whoever flies feels it before it is
# larger. Where a fit asks for more, the feedback only stands for something slow that the library does not hold.
_URGED = -0.02


@dataclass(frozen=True)
class Feedback:
    """The law that adds K x to what a servo is told.

    With "lag_s" among the values x is filtered, x / (1 + lag s); with "washout_rad_s" its slow part is taken away,
    s / (s + washout) x; with "most_rad" K x is no more than that either way.
    """

    name: str  # of the effect
    control: str  # whose servo is told
    quantity: str  # property that x is, "da" for the aileron's command, "sin PROPERTY" for a sine
    gain: str  # name of the parameter |K|
    sign: float  # of K for a positive gain; that which damps or holds
    text: str  # what it does, with a place for K
    filter: str = "filter"  # what people call the lag
    upstream: int = AUTOPILOT  # see :class:`Effect`

    def __call__(self, aircraft: Aircraft, path: ControlPath, values: Values) -> Amendment:
        """Return the amendment; ModelError if the aircraft lacks the aileron that it listens to."""
        K, label = self.sign * values[self.gain], self.name.replace("_", "-")
        x = self.quantity if self.quantity != "da" else control_path(aircraft, "da").command
        washout, lag = values.get("washout_rad_s"), values.get("lag_s")
        text, states = self.text.format(K), tuple[Memory, ...]()
        if washout is not None and lag is not None:
            edit, states = band_feedback(path.command, label, x, K, washout, lag)
        elif washout is not None:
            edit, state = washed_feedback(path.command, label, x, K, washout)
            states = (state,)
        elif lag is not None:
            edit, state = filtered_feedback(path.command, label, x, K, lag)
            states = (replace(state, commanded=self.quantity == "da"),)
        else:
            _, sine, of = x.rpartition("sin ")
            added = product(value(K), f"<sin> {prop(of)} </sin>" if sine else prop(of))
            if "most_rad" in values:
                most = values["most_rad"]
                added = f"<max> {value(-most)} <min> {value(most)} {added} </min> </max>"
                text += f", {most:.3g} rad at most"
            edit = reroute(path.command, label, f"<sum> {prop(path.command)} {added} </sum>")
        if washout is not None:
            text += f", washed out below {washout:.3g} rad/s"
        if lag is not None:
            text += f"{',' if washout is not None else ''} behind a {self.filter} of {lag:.3g} s"
        return Amendment(self.name, text, (edit,), memories=states)


# --- the table --------------------------------------------------------------------------------------------------------


_PLACES = {**WORDS, "de": "pitching moment"}


def _row(
    law: Feedback,
    title: str,
    physics: str,
    parameters: tuple[Parameter, ...],
    mistaken_for: str,
    separated_by: str,
    contains: tuple[str, ...] = (),
) -> Effect:
    joined = law.quantity == "da"  # by a spring or a mixer; all others are made by an autopilot
    return Effect(
        name=law.name,
        title=title,
        place=_PLACES[law.control],
        physics=physics,
        parameters=parameters,
        amend=partial(on_path, law, law.control),
        mistaken_for=mistaken_for,
        separated_by=separated_by,
        lateral=law.control != "de",
        contains=contains,
        upstream=law.upstream,
        part="" if joined else "autopilot",
        ground_check="move the aileron and look at the rudder: a connected rudder moves with it" if joined else "",
    )


_Q, _R, _P = "velocities/q-rad_sec", "velocities/r-rad_sec", "velocities/p-rad_sec"
_BANK, _HEADING = "attitude/phi-rad", "sin attitude/psi-rad"  # flights begin northwards; the angle itself jumps there
_PITCH_RATE = ("de", _Q, "gain_s", 1.0, "elevator fed back {:+.4g} rad per rad/s of pitch rate")
_YAW_RATE = ("dr", _R, "gain_s", 1.0, "rudder fed back {:+.4g} rad per rad/s of yaw rate")
_ROLL_RATE = ("da", _P, "gain_s", -1.0, "aileron fed {:+.4g} rad per rad/s of roll rate", "lag")
_AILERON = ("dr", "da", "ratio", 1.0, "rudder fed {:+.4g} rad per rad of aileron command", "lag")
_BANKED = ("da", _BANK, "gain", -1.0, "aileron fed {:+.4g} rad per rad of bank")
_TURNED = ("da", _HEADING, "gain", -1.0, "aileron fed {:+.4g} rad per rad of heading")


def _gain(most: float, start: float) -> Parameter:
    return Parameter("gain_s", "s", _URGED, most, (start, 0.5 * _URGED), none=0.0)


def _lag(most: float, start: float) -> Parameter:
    return Parameter("lag_s", "s", 0.0, most, (start,), none=0.0)


_YAW = (_gain(2.0, 0.2), Parameter("washout_rad_s", "rad/s", 0.0, 5.0, (0.3,), none=0.0))
_RATIO = Parameter("ratio", "1", -2.0, 2.0, (0.2, -0.2), none=0.0)
_HOLD = Parameter("gain", "1", -0.02, 3.0, (0.2, -0.01), none=0.0)
# fmt: off
EFFECTS = (
    _row(
        Feedback("pitch_damper", *_PITCH_RATE), "pitch damper",
        "An autopilot turns the elevator in proportion to pitch rate, behind the recorded command and through the "
        "servo. The short period is damped more, or less with the other sign, than the aircraft itself would be.",
        (_gain(1.0, 0.1),),
        "an error of Cm_q, within its prior, where the servo is much faster than the short period",
        "a measured deflection, or a flight with the autopilot off"),
    _row(
        Feedback("washed_pitch_damper", *_PITCH_RATE), "pitch damper with washout",
        "An autopilot turns the elevator in proportion to pitch rate, but lets a lasting rate pass, so that it does "
        "not work against a pull-up. The short period is damped more, and the phugoid stays as it is.",
        (_gain(1.0, 0.15), Parameter("washout_rad_s", "rad/s", 0.0, 5.0, (0.5,), none=0.0)),
        "a plain pitch damper where no pitch rate lasts as long as the washout; an error of Cm_q",
        "a measured deflection, a pull-up held for some seconds, or a flight with the autopilot off",
        contains=("pitch_damper",)),
    _row(
        Feedback("filtered_pitch_damper", *_PITCH_RATE), "pitch damper with filter",
        "An autopilot turns the elevator in proportion to pitch rate, but behind a filter that keeps out the gyro's "
        "noise and vibration. Late feedback damps less and stiffens more; it may set off an oscillation.",
        (_gain(1.0, 0.15), _lag(0.3, 0.06)),
        "a plain pitch damper where the filter is faster than the servo; errors of Cm_q and Cm_alpha",
        "a measured deflection, a sweep through the short period, or a flight with the autopilot off",
        contains=("pitch_damper",)),
    _row(
        Feedback("yaw_damper", *_YAW_RATE, upstream=FORCES), "yaw damper",
        "An autopilot turns the rudder in proportion to yaw rate, behind the recorded command and through the servo; a "
        "washout lets a steady turn pass. The Dutch roll is damped more, or less with the other sign, than by the "
        "aircraft itself, and the yaw that the rudder commands is reduced.",
        _YAW,
        "an error of Cn_r, within its prior, where the servo is much faster than the Dutch roll; the washout is not "
        "known where no record holds a turn as long as it lasts",
        "a measured rudder deflection, a flight with the autopilot off, or a turn held for some seconds"),
    _row(
        Feedback("filtered_yaw_damper", *_YAW_RATE), "yaw damper with filter",
        "An autopilot turns the rudder in proportion to yaw rate, but behind a filter that keeps out the gyro's noise "
        "and vibration; a washout lets a steady turn pass. Late feedback damps the Dutch roll less and changes its "
        "frequency.",
        (*_YAW, _lag(0.5, 0.1)),
        "a plain yaw damper where the filter is faster than the servo; errors of Cn_r and Cn_beta",
        "a measured rudder deflection, a sweep through the Dutch roll, or a flight with the autopilot off",
        contains=("yaw_damper",)),
    _row(
        Feedback("roll_damper", *_ROLL_RATE), "roll damper",
        "An autopilot turns the ailerons against the roll rate, behind the recorded command and through the servo. The "
        "aircraft rolls less far for the same command, and its roll mode is faster, or slower with the other sign.",
        (_gain(1.0, 0.05),),
        "errors of Cl_p and Cl_da together, within their priors, where the servo is much faster than the roll mode",
        "a measured aileron deflection, a flight with the autopilot off, or another speed: the damper's moment grows "
        "with dynamic pressure, that of Cl_p with speed"),
    _row(
        Feedback("filtered_roll_damper", *_ROLL_RATE), "roll damper with filter",
        "An autopilot turns the ailerons against the roll rate, but behind a filter that keeps out the gyro's noise "
        "and vibration. Late feedback damps less, and the roll may overshoot.",
        (_gain(1.0, 0.05), _lag(0.5, 0.06)),
        "a plain roll damper where the filter is faster than the servo; errors of Cl_p and Cl_da",
        "a measured aileron deflection, a sweep of the aileron, or a flight with the autopilot off",
        contains=("roll_damper",)),
    _row(
        Feedback("interconnect", *_AILERON), "aileron-rudder interconnect",
        "A spring, or a mixer of the transmitter, turns the rudder with the ailerons to take their adverse yaw out. "
        "Yaw responds to the aileron command as if the rudder had moved, through the rudder's servo.",
        (_RATIO,),
        "an error of Cn_da (with Cl_da and a side force), where the rudder's servo is fast",
        "a measured rudder deflection; moving the ailerons by hand on the ground and looking at the rudder"),
    _row(
        Feedback("late_interconnect", *_AILERON), "aileron-rudder interconnect that is late",
        "A spring, or a mixer behind the ailerons' own servo, turns the rudder with the ailerons, but later than they "
        "are commanded. Yaw follows the ailerons as if the rudder had moved after them.",
        (_RATIO, _lag(0.5, 0.1)),
        "an interconnect that is not late, where the rudder's servo is slow; a roll rate in the yaw gyro, with an "
        "error of Cn_da",
        "a measured rudder deflection; moving the ailerons by hand and looking at the rudder",
        contains=("interconnect",)),
    _row(
        Feedback("bank_hold", *_BANKED), "bank hold",
        "An autopilot turns the ailerons against the bank angle. The spiral mode becomes fast, and the aircraft rolls "
        "back to level after every input.",
        (_HOLD,),
        "an error of Cl_beta, Cl_r or Cn_beta as far as they set the spiral mode; a roll damper in short inputs",
        "a bank held for some seconds; a measured aileron deflection, or a flight with the autopilot off"),
    _row(
        Feedback("limited_bank_hold", *_BANKED), "bank hold with little authority",
        "An autopilot turns the ailerons against the bank angle, by no more than its authority. The aircraft rolls "
        "back to level after small inputs; beyond, a constant aileron is all that brings it back.",
        (Parameter("gain", "1", 0.0, 3.0, (0.2,), none=0.0),
         Parameter("most_rad", "rad", 0.001, 0.5, (0.01, 0.04))),
        "a bank hold, where banks are small",
        "banks of several sizes, each held for some seconds; a measured aileron deflection",
        contains=("bank_hold",)),
    _row(
        Feedback("heading_hold", *_TURNED), "heading hold",
        "An autopilot turns the ailerons against the change of heading since the beginning. After a disturbance the "
        "aircraft banks back to its heading and may overshoot it, over many seconds.",
        (_HOLD,),
        "a bank hold in records shorter than the return to the heading",
        "ten seconds without input after a turn; a measured aileron deflection, or a flight with the autopilot off"),
)
FED_TO = {c: tuple(e.name for e in EFFECTS if e.place == place) for c, place in _PLACES.items()}
"""Control -> names of the effects that are fed to its servo."""
