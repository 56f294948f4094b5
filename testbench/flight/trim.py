"""Trim: the attitude and controls at which a steady straight flight needs no further force or moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.errors import TrimError
from testbench.core.record import FloatArray
from testbench.flight.air import AXES, Air
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import Executive, body_from_earth

_STEP = {"thr": 1e-3}  # of the differences of the Jacobian; 1e-4 rad otherwise
_ACCELERATIONS = (
    ("accelerations/udot-ft_sec2", FT_M),
    ("accelerations/vdot-ft_sec2", FT_M),
    ("accelerations/wdot-ft_sec2", FT_M),
    ("accelerations/pdot-rad_sec2", 1.0),
    ("accelerations/qdot-rad_sec2", 1.0),
    ("accelerations/rdot-rad_sec2", 1.0),
)
_THROTTLE_STARTS = (0.3, 0.8)  # a propeller that gives no thrust at the first has no effect there to start from
# Radii of curvature (m) of the WGS 84 ellipsoid at the equator, where flights start: along the meridian and across it.
_RADIUS_NORTH, _RADIUS_EAST = 6335439.0, 6378137.0
_KEPT = 0.3  # of the residual left by a step: with less the Jacobian is kept
TOLERANCE = 1e-9  # m/s2 and rad/s2 left over; well above the rounding of JSBSim's forces
PROPELLER_TOLERANCE = 1e-7  # the same with propellers, whose equilibrium JSBSim finds to some 1e-9 of the thrust


def trim(
    aircraft: Aircraft, condition: FlightCondition, rate_hz: float | None = None, air: Air | None = None
) -> TrimmedFlight:
    """Trim in steady straight flight without sideslip.

    Turbulence and gusts of ``air`` are left out. Airspeed, flight-path angle and heading are those within its steady
    wind, which changes the equilibrium only by way of the Earth's rotation (1.5e-3 m/s2 for 10 m/s).

    Newton's method on the six accelerations over alpha, phi, elevator, aileron, rudder and throttle, elastic modes in
    static equilibrium and propellers at their equilibrium at every step. What has no throttle is trimmed over the
    flight-path angle in its place; what lacks a surface, over the rest, and over sideslip where it has no rudder. The rates are those of the horizon, see :func:`horizon_rates`. Without them the
    nose would rise against the horizon and start a phugoid (0.12 m/s in a minute at 200 m/s). JSBSim's own trim stops
    at 1e-5 m/s2, which drifts visibly in a minute's record.

    Raises:
        TrimError: there is no equilibrium within the limits of the controls and the flight envelope.

    Example:
        >>> import testbench as tb
        >>> trimmed = tb.trim(tb.load_aircraft("taurus"), tb.FlightCondition(V_m_s=12.0, h_m=100.0))
        >>> round(trimmed.alpha, 3) > 0.0
        True
    """
    rate = rate_hz or aircraft.rate_hz
    fdm = Executive(aircraft, rate, condition)
    if air is not None:
        fdm.set_wind(air.wind_m_s)
    problem = _Problem(fdm, condition)
    solvable = False
    for throttle in _THROTTLE_STARTS if "thr" in problem.names else _THROTTLE_STARTS[:1]:
        x, solvable = problem.newton(throttle)
        if solvable:
            break
    if not solvable:
        _check_limits(aircraft, condition, problem.values(x))
        raise TrimError(
            f"trim of {aircraft.name} at {condition} needs controls that can balance it, but on the way there they "
            "lose their effect; the condition is outside the flight envelope"
        )
    residual = problem.accelerations(x, to_rest=True)
    found = problem.values(x)
    _check(aircraft, condition, found, residual, problem.tolerance)
    controls = {n: v for n, v in found.items() if n in aircraft.controls}
    condition = replace(condition, gamma_rad=found.get("gamma", condition.gamma_rad))
    alpha = found["alpha"]
    theta, phi, beta = _theta(condition, alpha), found["phi"], found.get("beta", 0.0)
    return TrimmedFlight(condition, rate, alpha, theta, phi, controls, residual, fdm.read(), beta)


class _Problem:
    """Six accelerations as functions of the unknowns of a trim.

    Args:
        fdm: fresh executive, steady wind set.
        condition: what is wanted.
        names: of the unknowns; those that the aircraft has if not given.
    """

    def __init__(self, fdm: Executive, condition: FlightCondition, names: Sequence[str] = ()) -> None:
        self._fdm, self._condition = fdm, condition
        has = fdm.aircraft.controls
        surfaces = tuple(n for n in ("de", "da", "dr") if n in has)
        sideslip = ("beta",) if "dr" not in has else ()
        self.names = tuple(names) or ("alpha", "phi", *surfaces, *sideslip, "thr" if "thr" in has else "gamma")

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return the unknowns by name."""
        return dict(zip(self.names, map(float, x), strict=True))

    def start(self, throttle: float) -> FloatArray:
        """Return the unknowns that a search begins with."""
        first = {"alpha": 0.05, "thr": throttle, "gamma": -0.05}
        return np.array([first.get(n, 0.0) for n in self.names])

    def newton(self, throttle: float) -> tuple[FloatArray, bool]:
        """Return the unknowns reached from ``throttle`` and whether every step on the way could be solved for.

        A Jacobian costs twelve evaluations; it is kept for as long as each step takes most of the residual away.
        """
        x = self.start(throttle)
        residual = self.accelerations(x)
        jacobian, before, most = None, np.inf, self.tolerance
        for _ in range(40):
            left = float(np.max(np.abs(residual)))
            if left < most:
                break
            if jacobian is None or not left < _KEPT * before:
                jacobian = self._jacobian(x)
                if not np.all(np.isfinite(jacobian)) or np.linalg.cond(jacobian) > 1e12:
                    return x, False
            before = left
            x = x - np.clip(_solved(jacobian, residual), -0.3, 0.3)
            residual = self.accelerations(x)
        return x, True

    @property
    def tolerance(self) -> float:
        """Acceleration that may be left over, m/s2 and rad/s2."""
        return PROPELLER_TOLERANCE if len(self._fdm.propellers) else TOLERANCE

    def _jacobian(self, x: FloatArray) -> FloatArray:
        """Return d accelerations / d unknowns (6, n) by central differences."""
        columns = []
        for i, name in enumerate(self.names):
            step = _STEP.get(name, 1e-4)
            d = step * np.eye(len(x))[i]
            up, down = (self.accelerations(x + sign * d) for sign in (1.0, -1.0))
            columns.append((up - down) / (2.0 * step))
        return np.column_stack(columns)

    def accelerations(self, x: FloatArray, to_rest: bool = False) -> FloatArray:
        """Place the aircraft and return its six accelerations (6,), m/s2 and rad/s2."""
        at, fdm = self.values(x), self._fdm
        alpha, phi, beta = at["alpha"], at["phi"], at.get("beta", 0.0)
        condition = self._condition
        if "gamma" in at:
            condition = replace(condition, gamma_rad=at["gamma"])
        V = condition.V_m_s
        # The wings are all but level, so that theta = alpha + gamma holds the flight path to phi^2.
        fdm.command({n: v for n, v in at.items() if n in fdm.command_nodes})
        theta, uvw = _theta(condition, alpha), np.array([V * np.cos(alpha), 0.0, V * np.sin(alpha)])
        if beta:
            uvw = np.array([uvw[0] * np.cos(beta), V * np.sin(beta), uvw[2] * np.cos(beta)])
        fdm.place(condition.h_m, theta, phi, uvw, horizon_rates(condition.h_m, theta, phi, uvw, fdm.wind_m_s))
        fdm.evaluate(to_rest)
        return np.array([fdm.get(name) * factor for name, factor in _ACCELERATIONS])


