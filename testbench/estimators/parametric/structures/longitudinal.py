"""Longitudinal motion about a trimmed flight in dimensional derivatives, rigid or with elastic modes.

The short period: angle of attack and pitch rate at constant speed.

Whether the speed stayed constant enough for a structure that leaves it out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.core.advice import Advice, doubt
from testbench.core.errors import EstimationError
from testbench.core.record import FlightRecord, FloatArray
from testbench.estimators.parametric.structure import AnyArray, LinearStructure, Matrices, Parameter
from testbench.estimators.parametric.structures.settings import Rows, Trim, check_outputs, derivatives

# --- whether the speed stayed constant enough for a structure that leaves it out --------------------------------------


_SHARE = 0.3  # of the change of the flight path that speed alone makes
_G = 9.81


def speed_doubts(records: Sequence[FlightRecord], V_m_s: float | None) -> list[Advice]:
    """Return the doubt that a short-period model without airspeed takes up what the airspeed did.

    Lift grows with the square of speed, so that a speed V0 + v bends the flight path by 2 g v / V0^2. Its integral is
    compared with alpha less the integral of q, which is what the normal force did to the path altogether; a straight
    line is removed from both, since trims and biases make one.

    Args:
        records: prepared, with V, alpha and q; others say nothing.
        V_m_s: trimmed airspeed V0; None: the mean that was removed from V.
    """
    shares, moved = [], []
    for record in records:
        speed = V_m_s or dict(record.provenance.get("prepared", {}).get("removed", {})).get("V")
        if not speed or any(name not in record.channels for name in ("V", "alpha", "q")):
            continue
        part = record.select(("V", "alpha", "q"))
        V, alpha, q = (np.where(ok, z, 0.0) for z, ok in zip(part.data.T, part.valid.T, strict=True))
        V = V - speed if abs(float(np.mean(V))) > 0.5 * speed else V
        by_speed = _bent(np.cumsum(2.0 * _G * V / speed**2) * record.dt_s)
        whole = _bent(alpha - np.cumsum(q) * record.dt_s)
        if whole > 0.0:
            shares.append(by_speed / whole)
            moved.append(float(np.std(V)) / speed)
    if not shares or float(np.median(shares)) < _SHARE:
        return []
    return [
        doubt(
            "speed_left_out",
            f"the structure leaves out the airspeed, which varied by {100 * float(np.median(moved)):.1f} % (rms) and "
            f"by lift alone bent the path {float(np.median(shares)):.1f} times as much as all that was measured: "
            "Z_alpha, Z_q and what depends on them are biased beyond their errors; estimate V and theta too (leave out "
            "short), or identify from a few seconds after a fast input",
        )
    ]


def _bent(angle: FloatArray) -> float:
    """Return the root mean square of an angle (N,) about its straight line."""
    t = np.linspace(-1.0, 1.0, angle.size)
    return float(np.std(angle - np.polyval(np.polyfit(t, angle, 1), t)))


# --- the short period -------------------------------------------------------------------------------------------------


_OUTPUTS = ("alpha", "q", "qdot")


@dataclass(frozen=True, eq=False, kw_only=True)
class ShortPeriod(LinearStructure):
    """Short-period motion in dimensional derivatives per speed and per inertia (rad, s).

        alphadot = Z_0 + Z_alpha alpha + (1 + Z_q) q + Z_de de
        qdot     = M_0 + M_alpha alpha + M_q q + M_de de

    Outputs are any of alpha, q and qdot. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015.
    """

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        rows = Rows(self, params)
        variables = ("alpha", "q", *self.inputs)
        alphadot, qdot = rows.unit("q") + rows.sum_of("Z", variables), rows.sum_of("M", variables)
        outputs = [qdot if name == "qdot" else rows.unit(name) for name in self.outputs]
        return rows.matrices([alphadot, qdot], outputs)


def short_period(outputs: tuple[str, ...] = ("alpha", "q"), control: str = "de") -> ShortPeriod:
    """Return the short-period structure; it starts from a slow, well damped one.

    Args:
        outputs: any of alpha, q and qdot.
        control: the input channel, e.g. ``de`` or ``de_cmd``.

    Raises:
        EstimationError: an output or a parameter is not one of the structure's.
    """
    check_outputs("short_period", outputs, _OUTPUTS)
    d = control.removesuffix("_cmd")
    guess = {"Z_alpha": -1.0, "M_alpha": -4.0, "M_q": -2.0, f"M_{d}": -5.0}
    names = ("Z_0", "Z_alpha", "Z_q", f"Z_{d}", "M_0", "M_alpha", "M_q", f"M_{d}")
    return ShortPeriod(
        name="short_period",
        states=("alpha", "q"),
        inputs=(control,),
        outputs=tuple(outputs),
        parameters=tuple(Parameter(name, guess.get(name, 0.0)) for name in names),
    )


# --- longitudinal motion about a trimmed flight in dimensional derivatives, rigid or with elastic modes ---------------


FULL = ("V", "alpha", "q", "theta")
SHORT = ("alpha", "q")
_DERIVED = ("qdot", "ax", "az")


@dataclass(frozen=True, eq=False, kw_only=True)
class Longitudinal(LinearStructure):
    """Small longitudinal motion about a trim (V0, alpha0, theta0), gamma0 = theta0 - alpha0.

        Vdot     = X - g cos(gamma0) theta,        X = X_0 + X_V V + X_alpha alpha + X_q q + X_de de
        alphadot = q + (Z - g sin(gamma0) theta) / V0,    Z = Z_0 + Z_V V + Z_alpha alpha + Z_q q + Z_de de
        qdot     = M,                              M = M_0 + M_V V + M_alpha alpha + M_q q + M_de de
        thetadot = q

    X and Z are specific forces along the stability axes of the trim (x along the flight, z down), m/s2 per unit; M is
    an angular acceleration, rad/s2 per unit. Without V and theta among the states it is the
    short period. Derived outputs: ``qdot``, and the specific forces along body axes that an accelerometer reads at
    (x_a, z_a) from the centre of gravity, as deviations from trim:

        ax = X cos(alpha0) - Z sin(alpha0) + z_a qdot,    az = X sin(alpha0) + Z cos(alpha0) - x_a qdot

    The constants X_0, Z_0, M_0 take up what was left of trim values of V, alpha and theta. D. McRuer, I. Ashkenas, D.
    Graham, Aircraft Dynamics and Automatic Control, 1973, chapter 4.

    Attributes:
        trim: V0, alpha0, theta0 and g.
        accelerometer: (x_a, z_a) from the centre of gravity, m, body axes.
    """

    trim: Trim
    accelerometer: tuple[float, float] = (0.0, 0.0)

    def matrices(self, params: AnyArray) -> Matrices:
        """Return the matrices of parameters (..., k)."""
        rows = Rows(self, params)
        variables = (*self.states, *self.inputs)
        X, Z, M = (rows.sum_of(symbol, variables) for symbol in "XZM")
        derivative = {**self.rigid(rows, X, Z, M), **self.elastic(rows)}
        a, (x_a, z_a) = self.trim.alpha, self.accelerometer
        output = {
            "qdot": M,
            "ax": np.cos(a) * X - np.sin(a) * Z + z_a * M,
            "az": np.sin(a) * X + np.cos(a) * Z - x_a * M,
        }
        read = [self.sensed(rows, name, output.get(name, rows.unit(name)), derivative) for name in self.outputs]
        return rows.matrices([derivative[name] for name in self.states], read)

    def rigid(self, rows: Rows, X: AnyArray, Z: AnyArray, M: AnyArray) -> dict[str, AnyArray]:
        """Return the rows of the derivatives of the rigid states."""
        V, g, gamma = self.trim.V, self.trim.g, self.trim.theta - self.trim.alpha
        theta = rows.unit("theta")
        return {
            "V": X - g * np.cos(gamma) * theta,
            "alpha": rows.unit("q") + (Z - g * np.sin(gamma) * theta) / V,
            "q": M,
            "theta": rows.unit("q"),
        }

    def elastic(self, rows: Rows) -> dict[str, AnyArray]:
        """Return the rows of the derivatives of elastic states: none."""
        return {}

    def sensed(self, rows: Rows, name: str, row: AnyArray, derivative: Mapping[str, AnyArray]) -> AnyArray:
        """Return the row of an output with what elastic modes add to it: nothing."""
        return row


@dataclass(frozen=True, eq=False, kw_only=True)
class FlexibleLongitudinal(Longitudinal):
    """Longitudinal motion with elastic modes i = 1, 2, ... coupled to it.

        etaddot_i = -wn_i^2 eta_i - 2 zeta_i wn_i etadot_i + Qi_0 + Qi_V V + Qi_alpha alpha + Qi_q q + Qi_de de

    Qi are generalised forces per generalised mass; wn_i and zeta_i are those of the mode in the air flow, the rigid
    motion held. The modes act back through Z_eta_i, Z_etadot_i, M_eta_i and M_etadot_i (X likewise), terms of Z and M.
    Sensors feel them: the gyro reads q + slope_i etadot_i, the accelerometer az + phi_i etaddot_i, with the slope and
    the deflection (z down) of the mode shape where they sit. M. R. Waszak and D. K. Schmidt, Journal of Aircraft 25(6),
    1988.

    The scale of eta_i is free unless ``eta_i`` is an output; :func:`flexible` then fixes phi_i, or slope_i, to set it.
    """

    def elastic(self, rows: Rows) -> dict[str, AnyArray]:
        """Return the rows of the derivatives of displacements and velocities."""
        out: dict[str, AnyArray] = {}
        for i in range(1, _modes(self.states) + 1):
            wn, zeta = rows.values[f"wn_{i}"], rows.values[f"zeta_{i}"]
            stiffness, damping = (
                rows.scaled(wn**2, rows.unit(f"eta_{i}")),
                rows.scaled(2.0 * zeta * wn, rows.unit(f"etadot_{i}")),
            )
            out[f"eta_{i}"] = rows.unit(f"etadot_{i}")
            out[f"etadot_{i}"] = rows.sum_of(f"Q{i}", (*self.states, *self.inputs)) - stiffness - damping
        return out

    def sensed(self, rows: Rows, name: str, row: AnyArray, derivative: Mapping[str, AnyArray]) -> AnyArray:
        """Return the row of an output with what the modes add to gyro and accelerometer."""
        for i in range(1, _modes(self.states) + 1):
            if name == "q":
                row = row + rows.scaled(rows.values[f"slope_{i}"], rows.unit(f"etadot_{i}"))
            elif name == "az":
                row = row + rows.scaled(rows.values[f"phi_{i}"], derivative[f"etadot_{i}"])
        return row


def _modes(states: Sequence[str]) -> int:
    return sum(name.startswith("eta_") for name in states)


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
) -> Longitudinal:
    """Return longitudinal motion about a trim; X_q, which hardly shows in flight, is fixed at zero.

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
    return Longitudinal(
        name="longitudinal",
        states=tuple(states),
        inputs=tuple(controls),
        outputs=tuple(outputs),
        parameters=tuple(_rigid_parameters(states, controls, (), trim, ("X_q",))),
        trim=trim,
        accelerometer=accelerometer,
    )


