"""The standard atmosphere (ISO 2533:1975), as far as aircraft of this testbench fly."""

from __future__ import annotations

_LAPSE_K_M, _T0_K, _RHO0_KG_M3, _POWER = 0.0065, 288.15, 1.225, 4.2558797  # the troposphere
_R_J_KG_K = 287.05287


def air_density(h_m: float, temperature_K: float | None = None) -> float:
    """Return the density of the standard atmosphere below 11 km, kg/m3 (ISO 2533:1975).

    With a temperature it is that of air at the standard pressure of the height.
    """
    density = _RHO0_KG_M3 * (1.0 - _LAPSE_K_M * h_m / _T0_K) ** _POWER
    return density if temperature_K is None else density * (_T0_K - _LAPSE_K_M * h_m) / temperature_K


def height_of_density(density_kg_m3: float) -> float:
    """Return the height, m, below 11 km at which the standard atmosphere has this density (ISO 2533:1975)."""
    return (1.0 - (density_kg_m3 / _RHO0_KG_M3) ** (1.0 / _POWER)) * _T0_K / _LAPSE_K_M


def air_pressure(h_m: float) -> float:
    """Return the pressure of the standard atmosphere below 11 km, Pa (ISO 2533:1975).

    Example:
        >>> round(air_pressure(0.0), 0)
        101325.0
    """
    return air_density(h_m) * _R_J_KG_K * (_T0_K - _LAPSE_K_M * h_m)
