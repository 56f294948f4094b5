"""Airspeed held against all else that tells speed: pressure, ground speed, the curved path, the climb.

Knots, feet per second and kilometres per hour read as metres per second are speeds that aircraft fly. So the range of
the channel does not tell them; what the speed makes of the other channels does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from testbench.core.atmosphere import air_density
from testbench.core.channels import UNITS
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.record import FloatArray
from testbench.logs.intervals import about, means, times_of_all
from testbench.logs.question import Criteria, Question, Signals, in_unit

_Evidence = tuple[float, str]  # how many times too large the airspeed is, and what says so


def against_airspeed(signals: Signals, c: Criteria) -> list[Question]:
    """Question airspeed too slow to fly, in another unit, and what airspeed contradicts by the factor of a unit."""
    if "V" not in signals:
        return []
    V = signals["V"][1]
    typical = float(np.median(V))
    if 0.0 < typical < c.slowest_m_s and float(np.min(V)) > 0.5 * typical and _moves(signals, c):
        got = f"{typical:.3g} m/s while the aircraft moves"
        return [Question("V", got, "is it in km/s, a Mach number or a fraction, or was the pitot tube covered")]
    if not c.slowest_m_s < typical < c.fastest_m_s:
        return []
    return _pressure(signals, typical, c) or _speed_unit(signals, typical, c)


def _pressure(signals: Signals, typical: float, c: Criteria) -> list[Question]:
    """Question dynamic pressure whose air would be thinner than any that is flown in."""
    if "qbar" not in signals:
        return []
    pressure = float(np.median(signals["qbar"][1]))
    ratio = pressure / (0.5 * air_density(0.0) * typical**2)
    if not 0.0 < ratio < c.thinnest:
        return []
    fits = {u: f * ratio for u, f in UNITS["Pa"].items() if 0.1 < f * ratio < 1.5}
    unit = min(fits, key=lambda u: abs(np.log(fits[u])), default="")
    got = f"{pressure:.3g} Pa at {typical:.3g} m/s, {ratio:.2g} of what air at sea level gives"
    return [Question("qbar", got, f"is it in {unit}" if unit else "which unit is it in", unit)]


def _speed_unit(signals: Signals, typical: float, c: Criteria) -> list[Question]:
    """Question airspeed that another channel shows to be too large or too small as by a unit, and height in feet."""
    for witness in _WITNESSES:
        found = witness(signals, typical, c)
        if found is None:
            continue
        times, says = found
        compared = f"{typical:.3g} m/s, {times:.2g} times what {says}"
        unit = _unit(times, c)
        if unit:
            return [Question("V", compared, in_unit("V", typical, unit), unit)]
        if witness is _by_climb and _near(times, UNITS["m"]["ft"], c):
            h = float(np.max(np.abs(signals["h"][1])))
            got = f"it changes {1.0 / times:.2g} times as fast as airspeed and the path angle say"
            return [Question("h", got, in_unit("h", h, "ft"), "ft")]
        if times * c.speed_match < 1.0 and witness is not _by_ground:  # wind makes ground speed the larger one
            other = f"is another unit set than its own ({_set(times)}), or is it calibrated airspeed"
            return [Question("V", compared, other)]
    return []


def _unit(times: float, c: Criteria) -> str:
    """Return the unit of speed whose values are so many times those in m/s, "" if none is."""
    units = {unit: 1.0 / factor for unit, factor in UNITS["m/s"].items() if factor != 1.0}
    best = min(units, key=lambda u: abs(np.log(times / units[u])))
    return best if _near(times, units[best], c) else ""


def _set(times: float) -> str:
    """Return which unit, set for values in another one, comes nearest to making them so many times too large."""
    factors = {unit: np.log(factor) for unit, factor in UNITS["m/s"].items()}
    pairs = [(a, b) for a in factors for b in factors if a != b]
    wrong, right = min(pairs, key=lambda pair: abs(np.log(times) - factors[pair[0]] + factors[pair[1]]))
    return f"{wrong} for {right} makes {np.exp(factors[wrong] - factors[right]):.2g}"


def _near(times: float, expected: float, c: Criteria) -> bool:
    return 1.0 / c.speed_match < times / expected < c.speed_match


def _by_pressure(signals: Signals, typical: float, c: Criteria) -> _Evidence | None:
    """Compare with the dynamic pressure in the standard atmosphere at the recorded height."""
    if "qbar" not in signals or "h" not in signals:
        return None
    h, pressure = (float(np.median(signals[name][1])) for name in ("h", "qbar"))
    if not (c.lowest_m < h < 11_000.0 and pressure > 0.0):
        return None
    return typical / float(np.sqrt(2.0 * pressure / air_density(h))), "dynamic pressure and height say"


def _by_ground(signals: Signals, typical: float, c: Criteria) -> _Evidence | None:
    """Compare with ground speed, where the heading turns so far that the wind is not ahead or behind all the time."""
    if "Vg" not in signals or "psi" not in signals or np.ptp(np.unwrap(signals["psi"][1])) < c.turned_rad:
        return None
    ground = float(np.median(signals["Vg"][1]))
    return (typical / ground, "ground speed says") if ground > c.slowest_m_s else None


def _by_curve(signals: Signals, typical: float, c: Criteria) -> _Evidence | None:
    """Compare the force that curves the path, -az - g cos(theta) cos(phi) = V (q - alphadot), with its turning."""
    at = times_of_all(signals, ("q", "az", "alpha", "theta"), 0.5)
    if at is None:
        return None
    mean = {name: means(signals[name], at[:-1], at[1:]) for name in ("q", "az", "theta", "phi") if name in signals}
    turning = mean["q"] - np.diff(about(signals["alpha"], at, 0.1)) / 0.5
    weight = G0_M_S2 * np.cos(mean["theta"]) * np.cos(mean.get("phi", 0.0))
    return _slope(turning, -mean["az"] - weight, typical, c, "the curve of the path says")


def _by_climb(signals: Signals, typical: float, c: Criteria) -> _Evidence | None:
    """Compare the change of height with V sin(theta - alpha)."""
    at = times_of_all(signals, ("theta", "alpha", "h"), 2.0)
    if at is None:
        return None
    theta, alpha = (means(signals[name], at[:-1], at[1:]) for name in ("theta", "alpha"))
    climb = np.diff(about(signals["h"], at, 0.4)) / 2.0
    return _slope(np.sin(theta - alpha), climb, typical, c, "height and the path angle say")


_WITNESSES: tuple[Callable[[Signals, float, Criteria], _Evidence | None], ...] = (
    _by_pressure, _by_ground, _by_curve, _by_climb,
)  # fmt: skip


def _slope(x: FloatArray, y: FloatArray, typical: float, c: Criteria, says: str) -> _Evidence | None:
    """Return how many times the slope of ``y`` over ``x`` the airspeed is, if ``y`` follows ``x`` closely."""
    if x.size < 10 or np.std(x) < 0.5 * DEG_RAD:
        return None
    r = float(np.corrcoef(x, y)[0, 1]) if np.std(y) > 0.0 else 0.0
    speed = r * float(np.std(y) / np.std(x))
    return (typical / speed, says) if r > 0.0 and r**2 > c.follows else None


def _moves(signals: Signals, c: Criteria) -> bool:
    """Say whether rates or angles of the aircraft move, or nothing tells."""
    rates = [np.std(signals[name][1]) > c.moving_rad_s for name in ("p", "q", "r") if name in signals]
    angles = [np.ptp(signals[name][1]) > 5.0 * c.moving_rad_s for name in ("phi", "theta", "alpha") if name in signals]
    return any([*rates, *angles]) or not (rates or angles)
