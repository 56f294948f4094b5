"""Nonlinear longitudinal motion with aerodynamic coefficients as polynomials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from testbench.core.constants import G0_M_S2
from testbench.core.errors import EstimationError
from testbench.estimators.parametric.structure import AnyArray, ModelStructure, Parameter
from testbench.estimators.parametric.structures.settings import check_outputs

_STATES = ("V", "alpha", "theta", "q")
_OUTPUTS = (*_STATES, "qdot", "ax", "az")
_COEFFICIENTS = ("CD", "CL", "Cm")
TERMS: Mapping[str, tuple[str, ...]] = {
    "CD": ("0", "V", "alpha"),
    "CL": ("0", "V", "alpha"),
    "Cm": ("0", "V", "alpha", "q", "de"),
}
"""The parametrisation of the HFB-320 example: CD_0, CD_V, CD_alpha, CL_0, ..., Cm_de."""


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """Constants of the aircraft and of the air, SI.

    Args:
        S_m: wing area over mass, m2/kg.
        S_cbar_Iyy: wing area times chord over pitch inertia, 1/(kg m).
        cbar: chord, m.
        mass: kg.
        V0: reference airspeed, m/s.
        rho: density of the air, kg/m3.
        thrust_angle: thrust line above body x, rad.
        thrust_moment: pitch acceleration by thrust, rad/s2 per N.
        g: acceleration of gravity, m/s2.

    Raises:
        EstimationError: a value is not finite, or one that must be positive is not.
    """

    S_m: float
    S_cbar_Iyy: float
    cbar: float
    mass: float
    V0: float
    rho: float
    thrust_angle: float = 0.0
    thrust_moment: float = 0.0
    g: float = G0_M_S2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            positive = field.name not in ("thrust_angle", "thrust_moment", "g")
            if not np.isfinite(value) or (positive and not value > 0.0):
                law = "a number > 0" if positive else "a finite number"
                raise EstimationError(f"{field.name} of an airframe must be {law}, got {value}")


@dataclass(frozen=True, eq=False, kw_only=True)
class AerodynamicLongitudinal(ModelStructure):
    """Longitudinal flight over a flat earth, aerodynamics as polynomials, qbar = rho V^2 / 2.

        Vdot     = -S/m qbar CD + T/m cos(alpha + sigma) + g sin(alpha - theta)
        alphadot = q - S/(m V) qbar CL - T/(m V) sin(alpha + sigma) + g/V cos(alpha - theta)
        thetadot = q
        qdot     = S cbar/Iyy qbar Cm + (thrust moment) T
        ax = S/m qbar (CL sin(alpha) - CD cos(alpha)) + T/m cos(sigma)
        az = S/m qbar (-CL cos(alpha) - CD sin(alpha)) - T/m sin(sigma)

    A term of a coefficient is a product of V/V0, alpha, q cbar/(2 V0) and controls, written ``alpha``, ``alpha*alpha``,
    ``alpha*de``; "0" is the constant. Its parameter is ``CL_alpha``, ``CL_alpha_alpha``,
    ``Cm_alpha_de``, ``CD_0``. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., 2015 (HFB-320 example).

    Attributes:
        airframe: the constants.
        terms: coefficient -> its terms.
    """

    airframe: Airframe
    terms: Mapping[str, tuple[str, ...]]

    @property
    def must_move(self) -> tuple[str, ...]:
        """The controls; thrust may stay constant."""
        return tuple(name for name in self.inputs if name != "thrust")

    def derivative(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return dx/dt, shape (..., 4)."""
        a, (V, alpha, theta, q) = self.airframe, np.moveaxis(x, -1, 0)
        CD, CL, Cm = self._coefficients(x, u, params)
        lift, T = 0.5 * a.rho * V * V, u[..., self.inputs.index("thrust")]
        force, path = T / a.mass, alpha - theta
        Vdot = -a.S_m * lift * CD + force * np.cos(alpha + a.thrust_angle) + a.g * np.sin(path)
        turn = -a.S_m * lift * CL - force * np.sin(alpha + a.thrust_angle) + a.g * np.cos(path)
        return np.stack(np.broadcast_arrays(Vdot, q + turn / V, q, self._pitch(lift, Cm, T)), axis=-1)

    def output(self, x: AnyArray, u: AnyArray, params: AnyArray) -> AnyArray:
        """Return y, shape (..., p)."""
        a, (V, alpha, _, _) = self.airframe, np.moveaxis(x, -1, 0)
        CD, CL, Cm = self._coefficients(x, u, params)
        lift, T = 0.5 * a.rho * V * V, u[..., self.inputs.index("thrust")]
        s, c = np.sin(alpha), np.cos(alpha)
        derived = {
            "qdot": self._pitch(lift, Cm, T),
            "ax": a.S_m * lift * (CL * s - CD * c) + T / a.mass * np.cos(a.thrust_angle),
            "az": -a.S_m * lift * (CL * c + CD * s) - T / a.mass * np.sin(a.thrust_angle),
        }
        y = [derived[name] if name in derived else x[..., self.states.index(name)] for name in self.outputs]
        return np.stack(np.broadcast_arrays(*y), axis=-1)

    def _pitch(self, lift: AnyArray, Cm: AnyArray, T: AnyArray) -> AnyArray:
        return self.airframe.S_cbar_Iyy * lift * Cm + self.airframe.thrust_moment * T

    def _coefficients(self, x: AnyArray, u: AnyArray, params: AnyArray) -> list[AnyArray]:
        a = self.airframe
        variable = {"V": x[..., 0] / a.V0, "alpha": x[..., 1], "q": x[..., 3] * (a.cbar / (2.0 * a.V0))}
        variable |= {name.removesuffix("_cmd"): u[..., i] for i, name in enumerate(self.inputs)}
        out, index = [], 0
        for coefficient in _COEFFICIENTS:
            total: AnyArray = np.zeros(())
            for term in self.terms[coefficient]:
                value = params[..., index]
                for factor in () if term == "0" else term.split("*"):
                    value = value * variable[factor]
                total, index = total + value, index + 1
            out.append(total)
        return out


