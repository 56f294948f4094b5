"""The derivatives of an aircraft as it flies, for the strips of its modes."""

from __future__ import annotations

from testbench.aircraft import Aircraft
from testbench.flight import FlightCondition, trim
from testbench.flight.coefficients import coefficients

_NOISE = 1e-9  # what differences of forces leave of a zero


def own_derivatives(aircraft: Aircraft) -> dict[str, float]:
    """Return the aerodynamic coefficients of an aircraft at its design condition, and "CL_0".

    They are those of :func:`testbench.flight.coefficients.coefficients`; CL_0 is what is left of the lift coefficient
    at zero alpha and elevator, CL - CL_alpha alpha - CL_de de.

    Raises:
        TrimError: the aircraft cannot be trimmed there.
    """
    trimmed = trim(aircraft, FlightCondition(aircraft.design_V_m_s, aircraft.design_h_m))
    own = coefficients(aircraft, trimmed)
    own = {name: value if abs(value) > _NOISE else 0.0 for name, value in own.items()}
    turned = own.get("CL_de", 0.0) * trimmed.controls.get("de", 0.0)
    return {**own, "CL_0": own["CL"] - own["CL_alpha"] * trimmed.alpha - turned}
