"""Hidden truths of the flow: stall, slipstream, tail and wake.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

from testbench.questions.gap.hidden.aircraft import SPEEDS_M_S, number_of
from testbench.questions.gap.hidden.terms import ALPHA, CHORD_TIME, ELEVATOR, coefficient, number, prop, state, term
from testbench.questions.gap.hidden.truth import Size, Truth


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
