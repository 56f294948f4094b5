"""The nondimensional derivatives of an aircraft as it flies, for the strips of its modes."""

from __future__ import annotations

import math

from testbench.aircraft import Aircraft
from testbench.evaluation.derivatives import dimensional_derivatives
from testbench.flight import FlightCondition, TrimmedFlight, linearise, trim

_LONGITUDINAL = {"alpha": 0.0, "q": 1.0, "de": 0.0}
_LATERAL = {"beta": 0.0, "p": 1.0, "r": 1.0, "da": 0.0, "dr": 0.0}


def own_derivatives(aircraft: Aircraft) -> tuple[dict[str, float], TrimmedFlight]:
    """Return the derivatives of an aircraft at its design condition, without unit, and the trim there.

    "CL" is the lift coefficient there and "CL_0" what is left of it at zero alpha and elevator, "CL_alpha" ... "Cm_de",
    "CY_beta" ... "Cn_dr" the derivatives by angles in rad and by q cbar/2V, p b/2V, r b/2V. Angular accelerations
    become moments with the aircraft's inertias. Forces count along the wind, so that the drag which turns with the
    axes is taken out: CL_alpha = -Z_alpha m / (qbar S) - CD. Derivatives by alphadot, where a model has them, are
    solved into those by alpha, q and de, which they change by some percent.

    Raises:
        TrimError: the aircraft cannot be trimmed at its design condition.
    """
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    model = linearise(aircraft, trimmed)
    found = {d.name: d.held for d in dimensional_derivatives(model, trimmed)}
    g, m, V, qbar = aircraft.geometry, aircraft.mass, trimmed.condition.V_m_s, trimmed.state["qbar"]
    a, ax, az = trimmed.alpha, trimmed.state["ax"], trimmed.state["az"]
    thrust = trimmed.state.get("thrust", 0.0) / m.mass_kg
    force = qbar * g.S_m2 / m.mass_kg  # acceleration per coefficient
    CL = (ax * math.sin(a) - az * math.cos(a) - thrust * math.sin(a)) / force
    CD = (thrust * math.cos(a) - ax * math.cos(a) - az * math.sin(a)) / force
    out = {"CL": CL}
    for variable, rate in _LONGITUDINAL.items():
        if f"M_{variable}" not in found:
            continue
        per = (2.0 * V / g.cbar_m) ** rate
        out[f"CL_{variable}"] = -found[f"Z_{variable}"] / force * per - (CD if variable == "alpha" else 0.0)
        out[f"Cm_{variable}"] = found[f"M_{variable}"] * m.Iyy / (qbar * g.S_m2 * g.cbar_m) * per
    for variable, rate in _LATERAL.items():
        if f"L_{variable}" not in found:
            continue
        per = (2.0 * V / g.b_m) ** rate
        L, N = found[f"L_{variable}"], found[f"N_{variable}"]
        moment = qbar * g.S_m2 * g.b_m
        out[f"CY_{variable}"] = found[f"Y_{variable}"] / force * per + (CD if variable == "beta" else 0.0)
        out[f"Cl_{variable}"] = (m.Ixx * L + m.Ixz * N) / moment * per
        out[f"Cn_{variable}"] = (m.Izz * N + m.Ixz * L) / moment * per
    out["CL_0"] = CL - out["CL_alpha"] * a - out.get("CL_de", 0.0) * trimmed.controls.get("de", 0.0)
    return out, trimmed
