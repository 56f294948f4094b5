"""Every kind of hidden truth by name: (sizes, aircraft) -> what flies.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from studies.blind import servos
from studies.blind.truth import (
    ALPHA,
    ALPHA_DOT,
    CHORD_TIME,
    ELEVATOR,
    Law,
    Size,
    Truth,
    coefficient,
    number,
    prop,
    state,
    term,
)

from testbench.aircraft import Insert, SetProperty, SetText
from testbench.core.record import FloatArray
from testbench.flight import load_aircraft
from testbench.flight.air import Gust
from testbench.sensors import Sensor

RATE_HZ = 100.0  # frames a second of truths that count them
SPEEDS_M_S = {"eolo": 16.0, "taurus": 15.0}
SERVO_LAG = {"eolo": 50.0, "taurus": 33.0}  # corner of the elevator servo, rad/s
ELEVATOR_FULL = {"eolo": 0.4363323, "taurus": 0.2181662}  # rad


@cache
def number_of(aircraft: str, name: str) -> float:
    """Return a coefficient of an aircraft, its mass "mass_kg" or its chord "cbar_m"."""
    model = load_aircraft(aircraft, "rigid")
    if name == "mass_kg":
        return model.mass.mass_kg
    return model.geometry.cbar_m if name == "cbar_m" else model.coefficient(name)


# --- loads ------------------------------------------------------------------------------------------------------------

_PLACED = ("ax", "ay", "az")


def load(kg: float, aft_m: float) -> Truth:
    """Return the truth of a point mass on the centre line."""
    point = (
        f'<pointmass name="load"><weight unit="KG">{kg!r}</weight><location unit="M"><x>{aft_m!r}</x><y>0</y><z>0</z>'
        "</location></pointmass>"
    )
    return Truth(changes=(Insert("mass_balance", point),), extra_kg=kg)


def with_moved_accelerometers(truth: Truth, ahead_m: float) -> Truth:
    """Return the truth with all accelerometers so much further ahead of the centre of gravity than believed."""

    def read(s: Sensor) -> Sensor:
        return replace(s, position_m=(s.position_m[0] + ahead_m, *s.position_m[1:])) if s.channel in _PLACED else s

    return replace(truth, read=read)


def shifted(ahead_m: float) -> Truth:
    """Everything but the centre of gravity moves forward."""
    truth = Truth(changes=(SetText("metrics/location[@name='AERORP']/x", -ahead_m),))
    return with_moved_accelerometers(truth, ahead_m)


# --- sensors ----------------------------------------------------------------------------------------------------------


def sensor(channel: str, change: Callable[[Sensor], Sensor]) -> Truth:
    """Return the truth that changes the sensor of one channel."""
    return Truth(read=lambda s: change(s) if s.channel == channel else s)


def vane(s: Size, aircraft: str) -> Truth:
    """A vane of second order."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "alpha":
            return y
        fine = np.interp(np.arange(t[0], t[-1], (t[1] - t[0]) / 10.0), t, y)
        slow = servos.sprung(s["omega_rad_s"], 0.6)(fine, (t[1] - t[0]) / 10.0)[::10]
        noise = y - _smooth(y, 2)  # keep the reading's scatter
        return _smooth(np.append(slow, slow[-1])[: len(y)], 2) + noise

    return Truth(spoil=spoil)


def calibrated(channel: str, centre: float, s: Size) -> Truth:
    """A reading whose slope changes over the range: y + (gain - 1) (y - centre) (1 + bend (y - centre) / span).

    The noise of the electronics behind stays as it is.
    """
    span = {"V": 5.0, "alpha": 0.1, "q": 0.3}[channel]

    def spoil(name: str, y: FloatArray, t: FloatArray) -> FloatArray:
        d = _smooth(y) - centre
        return y if name != channel else np.asarray(y + (s["gain"] - 1.0) * d * (1.0 + 0.3 * d / span))

    return Truth(spoil=spoil)


def _smooth(y: FloatArray, half: int = 4) -> FloatArray:
    """Return the mean over ``half`` samples to either side."""
    width = 2 * half + 1
    return np.asarray(np.convolve(np.pad(y, half, mode="edge"), np.ones(width) / width, "valid"))


def sticky_vane(s: Size, aircraft: str) -> Truth:
    """A vane that stays where it is until the air has turned by half the play; the reading's scatter stays."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "alpha":
            return y
        smooth = _smooth(y)
        return np.asarray(servos.backlash(s["width_rad"])(smooth, t[1] - t[0]) + y - smooth)

    return Truth(spoil=spoil)


def vibration(s: Size, aircraft: str) -> Truth:
    """The engine shakes the accelerometer at one frequency."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + s["amplitude"] * np.sin(2.0 * math.pi * s["f_hz"] * t)) if channel == "az" else y

    return Truth(spoil=spoil)


