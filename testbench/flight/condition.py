"""The condition that a flight starts from, and the equilibrium found there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from testbench.core.atmosphere import air_density
from testbench.core.record import FloatArray


@dataclass(frozen=True)
class FlightCondition:
    """Steady straight flight: true airspeed (m/s), altitude above sea level (m), flight-path angle (rad).

    Example:
        >>> import testbench as tb
        >>> str(tb.FlightCondition(V_m_s=16.0, h_m=547.0))
        '16 m/s, 547 m'
    """

    V_m_s: float
    h_m: float
    gamma_rad: float = 0.0

    @property
    def qbar_Pa(self) -> float:
        """Dynamic pressure in the standard atmosphere, Pa."""
        return 0.5 * air_density(self.h_m) * self.V_m_s**2

    def __str__(self) -> str:
        return f"{self.V_m_s:g} m/s, {self.h_m:g} m"


@dataclass(frozen=True)
class Start:
    """How far from its trim a flight begins, SI; a flight that is given one begins with its first commands.

    Servos and engines begin where these commands hold them at that airspeed, elastic modes at their static deflection.

    Attributes:
        V_m_s, h_m: airspeed and height beyond those of the trim.
        alpha, beta: flow angles beyond those of the trim, rad.
        p, q, r: rates beyond those that keep the attitude to the horizon, rad/s.
        phi, theta: attitude beyond that of the trim, rad; the heading is north.

    Example:
        >>> import testbench as tb
        >>> tb.Start(V_m_s=-1.0, phi=0.5).beta
        0.0
    """

    V_m_s: float = 0.0
    alpha: float = 0.0
    beta: float = 0.0
    p: float = 0.0
    q: float = 0.0
    r: float = 0.0
    phi: float = 0.0
    theta: float = 0.0
    h_m: float = 0.0


@dataclass(frozen=True, eq=False)
class TrimmedFlight:
    """An equilibrium: attitude and controls that hold the condition.

    Attributes:
        condition: what was asked for.
        rate_hz: frame rate of the model that was trimmed.
        alpha, theta, phi: rad.
        controls: channel -> value, rad or 1.
        residual: (6,) udot, vdot, wdot in m/s2 and pdot, qdot, rdot in rad/s2 that remain.
        state: channel -> value of every channel of the simulator at trim, SI.
        beta: rad; zero unless there is no rudder.
    """

    condition: FlightCondition
    rate_hz: float
    alpha: float
    theta: float
    phi: float
    controls: Mapping[str, float]
    residual: FloatArray
    state: Mapping[str, float]
    beta: float = 0.0