def _solved(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the step; of least squares where there are fewer unknowns than accelerations."""
    if jacobian.shape[0] == jacobian.shape[1]:
        return np.asarray(np.linalg.solve(jacobian, residual))
    return np.asarray(np.linalg.lstsq(jacobian, residual, rcond=None)[0])


def _theta(condition: FlightCondition, alpha: float) -> float:
    return alpha + condition.gamma_rad


def steady_wind(trimmed: TrimmedFlight) -> tuple[float, float, float]:
    """Return the velocity of the air (north, east, down, m/s) that a flight was trimmed in.

    Rounded to 1e-9 m/s: JSBSim's initial conditions leave a wind of 1e-13 m/s, the rounding of airspeed and speed over
    the ground, and make it anew wherever the trim is placed.
    """
    north, east, down = (round(trimmed.state[f"wind_{axis}"], 9) + 0.0 for axis in AXES)
    return north, east, down


def horizon_rates(
    h_m: float, theta: float, phi: float, uvw_m_s: FloatArray, wind_m_s: Sequence[float] | FloatArray = (0.0, 0.0, 0.0)
) -> FloatArray:
    """Return p, q, r (rad/s, relative to the Earth) that keep the attitude to the horizon during the flight.

    Heading north over the equator, with v the velocity over the ground (B. L. Stevens, F. L. Lewis, Aircraft Control
    and Simulation, 2nd ed., chapter 1, terrestrial navigation):

        (p, q, r) = C(phi, theta) (v_east / (R_east + h), -v_north / (R_north + h), 0)

    so that straight and level flight has q = -V / (R + h), -2.5e-6 rad/s at 16 m/s.

    Args:
        h_m: height above sea level.
        theta: rad.
        phi: rad.
        uvw_m_s: (3,) airspeed in body axes.
        wind_m_s: north, east, down.
    """
    C = body_from_earth(theta, phi)
    north, east, _ = C.T @ uvw_m_s + np.asarray(wind_m_s, float)
    return np.asarray(C @ np.array([east / (_RADIUS_EAST + h_m), -north / (_RADIUS_NORTH + h_m), 0.0]))


def place_at_trim(fdm: Executive, trimmed: TrimmedFlight) -> None:
    """Put a fresh executive into the trimmed state, steady wind included, at rest in time."""
    fdm.set_wind(steady_wind(trimmed))
    beta = {"beta": trimmed.beta} if trimmed.beta else {}
    at = {"alpha": trimmed.alpha, "phi": trimmed.phi, **trimmed.controls, **beta}
    _Problem(fdm, trimmed.condition, tuple(at)).accelerations(np.array(list(at.values())), to_rest=True)


def _check(
    aircraft: Aircraft, condition: FlightCondition, found: Mapping[str, float], residual: FloatArray, most: float
) -> None:
    where = f"{aircraft.name} at {condition}"
    if not np.max(np.abs(residual)) < most:
        raise TrimError(
            f"trim must leave less than {most:g} m/s2 and rad/s2, but {where} keeps "
            f"{np.max(np.abs(residual)):.3g}; the condition is probably outside the flight envelope"
        )
    _check_limits(aircraft, condition, found)


def _check_limits(aircraft: Aircraft, condition: FlightCondition, found: Mapping[str, float]) -> None:
    """Raise TrimError if alpha or a control lies outside its range; a surface at its stop has lost its effect there."""
    where = f"{aircraft.name} at {condition}"
    low, high = aircraft.limits.get("alpha", (-np.inf, np.inf))
    alpha = found["alpha"]
    if not low <= alpha <= high:
        raise TrimError(
            f"trim of {where} needs alpha = {alpha / DEG_RAD:.1f} deg, but {low / DEG_RAD:g} <= alpha_deg <= "
            f"{high / DEG_RAD:g} must hold; fly {'faster' if alpha > high else 'slower'}"
        )
    for name, value in found.items():
        if name not in aircraft.controls:
            continue
        control = aircraft.controls[name]
        if not control.low - 1e-9 <= value <= control.full + 1e-9:
            scale, unit = (100.0, "%") if name == "thr" else (1.0 / DEG_RAD, "deg")
            raise TrimError(
                f"trim of {where} needs {name} = {value * scale:.1f} {unit}, but {control.low * scale:g} to "
                f"{control.full * scale:g} {unit} is available"
            )
