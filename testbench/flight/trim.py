"""Trim: the attitude and controls at which a steady straight flight needs no further force or moment."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbench.aircraft import Aircraft
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.errors import TrimError
from testbench.core.named import Named, obtain
from testbench.core.record import FloatArray
from testbench.flight.air import AXES, Air
from testbench.flight.condition import FlightCondition, TrimmedFlight
from testbench.flight.executive import ACCELERATIONS, Executive, body_from_earth, velocity_at

UNKNOWN_STEP = {"thr": 1e-3}
"""Step of the differences of a Jacobian, by unknown; 1e-4 rad otherwise."""
_THROTTLE_STARTS = (0.3, 0.8)  # a propeller that gives no thrust at the first has no effect there to start from
# Radii of curvature (m) of the WGS 84 ellipsoid at the equator, where flights start: along the meridian and across it.
RADIUS_NORTH_M, RADIUS_EAST_M = 6335439.0, 6378137.0
_ALPHA = (-10.0 * DEG_RAD, 20.0 * DEG_RAD)
_STARTS = ((0.05, 0.8), (0.15, 0.5), (0.0, 1.0))  # alpha, throttle of damped steps
_FEW = 5
_JACOBIANS = 10  # of Newton's method on a foreign model
_NEARLY = 1e-3  # m/s2 and rad/s2: from there Newton's method is tried again
_DIVERGED = 1e4  # m/s2 and rad/s2
_NO_FAULT = 5e-6  # of what all controls can do, and of gravity: 1 mm/s in 20 s
_NO_EFFECT = 1e-7  # m/s2 and rad/s2 per unit of a control
_MOTIONS = ("udot", "vdot", "wdot", "pdot", "qdot", "rdot")
_WORDS = {
    "alpha": "the angle of attack",
    "beta": "sideslip",
    "gamma": "the flight-path angle",
    "phi": "bank",
    "de": "the elevator",
    "da": "the aileron",
    "dr": "the rudder",
    "thr": "the throttle",
}
_KEPT = 0.3  # of the residual left by a step: with less the Jacobian is kept
TOLERANCE = 1e-9  # m/s2 and rad/s2 left over; well above the rounding of JSBSim's forces
PROPELLER_TOLERANCE = 1e-7  # the same with propellers, whose equilibrium JSBSim finds to some 1e-9 of the thrust


def trim(
    aircraft: Named[Aircraft],
    condition: FlightCondition,
    rate_hz: float | None = None,
    air: Air | None = None,
    near: TrimmedFlight | None = None,
    thorough: bool = True,
    slopes: FloatArray | None = None,
) -> TrimmedFlight:
    """Trim in steady straight flight without sideslip.

    Turbulence and gusts of ``air`` are left out. Airspeed, flight-path angle and heading are those within its steady
    wind, which changes the equilibrium only by way of the Earth's rotation (1.5e-3 m/s2 for 10 m/s).

    Newton's method on the six accelerations over alpha, phi, elevator, aileron, rudder and throttle, elastic modes in
    static equilibrium and propellers at their equilibrium at every step. What has no throttle is trimmed over the
    flight-path angle in its place; what lacks a surface, over the rest, and over sideslip where it has no rudder. The
    rates are those of the horizon, see :func:`horizon_rates`. Without them the nose would rise against the horizon and
    start a phugoid (0.12 m/s in a minute at 200 m/s). JSBSim's own trim stops at 1e-5 m/s2, which drifts visibly in a
    minute's record.

    Where Newton's method fails on a foreign model, damped steps within the limits of alpha and the controls follow,
    from several starts; what stands against a balance is read off from where they end. What is left there is no fault
    below 5e-6 of what the controls can do.

    A warning (:class:`FrameRateWarning`) says so if an amendment counts frames of another rate.

    ``near`` is a trim of the same aircraft, or of one much like it, to start from, with the ``slopes`` of
    :func:`slopes_at` there. Not ``thorough``, damped steps are few and serve the reason.

    Raises:
        TrimError: there is no equilibrium within the limits of the controls and the flight envelope.

    Example:
        >>> import testbench as tb
        >>> trimmed = tb.trim(tb.load_aircraft("taurus"), tb.FlightCondition(V_m_s=12.0, h_m=100.0))
        >>> round(trimmed.alpha, 3) > 0.0
        True
    """
    return trim_and_executive(obtain(Aircraft, aircraft), condition, rate_hz, air, near, thorough, slopes)[0]


def trim_and_executive(
    aircraft: Aircraft,
    condition: FlightCondition,
    rate_hz: float | None = None,
    air: Air | None = None,
    near: TrimmedFlight | None = None,
    thorough: bool = True,
    slopes: FloatArray | None = None,
) -> tuple[TrimmedFlight, Executive]:
    """Return what :func:`trim` does, and the executive that was brought to rest there.

    Raises:
        TrimError: as :func:`trim`.
    """
    rate = rate_hz or aircraft.rate_hz
    _warn_of_frames(aircraft, rate)
    fdm = Executive(aircraft, rate, condition)
    if air is not None:
        fdm.set_wind(air.wind_m_s)
    problem = _Problem(fdm, condition)
    x, solvable = problem.start(_THROTTLE_STARTS[0]), False
    if near is not None:
        x, solvable = problem.newton(values_of(problem.names, near), slopes)
        solvable = solvable and problem.balanced(x)
    if not solvable and (near is None or thorough):
        for throttle in problem.throttle_starts:
            x, solvable = problem.newton(problem.start(throttle))
            if solvable and (aircraft.adapter is None or problem.balanced(x)):
                break
    if aircraft.adapter is not None and not (solvable and problem.balanced(x)):
        x = problem.descend() if thorough else problem.descend([x], _FEW)
        if not problem.balanced(x, problem.no_fault(x)):
            raise TrimError(problem.reason(x))
    elif not solvable:
        _check_limits(aircraft, condition, problem.values(x))
        raise TrimError(
            f"trim of {aircraft.name} at {condition} needs controls that can balance it, but on the way there they "
            "lose their effect; the condition is outside the flight envelope"
        )
    residual = problem.accelerations(x, to_rest=True)
    most = problem.most if np.max(np.abs(residual)) < problem.most else problem.no_fault(x)
    return checked_trim(aircraft, condition, rate, problem.values(x), residual, fdm.read(), most), fdm


def slopes_at(aircraft: Aircraft, trimmed: TrimmedFlight) -> FloatArray:
    """Return the slopes (6, unknowns) of the accelerations, m/s2 and rad/s2, over the unknowns of a trim, at one."""
    problem = _Problem(Executive(aircraft, trimmed.rate_hz, trimmed.condition), trimmed.condition)
    x = values_of(problem.names, trimmed)
    problem.accelerations(x)  # propellers come to rest there first
    return problem.jacobian(x)


def sideslip_held_by(aircraft: Aircraft, trimmed: TrimmedFlight, rudder: float) -> float:
    """Return the sideslip, rad, of steady straight flight with the rudder held there, rad, at the speed of a trim.

    Raises:
        TrimError: bank, aileron and the rest cannot balance it.
    """
    fdm = Executive(aircraft, trimmed.rate_hz, trimmed.condition)
    names = tuple("beta" if n == "dr" else n for n in unknowns(aircraft))
    fdm.command({"dr": rudder})
    problem = _Problem(fdm, trimmed.condition, names)
    x, solved = problem.newton(values_of(names, trimmed))
    if not (solved and problem.balanced(x, problem.no_fault(x))):
        raise TrimError(f"{aircraft.name} has no steady flight with the rudder at {rudder / DEG_RAD:.3g} deg")
    return problem.values(x)["beta"]


class FrameRateWarning(UserWarning):
    """An amendment that counts frames, such as a delay, is flown at another frame rate than it was made for."""


def _warn_of_frames(aircraft: Aircraft, rate_hz: float) -> None:
    for a in aircraft.amendments:
        if a.rate_hz is not None and abs(a.rate_hz / rate_hz - 1.0) > 1e-6:
            text = (
                f"{a.name} ({a.description}) counts frames of {a.rate_hz:g} Hz and is flown at {rate_hz:g} Hz, where "
                f"its times are {a.rate_hz / rate_hz:.3g} times as long; amend dataclasses.replace(aircraft, "
                f"rate_hz={rate_hz:g}) instead"
            )
            warnings.warn(FrameRateWarning(text), stacklevel=3)


def checked_trim(
    aircraft: Aircraft,
    condition: FlightCondition,
    rate_hz: float,
    found: Mapping[str, float],
    residual: FloatArray,
    state: Mapping[str, float],
    most: float | FloatArray = TOLERANCE,
) -> TrimmedFlight:
    """Return the equilibrium that a search has come to.

    Args:
        aircraft: what is trimmed.
        condition: what was wanted.
        rate_hz: frame rate.
        found: unknown -> value.
        residual: (6,) accelerations left over.
        state: channel -> value there, SI.
        most: acceleration that may be left over, of all or of each.

    Raises:
        TrimError: more is left over, or alpha or a control lies outside its range.
    """
    _check(aircraft, condition, found, residual, most)
    controls = {n: v for n, v in found.items() if n in aircraft.controls}
    condition = replace(condition, gamma_rad=found.get("gamma", condition.gamma_rad))
    alpha = found["alpha"]
    theta, phi, beta = _theta(condition, alpha), found["phi"], found.get("beta", 0.0)
    return TrimmedFlight(condition, rate_hz, alpha, theta, phi, controls, residual, state, beta)


def unknowns(aircraft: Aircraft) -> tuple[str, ...]:
    """Return what a trim of an aircraft seeks."""
    has = aircraft.controls
    surfaces = tuple(n for n in ("de", "da", "dr") if n in has)
    # Sideslip takes the place of a missing control: side force, roll and yaw are three equations.
    sideslip = () if {"da", "dr"} <= {*has} else ("beta",)
    return ("alpha", "phi", *surfaces, *sideslip, "thr" if "thr" in has else "gamma")


def first_guess(names: Sequence[str], throttle: float = _THROTTLE_STARTS[0]) -> FloatArray:
    """Return the unknowns that a search begins with."""
    first = {"alpha": 0.05, "thr": throttle, "gamma": -0.05}
    return np.array([first.get(n, 0.0) for n in names])


def values_of(names: Sequence[str], trimmed: TrimmedFlight) -> FloatArray:
    """Return the values of unknowns at a trim that is known."""
    known = {"alpha": trimmed.alpha, "phi": trimmed.phi, "beta": trimmed.beta, "gamma": trimmed.condition.gamma_rad}
    known |= dict(trimmed.controls)
    return np.array([known.get(n, 0.0) for n in names])


class _Problem:
    """Six accelerations as functions of the unknowns of a trim.

    Args:
        fdm: fresh executive, steady wind set.
        condition: what is wanted.
        names: of the unknowns; those that the aircraft has if not given.
    """

    def __init__(self, fdm: Executive, condition: FlightCondition, names: Sequence[str] = ()) -> None:
        self._fdm, self._condition = fdm, condition
        self.names = tuple(names) or unknowns(fdm.aircraft)

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return the unknowns by name."""
        return dict(zip(self.names, map(float, x), strict=True))

    def start(self, throttle: float) -> FloatArray:
        """Return the unknowns that a search begins with."""
        return first_guess(self.names, throttle)

    @property
    def throttle_starts(self) -> tuple[float, ...]:
        """Throttles to start from, in this order; with a governor, first one that lets it govern."""
        if "thr" not in self.names:
            return _THROTTLE_STARTS[:1]
        return _THROTTLE_STARTS[::-1] if self._fdm.propellers.governed else _THROTTLE_STARTS

    def balanced(self, x: FloatArray, most: float | FloatArray = 0.0) -> bool:
        """Return whether the unknowns leave no more than this, or the tolerance, and lie within their limits."""
        low, high = self._bounds()
        inside = bool(np.all(x >= low - 1e-9) and np.all(x <= high + 1e-9))
        return inside and bool(np.all(np.abs(self.accelerations(x, to_rest=True)) < np.maximum(most, self.most)))

    def no_fault(self, x: FloatArray) -> FloatArray:
        """Return the accelerations (6,) too small to matter, m/s2 and rad/s2: a part of what all controls can do.

        Where tables have kinks, or engines steps, no search may come nearer.
        """
        low, high = self._bounds()
        control = np.isin(self.names, list(self._fdm.aircraft.controls))
        can = np.abs(np.nan_to_num(self.jacobian(x))) @ np.where(control, high - low, 0.0)
        can[:3] = np.maximum(can[:3], G0_M_S2)
        self.accelerations(x, to_rest=True)
        return np.asarray(_NO_FAULT * can)

    @property
    def most(self) -> float:
        """Acceleration that is accepted, m/s2 and rad/s2.

        Filters of foreign models may never come quite to rest. With neither aileron nor rudder, the turning Earth
        leaves a lateral acceleration of this size that nothing can balance.
        """
        lateral = {"da", "dr"} & {*self.names}
        return PROPELLER_TOLERANCE if self._fdm.aircraft.adapter is not None or not lateral else self.tolerance

    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest values of the unknowns (n,)."""
        aircraft = self._fdm.aircraft
        ends = {"phi": (-0.35, 0.35), "beta": (-0.35, 0.35), "gamma": (-1.0, 0.5)}
        ends["alpha"] = aircraft.limits.get("alpha", _ALPHA)
        ends |= {n: (c.low, c.full) for n, c in aircraft.controls.items()}
        low, high = zip(*(ends[n] for n in self.names), strict=True)
        return np.array(low), np.array(high)

    def descend(self, starts: Sequence[FloatArray] = (), steps: int = 12) -> FloatArray:
        """Return where damped steps of least squares within the limits end, the best of several starts.

        Levenberg and Marquardt: a step that leaves more than before is shortened and turned towards the steepest
        descent; unknowns at a limit that would leave it are held there.
        """
        low, high = self._bounds()
        best, least = np.clip(self.start(_THROTTLE_STARTS[0]), low, high), np.inf
        is_alpha = np.array(self.names) == "alpha"
        for first in starts or [np.where(is_alpha, alpha, self.start(throttle)) for alpha, throttle in _STARTS]:
            x = np.clip(np.nan_to_num(first), low, high)
            residual = self.accelerations(x)
            damping, stuck = 1e-3, False
            for _ in range(steps):
                J = self.jacobian(x)
                if not (np.all(np.isfinite(J)) and np.all(np.isfinite(residual))):
                    break
                slope = J.T @ residual
                free = ~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0)))
                H = (J.T @ J)[np.ix_(free, free)]
                for _ in range(6):
                    step = np.zeros(len(x))
                    damped = H + damping * np.diag(np.diag(H) + 1e-9)
                    step[free] = np.linalg.solve(damped, slope[free]) if np.any(free) else 0.0
                    trial = np.clip(x - np.clip(step, -0.2, 0.2), low, high)
                    now = self.accelerations(trial)
                    if np.linalg.norm(now) < np.linalg.norm(residual):
                        break
                    damping = min(10.0 * damping, 1e6)
                else:
                    stuck = True
                if stuck:
                    break
                gain = 1.0 - np.linalg.norm(now) / np.linalg.norm(residual)
                x, residual, damping = trial, now, max(0.1 * damping, 1e-12)
                if gain < 1e-3 or np.max(np.abs(residual)) < self.tolerance:
                    break
            left = float(np.linalg.norm(residual))
            if left < least:
                best, least = x, left
            if np.max(np.abs(residual)) < _NEARLY:
                polished, solved = self.newton(x)
                if solved and self.balanced(polished):
                    return polished
        return best

    def reason(self, x: FloatArray) -> str:
        """Return why there is no trim, read off from the unknowns that come nearest to one."""
        fdm, aircraft = self._fdm, self._fdm.aircraft
        where = f"{aircraft.name} at {self._condition}"
        residual = self.accelerations(x, to_rest=True)
        J = self.jacobian(x)
        at = self.values(x)
        low, high = self._bounds()
        k = int(np.argmax(np.abs(residual)))
        unit = "m/s2" if k < 3 else "rad/s2"
        left = f"{residual[k]:.2g} {unit} of {_MOTIONS[k]} are left"
        if not np.max(np.abs(residual)) < _DIVERGED:
            why = (
                ": lift or moment by alphadot changes alphadot by more than itself"
                if "aero/alphadot-rad_sec" in aircraft.xml
                else ""
            )
            return f"trim of {where} needs forces that settle, but they grow from evaluation to evaluation{why}"
        for i, name in enumerate(self.names):
            if name not in aircraft.controls or np.max(np.abs(J[:, i])) > _NO_EFFECT:
                continue
            moved = [np.where(np.arange(len(x)) == i, low[i] + f * (high[i] - low[i]), x) for f in (0.3, 0.9)]
            if not np.max(np.abs(self.accelerations(moved[1]) - self.accelerations(moved[0]))) > _NO_EFFECT:
                self.accelerations(x, to_rest=True)
                said = f"; {fdm.engine_state()}" if name == "thr" else ""
                return f"trim of {where} needs a balance, but {_WORDS[name]} has no effect there: {left}{said}"
        self.accelerations(x, to_rest=True)
        stops = [
            f"{_WORDS[n]} at its end of {_shown(n, at[n])}"
            for i, n in enumerate(self.names)
            if n != "phi" and (at[n] <= low[i] + 1e-9 or at[n] >= high[i] - 1e-9)
        ]
        limited = fdm.propellers.limited()
        said = f"; {fdm.engine_state()}" if at.get("thr", 0.0) > 0.999 else ""
        if limited:
            return f"trim of {where} needs more power than {limited}"
        if k == 0 and residual[0] < 0.0 and at.get("thr", 0.0) > 0.999:
            lacks = -residual[0] * aircraft.mass.mass_kg
            return f"trim of {where} needs {lacks:.3g} N more than full throttle gives: {fdm.engine_state()}"
        ends = f"with {', '.join(stops)} " if stops else "at any position of the controls "
        return f"trim of {where} needs a balance, but {ends}{left}{said}"

    def newton(self, x: FloatArray, jacobian: FloatArray | None = None) -> tuple[FloatArray, bool]:
        """Return the unknowns reached from ``x`` and whether every step on the way could be solved for.

        A Jacobian costs twelve evaluations; it is kept for as long as each step takes most of the residual away, and so
        is one that is given.
        """
        residual = self.accelerations(x)
        before, most, made = np.inf, self.tolerance, 0
        for _ in range(40):
            left = float(np.max(np.abs(residual)))
            if left < most or (left < self.most and not left < _KEPT * before):
                break
            if jacobian is None or not left < _KEPT * before:
                made += 1
                if made > _JACOBIANS and self._fdm.aircraft.adapter is not None:
                    break
                jacobian = self.jacobian(x)
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

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return d accelerations / d unknowns (6, n) by central differences."""
        columns = []
        for i, name in enumerate(self.names):
            step = UNKNOWN_STEP.get(name, 1e-4)
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
        theta, uvw = _theta(condition, alpha), velocity_at(V, alpha, beta)
        fdm.place(condition.h_m, theta, phi, uvw, horizon_rates(condition.h_m, theta, phi, uvw, fdm.wind_m_s))
        fdm.evaluate(to_rest)
        return np.array([fdm.get(name) * factor for name, factor in ACCELERATIONS])


def _shown(name: str, value: float) -> str:
    return f"{100.0 * value:.0f} %" if name == "thr" else f"{value / DEG_RAD:.1f} deg"


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
    return np.asarray(C @ np.array([east / (RADIUS_EAST_M + h_m), -north / (RADIUS_NORTH_M + h_m), 0.0]))


def place_at_trim(fdm: Executive, trimmed: TrimmedFlight) -> None:
    """Put a fresh executive into the trimmed state, steady wind included, at rest in time."""
    fdm.set_wind(steady_wind(trimmed))
    beta = {"beta": trimmed.beta} if trimmed.beta else {}
    at = {"alpha": trimmed.alpha, "phi": trimmed.phi, **trimmed.controls, **beta}
    _Problem(fdm, trimmed.condition, tuple(at)).accelerations(np.array(list(at.values())), to_rest=True)


def _check(
    aircraft: Aircraft,
    condition: FlightCondition,
    found: Mapping[str, float],
    residual: FloatArray,
    most: float | FloatArray,
) -> None:
    where = f"{aircraft.name} at {condition}"
    if not np.all(np.abs(residual) < most):
        raise TrimError(
            f"trim must leave less than {np.min(most):g} m/s2 and rad/s2, but {where} keeps "
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
