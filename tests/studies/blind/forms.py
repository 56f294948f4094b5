"""What hidden truths change in model and sensors.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from studies.blind import servos
from studies.blind.flights import RATE_HZ, SPEEDS_M_S, Plan

from testbench.aircraft import Insert, SetText, load_aircraft
from testbench.core.record import FloatArray
from testbench.sensors import Sensor

Size = Mapping[str, float]
SERVO_LAG = {"eolo": 50.0, "taurus": 33.0}
ELEVATOR_FULL = {"eolo": 0.4363323, "taurus": 0.2181662}


@cache
def number_of(aircraft: str, name: str) -> float:
    """Return a coefficient of an aircraft, its mass "mass_kg" or its chord "cbar_m"."""
    model = load_aircraft(aircraft, "rigid")
    if name == "mass_kg":
        return model.mass.mass_kg
    return model.geometry.cbar_m if name == "cbar_m" else model.coefficient(name)


def coefficient(axis: str, *terms: str) -> Insert:
    """Return the edit that adds qbar S (cbar for PITCH) times the product of ``terms`` (XML) to an axis."""
    arm = "<property>metrics/cbarw-ft</property>" if axis == "PITCH" else ""
    body = f"<property>aero/qbar-psf</property><property>metrics/Sw-sqft</property>{arm}{''.join(terms)}"
    name = f"hidden/{axis}-{len(body)}"
    return Insert(f"aerodynamics/axis[@name='{axis}']", f'<function name="{name}"><product>{body}</product></function>')


def term(tag: str, *parts: str) -> str:
    """Return the XML of a function term, e.g. ``term("sum", a, b)``."""
    return f"<{tag}>{''.join(parts)}</{tag}>"


def number(x: float) -> str:
    """Return the XML of a number."""
    return f"<value>{float(x)!r}</value>"


def prop(name: str) -> str:
    """Return the XML of a property."""
    return f"<property>{name}</property>"


ALPHA, ELEVATOR, ALPHA_DOT = "aero/alpha-rad", "fcs/elevator-pos-rad", "aero/alphadot-rad_sec"
CHORD_TIME = "aero/ci2vel"  # cbar / (2 V)


def sensor(channel: str, change: Callable[[Sensor], Sensor]) -> Plan:
    """Return the plan that changes the sensor of one channel."""
    return Plan(read=lambda s: change(s) if s.channel == channel else s)


def state(name: str, target: str, time_s: float) -> tuple[Insert, Insert]:
    """Return the edits of a state that follows ``target`` (XML): x+ = x + (target - x) (1 - exp(-dt / time))."""
    power = term("quotient", term("product", number(-1.0), prop("simulation/dt")), number(time_s))
    gain = term("difference", number(1.0), term("exp", power))
    step = term("sum", prop(name), term("product", gain, term("difference", target, prop(name))))
    rest = term("ifthen", term("gt", prop("simulation/dt"), number(0.0)), step, term("sum", target, number(0.0)))
    return (
        Insert("flight_control", f'<property value="0">{name}</property>', 0),
        Insert(
            "flight_control",
            f'<channel name="{name}-c"><fcs_function name="{name}-f"><function>{rest}</function>'
            f"<output>{name}</output></fcs_function></channel>",
        ),
    )


def feedback(gain_s: float, aircraft: str, source: str) -> Insert:
    """Return the edit that feeds a property to the elevator's trim input, rad per unit of it."""
    gain = gain_s / ELEVATOR_FULL[aircraft]
    return Insert(
        "flight_control",
        f'<channel name="feedback"><pure_gain name="feedback/pitch"><input>{source}</input>'
        f"<gain>{gain!r}</gain><output>fcs/pitch-trim-cmd-norm</output></pure_gain></channel>",
        0,
    )


def load(kg: float, aft_m: float) -> Plan:
    """Return the plan with a point mass on the centre line."""
    point = (
        f'<pointmass name="load"><weight unit="KG">{kg!r}</weight><location unit="M"><x>{aft_m!r}</x><y>0</y><z>0</z>'
        "</location></pointmass>"
    )
    return Plan(changes=(Insert("mass_balance", point),), extra_kg=kg)


def with_moved_accelerometers(plan: Plan, aft_m: float) -> Plan:
    """Return the plan for a centre of gravity that lies further aft beside the accelerometer."""

    def read(s: Sensor) -> Sensor:
        return replace(s, position_m=(s.position_m[0] + aft_m, *s.position_m[1:])) if s.channel == "az" else s

    return replace(plan, read=read)


def shifted(aft_chords: float, aircraft: str) -> Plan:
    """Everything but the centre of gravity moves forward."""
    ahead = aft_chords * number_of(aircraft, "cbar_m")
    plan = Plan(changes=(SetText("metrics/location[@name='AERORP']/x", -ahead),))
    return with_moved_accelerometers(plan, ahead)