def freezing(s: Size, aircraft: str) -> Truth:
    """The attitude stands still for a while in every record."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "theta":
            return y
        out, a, b = y.copy(), int(np.searchsorted(t, 3.0)), int(np.searchsorted(t, 3.0 + s["length_s"]))
        out[a:b] = out[a]
        return out

    return Truth(spoil=spoil)


def wandering(s: Size, aircraft: str) -> Truth:
    """The attitude wanders as a sine of 11 s."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + s["amplitude_rad"] * np.sin(2.0 * math.pi * t / 11.0)) if channel == "theta" else y

    return Truth(spoil=spoil)


# --- feedbacks --------------------------------------------------------------------------------------------------------


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


# --- the flow ---------------------------------------------------------------------------------------------------------


def sigmoid_stall(s: Size, aircraft: str) -> Truth:
    """Lift slope lost beyond a logistic break, and drag won: see the terms.

    CL -= loss CL_alpha ln(1 + e^x) / slope and CD += 0.02 / (1 + e^-x) with x = slope (alpha - alpha_s).
    """
    over = term("difference", prop(ALPHA), number(s["alpha_rad"]))
    rising, falling = (term("exp", term("product", number(k * s["slope"]), over)) for k in (1.0, -1.0))
    sigma = term("quotient", number(1.0), term("sum", number(1.0), falling))
    smooth = term("quotient", term("ln", term("sum", number(1.0), rising)), number(s["slope"]))
    lift = coefficient("LIFT", number(-s["loss"] * number_of(aircraft, "CL_alpha")), smooth)
    return Truth(changes=(lift, coefficient("DRAG", number(0.02), sigma)))


def separation(s: Size, aircraft: str) -> Truth:
    """Kirchhoff's lift: CL_alpha alpha ((1 + sqrt X) / 2)^2 with X = (1 - tanh(a (alpha - alpha_s))) / 2."""
    over = term("difference", prop(ALPHA), number(s["alpha_rad"]))
    rising = term("exp", term("product", number(2.0 * s["sharpness"]), over))
    tanh = term("difference", number(1.0), term("quotient", number(2.0), term("sum", number(1.0), rising)))
    X = term("product", number(0.5), term("difference", number(1.0), tanh))
    half = term("product", number(0.5), term("sum", number(1.0), term("sqrt", X)))
    lost = term("difference", term("product", half, half), number(1.0))
    return Truth(changes=(coefficient("LIFT", number(number_of(aircraft, "CL_alpha")), prop(ALPHA), lost),))


def momentum_slipstream(s: Size, aircraft: str) -> Truth:
    """Elevator power times the rise of dynamic pressure in a contracted slipstream, k T / (qbar A), A a disk."""
    disk = {"eolo": 0.15, "taurus": 0.07}[aircraft]
    area = number(disk / 0.3048**2)
    ratio = term("quotient", prop("propulsion/engine/thrust-lbs"), term("product", prop("aero/qbar-psf"), area))
    swirl = f"<difference><pow><sum>{number(1.0)}{ratio}</sum>{number(s['power'])}</pow>{number(1.0)}</difference>"
    return Truth(
        changes=(coefficient("PITCH", number(number_of(aircraft, "Cm_de") * s["share"]), prop(ELEVATOR), swirl),)
    )


def library_slipstream(s: Size, aircraft: str) -> Truth:
    """Elevator power and pitch damping grow by k T / (qbar S)."""
    of_elevator = term("product", number(number_of(aircraft, "Cm_de")), prop(ELEVATOR))
    of_rate = term("product", number(number_of(aircraft, "Cm_q")), prop("velocities/q-aero-rad_sec"), prop(CHORD_TIME))
    return Truth(changes=(coefficient("PITCH", number(s["k"]), thrust_share(), term("sum", of_elevator, of_rate)),))


def thrust_share() -> str:
    """Return the XML of T / (qbar S)."""
    force = term("product", prop("aero/qbar-psf"), prop("metrics/Sw-sqft"))
    return term("quotient", prop("propulsion/engine/thrust-lbs"), term("max", force, number(1e-6)))


def speed_excess(V_m_s: float) -> str:
    """Return the XML of V / V0 - 1."""
    return term("difference", term("quotient", prop("velocities/vt-fps"), number(V_m_s / 0.3048)), number(1.0))


def fading_thrust(s: Size, aircraft: str) -> Truth:
    """Thrust falls with speed faster than believed: T (1 - k (V / V0 - 1)), V0 the speed of the trim."""
    return Truth(changes=(coefficient("DRAG", number(s["k"]), thrust_share(), speed_excess(SPEEDS_M_S[aircraft])),))


