"""Trim: the attitude and controls at which a steady straight flight needs no further force or moment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, FT_M
from testbench.core.errors import TrimError
from testbench.core.record import FloatArray
from testbench.flight.air import AXES, Air
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import Executive, body_from_earth

_UNKNOWNS = ("alpha", "phi", "de", "da", "dr", "thr")
_STEPS = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3])
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


def trim(
    aircraft: Aircraft, condition: FlightCondition, rate_hz: float | None = None, air: Air | None = None
) -> TrimmedFlight:
    """Trim in steady straight flight without sideslip.

    Turbulence and gusts of ``air`` are left out. Airspeed, flight-path angle and heading are those within its steady
    wind, which changes the equilibrium only by way of the Earth's rotation (1.5e-3 m/s2 for 10 m/s).

    Newton's method on the six accelerations over alpha, phi, elevator, aileron, rudder and throttle, elastic modes in
    static equilibrium at every step. The rates are those of the horizon, see :func:`horizon_rates`. Without them the
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
    solvable = False
    for throttle in _THROTTLE_STARTS:
        x, solvable = _newton(fdm, condition, throttle)
        if solvable:
            break
    if not solvable:
        _check_limits(aircraft, condition, x)
        raise TrimError(
            f"trim of {aircraft.name} at {condition} needs controls that can balance it, but on the way there they "
            "lose their effect; the condition is outside the flight envelope"
        )
    residual = _accelerations(fdm, condition, x, to_rest=True)
    _check(aircraft, condition, x, residual)
    controls = {n: float(v) for n, v in zip(_UNKNOWNS, x, strict=True) if n in aircraft.controls}
    alpha, phi = float(x[0]), float(x[1])
    return TrimmedFlight(condition, rate, alpha, _theta(condition, alpha), phi, controls, residual, fdm.read())


def _newton(fdm: Executive, condition: FlightCondition, throttle: float) -> tuple[FloatArray, bool]:
    """Return the unknowns reached from ``throttle`` and whether every step on the way could be solved for.

    A Jacobian costs twelve evaluations; it is kept for as long as each step takes most of the residual away.
    """
    x = np.array([0.05, 0.0, 0.0, 0.0, 0.0, throttle])
    residual = _accelerations(fdm, condition, x)
    jacobian, before = None, np.inf
    for _ in range(40):
        left = float(np.max(np.abs(residual)))
        if left < TOLERANCE:
            break
        if jacobian is None or not left < _KEPT * before:
            jacobian = _jacobian(fdm, condition, x)
            if not np.all(np.isfinite(jacobian)) or np.linalg.cond(jacobian) > 1e12:
                return x, False
        before = left
        x = x - np.clip(np.linalg.solve(jacobian, residual), -0.3, 0.3)
        residual = _accelerations(fdm, condition, x)
    return x, True


def _jacobian(fdm: Executive, condition: FlightCondition, x: FloatArray) -> FloatArray:
    """Return d accelerations / d unknowns (6, 6) by central differences."""
    columns = []
    for step, d in zip(_STEPS, np.diag(_STEPS), strict=True):
        up, down = (_accelerations(fdm, condition, x + sign * d) for sign in (1.0, -1.0))
        columns.append((up - down) / (2.0 * step))
    return np.column_stack(columns)


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
    x = np.array([trimmed.alpha, trimmed.phi, *(trimmed.controls[n] for n in _UNKNOWNS[2:])])
    _accelerations(fdm, trimmed.condition, x, to_rest=True)


def _accelerations(fdm: Executive, condition: FlightCondition, x: FloatArray, to_rest: bool = False) -> FloatArray:
    alpha, phi = float(x[0]), float(x[1])
    V = condition.V_m_s
    # The wings are all but level, so that theta = alpha + gamma holds the flight path to phi^2.
    fdm.command(dict(zip(_UNKNOWNS[2:], map(float, x[2:]), strict=True)))
    theta, uvw = _theta(condition, alpha), np.array([V * np.cos(alpha), 0.0, V * np.sin(alpha)])
    fdm.place(condition.h_m, theta, phi, uvw, horizon_rates(condition.h_m, theta, phi, uvw, fdm.wind_m_s))
    fdm.evaluate(to_rest)
    return np.array([fdm.get(name) * factor for name, factor in _ACCELERATIONS])


def _check(aircraft: Aircraft, condition: FlightCondition, x: FloatArray, residual: FloatArray) -> None:
    where = f"{aircraft.name} at {condition}"
    if not np.max(np.abs(residual)) < TOLERANCE:
        raise TrimError(
            f"trim must leave less than {TOLERANCE:g} m/s2 and rad/s2, but {where} keeps "
            f"{np.max(np.abs(residual)):.3g}; the condition is probably outside the flight envelope"
        )
    _check_limits(aircraft, condition, x)


def _check_limits(aircraft: Aircraft, condition: FlightCondition, x: FloatArray) -> None:
    """Raise TrimError if alpha or a control lies outside its range; a surface at its stop has lost its effect there."""
    where = f"{aircraft.name} at {condition}"
    low, high = aircraft.limits.get("alpha", (-np.inf, np.inf))
    if not low <= x[0] <= high:
        raise TrimError(
            f"trim of {where} needs alpha = {x[0] / DEG_RAD:.1f} deg, but {low / DEG_RAD:g} <= alpha_deg <= "
            f"{high / DEG_RAD:g} must hold; fly {'faster' if x[0] > high else 'slower'}"
        )
    for name, value in zip(_UNKNOWNS[2:], x[2:], strict=True):
        control = aircraft.controls[name]
        if not control.low - 1e-9 <= value <= control.full + 1e-9:
            scale, unit = (100.0, "%") if name == "thr" else (1.0 / DEG_RAD, "deg")
            raise TrimError(
                f"trim of {where} needs {name} = {value * scale:.1f} {unit}, but {control.low * scale:g} to "
                f"{control.full * scale:g} {unit} is available"
            )
