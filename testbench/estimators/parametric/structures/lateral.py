"""Lateral-directional motion: sideslip is a state, of known speed or not, or an input of the rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, Parameter
from testbench.estimators.parametric.structures.settings import Rows, Trim, check_outputs, derivatives

_STATES = ("beta", "p", "r", "phi")
_GUESS = {"L_p": -2.0, "L_r": 0.5, "L_beta": -4.0, "L_da": 5.0, "N_r": -0.5, "N_beta": 3.0, "N_dr": -2.0}


@dataclass(frozen=True, eq=False, kw_only=True)
class LateralDirectional(LinearStructure):
    """Small lateral motion about a straight trim with wings level (V0, alpha0, theta0).

        betadot = (Y + g cos(theta0) phi) / V0 + p sin(alpha0) - r cos(alpha0)
        pdot    = L,    rdot = N,    phidot = p + r tan(theta0)
        Y = Y_0 + Y_beta beta + Y_p p + Y_r r + Y_da da + Y_dr dr;  L, N likewise

    Y is a specific force, m/s2 per unit; L and N are angular accelerations about body axes, products of inertia
    included (the primed derivatives). Derived outputs: pdot, rdot and the lateral specific force at (x_a, z_a) from the
    centre of gravity, ay = Y + x_a rdot - z_a pdot. D. McRuer, I. Ashkenas, D. Graham, Aircraft Dynamics and Automatic
    Control, 1973, chapter 4.

    Attributes:
        trim: V0, alpha0, theta0 and g.
        accelerometer: (x_a, z_a) from the centre of gravity, m, body axes.
    """

    trim: Trim
    accelerometer: tuple[float, float] = (0.0, 0.0)

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        rows, t = Rows(self, params), self.trim
        Y, L, N = (rows.sum_of(symbol, ("beta", "p", "r", *self.inputs)) for symbol in "YLN")
        p, r, phi = (rows.unit(name) for name in ("p", "r", "phi"))
        betadot = (Y + t.g * np.cos(t.theta) * phi) / t.V + np.sin(t.alpha) * p - np.cos(t.alpha) * r
        x_a, z_a = self.accelerometer
        derived = {"pdot": L, "rdot": N, "ay": Y + x_a * N - z_a * L}
        outputs = [derived.get(name, rows.unit(name)) for name in self.outputs]
        return rows.matrices([betadot, L, N, p + np.tan(t.theta) * r], outputs)


@dataclass(frozen=True, eq=False, kw_only=True)
class RollYawRates(LinearStructure):
    """Roll and yaw rate driven by controls and by the measured sideslip.

        pdot = L_0 + L_p p + L_r r + L_da da + L_dr dr + L_beta beta;    rdot likewise with N
        ay   = Y_0 + Y_p p + Y_r r + Y_da da + Y_dr dr + Y_beta beta

    R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015. Noise of the measured sideslip biases
    estimates; it is taken as small.
    """

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        rows = Rows(self, params)
        Y, L, N = (rows.sum_of(symbol, ("p", "r", *self.inputs)) for symbol in "YLN")
        derived = {"pdot": L, "rdot": N, "ay": Y}
        return rows.matrices([L, N], [derived.get(name, rows.unit(name)) for name in self.outputs])


@dataclass(frozen=True, eq=False, kw_only=True)
class LateralPerSpeed(LinearStructure):
    """Small lateral motion of an airspeed that nobody measured: side forces are per speed (rad, s).

        betadot = Y_0 + Y_beta beta + (Y_r - 1) r + Y_da da + Y_dr dr + alpha_trim p + g_V phi
        pdot    = L,    rdot = N,    phidot = p + theta_trim r
        L = L_0 + L_beta beta + L_p p + L_r r + L_da da + L_dr dr;  N likewise

    g_V is gravity over speed, 1/s: the airspeed comes with the derivatives, and so do the trimmed angles of attack and
    pitch (rad, small). L and N are as in :class:`LateralDirectional`.
    """

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        rows = Rows(self, params)
        Y, L, N = (rows.sum_of(symbol, ("beta", "p", "r", *self.inputs)) for symbol in "YLN")
        p, r, phi = (rows.unit(name) for name in ("p", "r", "phi"))
        alpha, theta, g_V = (rows.values[name] for name in ("alpha_trim", "theta_trim", "g_V"))
        betadot = Y + rows.scaled(g_V, phi) + rows.scaled(alpha, p) - r
        derived = {"pdot": L, "rdot": N}
        outputs = [derived.get(name, rows.unit(name)) for name in self.outputs]
        return rows.matrices([betadot, L, N, p + rows.scaled(theta, r)], outputs)


def lateral_directional(
    trim: Trim,
    *,
    outputs: Sequence[str] = _STATES,
    controls: Sequence[str] = ("da", "dr"),
    accelerometer: tuple[float, float] = (0.0, 0.0),
) -> LateralDirectional:
    """Return lateral-directional motion about a trim; Y_p and Y_da, which hardly show in flight, are fixed at zero.

    Args:
        trim: airspeed, m/s, angle of attack and pitch angle, rad, that the records are deviations from.
        outputs: any of beta, p, r, phi, pdot, rdot and ay.
        controls: input channels.
        accelerometer: x_a, z_a from the centre of gravity, m, forward and down positive.

    Raises:
        EstimationError: an output or a parameter that the structure does not have.
    """
    check_outputs("lateral_directional", outputs, (*_STATES, "pdot", "rdot", "ay"))
    variables = ("beta", "p", "r", *controls)
    guess = {"Y_beta": -0.2 * trim.V, **_GUESS}
    return LateralDirectional(
        name="lateral_directional",
        states=_STATES,
        inputs=tuple(controls),
        outputs=tuple(outputs),
        parameters=tuple(p for symbol in "YLN" for p in derivatives(symbol, variables, guess, ("Y_p", "Y_da"))),
        trim=trim,
        accelerometer=accelerometer,
    )


def lateral_per_speed(outputs: Sequence[str] = _STATES, controls: Sequence[str] = ("da", "dr")) -> LateralPerSpeed:
    """Return lateral motion without a known airspeed; Y_da, which hardly shows in flight, is fixed at zero.

    Args:
        outputs: any of beta, p, r, phi, pdot and rdot.
        controls: input channels.

    Raises:
        EstimationError: an output or a parameter that the structure does not have.
    """
    check_outputs("lateral_per_speed", outputs, (*_STATES, "pdot", "rdot"))
    guess = {"Y_beta": -0.2, **_GUESS}
    found = [
        p
        for symbol in "YLN"
        for p in derivatives(symbol, ("beta", "r", *controls) if symbol == "Y" else ("beta", "p", "r", *controls),
                             guess, ("Y_da",))
    ]  # fmt: skip
    angles = [Parameter("alpha_trim", 0.0), Parameter("theta_trim", 0.0), Parameter("g_V", 0.4, low=0.0)]
    return LateralPerSpeed(
        name="lateral_per_speed",
        states=_STATES,
        inputs=tuple(controls),
        outputs=tuple(outputs),
        parameters=(*found, *angles),
    )


def roll_yaw_rates(
    outputs: Sequence[str] = ("p", "r"),
    controls: Sequence[str] = ("da", "dr"),
) -> RollYawRates:
    """Return roll and yaw rate with sideslip as a further input.

    Args:
        outputs: any of p, r, pdot, rdot and ay.
        controls: input channels besides beta.

    Raises:
        EstimationError: an output or a parameter that the structure does not have.
    """
    check_outputs("roll_yaw_rates", outputs, ("p", "r", "pdot", "rdot", "ay"))
    symbols = "YLN" if "ay" in outputs else "LN"
    inputs = (*controls, "beta")
    return RollYawRates(
        name="roll_yaw_rates",
        states=("p", "r"),
        inputs=inputs,
        outputs=tuple(outputs),
        parameters=tuple(p for symbol in symbols for p in derivatives(symbol, ("p", "r", *inputs), _GUESS, ())),
    )