def sigmoid_stall(s: Size, aircraft: str) -> Plan:
    """Lift slope lost beyond a logistic break, and drag won: see the terms.

    CL -= loss CL_alpha ln(1 + e^x) / slope and CD += 0.02 / (1 + e^-x) with x = slope (alpha - alpha_s).
    """
    over = term("difference", prop(ALPHA), number(s["alpha_rad"]))
    rising, falling = (term("exp", term("product", number(k * s["slope"]), over)) for k in (1.0, -1.0))
    sigma = term("quotient", number(1.0), term("sum", number(1.0), falling))
    smooth = term("quotient", term("ln", term("sum", number(1.0), rising)), number(s["slope"]))
    lift = coefficient("LIFT", number(-s["loss"] * number_of(aircraft, "CL_alpha")), smooth)
    return Plan(changes=(lift, coefficient("DRAG", number(0.02), sigma)))


def separation(s: Size, aircraft: str) -> Plan:
    """Kirchhoff's lift: CL_alpha alpha ((1 + sqrt X) / 2)^2 with X = (1 - tanh(a (alpha - alpha_s))) / 2."""
    over = term("difference", prop(ALPHA), number(s["alpha_rad"]))
    rising = term("exp", term("product", number(2.0 * s["sharpness"]), over))
    tanh = term("difference", number(1.0), term("quotient", number(2.0), term("sum", number(1.0), rising)))
    X = term("product", number(0.5), term("difference", number(1.0), tanh))
    half = term("product", number(0.5), term("sum", number(1.0), term("sqrt", X)))
    lost = term("difference", term("product", half, half), number(1.0))
    return Plan(changes=(coefficient("LIFT", number(number_of(aircraft, "CL_alpha")), prop(ALPHA), lost),))


def momentum_slipstream(s: Size, aircraft: str) -> Plan:
    """Elevator power times the rise of dynamic pressure in a contracted slipstream, k T / (qbar A), A a disk."""
    disk = {"eolo": 0.15, "taurus": 0.07}[aircraft]
    area = number(disk / 0.3048**2)
    ratio = term("quotient", prop("propulsion/engine/thrust-lbs"), term("product", prop("aero/qbar-psf"), area))
    swirl = f"<difference><pow><sum>{number(1.0)}{ratio}</sum>{number(s['power'])}</pow>{number(1.0)}</difference>"
    return Plan(
        changes=(coefficient("PITCH", number(number_of(aircraft, "Cm_de") * s["share"]), prop(ELEVATOR), swirl),)
    )


def library_slipstream(s: Size, aircraft: str) -> Plan:
    """Elevator power and pitch damping grow by k T / (qbar S)."""
    of_elevator = term("product", number(number_of(aircraft, "Cm_de")), prop(ELEVATOR))
    of_rate = term("product", number(number_of(aircraft, "Cm_q")), prop("velocities/q-aero-rad_sec"), prop(CHORD_TIME))
    return Plan(changes=(coefficient("PITCH", number(s["k"]), thrust_share(), term("sum", of_elevator, of_rate)),))


def thrust_share() -> str:
    """Return the XML of T / (qbar S)."""
    force = term("product", prop("aero/qbar-psf"), prop("metrics/Sw-sqft"))
    return term("quotient", prop("propulsion/engine/thrust-lbs"), term("max", force, number(1e-6)))


def speed_excess(V_m_s: float) -> str:
    """Return the XML of V / V0 - 1."""
    return term("difference", term("quotient", prop("velocities/vt-fps"), number(V_m_s / 0.3048)), number(1.0))


def fading_thrust(s: Size, aircraft: str) -> Plan:
    """Thrust falls with speed faster than believed: T (1 - k (V / V0 - 1)), V0 the speed of the trim."""
    return Plan(changes=(coefficient("DRAG", number(s["k"]), thrust_share(), speed_excess(SPEEDS_M_S[aircraft])),))


def fading_elevator(s: Size, aircraft: str) -> Plan:
    """The elevator loses power as it turns: Cm_de de (1 - loss (de / 0.1 rad)^2)."""
    lost = -s["loss"] * number_of(aircraft, "Cm_de") / 0.1**2
    return Plan(changes=(coefficient("PITCH", number(lost), *(prop(ELEVATOR),) * 3),))


def curved_damping(s: Size, aircraft: str) -> Plan:
    """Pitch damping changes with alpha: Cm_q q cbar / (2 V) k alpha / 0.1 rad."""
    slope = s["k"] * number_of(aircraft, "Cm_q") / 0.1
    terms = (number(slope), prop(ALPHA), prop("velocities/q-aero-rad_sec"), prop(CHORD_TIME))
    return Plan(changes=(coefficient("PITCH", *terms),))


def aeroelastic_tail(s: Size, aircraft: str) -> Plan:
    """Effectiveness 1 / (1 + k qbar / qbar0), the part that changes with speed."""
    q0 = 0.5 * 1.2 * {"eolo": 16.0, "taurus": 15.0}[aircraft] ** 2 / 47.880259
    loss = term("sum", number(1.0), term("product", number(s["k"] / q0), prop("aero/qbar-psf")))
    share = term("difference", term("quotient", number(1.0 + s["k"]), loss), number(1.0))
    return Plan(changes=(coefficient("PITCH", number(number_of(aircraft, "Cm_de")), prop(ELEVATOR), share),))


