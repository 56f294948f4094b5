"""Hidden truths in roll and yaw, and of any aircraft, by name: (sizes, aircraft) -> what flies.

Sizes that must suit both packaged aircraft are shares of what the aircraft has, or times: a gain that damps one does
nothing to the other. Models that are not the testbench's own have other names for everything, and often no servos: a
servo is then a law between command and surface, and no model is edited.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from studies.blind import servos
from studies.blind.truth import ALPHA, Law, Size, Truth, coefficient, number, prop, state, term
from studies.blind.truths import SERVO_LAG, SPEEDS_M_S, TRUTHS, Make, number_of, sensor, yaw_feedback

from testbench.aircraft import Insert, SetProperty, SetText
from testbench.core.record import FloatArray
from testbench.flight import load_aircraft
from testbench.sensors import Sensor

BETA = "aero/beta-rad"
FULL_RAD = 0.4363323  # of aileron and rudder of both aircraft
STEPS = {"da": {"eolo": 0.09, "taurus": 0.035}, "dr": {"eolo": 0.11, "taurus": 0.035}}
"""Deflection (rad) of aileron and rudder that moves each aircraft by some 20 deg of bank, or 6 deg of sideslip."""
_WORDS = {"de": "elevator", "da": "aileron", "dr": "rudder"}
_TRIMS = {"da": "fcs/roll-trim-cmd-norm", "dr": "fcs/yaw-trim-cmd-norm"}
_P, _R, _PHI = "velocities/p-rad_sec", "velocities/r-rad_sec", "attitude/phi-rad"
_G = 9.81


def slow(control: str) -> Make:
    """Return what flies with another corner frequency of a servo."""
    return lambda s, a: Truth(changes=(SetProperty(f"fcs/{_WORDS[control]}-lag-rad_sec", s["lag_rad_s"]),))


def link(control: str, make: Callable[[Size], Law]) -> Make:
    """Return what flies with something between command and servo."""
    return lambda s, a: Truth(surfaces={control: make(s)})


def servo(control: str, make: Callable[[Size, str], Law]) -> Make:
    """Return what flies with another servo in place of the believed one, whose slew limit stays."""
    passed = SetProperty(f"fcs/{_WORDS[control]}-lag-rad_sec", 1e5)
    return lambda s, a: Truth(surfaces={control: make(s, a)}, changes=(passed,))


def soft_slew(control: str) -> Make:
    """Return what flies with a servo whose rate saturates softly; it takes ``slew_s`` for the step of the aircraft."""

    def make(s: Size, aircraft: str) -> Law:
        limit = STEPS[control][aircraft] / s["slew_s"]
        return servos.slewing(SERVO_LAG[aircraft], limit, limit, True)

    return servo(control, make)


def fed(control: str, gain: float, source: str, most_rad: float = math.inf) -> Insert:
    """Return the edit that adds a gain times a property to the trim input of a surface, at most so many rad."""
    most = most_rad / FULL_RAD
    limit = f"<clipto><min>{-most!r}</min><max>{most!r}</max></clipto>" if math.isfinite(most) else ""
    return Insert(
        "flight_control",
        f'<channel name="feedback-{control}"><pure_gain name="feedback/{control}"><input>{source}</input>'
        f"<gain>{gain / FULL_RAD!r}</gain>{limit}<output>{_TRIMS[control]}</output></pure_gain></channel>",
        0,
    )


def _roll_gain(share: float, aircraft: str) -> float:
    """Return the aileron, rad per rad/s of roll rate, that adds a share of the roll damping."""
    b = load_aircraft(aircraft, "rigid").geometry.b_m
    damping = number_of(aircraft, "Cl_p") * b / (2.0 * SPEEDS_M_S[aircraft])
    return share * damping / number_of(aircraft, "Cl_da")


def _yaw_gain(share: float, aircraft: str) -> float:
    """Return the rudder, rad per rad/s of yaw rate, that adds a share of the yaw damping."""
    b = load_aircraft(aircraft, "rigid").geometry.b_m
    damping = number_of(aircraft, "Cn_r") * b / (2.0 * SPEEDS_M_S[aircraft])
    return share * damping / number_of(aircraft, "Cn_dr")


def filtered_roll_damper(s: Size, aircraft: str) -> Truth:
    """A roll damper behind a noise filter of 0.08 s."""
    states = state("hidden/roll-rate", prop(_P), 0.08)
    gain = _roll_gain(s["share"], aircraft)
    return Truth(changes=(fed("da", gain, "hidden/roll-rate"), *reversed(states)))


def filtered_yaw_damper(s: Size, aircraft: str) -> Truth:
    """A yaw damper without washout, behind a noise filter of 0.1 s."""
    states = state("hidden/yaw-rate", prop(_R), 0.1)
    gain = _yaw_gain(s["share"], aircraft)
    return Truth(changes=(fed("dr", gain, "hidden/yaw-rate"), *reversed(states)))


def bank_hold(s: Size, aircraft: str) -> Truth:
    """Ailerons against the bank angle, which falls with a time constant where roll damping is all else there is."""
    return Truth(changes=(fed("da", _roll_gain(1.0 / s["time_s"], aircraft), _PHI),))


def weak_bank_hold(s: Size, aircraft: str) -> Truth:
    """A bank hold that may turn the ailerons by no more than a quarter of the step of the aircraft."""
    most = 0.25 * STEPS["da"][aircraft]
    return Truth(changes=(fed("da", _roll_gain(1.0 / s["time_s"], aircraft), _PHI, most),))


def heading_hold(s: Size, aircraft: str) -> Truth:
    """Ailerons against the sine of the heading: bank follows it, and turns the aircraft back at a frequency."""
    turn = _G / SPEEDS_M_S[aircraft]  # rad/s of heading per rad of bank
    gain = _roll_gain(s["omega_rad_s"] ** 2 / turn, aircraft)
    name = "hidden/heading"
    body = term("sum", term("sin", prop("attitude/psi-rad")), number(0.0))
    read = f'<channel name="heading"><fcs_function name="{name}-f"><function>{body}</function><output>{name}</output>'
    edits = (
        fed("da", gain, name),
        Insert("flight_control", f"{read}</fcs_function></channel>", 0),
        Insert("flight_control", f'<property value="0">{name}</property>', 0),
    )
    return Truth(changes=edits)


def interconnect(s: Size, aircraft: str) -> Truth:
    """The rudder turns with the command of the ailerons."""
    return Truth(changes=(fed("dr", s["ratio"] * FULL_RAD, "fcs/aileron-cmd-norm"),))


def springy_interconnect(s: Size, aircraft: str) -> Truth:
    """The rudder is drawn by the ailerons themselves through a spring, 0.06 s late."""
    states = state("hidden/drawn", prop("fcs/left-aileron-pos-rad"), 0.06)
    return Truth(changes=(fed("dr", s["ratio"], "hidden/drawn"), *reversed(states)))


def moment(axis: str, *terms: str) -> Insert:
    """Return the edit that adds qbar S b times the product of ``terms`` (XML) to ROLL or YAW."""
    return coefficient(axis, prop("metrics/bw-ft"), *terms)


def point(kg: float, aft_m: float, right_m: float) -> Insert:
    """Return the edit that adds a point mass, or takes it away if negative."""
    return Insert(
        "mass_balance",
        f'<pointmass name="load"><weight unit="KG">{kg!r}</weight><location unit="M"><x>{aft_m!r}</x>'
        f"<y>{right_m!r}</y><z>0</z></location></pointmass>",
    )


def _accelerometers_right(right_m: float, truth: Truth) -> Truth:
    """Return the truth with all accelerometers so much further right of the centre of gravity than believed."""

    def read(s: Sensor) -> Sensor:
        ahead, right, down = s.position_m
        return replace(s, position_m=(ahead, right + right_m, down)) if s.channel in ("ax", "ay", "az") else s

    return replace(truth, read=read)


def aside(s: Size, aircraft: str) -> Truth:
    """Everything but the centre of gravity moves to the left."""
    y = -s["right_spans"] * load_aircraft(aircraft, "rigid").geometry.b_m
    moved = (SetText("metrics/location[@name='AERORP']/y", y), SetText("propulsion/engine/thruster/location/y", y))
    return _accelerometers_right(y, Truth(changes=moved))


def pod(s: Size, aircraft: str) -> Truth:
    """A load under one wing, half way out: mass, inertia and centre of gravity together."""
    b, mass = load_aircraft(aircraft, "rigid").geometry.b_m, number_of(aircraft, "mass_kg")
    kg, right = s["ratio"] * mass, math.copysign(0.25 * b, s["side"])
    return _accelerometers_right(-kg / (mass + kg) * right, Truth(changes=(point(kg, 0.0, right),), extra_kg=kg))


def uneven_lift(s: Size, aircraft: str) -> Truth:
    """One wing lifts more per angle of attack."""
    return Truth(changes=(moment("ROLL", number(s["Cl_alpha"]), prop(ALPHA)),))


def uneven_lift_and_drag(s: Size, aircraft: str) -> Truth:
    """One wing lifts more per angle of attack, the more the larger it is, and drags more by a twenty-fifth of it."""
    bend = term("sum", number(1.0), term("product", number(2.0), prop(ALPHA)))
    roll = moment("ROLL", number(s["Cl_alpha"]), prop(ALPHA), bend)
    return Truth(changes=(roll, moment("YAW", number(-0.04 * s["Cl_alpha"]), prop(ALPHA))))


def lost_fin(s: Size, aircraft: str) -> Truth:
    """A share of the fin's weathercock stability, yaw damping and rudder power gone, with side force and mass.

    Its lever over the span is Cn_dr / CY_dr, and its weathercock stability -Cn_r / (2 lever). A fin weighs 1 %.
    """
    share, number_ = s["share"], lambda name: number_of(aircraft, name)
    arm = abs(number_("Cn_dr") / number_("CY_dr"))
    stiff = -number_("Cn_r") / (2.0 * arm)
    rate = term("product", prop("velocities/r-aero-rad_sec"), prop("aero/bi2vel"))
    rudder = prop("fcs/rudder-pos-rad")

    def of(beta: float, damping: float, control: float) -> str:
        parts = ((beta, prop(BETA)), (damping, rate), (control, rudder))
        return term("sum", *(term("product", number(c), x) for c, x in parts))

    yaw = moment("YAW", number(-share), of(stiff, number_("Cn_r"), number_("Cn_dr")))
    side = coefficient("SIDE", number(-share), of(-stiff / arm, -number_("Cn_r") / arm, number_("CY_dr")))
    kg = 0.01 * share * number_("mass_kg")
    aft = arm * load_aircraft(aircraft, "rigid").geometry.b_m
    return Truth(changes=(yaw, side, point(-kg, aft, 0.0)), extra_kg=-kg)


def lost_wing(s: Size, aircraft: str) -> Truth:
    """The outer share of one half span gone: lift, drag, roll damping and mass by strips of an even load.

    A wing weighs 12 % of the aircraft.
    """
    share, side, number_ = s["share"], s["side"], lambda name: number_of(aircraft, name)
    area, lever = 0.5 * share, 0.5 * (1.0 - 0.5 * share)
    lift = term("sum", term("product", number(number_("CL_alpha")), prop(ALPHA)), number(number_("CL0")))
    damping = -0.5 * (1.0 - (1.0 - share) ** 3) * number_("Cl_p")
    changes = (
        coefficient("LIFT", number(-area), lift),
        coefficient("DRAG", number(-area * number_("CD"))),
        moment("ROLL", number(side * area * lever), lift),
        moment("ROLL", number(damping), prop("velocities/p-aero-rad_sec"), prop("aero/bi2vel")),
        moment("YAW", number(-side * area * lever * number_("CD"))),
    )
    kg = 0.06 * share * number_("mass_kg")
    right = side * lever * load_aircraft(aircraft, "rigid").geometry.b_m
    return Truth(changes=(*changes, point(-kg, 0.0, right)), extra_kg=-kg)


def cubic_weathercock(s: Size, aircraft: str) -> Truth:
    """Weathercock stability that is another one at sideslips of 0.12 rad: Cn_beta beta share (beta / 0.12 rad)^2."""
    slope = s["share"] * number_of(aircraft, "Cn_beta") / 0.12**2
    return Truth(changes=(moment("YAW", number(slope), *(prop(BETA),) * 3),))


def fading_fin(s: Size, aircraft: str) -> Truth:
    """A fin that fades with the size of sideslip, not its square: Cn_beta beta share |beta| / 0.12 rad."""
    slope = s["share"] * number_of(aircraft, "Cn_beta") / 0.12
    return Truth(changes=(moment("YAW", number(slope), prop(BETA), term("abs", prop(BETA))),))


def sluggish(channel: str, law: Law) -> Truth:
    """Return the truth of a reading that passes a law; its scatter stays."""

    def spoil(name: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if name != channel:
            return y
        smooth, dt_s = _smooth(y), (t[1] - t[0]) / 10.0
        fine = np.interp(t[0] + dt_s * np.arange(10 * len(t)), t, smooth)
        return np.asarray(law(fine, dt_s)[::10] + y - smooth)

    return Truth(spoil=spoil)


def bent(channel: str, span: float, s: Size) -> Truth:
    """Return the truth of a reading whose slope changes over its range; its scatter stays."""

    def spoil(name: str, y: FloatArray, t: FloatArray) -> FloatArray:
        d = _smooth(y)
        return y if name != channel else np.asarray(y + (s["gain"] - 1.0) * d * (1.0 + 0.3 * d / span))

    return Truth(spoil=spoil)


def _smooth(y: FloatArray) -> FloatArray:
    return np.asarray(np.convolve(np.pad(y, 2, mode="edge"), np.ones(5) / 5.0, "valid"))


LATERAL: Mapping[str, Make] = {
    "slow aileron servo": slow("da"),
    "slow rudder servo": slow("dr"),
    "late aileron link": link("da", lambda s: servos.late(s["delay_s"])),
    "late rudder link": link("dr", lambda s: servos.late(s["delay_s"])),
    "aileron linkage ratio": link("da", lambda s: servos.scaled(s["gain"])),
    "rudder linkage ratio": link("dr", lambda s: servos.scaled(s["gain"])),
    "roll-rate feedback": lambda s, a: Truth(changes=(fed("da", _roll_gain(s["share"], a), _P),)),
    "yaw-rate feedback": lambda s, a: Truth(
        changes=(yaw_feedback(_yaw_gain(s["share"], a), s["washout_s"], FULL_RAD),)
    ),
    "interconnect": interconnect,
    "bank hold": bank_hold,
    "heading hold": heading_hold,
    "lateral centre of gravity": aside,
    "uneven lift": uneven_lift,
    "lost fin": lost_fin,
    "lost wing": lost_wing,
    "curved weathercock": cubic_weathercock,
    "sideslip gain": lambda s, a: sensor("beta", lambda r: replace(r, scale=r.scale * s["gain"])),
    "sideslip lag": lambda s, a: sensor("beta", lambda r: replace(r, lag_s=r.lag_s + s["lag_s"])),
    "roll gyro gain": lambda s, a: sensor("p", lambda r: replace(r, scale=s["gain"])),
    "yaw gyro gain": lambda s, a: sensor("r", lambda r: replace(r, scale=s["gain"])),
    "late bank angle": lambda s, a: sensor("phi", lambda r: replace(r, delay_s=s["delay_s"])),
    "lateral accelerometer ahead": lambda s, a: sensor("ay", lambda r: replace(r, position_m=(s["ahead_m"], 0.0, 0.0))),
    "aileron servo of two stages": servo("da", lambda s, a: servos.stages(s["lag_rad_s"], 2)),
    "rudder servo of two stages": servo("dr", lambda s, a: servos.stages(s["lag_rad_s"], 2)),
    "soft aileron slew limit": soft_slew("da"),
    "soft rudder slew limit": soft_slew("dr"),
    "aileron link with jitter": link("da", lambda s: servos.late(s["delay_s"], 0.3, 5)),
    "rudder link with jitter": link("dr", lambda s: servos.late(s["delay_s"], 0.3, 5)),
    "aileron linkage that loses": link("da", lambda s: servos.scaled(s["gain"], 0.08)),
    "rudder linkage that loses": link("dr", lambda s: servos.scaled(s["gain"], 0.08)),
    "roll damper that filters": filtered_roll_damper,
    "yaw damper that filters": filtered_yaw_damper,
    "springy interconnect": springy_interconnect,
    "weak bank hold": weak_bank_hold,
    "pod under a wing": pod,
    "uneven lift and drag": uneven_lift_and_drag,
    "fin that fades": fading_fin,
    "sideslip vane of second order": lambda s, a: sluggish("beta", servos.sprung(s["omega_rad_s"], 0.6)),
    "sideslip with a bent scale": lambda s, a: bent("beta", 0.2, s),
    "yaw gyro with a bent scale": lambda s, a: bent("r", 1.0, s),
    "bank angle of two stages": lambda s, a: sluggish("phi", servos.stages(2.0 / s["lag_s"], 2)),
}


# --- any aircraft -----------------------------------------------------------------------------------------------------

_LAWS: Mapping[str, Callable[[Size], Law]] = {
    "slow {} servo": lambda s: servos.stages(s["lag_rad_s"], 1),
    "{} servo of two stages": lambda s: servos.stages(s["lag_rad_s"], 2),
    "late {} link": lambda s: servos.late(s["delay_s"]),
    "{} link with jitter": lambda s: servos.late(s["delay_s"], 0.3, 5),
    "{} linkage ratio": lambda s: servos.scaled(s["gain"]),
    "{} linkage that loses": lambda s: servos.scaled(s["gain"], 0.08),
}
_READINGS = (
    "vane gain", "vane lag", "gyro gain", "late attitude", "airspeed lag", "vane of second order",
    "vane with a bent scale",
)  # fmt: skip
_LATERAL_READINGS = (
    "sideslip gain", "sideslip lag", "roll gyro gain", "yaw gyro gain", "late bank angle",
    "sideslip vane of second order", "sideslip with a bent scale", "yaw gyro with a bent scale",
    "bank angle of two stages",
)  # fmt: skip


def _on(control: str, make: Callable[[Size], Law]) -> Make:
    return lambda s, a: Truth(surfaces={control: make(s)})


STOCK: Mapping[str, Make] = {
    **{name.format(word): _on(c, make) for name, make in _LAWS.items() for c, word in _WORDS.items()},
    **{n: TRUTHS[n] for n in (*_READINGS, "slow motor", "stronger motor", "motor of two stages")},
    **{n: LATERAL[n] for n in _LATERAL_READINGS},
}
