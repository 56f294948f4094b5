"""Longitudinal motion about a trimmed flight in dimensional derivatives, rigid or with elastic modes.

The short period: angle of attack and pitch rate at constant speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.core.errors import EstimationError
from testbench.estimators.parametric.structure import Parameter
from testbench.estimators.parametric.structures.settings import Trim, check_outputs, derivatives, total
from testbench.estimators.parametric.structures.written import Law, Packaged

# --- the short period -------------------------------------------------------------------------------------------------


def short_period(outputs: tuple[str, ...] = ("alpha", "q"), control: str = "de") -> Packaged:
    """Return short-period motion in dimensional derivatives per speed and per inertia (rad, s).

        alphadot = Z_0 + Z_alpha alpha + (1 + Z_q) q + Z_de de
        qdot     = M_0 + M_alpha alpha + M_q q + M_de de

    It starts from a slow, well damped one. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015.

    Args:
        outputs: any of alpha, q and qdot.
        control: the input channel, e.g. ``de`` or ``de_cmd``.

    Raises:
        EstimationError: an output or a parameter is not one of the structure's.
    """
    check_outputs("short_period", outputs)
    d = control.removesuffix("_cmd")
    guess = {"Z_alpha": -1.0, "M_alpha": -4.0, "M_q": -2.0, f"M_{d}": -5.0}
    names = ("Z_0", "Z_alpha", "Z_q", f"Z_{d}", "M_0", "M_alpha", "M_q", f"M_{d}")
    parameters = [Parameter(name, guess.get(name, 0.0)) for name in names]
    Z, M = (total(symbol, ("alpha", "q", control), parameters) for symbol in "ZM")
    steps = {"alpha_dot": f"q + ({Z})", "q_dot": M}
    law = Law.of(("alpha", "q"), (control,), outputs, parameters, steps, {"qdot": "q_dot"})
    return Packaged.of("short_period", law, parameters)


# --- longitudinal motion about a trimmed flight in dimensional derivatives, rigid or with elastic modes ---------------


FULL = ("V", "alpha", "q", "theta")
SHORT = ("alpha", "q")


def _about(
    trim: Trim,
    name: str,
    states: Sequence[str],
    controls: Sequence[str],
    outputs: Sequence[str],
    parameters: Sequence[Parameter],
    accelerometer: tuple[float, float],
) -> Packaged:
    """Return the motion of rigid and elastic states about a trim, see :func:`longitudinal` and :func:`flexible`."""
    variables, modes = (*states, *controls), range(1, sum(s.startswith("eta_") for s in states) + 1)
    theta = "theta" if "theta" in states else "0"
    steps = {symbol: total(symbol, variables, parameters) for symbol in "XZM"} | {
        "V_dot": f"X - sink*{theta}",
        "alpha_dot": f"q + (Z - rise*{theta})/V0",
        "q_dot": "M",
        "theta_dot": "q",
    }
    for i in modes:
        forces = total(f"Q{i}", variables, parameters)
        steps[f"eta_{i}_dot"] = f"etadot_{i}"
        steps[f"etadot_{i}_dot"] = f"{forces} - wn_{i}^2*eta_{i} - 2*zeta_{i}*wn_{i}*etadot_{i}"
    shown = {
        "qdot": "M",
        "q": " + ".join(["q", *(f"slope_{i}*etadot_{i}" for i in modes)]),
        "ax": "cos_a*X - sin_a*Z + z_a*M",
        "az": " + ".join(["sin_a*X + cos_a*Z - x_a*M", *(f"phi_{i}*etadot_{i}_dot" for i in modes)]),
    }
    gamma = trim.theta - trim.alpha
    constants = {
        "V0": trim.V,
        "sink": trim.g * np.cos(gamma),
        "rise": trim.g * np.sin(gamma),
        "cos_a": np.cos(trim.alpha),
        "sin_a": np.sin(trim.alpha),
        **dict(zip(("x_a", "z_a"), accelerometer, strict=True)),
    }
    return Packaged.of(name, Law.of(states, controls, outputs, parameters, steps, shown, constants), parameters, trim)


def _rigid_parameters(
    states: Sequence[str], controls: Sequence[str], elastic: Sequence[str], trim: Trim, fixed: Sequence[str]
) -> list[Parameter]:
    V, g = trim.V, trim.g
    guess = {"X_V": -0.05, "X_alpha": 0.5 * g, "Z_V": -2.0 * g / V, "Z_alpha": -V, "M_alpha": -4.0, "M_q": -2.0}
    guess |= {"M_de": -5.0}
    moving = [s for s in states if s != "theta"]
    variables = [*moving, *elastic, *controls]
    symbols = ("X", "Z", "M") if "V" in states else ("Z", "M")
    return [p for symbol in symbols for p in derivatives(symbol, variables, guess, fixed)]


def longitudinal(
    trim: Trim,
    *,
    states: Sequence[str] = FULL,
    outputs: Sequence[str] = FULL,
    controls: Sequence[str] = ("de",),
    accelerometer: tuple[float, float] = (0.0, 0.0),
) -> Packaged:
    """Return small longitudinal motion about a trim (V0, alpha0, theta0), gamma0 = theta0 - alpha0.

        Vdot     = X - g cos(gamma0) theta,        X = X_0 + X_V V + X_alpha alpha + X_q q + X_de de
        alphadot = q + (Z - g sin(gamma0) theta) / V0,    Z = Z_0 + Z_V V + Z_alpha alpha + Z_q q + Z_de de
        qdot     = M,                              M = M_0 + M_V V + M_alpha alpha + M_q q + M_de de
        thetadot = q

    X and Z are specific forces along the stability axes of the trim (x along the flight, z down), m/s2 per unit; M is
    an angular acceleration, rad/s2 per unit. Without V and theta among the states it is the
    short period. Derived outputs: ``qdot``, and the specific forces along body axes that an accelerometer reads at
    (x_a, z_a) from the centre of gravity, as deviations from trim:

        ax = X cos(alpha0) - Z sin(alpha0) + z_a qdot,    az = X sin(alpha0) + Z cos(alpha0) - x_a qdot

    The constants X_0, Z_0, M_0 take up what was left of trim values of V, alpha and theta; X_q, which hardly shows in
    flight, is fixed at zero. D. McRuer, I. Ashkenas, D. Graham, Aircraft Dynamics and Automatic Control, 1973, chapter
    4.

    Args:
        trim: airspeed, m/s, angle of attack and pitch angle, rad, that the records are deviations from.
        states: V, alpha, q, theta, or alpha and q alone.
        outputs: any of the states, qdot, ax and az; ax needs V among the states.
        controls: input channels, e.g. ``de``, ``thr``.
        accelerometer: x_a, z_a from the centre of gravity, m, forward and down positive.

    Raises:
        EstimationError: states, outputs or a parameter that the structure does not have.
    """
    _check("longitudinal", states, outputs, 0)
    parameters = _rigid_parameters(states, controls, (), trim, ("X_q",))
    return _about(trim, "longitudinal", states, controls, outputs, parameters, accelerometer)


def flexible(
    trim: Trim,
    wn_rad_s: Sequence[float],
    *,
    coupled: bool = False,
    states: Sequence[str] = SHORT,
    outputs: Sequence[str] = ("q", "alpha", "az"),
    controls: Sequence[str] = ("de",),
    accelerometer: tuple[float, float] = (0.0, 0.0),
) -> Packaged:
    """Return longitudinal motion with elastic modes i = 1, 2, ... coupled to it, one for each of ``wn_rad_s``.

        etaddot_i = -wn_i^2 eta_i - 2 zeta_i wn_i etadot_i + Qi_0 + Qi_V V + Qi_alpha alpha + Qi_q q + Qi_de de

    Qi are generalised forces per generalised mass; wn_i and zeta_i are those of the mode in the air flow, the rigid
    motion held. The modes act back through Z_eta_i, Z_etadot_i, M_eta_i and M_etadot_i (X likewise), terms of Z and M.
    Sensors feel them: the gyro reads q + slope_i etadot_i, the accelerometer az + phi_i etaddot_i, with the slope and
    the deflection (z down) of the mode shape where they sit. M. R. Waszak and D. K. Schmidt, Journal of Aircraft 25(6),
    1988.

    The scale of a mode is set by its first of: output eta_i, phi_i = 1 (eta_i is then the deflection at the
    accelerometer, m), slope_i = 1 (the slope at the gyro, rad); the others are free. Qi_0, X_eta_i, X_etadot_i and
    Qi_V are fixed at zero. With ``coupled`` the slopes must be known, from a ground vibration test or a finite element
    model, and are fixed at their start values: with free ones two different sets of values give the same response.

    Args:
        trim: airspeed, m/s, angle of attack and pitch angle, rad, that the records are deviations from.
        wn_rad_s: start values of the natural frequencies, rad/s.
        coupled: estimate what the modes do to Z and M; else fixed at zero.
        states: rigid states, as for :func:`longitudinal`.
        outputs: any of the rigid states, qdot, ax, az and eta_i, etadot_i.
        controls: input channels.
        accelerometer: x_a, z_a from the centre of gravity, m.

    Raises:
        EstimationError: no mode, frequencies that are not positive, a mode that no output feels, or names that the
            structure does not have.
    """
    if not wn_rad_s or min(wn_rad_s) <= 0.0:
        raise EstimationError(f"structure 'flexible' needs a frequency > 0 for each mode, got {list(wn_rad_s)} rad/s")
    modes = range(1, len(wn_rad_s) + 1)
    _check("flexible", states, outputs, len(wn_rad_s))
    elastic = [f"{kind}_{i}" for i in modes for kind in ("eta", "etadot")]
    back = [f"{symbol}_{name}" for symbol in "XZM" for name in elastic]
    fixed = ["X_q", *(name for name in back if not coupled or name.startswith("X"))]
    parameters = _rigid_parameters(states, controls, elastic, trim, fixed)
    for i in modes:
        measured = f"eta_{i}" in outputs or f"etadot_{i}" in outputs
        if not measured and not {"q", "az"} & set(outputs):
            raise EstimationError(f"no output depends on elastic mode {i}; add eta_{i}, az or q to the outputs")
        forced = [s for s in states if s != "theta"]
        parameters += [
            Parameter(f"wn_{i}", float(wn_rad_s[i - 1]), low=0.0),
            Parameter(f"zeta_{i}", 0.05),
            *derivatives(
                f"Q{i}", [*forced, *controls], {f"Q{i}_alpha": -1.0, f"Q{i}_de": -1.0}, (f"Q{i}_0", f"Q{i}_V")
            ),
        ]
        sets_scale = None if measured else "az" if "az" in outputs else "q"
        known = coupled and not measured
        for sensor, name in (("az", f"phi_{i}"), ("q", f"slope_{i}")):
            if sensor in outputs:
                parameters.append(Parameter(name, float(sensor == sets_scale), free=sensor != sets_scale and not known))
    return _about(trim, "flexible", (*states, *elastic), controls, outputs, parameters, accelerometer)


def _check(name: str, states: Sequence[str], outputs: Sequence[str], modes: int) -> None:
    if tuple(states) not in (FULL, SHORT):
        raise EstimationError(
            f"states of structure '{name}' must be {', '.join(FULL)} or {', '.join(SHORT)}, got {', '.join(states)}"
        )
    derived = [d for d in ("qdot", "ax", "az") if d != "ax" or "V" in states]
    elastic = [f"{kind}_{i}" for kind in ("eta", "etadot") for i in range(1, modes + 1)]
    check_outputs(name, outputs, (*states, *derived, *elastic))