def speed_power(s: Size, aircraft: str) -> Plan:
    """Elevator power grows by k (V / V0 - 1)."""
    V0 = {"eolo": 16.0, "taurus": 12.0}[aircraft]
    return Plan(
        changes=(coefficient("PITCH", number(s["k"] * number_of(aircraft, "Cm_de")), prop(ELEVATOR), speed_excess(V0)),)
    )


def boom(s: Size, aircraft: str) -> Plan:
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
    return Plan(changes=(*edits, coefficient("PITCH", number(s["Cm"]), prop(x))))


def wake(s: Size, aircraft: str) -> Plan:
    """The downwash at the tail follows alpha with a lag."""
    lagged = f"<difference>{prop('hidden/wake')}{prop(ALPHA)}</difference>"
    return Plan(
        changes=(*state("hidden/wake", prop(ALPHA), s["time_s"]), coefficient("PITCH", number(s["Cm"]), lagged))
    )


def washed_damper(s: Size, aircraft: str) -> Plan:
    """A pitch damper that lets slow rates pass."""
    states = state("hidden/washed", prop("velocities/q-rad_sec"), 1.5)
    high = (
        '<channel name="washout"><fcs_function name="hidden/high-f"><function><difference>'
        f"{prop('velocities/q-rad_sec')}{prop('hidden/washed')}</difference></function><output>hidden/high</output>"
        "</fcs_function></channel>"
    )
    edits = (feedback(s["gain_s"], aircraft, "hidden/high"), Insert("flight_control", high, 0), *reversed(states))
    declared = Insert("flight_control", '<property value="0">hidden/high</property>', 0)
    return Plan(changes=(*edits, declared))


def filtered_damper(s: Size, aircraft: str) -> Plan:
    """A pitch damper behind a noise filter of 0.08 s."""
    states = state("hidden/filtered", prop("velocities/q-rad_sec"), 0.08)
    return Plan(changes=(feedback(s["gain_s"], aircraft, "hidden/filtered"), *reversed(states)))


def vane(s: Size, aircraft: str) -> Plan:
    """A vane of second order."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "alpha":
            return y
        fine = np.interp(np.arange(t[0], t[-1], (t[1] - t[0]) / 10.0), t, y)
        slow = servos.sprung(s["omega_rad_s"], 0.6)(fine, (t[1] - t[0]) / 10.0)[::10]
        noise = y - _smooth(y, 2)  # keep the reading's scatter
        return _smooth(np.append(slow, slow[-1])[: len(y)], 2) + noise

    return Plan(spoil=spoil)


def calibrated(channel: str, centre: float, s: Size) -> Plan:
    """A reading whose slope changes over the range: y + (gain - 1) (y - centre) (1 + bend (y - centre) / span).

    The noise of the electronics behind stays as it is.
    """
    span = {"V": 5.0, "alpha": 0.1, "q": 0.3}[channel]

    def spoil(name: str, y: FloatArray, t: FloatArray) -> FloatArray:
        d = _smooth(y) - centre
        return y if name != channel else np.asarray(y + (s["gain"] - 1.0) * d * (1.0 + 0.3 * d / span))

    return Plan(spoil=spoil)


def _smooth(y: FloatArray, half: int = 4) -> FloatArray:
    """Return the mean over ``half`` samples to either side."""
    width = 2 * half + 1
    return np.asarray(np.convolve(np.pad(y, half, mode="edge"), np.ones(width) / width, "valid"))


def sticky_vane(s: Size, aircraft: str) -> Plan:
    """A vane that stays where it is until the air has turned by half the play; the reading's scatter stays."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "alpha":
            return y
        smooth = _smooth(y)
        return np.asarray(servos.backlash(s["width_rad"])(smooth, t[1] - t[0]) + y - smooth)

    return Plan(spoil=spoil)


def vibration(s: Size, aircraft: str) -> Plan:
    """The engine shakes the accelerometer at one frequency."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + s["amplitude"] * np.sin(2.0 * math.pi * s["f_hz"] * t)) if channel == "az" else y

    return Plan(spoil=spoil)


def freezing(s: Size, aircraft: str) -> Plan:
    """The attitude stands still for a while in every record."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "theta":
            return y
        out, a, b = y.copy(), int(np.searchsorted(t, 3.0)), int(np.searchsorted(t, 3.0 + s["length_s"]))
        out[a:b] = out[a]
        return out

    return Plan(spoil=spoil)


def wandering(s: Size, aircraft: str) -> Plan:
    """The attitude wanders as a sine of 11 s."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + s["amplitude_rad"] * np.sin(2.0 * math.pi * t / 11.0)) if channel == "theta" else y

    return Plan(spoil=spoil)
