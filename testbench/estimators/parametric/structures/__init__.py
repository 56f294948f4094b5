"""Model structures: one file per family of equations, and the table of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from testbench.estimators.parametric.structures.aerodynamic import aerodynamic_longitudinal
from testbench.estimators.parametric.structures.lateral import lateral_directional, lateral_per_speed, roll_yaw_rates
from testbench.estimators.parametric.structures.longitudinal import flexible, longitudinal, short_period
from testbench.estimators.parametric.structures.settings import Trim


class Family(NamedTuple):
    """A factory of model structures, its settings as arguments, and what it makes in words."""

    factory: Callable[..., Any]
    description: str


STRUCTURES: dict[str, Family] = {
    "short_period": Family(short_period, "angle of attack and pitch rate at constant speed, derivatives per speed"),
    "longitudinal": Family(longitudinal, "V, alpha, q, theta about a trim, dimensional derivatives"),
    "flexible": Family(flexible, "longitudinal motion coupled with elastic modes"),
    "lateral_directional": Family(lateral_directional, "beta, p, r, phi about a trim, dimensional derivatives"),
    "lateral_per_speed": Family(
        lateral_per_speed, "beta, p, r, phi of an airspeed that is not known, side forces per speed"
    ),
    "roll_yaw_rates": Family(roll_yaw_rates, "p and r driven by controls and the measured sideslip"),
    "aerodynamic_longitudinal": Family(
        aerodynamic_longitudinal, "nonlinear V, alpha, theta, q with polynomials for CD, CL and Cm"
    ),
}

__all__ = [
    "STRUCTURES",
    "Family",
    "Trim",
    "aerodynamic_longitudinal",
    "flexible",
    "lateral_directional",
    "lateral_per_speed",
    "longitudinal",
    "roll_yaw_rates",
    "short_period",
]
