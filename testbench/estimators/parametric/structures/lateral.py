"""Lateral-directional motion: sideslip is a state, of known speed or not, or an input of the rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.estimators.parametric.structure import Parameter
from testbench.estimators.parametric.structures.settings import Trim, check_outputs, derivatives, total
from testbench.estimators.parametric.structures.written import Law, Packaged

_STATES = ("beta", "p", "r", "phi")
_GUESS = {"L_p": -2.0, "L_r": 0.5, "L_beta": -4.0, "L_da": 5.0, "N_r": -0.5, "N_beta": 3.0, "N_dr": -2.0}


def lateral_directional(
    trim: Trim,
    *,
    outputs: Sequence[str] = _STATES,
    controls: Sequence[str] = ("da", "dr"),
    accelerometer: tuple[float, float] = (0.0, 0.0),
) -> Packaged:
    """Return small lateral motion about a straight trim with wings level (V0, alpha0, theta0).

        betadot = (Y + g cos(theta0) phi) / V0 + p sin(alpha0) - r cos(alpha0)
        pdot    = L,    rdot = N,    phidot = p + r tan(theta0)
        Y = Y_0 + Y_beta beta + Y_p p + Y_r r + Y_da da + Y_dr dr;  L, N likewise

    Y is a specific force, m/s2 per unit; L and N are angular accelerations about body axes, products of inertia
    included (the primed derivatives). Y_p and Y_da, which hardly show in flight, are fixed at zero. Derived outputs:
    pdot, rdot and the lateral specific force at (x_a, z_a) from the centre of gravity, ay = Y + x_a rdot - z_a pdot. D.
    McRuer, I. Ashkenas, D. Graham, Aircraft Dynamics and Automatic Control, 1973, chapter 4.

    Args:
        trim: airspeed, m/s, angle of attack and pitch angle, rad, that the records are deviations from.
        outputs: any of beta, p, r, phi, pdot, rdot and ay.
        controls: input channels.
        accelerometer: x_a, z_a from the centre of gravity, m, forward and down positive.

    Raises:
        EstimationError: an output or a parameter that the structure does not have.
    """
    check_outputs("lateral_directional", outputs)
    variables = ("beta", "p", "r", *controls)
    guess = {"Y_beta": -0.2 * trim.V, **_GUESS}
    parameters = [p for symbol in "YLN" for p in derivatives(symbol, variables, guess, ("Y_p", "Y_da"))]
    steps = {
        **{symbol: total(symbol, variables, parameters) for symbol in "YLN"},
        "beta_dot": "(Y + g_level*phi)/V0 + sin_a*p - cos_a*r",
        "p_dot": "L",
        "r_dot": "N",
        "phi_dot": "p + tan_theta*r",
    }
    constants = {
        "V0": trim.V,
        "g_level": trim.g * np.cos(trim.theta),
        "sin_a": np.sin(trim.alpha),
        "cos_a": np.cos(trim.alpha),
        "tan_theta": np.tan(trim.theta),
        **dict(zip(("x_a", "z_a"), accelerometer, strict=True)),
    }
    shown = {"pdot": "L", "rdot": "N", "ay": "Y + x_a*N - z_a*L"}
    law = Law.of(_STATES, controls, outputs, parameters, steps, shown, constants)
    return Packaged.of("lateral_directional", law, parameters, trim)


def lateral_per_speed(outputs: Sequence[str] = _STATES, controls: Sequence[str] = ("da", "dr")) -> Packaged:
    """Return small lateral motion of an airspeed that nobody measured: side forces are per speed (rad, s).

        betadot = Y_0 + Y_beta beta + (Y_r - 1) r + Y_da da + Y_dr dr + alpha_trim p + g_V phi
        pdot    = L,    rdot = N,    phidot = p + theta_trim r
        L = L_0 + L_beta beta + L_p p + L_r r + L_da da + L_dr dr;  N likewise

    g_V is gravity over speed, 1/s: the airspeed comes with the derivatives, and so do the trimmed angles of attack and
    pitch (rad, small). L and N are as in :func:`lateral_directional`. Y_da, which hardly shows in flight, is fixed at
    zero.

    Args:
        outputs: any of beta, p, r, phi, pdot and rdot.
        controls: input channels.

    Raises:
        EstimationError: an output or a parameter that the structure does not have.
    """
    check_outputs("lateral_per_speed", outputs)
    guess = {"Y_beta": -0.2, **_GUESS}
    found = [
        p
        for symbol in "YLN"
        for p in derivatives(symbol, ("beta", "r", *controls) if symbol == "Y" else ("beta", "p", "r", *controls),
                             guess, ("Y_da",))
    ]  # fmt: skip
    angles = [Parameter("alpha_trim", 0.0), Parameter("theta_trim", 0.0), Parameter("g_V", 0.4, low=0.0)]
    steps = {
        "beta_dot": f"{total('Y', ('beta', 'r', *controls), found)} + g_V*phi + alpha_trim*p - r",
        "p_dot": total("L", ("beta", "p", "r", *controls), found),
        "r_dot": total("N", ("beta", "p", "r", *controls), found),
        "phi_dot": "p + theta_trim*r",
    }
    shown = {"pdot": "p_dot", "rdot": "r_dot"}
    parameters = (*found, *angles)
    return Packaged.of("lateral_per_speed", Law.of(_STATES, controls, outputs, parameters, steps, shown), parameters)


def roll_yaw_rates(outputs: Sequence[str] = ("p", "r"), controls: Sequence[str] = ("da", "dr")) -> Packaged:
    """Return roll and yaw rate driven by controls and by the measured sideslip.

        pdot = L_0 + L_p p + L_r r + L_da da + L_dr dr + L_beta beta;    rdot likewise with N
        ay   = Y_0 + Y_p p + Y_r r + Y_da da + Y_dr dr + Y_beta beta

    R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015. Noise of the measured sideslip biases
    estimates; it is taken as small.

    Args:
        outputs: any of p, r, pdot, rdot and ay.
        controls: input channels besides beta.

    Raises:
        EstimationError: an output or a parameter that the structure does not have.
    """
    check_outputs("roll_yaw_rates", outputs)
    symbols = "YLN" if "ay" in outputs else "LN"
    inputs = (*controls, "beta")
    variables = ("p", "r", *inputs)
    parameters = [p for symbol in symbols for p in derivatives(symbol, variables, _GUESS, ())]
    steps = {"p_dot": total("L", variables, parameters), "r_dot": total("N", variables, parameters)}
    shown = {"pdot": "p_dot", "rdot": "r_dot", "ay": total("Y", variables, parameters)}
    return Packaged.of("roll_yaw_rates", Law.of(("p", "r"), inputs, outputs, parameters, steps, shown), parameters)
