"""Dimensional derivatives of a linear model at trim, and the true values of parameters that mean them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import G0_M_S2
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.structured import STRUCTURE_NAMES, per_speed
from testbench.flight import LinearModel, TrimmedFlight

_ELASTIC = ("flexible",)  # structures that hold the modes themselves: their derivatives are those with modes held
_NOISE = 1e-8  # what is left of a zero after the differences of JSBSim's forces


@dataclass(frozen=True)
class Derivative:
    """One dimensional derivative."""

    name: str  #: e.g. "M_alpha".
    unit: str  #: SI
    meaning: str  #: in words
    held: float  #: with the elastic modes held at their trimmed deflection
    static: float | None  #: with the elastic modes following in static equilibrium; None without modes


_MOMENTS = {"L": ("p", "roll"), "M": ("q", "pitch"), "N": ("r", "yaw")}
_FORCES = {"X": "forward", "Y": "side", "Z": "downward"}
_VARIABLES = {
    "V": ("m/s", "airspeed"),
    "alpha": ("", "angle of attack"),
    "q": ("1/s", "pitch rate"),
    "de": ("", "elevator"),
    "thr": ("", "throttle, 0 to 1"),
    "beta": ("", "sideslip"),
    "p": ("1/s", "roll rate"),
    "r": ("1/s", "yaw rate"),
    "da": ("", "aileron"),
    "dr": ("", "rudder"),
}
_PER = {"": ("m/s²", "1/s²"), "m/s": ("1/s", "1/(m s)"), "1/s": ("m/s", "1/s")}  # units of accelerations per unit


@dataclass(frozen=True)
class StaticMargin:
    """Distance of the neutral point behind the centre of gravity, % of the mean chord."""

    held: float  #: with the elastic modes held at their trimmed deflection
    flown: float  #: with the modes following in static equilibrium; the same without modes


def static_margin(aircraft: Aircraft, derivatives: Sequence[Derivative]) -> StaticMargin:
    """Return the static margin -Cm_alpha / CL_alpha = M_alpha Iyy / (Z_alpha m cbar) of dimensional derivatives."""
    found = {d.name: d for d in derivatives}
    M, Z = found["M_alpha"], found["Z_alpha"]
    size = 100.0 * aircraft.mass.Iyy / (aircraft.mass.mass_kg * aircraft.geometry.cbar_m)
    M_flown, Z_flown = (d.held if d.static is None else d.static for d in (M, Z))
    return StaticMargin(size * M.held / Z.held, size * M_flown / Z_flown)


def lift_per_rad(model: LinearModel, V_m_s: float) -> float:
    """Return the change of load factor with angle of attack at a trimmed speed, dn/dalpha = -Z_w V / g, per rad."""
    w = model.states.index("w")
    return float(-model.A[w, w] * V_m_s / G0_M_S2)


def dimensional_derivatives(model: LinearModel, trimmed: TrimmedFlight) -> list[Derivative]:
    """Return accelerations per unit of motion and control, from a linear model at trim.

    Forces are per mass, along the stability axes of the trim (x along the flight, y right, z down), without gravity and
    without the accelerations of the turning frame; moments are angular accelerations about body axes, products of
    inertia included (the primed derivatives of the field). Angles in rad; alpha changes at constant speed.
    """
    V, a = trimmed.condition.V_m_s, trimmed.alpha
    modal = [k for k, s in enumerate(model.states) if s.startswith("eta")]
    held, static = _derivative_values(model, V, a), None
    if modal:
        static = _derivative_values(_residualised(model, modal), V, a)
    out = []
    for name, value in held.items():
        axis, variable = name.replace("/V", "").split("_")
        per, word = _VARIABLES[variable]
        if axis in _MOMENTS:
            unit, meaning = _PER[per][1], f"{_MOMENTS[axis][1]} acceleration due to {word}"
        else:
            unit, meaning = _PER[per][0], f"{_FORCES[axis]} acceleration due to {word}"
        if name.endswith("/V"):
            unit, meaning = "1/s", f"{meaning}, per airspeed"
        out.append(Derivative(name, unit, meaning, value, None if static is None else static[name]))
    return out


def _derivative_values(model: LinearModel, V: float, alpha: float) -> dict[str, float]:
    row = {s: k for k, s in enumerate(model.states)}
    c, s = math.cos(alpha), math.sin(alpha)

    def column(variable: str) -> FloatArray:
        """Return the state derivatives per unit of ``variable``."""
        if variable in model.inputs:
            return np.asarray(model.B[:, model.inputs.index(variable)])
        along = {"V": {"u": c, "w": s}, "alpha": {"u": -V * s, "w": V * c}, "beta": {"v": V}}
        return np.asarray(sum(g * model.A[:, row[x]] for x, g in along.get(variable, {variable: 1.0}).items()))

    def force(axis: str, variable: str) -> float:
        """Return the specific force along a stability axis, without V x rate of the turning frame."""
        f = column(variable)
        if axis == "Y":
            return float(f[row["v"]] - {"r": -V * c, "p": V * s}.get(variable, 0.0))
        u, w = f[row["u"]] + V * s * (variable == "q"), f[row["w"]] - V * c * (variable == "q")
        return float(c * u + s * w if axis == "X" else c * w - s * u)

    surfaces = [n for n in ("de", "thr") if n in model.inputs], [n for n in ("da", "dr") if n in model.inputs]
    out: dict[str, float] = {}
    for axis in "XZM":
        for variable in ("V", "alpha", "q", *surfaces[0]):
            value = float(column(variable)[row["q"]]) if axis == "M" else force(axis, variable)
            out[f"{axis}_{variable}"] = _clean(value)
            if (axis, variable) == ("Z", "alpha"):
                out["Z_alpha/V"] = value / V
    for axis in "YLN":
        for variable in ("beta", "p", "r", *surfaces[1]):
            moment = axis in _MOMENTS
            value = float(column(variable)[row[_MOMENTS[axis][0]]]) if moment else force(axis, variable)
            out[f"{axis}_{variable}"] = _clean(value)
            if (axis, variable) == ("Y", "beta"):
                out["Y_beta/V"] = value / V
    return out


def _clean(value: float) -> float:
    return 0.0 if abs(value) < _NOISE else value


def _residualised(model: LinearModel, modal: Sequence[int]) -> LinearModel:
    """Return the model with the states ``modal`` in static equilibrium: their rates set to zero and solved for."""
    keep = [k for k in range(len(model.states)) if k not in modal]
    solve = np.linalg.solve(model.A[np.ix_(modal, modal)], np.hstack([model.A[np.ix_(modal, keep)], model.B[modal]]))
    A, B = solve[:, : len(keep)], solve[:, len(keep) :]
    link = model.A[np.ix_(keep, modal)]
    return LinearModel(
        model.A[np.ix_(keep, keep)] - link @ A,
        model.B[keep] - link @ B,
        model.C[:, keep] - model.C[:, modal] @ A,
        model.D - model.C[:, modal] @ B,
        tuple(model.states[k] for k in keep),
        model.inputs,
        model.outputs,
    )


# --- parameters -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter: its estimate, standard errors and, where it is known, the truth."""

    name: str  #: symbol
    value: float  #: estimate, or the value it was held at
    std: float  #: standard error, corrected for coloured residuals; 0 if held
    std_white: float  #: standard error for white residuals
    free: bool  #: estimated or held
    true: float | None  #: true value of the simulated aircraft at trim; None if not known

    @property
    def deviations(self) -> float | None:
        """Error in standard errors; None if truth or error is not known."""
        if self.true is None or not self.std > 0.0:
            return None
        return (self.value - self.true) / self.std


