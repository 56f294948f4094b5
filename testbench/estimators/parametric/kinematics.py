"""Rigid-body kinematics with the errors of the instruments as parameters: what every record must obey, whatever flies.

Over a flat earth, in air that moves steadily (u, v, w relative to the air; ax, ay, az specific forces at the CG):

    udot = ax - g sin theta            + r v - q w        phidot   = p + tan theta (q sin phi + r cos phi)
    vdot = ay + g cos theta sin phi    + p w - r u        thetadot = q cos phi - r sin phi
    wdot = az + g cos theta cos phi    + q u - p v        psidot   = (q sin phi + r cos phi) / cos theta
    hdot = u sin theta - v cos theta sin phi - w cos theta cos phi - wind_down

An instrument reads y = scale x + bias. So true rates are (measured - bias) / scale, and true accelerations are
measured - bias. An accelerometer off the CG, at r, reads the force there, a + omegadot x r + omega x (omega x r).
R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015, chapter 10; V. Klein and E. A. Morelli,
Aircraft System Identification, 2006, chapter 10.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.core.errors import ChannelError, EstimationError
from testbench.estimators.parametric.structure import AnyArray, ModelStructure, Parameter

Motion = Literal["full", "longitudinal", "vertical", "lateral"]

INPUTS: dict[Motion, tuple[str, ...]] = {
    "full": ("p", "q", "r", "ax", "ay", "az"),
    "longitudinal": ("q", "ax", "az"),
    "vertical": ("q", "az", "V"),
    "lateral": ("p", "q", "r", "ay", "V", "alpha", "theta"),
}
"""The channels that drive each kind of motion. "longitudinal" holds v = phi = p = r = 0; "vertical" does so without ax
and takes the airspeed as it was measured; "lateral" takes airspeed, angle of attack and pitch angle as they were
measured."""
_STATES: dict[Motion, tuple[str, ...]] = {
    "full": ("u", "v", "w", "phi", "theta", "psi", "h"),
    "longitudinal": ("u", "w", "theta", "h"),
    "vertical": ("w", "theta", "h"),
    "lateral": ("v", "phi", "psi"),
}
OUTPUTS: dict[Motion, tuple[str, ...]] = {
    "full": ("V", "alpha", "beta", "phi", "theta", "psi", "h", "hdot", "Vg"),
    "longitudinal": ("V", "alpha", "theta", "h", "hdot"),
    "vertical": ("alpha", "theta", "h", "hdot"),
    "lateral": ("beta", "phi", "psi"),
}
"""The channels with which each kind of motion may be compared."""
_NEEDED: dict[Motion, tuple[str, ...]] = {
    "full": ("V", "alpha", "beta", "phi", "theta"),
    "longitudinal": ("V", "theta"),
    "vertical": ("alpha", "theta"),
    "lateral": ("beta", "phi"),
}
ACCELEROMETERS = ("ax", "ay", "az")
RATES = ("p", "q", "r")
_ROTATION = ("pdot", "qdot", "rdot")
_SCALED = ("V", "alpha", "beta", "phi", "theta")  # a heading has no zero to scale from


def motion_of(available: Collection[str]) -> Motion:
    """Return the fullest kind of motion that a record with these channels can be checked in.

    Raises:
        ChannelError: it is too few for any; the message says what would do.
    """
    for motion, inputs in INPUTS.items():
        if set(inputs) | set(_NEEDED[motion]) <= set(available):
            if motion == "longitudinal" and not {"alpha", "h", "hdot"} & set(available):
                continue
            return motion
    raise ChannelError(
        "data compatibility needs the channels of one kind of motion: p q r ax ay az with V alpha beta phi theta, or q "
        "ax az with V theta and alpha or h, or q az V with alpha theta, or p q r ay V alpha theta with beta phi; the "
        f"record holds only {', '.join(available)}"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class KinematicStructure(ModelStructure):
    """The equations of this module for one kind of motion.

    Attributes:
        motion: which of them.
        positions_m: accelerometer -> position from the CG (forward, right, down), m; at the CG where not named.
        gravity_m_s2: g, constant.
    """

    motion: Motion
    positions_m: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    gravity_m_s2: float = G0_M_S2

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return dx/dt, shape (..., n), of states (..., n), inputs (..., m) and parameters (..., k)."""
        p = self.unpack(params)
        m = self._motion(x, u, p)
        ax, ay, az = self._specific_force(m, p)
        s_phi, c_phi, s_theta, c_theta = m["s_phi"], m["c_phi"], m["s_theta"], m["c_theta"]
        U, V, W, P, Q, R, g = m["u"], m["v"], m["w"], m["p"], m["q"], m["r"], self.gravity_m_s2
        turn = Q * s_phi + R * c_phi
        out = {
            "u": lambda: ax - g * s_theta + R * V - Q * W,
            "v": lambda: ay + g * c_theta * s_phi + P * W - R * U,
            "w": lambda: az + g * c_theta * c_phi + Q * U - P * V,
            "phi": lambda: P + turn * s_theta / c_theta,
            "theta": lambda: Q * c_phi - R * s_phi,
            "psi": lambda: turn / c_theta,
            "h": lambda: self._climb(m, p),
        }
        return np.stack(np.broadcast_arrays(*(out[name]() for name in self.states)), axis=-1)

    def _motion(self, x: AnyArray, u: AnyArray, p: Mapping[str, Any]) -> dict[str, Any]:
        """Return velocities, true rates, and sines and cosines of the attitude."""
        m = self._true_inputs(u, p)
        m.update(zip(self.states, _columns(x), strict=True))
        if self.motion == "lateral":
            forward = np.sqrt(m["V"] * m["V"] - m["v"] * m["v"])
            m["u"], m["w"] = forward * np.cos(m["alpha"]), forward * np.sin(m["alpha"])
        elif self.motion == "vertical":
            m["u"] = np.sqrt(m["V"] * m["V"] - m["w"] * m["w"])
        for name in ("phi", "theta"):
            m[f"s_{name}"], m[f"c_{name}"] = np.sin(m[name]), np.cos(m[name])
        return m

    def _true_inputs(self, u: AnyArray, p: Mapping[str, Any]) -> dict[str, Any]:
        """Return the inputs less the errors of rates and speed; zero for what the motion holds at zero."""
        m: dict[str, Any] = dict.fromkeys((*ACCELEROMETERS, *RATES, *_ROTATION, "v", "phi", "theta"), 0.0)
        m.update(zip(self.inputs, _columns(u), strict=True))
        for name in RATES:
            if name in self.inputs:
                m[name] = (m[name] - p[f"{name}_bias"]) / p[f"{name}_scale"]
        if "V" in self.inputs:
            m["V"] = (m["V"] - p["V_bias"]) / p["V_scale"]
        return m

    def _specific_force(self, m: Mapping[str, Any], p: Mapping[str, Any]) -> list[Any]:
        out: list[Any] = []
        P, Q, R = m["p"], m["q"], m["r"]
        dP, dQ, dR = (m[name] for name in _ROTATION)
        for axis, name in enumerate(ACCELEROMETERS):
            if name not in self.inputs:
                out.append(0.0)
                continue
            a = m[name] - p[f"{name}_bias"]
            if name in self.positions_m:
                x, y, z = self.positions_m[name]
                # omegadot x r + omega x (omega x r), by axis
                arm = (
                    lambda: dQ * z - dR * y + P * (Q * y + R * z) - (Q * Q + R * R) * x,  # noqa: B023
                    lambda: dR * x - dP * z + Q * (P * x + R * z) - (P * P + R * R) * y,  # noqa: B023
                    lambda: dP * y - dQ * x + R * (P * x + Q * y) - (P * P + Q * Q) * z,  # noqa: B023
                )[axis]
                a = a - arm()
            out.append(a)
        return out

    def _climb(self, m: Mapping[str, Any], p: Mapping[str, Any]) -> Any:
        through_air = m["u"] * m["s_theta"] - m["c_theta"] * (m["v"] * m["s_phi"] + m["w"] * m["c_phi"])
        return through_air - p["wind_down"]

    def at_cg(self, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return inputs (..., m) without their errors: rates and speed true, accelerations at the CG."""
        p = self.unpack(params)
        m = self._true_inputs(u, p)
        m.update(zip(ACCELEROMETERS, self._specific_force(m, p), strict=True))
        return np.stack(np.broadcast_arrays(*(m[name] for name in self.inputs)), axis=-1)

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return what the instruments read, shape (..., p)."""
        p = self.unpack(params)
        m = self._motion(x, u, p)
        speed = np.sqrt(m["u"] ** 2 + m["v"] ** 2 + m["w"] ** 2)
        out = []
        for name in self.outputs:
            if name == "V":
                value = speed
            elif name == "alpha":
                value = np.arctan(m["w"] / m["u"])
            elif name == "beta":
                value = np.arcsin(m["v"] / speed)
            elif name == "hdot":
                value = self._climb(m, p)
            elif name == "Vg":
                value = self._ground_speed(m, p)
            else:
                value = m[name]
            if name in _SCALED:
                value = p[f"{name}_scale"] * value + p[f"{name}_bias"]
            out.append(value)
        return np.stack(np.broadcast_arrays(*out), axis=-1)

    def _ground_speed(self, m: Mapping[str, Any], p: Mapping[str, Any]) -> Any:
        ahead = m["u"] * m["c_theta"] + m["s_theta"] * (m["v"] * m["s_phi"] + m["w"] * m["c_phi"])
        right = m["v"] * m["c_phi"] - m["w"] * m["s_phi"]
        s, c = np.sin(m["psi"]), np.cos(m["psi"])
        north, east = ahead * c - right * s + p["wind_north"], ahead * s + right * c + p["wind_east"]
        return np.sqrt(north**2 + east**2)


def kinematics(
    available: Collection[str],
    motion: Motion | None = None,
    *,
    positions_m: Mapping[str, tuple[float, float, float]] | None = None,
    gravity_m_s2: float = G0_M_S2,
) -> KinematicStructure:
    """Return the kinematic structure for records that hold the channels ``available``.

    Its parameters are biases of the accelerations that drive it, bias and scale of its rates and of V, alpha, beta, phi
    and theta, ``wind_down`` where h or hdot is recorded, and ``wind_north`` and ``wind_east`` where Vg is (with psi).

    Args:
        available: channels of the records.
        motion: "full", "longitudinal", "vertical" or "lateral"; None takes the fullest that the channels allow.
        positions_m: accelerometer -> position from the CG (forward, right, down), m.
        gravity_m_s2: g.

    Raises:
        ChannelError: a channel that the motion needs is missing.
        EstimationError: a position is not that of an accelerometer that is used.
    """
    motion = motion or motion_of(available)
    missing = [n for n in (*INPUTS[motion], *_NEEDED[motion]) if n not in available]
    if missing:
        raise ChannelError(
            f"'{motion}' kinematics need {', '.join(missing)}, but the record holds {', '.join(available)}"
        )
    outputs = tuple(n for n in OUTPUTS[motion] if n in available and (n != "Vg" or "psi" in available))
    seen = {"psi": "psi" in outputs, "h": "h" in outputs}
    states = tuple(s for s in _STATES[motion] if seen.get(s, True))
    inputs = INPUTS[motion]
    positions = {name: position for name, position in (positions_m or {}).items() if any(position)}
    for name in positions:
        if name not in inputs or name not in ACCELEROMETERS:
            raise EstimationError(
                f"a position belongs to an accelerometer that drives '{motion}' kinematics, got one for '{name}'"
            )
    if positions:
        inputs = (*inputs, *(f"{name}dot" for name in RATES if name in inputs))
    parameters = [Parameter(f"{n}_bias", 0.0) for n in inputs if n in (*RATES, *ACCELEROMETERS)]
    parameters += [Parameter(f"{n}_scale", 1.0, low=0.1, high=10.0) for n in inputs if n in RATES]
    for name in dict.fromkeys((*(n for n in inputs if n == "V"), *outputs)):
        if name in _SCALED:
            parameters += [Parameter(f"{name}_scale", 1.0, low=0.1, high=10.0), Parameter(f"{name}_bias", 0.0)]
    vertical = "h" in outputs or "hdot" in outputs
    parameters.append(Parameter("wind_down", 0.0, free=vertical))
    parameters += [Parameter(f"wind_{axis}", 0.0) for axis in ("north", "east") if "Vg" in outputs]
    return KinematicStructure(
        name=f"{motion}_kinematics",
        states=states,
        inputs=inputs,
        outputs=outputs,
        parameters=tuple(parameters),
        motion=motion,
        positions_m=positions,
        gravity_m_s2=gravity_m_s2,
    )


def _columns(array: AnyArray) -> list[AnyArray]:
    return [array[..., i] for i in range(array.shape[-1])]