def aerodynamic_longitudinal(
    airframe: Airframe,
    *,
    terms: Mapping[str, Sequence[str]] = TERMS,
    outputs: Sequence[str] = _OUTPUTS,
    controls: Sequence[str] = ("de",),
) -> AerodynamicLongitudinal:
    """Return nonlinear longitudinal flight; inputs are the controls and ``thrust``.

    Args:
        airframe: constants of the aircraft.
        terms: CD, CL and Cm -> their terms, e.g. ``("0", "alpha", "alpha*alpha", "de")``.
        outputs: any of V, alpha, theta, q, qdot, ax and az.
        controls: input channels besides thrust.

    Raises:
        EstimationError: a coefficient without terms, a term, an output or a parameter that the structure does not have.
    """
    check_outputs("aerodynamic_longitudinal", outputs, _OUTPUTS)
    known = ("V", "alpha", "q", *(name.removesuffix("_cmd") for name in controls))
    if set(terms) != set(_COEFFICIENTS):
        raise EstimationError(f"terms must be given for CD, CL and Cm, got {', '.join(terms)}")
    guess = {
        "CD_0": 0.05,
        "CD_alpha": 0.3,
        "CL_0": 0.1,
        "CL_alpha": 4.5,
        "Cm_alpha": -0.8,
        "Cm_q": -15.0,
        "Cm_de": -1.0,
    }
    parameters = []
    for coefficient in _COEFFICIENTS:
        for term in terms[coefficient]:
            if term != "0" and not set(term.split("*")) <= set(known):
                raise EstimationError(
                    f"a term of {coefficient} must be '0' or a product of {', '.join(known)}, such as 'alpha*alpha', "
                    f"got '{term}'"
                )
            name = f"{coefficient}_{term.replace('*', '_')}"
            parameters.append(Parameter(name, guess.get(name, 0.0)))
    return AerodynamicLongitudinal(
        name="aerodynamic_longitudinal",
        states=_STATES,
        inputs=(*controls, "thrust"),
        outputs=tuple(outputs),
        parameters=tuple(parameters),
        airframe=airframe,
        terms={name: tuple(terms[name]) for name in _COEFFICIENTS},
    )