def parameter_estimates(model: ParametricModel, truth: Mapping[str, float] | None) -> tuple[ParameterEstimate, ...]:
    """Return every parameter of a model.

    Args:
        model: what an estimator returned.
        truth: name -> true value; see :func:`true_parameters`.
    """
    white = dict(zip(model.structure.parameter_names, model.covariance_plain.diagonal().tolist(), strict=True))
    return tuple(
        ParameterEstimate(
            p.name,
            model.values[p.name],
            model.standard_errors[p.name],
            max(white[p.name], 0.0) ** 0.5,
            p.free,
            None if truth is None else truth.get(p.name),
        )
        for p in model.structure.parameters
    )


def true_parameters(structure: str, derivatives: Sequence[Derivative], V_m_s: float) -> dict[str, float]:
    """Return the true parameters of a structure by name, from the derivatives of the linearised aircraft.

    A structure without elastic modes is compared with derivatives in which the modes follow statically, because slow
    motion cannot tell the two apart. A structure with modes is compared with derivatives at which the modes are held.
    Parameters whose meaning nobody said, whatever their names are, have no truth.

    Args:
        structure: name of a packaged structure, the ``meaning`` of any; "" where it is not known.
        derivatives: of :func:`testbench.evaluation.derivatives.dimensional_derivatives`.
        V_m_s: airspeed at trim.
    """
    out: dict[str, float] = {}
    if structure not in STRUCTURE_NAMES:
        return out
    for d in derivatives:
        if d.name.endswith("/V"):
            continue
        value = d.held if structure in _ELASTIC or d.static is None else d.static
        out[d.name] = value / (V_m_s if per_speed(structure, d.name.partition("_")[0]) else 1.0)
    return out
