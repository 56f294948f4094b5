"""Nondimensional coefficients of identified derivatives, from mass, inertia, geometry and condition.

    CX, CY, CZ = m/(qbar S) (X, Y, Z),    Cm = Iyy/(qbar S cbar) M,
    Cl = (Ixx L + J N)/(qbar S b),    Cn = (Izz N + J L)/(qbar S b),    J = the product term of the inertia matrix,

in stability axes for X and Z (CZ_alpha = -CL_alpha - CD), body axes for the rest; L and N are the primed derivatives.
By rates per p b/(2V), q cbar/(2V), r b/(2V); by angles per rad.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testbench.aircraft.model import Geometry
from testbench.core.record import FloatArray
from testbench.estimators.parametric.model import ParametricModel
from testbench.estimators.structured import STRUCTURE_NAMES, per_speed

_FORCES = {"X": "CX", "Y": "CY", "Z": "CZ"}


@dataclass(frozen=True)
class PartialMass:
    """Mass (kg) and inertia (kg m2) as far as they are known; Ixz positive as in JSBSim's file."""

    mass_kg: float | None = None
    Ixx: float | None = None
    Iyy: float | None = None
    Izz: float | None = None
    Ixz: float | None = None


@dataclass(frozen=True)
class Scaling:
    """What makes coefficients of derivatives: true airspeed (m/s), dynamic pressure (Pa), geometry and mass."""

    V_m_s: float
    qbar_Pa: float
    geometry: Geometry
    mass: PartialMass


def coefficient(model: ParametricModel, name: str, scaling: Scaling) -> tuple[str, float, float] | None:
    """Return name, value and standard error of the coefficient of a derivative such as "M_q"; None if it has none.

    Args:
        model: identified.
        name: of its parameter.
        scaling: condition, geometry and mass.
    """
    found = weights(model.structure.meaning, model.structure.parameter_names, name, scaling)
    if found is None:
        return None
    symbol, row = found
    return symbol, float(row @ model.params), max(float(row @ model.covariance @ row), 0.0) ** 0.5


def weights(structure: str, names: Sequence[str], name: str, scaling: Scaling) -> tuple[str, FloatArray] | None:
    """Return the coefficient's name, and what it is made of: (k,) weights of the parameters; None if it has none.

    Parameters whose meaning nobody said have none, whatever their names are.

    Args:
        structure: name of a packaged structure, the ``meaning`` of any; "" where it is not known.
        names: (k,) of its parameters.
        name: one of them.
        scaling: condition, geometry and mass.
    """
    axis, _, variable = name.partition("_")
    V, g, m = scaling.V_m_s, scaling.geometry, scaling.mass
    per = {"p": 2.0 * V / g.b_m, "r": 2.0 * V / g.b_m, "q": 2.0 * V / g.cbar_m}.get(variable, 1.0)
    if variable not in ("alpha", "beta", "p", "q", "r", "de", "da", "dr") or axis not in (*_FORCES, *"LMN"):
        return None
    if structure not in STRUCTURE_NAMES:
        return None
    row, force = np.zeros(len(names)), scaling.qbar_Pa * g.S_m2
    at = names.index(name)
    if axis in _FORCES:
        if m.mass_kg is None:
            return None
        speed = V if per_speed(structure, axis) else 1.0
        row[at] = m.mass_kg * speed / force * per
        return f"{_FORCES[axis]}_{variable}", row
    if axis == "M":
        if m.Iyy is None:
            return None
        row[at] = m.Iyy / (force * g.cbar_m) * per
        return f"Cm_{variable}", row
    own = m.Ixx if axis == "L" else m.Izz
    if own is None or m.Ixz is None:
        return None
    row[at] = own / (force * g.b_m) * per
    other = f"{'N' if axis == 'L' else 'L'}_{variable}"
    if m.Ixz != 0.0 and other not in names:
        return None
    if other in names:
        row[names.index(other)] = m.Ixz / (force * g.b_m) * per
    return f"C{axis.lower()}_{variable}", row
