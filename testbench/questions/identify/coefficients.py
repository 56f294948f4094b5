"""Nondimensional coefficients of identified derivatives, from mass, inertia and geometry of an aircraft.

    CX, CY, CZ = m/(qbar S) (X, Y, Z),    Cm = Iyy/(qbar S cbar) M,
    Cl = (Ixx L + J N)/(qbar S b),    Cn = (Izz N + J L)/(qbar S b),    J = the product term of the inertia matrix,

in stability axes for X and Z (CZ_alpha = -CL_alpha - CD), body axes for the rest; L and N are the primed derivatives.
By rates per p b/(2V), q cbar/(2V), r b/(2V); by angles per rad.
"""

from __future__ import annotations

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel

_FORCES = {"X": "CX", "Y": "CY", "Z": "CZ"}
_PER_SPEED = ("short_period",)  # structures whose Z derivatives are per airspeed


def coefficient(
    model: ParametricModel, name: str, aircraft: Aircraft, V_m_s: float, qbar_Pa: float
) -> tuple[str, float, float] | None:
    """Return name, value and standard error of the coefficient of a derivative such as "M_q"; None if it has none.

    Args:
        model: identified.
        name: of its parameter.
        aircraft: whose mass, inertia and geometry count.
        V_m_s: true airspeed.
        qbar_Pa: dynamic pressure.
    """
    weights = _weights(model, name, aircraft, V_m_s, qbar_Pa)
    if weights is None:
        return None
    symbol, row = weights
    return symbol, float(row @ model.params), max(float(row @ model.covariance @ row), 0.0) ** 0.5


def _weights(
    model: ParametricModel, name: str, aircraft: Aircraft, V: float, qbar: float
) -> tuple[str, FloatArray] | None:
    """Return the coefficient's name, and what it is made of: (k,) weights of the parameters."""
    axis, _, variable = name.partition("_")
    names, g, m = model.structure.parameter_names, aircraft.geometry, aircraft.mass
    per = {"p": 2.0 * V / g.b_m, "r": 2.0 * V / g.b_m, "q": 2.0 * V / g.cbar_m}.get(variable, 1.0)
    if variable not in ("alpha", "beta", "p", "q", "r", "de", "da", "dr") or axis not in (*_FORCES, *"LMN"):
        return None
    row, force = np.zeros(len(names)), qbar * g.S_m2
    at = names.index(name)
    if axis in _FORCES:
        speed = V if model.structure.name in _PER_SPEED and axis == "Z" else 1.0
        row[at] = m.mass_kg * speed / force * per
        return f"{_FORCES[axis]}_{variable}", row
    if axis == "M":
        row[at] = m.Iyy / (force * g.cbar_m) * per
        return f"Cm_{variable}", row
    other = f"{'N' if axis == 'L' else 'L'}_{variable}"
    row[at] = (m.Ixx if axis == "L" else m.Izz) / (force * g.b_m) * per
    if other not in names:
        return None
    row[names.index(other)] = m.Ixz / (force * g.b_m) * per
    return f"C{axis.lower()}_{variable}", row