def flexible(
    trim: Trim,
    wn_rad_s: Sequence[float],
    *,
    coupled: bool = False,
    states: Sequence[str] = SHORT,
    outputs: Sequence[str] = ("q", "alpha", "az"),
    controls: Sequence[str] = ("de",),
    accelerometer: tuple[float, float] = (0.0, 0.0),
) -> FlexibleLongitudinal:
    """Return longitudinal motion with an elastic mode for each of ``wn_rad_s``.

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
            raise EstimationError(f"no output feels elastic mode {i}; add eta_{i}, az or q to the outputs")
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
    return FlexibleLongitudinal(
        name="flexible",
        states=(*states, *elastic),
        inputs=tuple(controls),
        outputs=tuple(outputs),
        parameters=tuple(parameters),
        trim=trim,
        accelerometer=accelerometer,
    )


def _check(name: str, states: Sequence[str], outputs: Sequence[str], modes: int) -> None:
    if tuple(states) not in (FULL, SHORT):
        raise EstimationError(
            f"states of structure '{name}' must be {', '.join(FULL)} or {', '.join(SHORT)}, got {', '.join(states)}"
        )
    derived = [d for d in _DERIVED if d != "ax" or "V" in states]
    elastic = [f"{kind}_{i}" for kind in ("eta", "etadot") for i in range(1, modes + 1)]
    check_outputs(name, outputs, (*states, *derived, *elastic))
