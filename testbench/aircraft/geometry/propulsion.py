"""Thrust over throttle and airspeed: a straight line, or motor and propeller in equilibrium."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from testbench.aircraft.geometry.schema import Motor, Propeller
from testbench.core.errors import ScenarioError
from testbench.core.record import FloatArray

# The propeller of the Ultra Stick 25e (APC 12x6E) and the shape of its motor's power over throttle, from
# OpenFlightSim (MIT licence), as aircraft_models/taurus/derive.py has them: polynomials, highest power first, of the
# advance ratio J and of the throttle.
CT = (-0.4314, 1.08, -0.896, 0.1089, 0.0604)
CP = (0.5054, -0.5304, 0.0412, 0.01664, 0.0223)
POWER = (174.46, 70.135, -4.39)
PITCH_RATIO = 0.5  # pitch over diameter of that propeller
HIGHEST_J = 0.8  # beyond it the polynomials are not those of a propeller
TERMS = ((1, 0), (2, 0), (0, 1), (1, 1), (0, 2), (1, 2))  # powers of throttle and of V / (10 m/s)
LEAST_THROTTLE = 0.08  # from which the fit starts; below, the motor hardly turns


@dataclass(frozen=True)
class Thrust:
    """A thrust law."""

    static_N: float  # nominal thrust, at full throttle and at rest
    # (share of the nominal thrust, power of the throttle, power of V / (10 m/s)), to be added
    terms: tuple[tuple[float, int, int], ...]
    words: str  # where it comes from

    def at(self, throttle: float, V_m_s: float) -> float:
        """Return the thrust, N; never below zero, as JSBSim cuts it off there."""
        share = sum(c * throttle**i * (V_m_s / 10.0) ** j for c, i, j in self.terms)
        return self.static_N * max(share, 0.0)


def thrust_law(motor: Motor, density_kg_m3: float, speeds_m_s: tuple[float, float]) -> Thrust:
    """Return the thrust law of a motor.

    Args:
        motor: of the file.
        density_kg_m3: of the air at the design height.
        speeds_m_s: range in which a propeller's law is to fit.

    Raises:
        ScenarioError: the propeller gives no thrust within the range.
    """
    if motor.propeller is None:
        assert motor.static_thrust_N is not None  # the schema has seen to it
        assert motor.zero_thrust_V_m_s is not None
        loss = 10.0 / motor.zero_thrust_V_m_s
        words = (
            f"throttle times {motor.static_thrust_N:g} N static thrust, falling linearly to zero at "
            f"{motor.zero_thrust_V_m_s:g} m/s; both given"
        )
        return Thrust(motor.static_thrust_N, ((1.0, 1, 0), (-loss, 1, 1)), words)
    p = motor.propeller
    low, high = speeds_m_s
    throttle, V = np.linspace(LEAST_THROTTLE, 1.0, 24), np.linspace(low, high, 17)
    exact = np.array([[equilibrium(p, density_kg_m3, t, v) for v in V] for t in throttle])
    if exact[-1, 0] <= 0.0:
        raise ScenarioError(
            f"motor.propeller must give thrust at {low:g} m/s and full throttle, got none: more pitch or more power"
        )
    static = float(f"{equilibrium(p, density_kg_m3, 1.0, 0.0):.3g}")
    coefficients, rms = fit(throttle, V, exact)
    words = (
        f"computed: a propeller of {p.diameter_m:g} m with {p.pitch_m:g} m pitch on {p.power_W:g} W in "
        "equilibrium, with the "
        "curves of an APC 12x6E stretched to this pitch and the power over throttle of an Ultra Stick 25e (both "
        "judged to "
        f"carry over), fitted by six terms from {low:.3g} to {high:.3g} m/s ({rms:.2g} N rms)"
    )
    return Thrust(static, tuple((c / static, i, j) for c, (i, j) in zip(coefficients, TERMS, strict=True)), words)


def equilibrium(p: Propeller, density_kg_m3: float, throttle: float, V_m_s: float) -> float:
    """Return the thrust (N) at which the propeller takes the motor's power, C_P rho n^3 D^5 = P(throttle).

    A propeller of another pitch keeps its efficiency at the same share of its pitch speed: with k = pitch ratio over
    that of the known propeller, C_T(J) = C_T0(J / k) and C_P(J) = k C_P0(J / k). The motor's speed settles within some
    0.1 s and is no state of the model.
    """
    k = p.pitch_m / p.diameter_m / PITCH_RATIO
    D = p.diameter_m
    power = p.power_W * max(float(np.polyval(POWER, throttle) / np.polyval(POWER, 1.0)), 0.0)
    if power == 0.0:
        return 0.0

    def share(n: float) -> float:
        """Return J / k at ``n`` revolutions a second."""
        return min(V_m_s / (n * D * k), HIGHEST_J)

    def surplus(n: float) -> float:
        """Return the power that ``n`` revolutions a second take beyond the motor's, W."""
        return float(k * np.polyval(CP, share(n)) * density_kg_m3 * n**3 * D**5 - power)

    n = brentq(surplus, 1e-3, 1e4)
    return float(np.polyval(CT, share(n)) * density_kg_m3 * n**2 * D**4)


def fit(throttle: FloatArray, V_m_s: FloatArray, thrust_N: FloatArray) -> tuple[list[float], float]:
    """Return the least-squares coefficients of TERMS (N) for thrusts (throttle, V), and the error of the fit, N rms."""
    t, v = np.meshgrid(throttle, V_m_s / 10.0, indexing="ij")
    columns = np.column_stack([(t**i * v**j).ravel() for i, j in TERMS])
    coefficients = [float(f"{c:.5g}") for c in np.linalg.lstsq(columns, thrust_N.ravel(), rcond=None)[0]]
    return coefficients, float(np.sqrt(np.mean((columns @ coefficients - thrust_N.ravel()) ** 2)))
