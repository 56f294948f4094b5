"""Increments of coefficients by which a linearised aircraft has the derivatives that were identified.

Chord iteration on what JSBSim's linearised model has, with the slopes of a rigid aircraft in still air,

    dX = -qbar S/m dCD,  dZ = -qbar S/m dCL,  dM = qbar S cbar/Iyy dCm,  dY = qbar S/m dCY,
    [Ixx J; J Izz] [dL; dN] = qbar S b [dCl; dCn],

times cbar/2V or b/2V by rates. What alphadot, elastic modes or a reference point of the aerodynamics away from the
centre of gravity add is what the iteration is for. Of each variable all three forces and moments are aimed at, so that
those not asked for stay as they were. Increments vanish at the trim, which does not move.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.aircraft.adapter import PREFIX, declare
from testbench.aircraft.amend import AddCoefficient, Change
from testbench.aircraft.seams import with_servo
from testbench.core.record import FloatArray
from testbench.estimators.structured import per_speed
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.evaluation.parameters import true_parameters
from testbench.flight import FlightCondition, TrimmedFlight, linearise, trim
from testbench.questions.identify.amend.result import Targets

_LONGITUDINAL = {"X": "CD", "Z": "CL", "M": "Cm"}
_LATERAL = {"Y": "CY", "L": "Cl", "N": "Cn"}
_VARIABLES = {**dict.fromkeys(("alpha", "q", "de"), _LONGITUDINAL)}
_VARIABLES |= dict.fromkeys(("beta", "p", "r", "da", "dr"), _LATERAL)
REACHED_BY: Mapping[tuple[str, str], str] = {
    (axis, variable): f"{coefficient}_{variable}"
    for variable, axes in _VARIABLES.items()
    for axis, coefficient in axes.items()
}
"""(force or moment, variable) -> coefficient whose increment moves that derivative."""
_RATES = ("p", "q", "r")
_MOST, _ENOUGH = 25, 1e-8


def derivatives_of(aircraft: Aircraft, trimmed: TrimmedFlight, structure: str) -> dict[str, float]:
    """Return what the parameters of a structure are of an aircraft at a trim."""
    found = dimensional_derivatives(linearise(aircraft, trimmed), trimmed)
    return true_parameters(structure, found, trimmed.condition.V_m_s)


def reached(
    aircraft: Aircraft, condition: FlightCondition, structure: str, targets: Targets
) -> tuple[Aircraft, dict[str, float]]:
    """Return the aircraft whose linearised model has the targets, and coefficient -> what was added to it.

    Args:
        aircraft: as believed.
        condition: that the derivatives hold at.
        structure: whose parameters they are.
        targets: parameter -> value.

    Raises:
        TrimError: there is no trim.
        ModelError: the model cannot take an increment.
    """
    trimmed = trim(aircraft, condition)
    before = derivatives_of(aircraft, trimmed, structure)
    variables = list(dict.fromkeys(name.partition("_")[2] for name in targets))
    names = [f"{axis}_{v}" for v in variables for axis in _VARIABLES[v]]
    aim = np.array([targets.get(n, before[n]) for n in names])
    slopes = np.zeros((len(names), len(names)))
    for k, variable in enumerate(variables):
        slopes[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = _slopes(aircraft, condition, structure, variable)
    # A number is as good as the differences that it is found by, which are as good as the largest of its kind.
    size = np.maximum(np.abs(aim), np.abs([before[n] for n in names]))
    size = np.maximum(size, 1e-3 * np.abs(slopes).max(axis=1))
    total, best, least = np.zeros(len(names)), np.zeros(len(names)), np.inf
    now = np.array([before[n] for n in names])
    for _ in range(_MOST):
        error = aim - now
        worst = float(np.max(np.abs(error) / size))
        if worst >= least:
            break
        best, least = total, worst
        if worst <= _ENOUGH:
            break
        total = total + np.linalg.solve(slopes, error)
        found = derivatives_of(with_increments(aircraft, _named(names, total), trimmed), trimmed, structure)
        now = np.array([found[n] for n in names])
    wanted = {
        name: value
        for (name, value), slope in zip(_named(names, best).items(), np.abs(slopes).max(axis=0), strict=True)
        if abs(value) * slope > 1e-7 * float(size.max())
    }
    return with_increments(aircraft, wanted, trimmed), wanted


def _named(names: Sequence[str], values: FloatArray) -> dict[str, float]:
    keys = [REACHED_BY[axis, v] for axis, v in (n.split("_") for n in names)]
    return dict(zip(keys, values.tolist(), strict=True))


def _slopes(aircraft: Aircraft, condition: FlightCondition, structure: str, variable: str) -> FloatArray:
    """Return (3, 3): derivatives by one variable per coefficient by it."""
    g, m, V = aircraft.geometry, aircraft.mass, condition.V_m_s
    force = condition.qbar_Pa * g.S_m2
    by_mass = force / m.mass_kg

    def over(axis: str) -> float:
        return V if per_speed(structure, axis) else 1.0

    if _VARIABLES[variable] is _LONGITUDINAL:
        rate = g.cbar_m / (2.0 * V) if variable in _RATES else 1.0
        return rate * np.diag([-by_mass, -by_mass / over("Z"), force * g.cbar_m / m.Iyy])
    rate = g.b_m / (2.0 * V) if variable in _RATES else 1.0
    out = np.zeros((3, 3))
    out[0, 0] = by_mass / over("Y")
    out[1:, 1:] = force * g.b_m * np.linalg.inv(np.array([[m.Ixx, m.Ixz], [m.Ixz, m.Izz]]))
    return rate * out


def coefficient_errors(aircraft: Aircraft, condition: FlightCondition, structure: str) -> dict[str, float]:
    """Return derivative -> change of its coefficient per change of itself, the others of its variable held."""
    out: dict[str, float] = {}
    for variable, axes in _VARIABLES.items():
        inverse = np.linalg.inv(_slopes(aircraft, condition, structure, variable))
        out |= {f"{axis}_{variable}": abs(float(inverse[k, k])) for k, axis in enumerate(axes)}
    return out


def with_increments(aircraft: Aircraft, added: Mapping[str, float], trimmed: TrimmedFlight) -> Aircraft:
    """Return the aircraft with increments of coefficients in its model itself, which vanish at a trim.

    Args:
        aircraft: its other amendments stay what they are.
        added: coefficient -> increment.
        trimmed: the equilibrium that stays.
    """
    changes = [
        AddCoefficient(name, value, 0.0 if v in _RATES else float(trimmed.state[v]))
        for name, value in added.items()
        for v in (name.partition("_")[2],)
    ]
    return _in_itself(aircraft, changes)


def with_lag(aircraft: Aircraft, control: str, lag_s: float) -> Aircraft:
    """Return the aircraft with another time constant of a servo, in its model itself.

    Raises:
        ModelError: it has no such control.
    """
    aircraft, changes = with_servo(aircraft, control, 1.0 / lag_s)
    return _in_itself(aircraft, changes) if changes else aircraft


def _in_itself(aircraft: Aircraft, changes: Sequence[Change]) -> Aircraft:
    """Return the aircraft with changes made to its model as it is in its file, before adapter and amendments."""
    tree = ET.fromstring(aircraft.xml)
    for change in changes:
        change.apply(tree, aircraft)
    if aircraft.adapter is not None:
        read = {(e.text or "").strip() for e in tree.findall("external_reactions//property")}
        declare(tree, {n: 0.0 for n in sorted(read) if n.startswith(PREFIX)})
    return replace(aircraft, xml=ET.tostring(tree, encoding="unicode"))