def fading_elevator(s: Size, aircraft: str) -> Truth:
    """The elevator loses power as it turns: Cm_de de (1 - loss (de / 0.1 rad)^2)."""
    lost = -s["loss"] * number_of(aircraft, "Cm_de") / 0.1**2
    return Truth(changes=(coefficient("PITCH", number(lost), *(prop(ELEVATOR),) * 3),))


def curved_damping(s: Size, aircraft: str) -> Truth:
    """Pitch damping changes with alpha: Cm_q q cbar / (2 V) k alpha / 0.1 rad."""
    slope = s["k"] * number_of(aircraft, "Cm_q") / 0.1
    terms = (number(slope), prop(ALPHA), prop("velocities/q-aero-rad_sec"), prop(CHORD_TIME))
    return Truth(changes=(coefficient("PITCH", *terms),))


def aeroelastic_tail(s: Size, aircraft: str) -> Truth:
    """Effectiveness 1 / (1 + k qbar / qbar0), the part that changes with speed."""
    q0 = 0.5 * 1.2 * {"eolo": 16.0, "taurus": 15.0}[aircraft] ** 2 / 47.880259
    loss = term("sum", number(1.0), term("product", number(s["k"] / q0), prop("aero/qbar-psf")))
    share = term("difference", term("quotient", number(1.0 + s["k"]), loss), number(1.0))
    return Truth(changes=(coefficient("PITCH", number(number_of(aircraft, "Cm_de")), prop(ELEVATOR), share),))


def speed_power(s: Size, aircraft: str) -> Truth:
    """Elevator power grows by k (V / V0 - 1)."""
    V0 = {"eolo": 16.0, "taurus": 12.0}[aircraft]
    return Truth(
        changes=(coefficient("PITCH", number(s["k"] * number_of(aircraft, "Cm_de")), prop(ELEVATOR), speed_excess(V0)),)
    )


def wake(s: Size, aircraft: str) -> Truth:
    """The downwash at the tail follows alpha with a lag."""
    lagged = f"<difference>{prop('hidden/wake')}{prop(ALPHA)}</difference>"
    return Truth(
        changes=(*state("hidden/wake", prop(ALPHA), s["time_s"]), coefficient("PITCH", number(s["Cm"]), lagged))
    )


# --- a boom that rings ------------------------------------------------------------------------------------------------


def boom(s: Size, aircraft: str) -> Truth:
    """A tail boom that rings with the elevator's load: eta'' + 2 z w eta' + w^2 eta = w^2 de qbar / qbar0, Cm += c eta.

    Stepped exactly for a load that is held at its mean over a frame. qbar0 is the dynamic pressure at design speed, at
    sea level.
    """
    w, z, dt = 2.0 * math.pi * s["f_hz"], s.get("zeta", 0.03), 1.0 / RATE_HZ
    wd = w * math.sqrt(1.0 - z * z)
    e, c, n = math.exp(-z * w * dt), math.cos(wd * dt), math.sin(wd * dt)
    a11, a12 = e * (c + z * w / wd * n), e * n / wd
    a21, a22 = -e * w * w / wd * n, e * (c - z * w / wd * n)
    x, v, nx, last = "hidden/boom-x", "hidden/boom-v", "hidden/boom-nx", "hidden/boom-load"
    qbar0 = 0.5 * 1.225 * load_aircraft(aircraft, "rigid").design_V_m_s ** 2 / 47.880259
    load_now = term("quotient", term("product", prop(ELEVATOR), prop("aero/qbar-psf")), number(qbar0))
    mean = term("product", number(0.5), term("sum", load_now, prop(last)))
    off = term("difference", prop(x), mean)
    moved, turned = (
        term("sum", term("product", number(a), off), term("product", number(b), prop(v)))
        for a, b in ((a11, a12), (a21, a22))
    )

    def go(body: str, rest: str) -> str:
        runs = term("gt", prop("simulation/dt"), number(0.0))
        return term("ifthen", runs, term("sum", body, number(0.0)), term("sum", rest, number(0.0)))

    steps = (
        (nx, go(term("sum", mean, moved), load_now)),
        (v, go(turned, number(0.0))),
        (x, go(prop(nx), load_now)),
        (last, term("sum", load_now, number(0.0))),
    )
    parts = "".join(
        f'<fcs_function name="{name}-f"><function>{body}</function><output>{name}</output></fcs_function>'
        for name, body in steps
    )
    edits = [Insert("flight_control", f'<property value="0">{name}</property>', 0) for name in (x, v, nx, last)]
    edits.append(Insert("flight_control", f'<channel name="boom">{parts}</channel>'))
    return Truth(changes=(*edits, coefficient("PITCH", number(s["Cm"]), prop(x))))


# --- all of them ------------------------------------------------------------------------------------------------------

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
        changes=(coefficient("DRAG", number(s["CD0"])), coefficient("PITCH", number(0.1 * s["CD0"])))
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
