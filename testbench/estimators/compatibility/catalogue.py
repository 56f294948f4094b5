"""The errors that instruments may have: their names, their plausible sizes, and the words for them.

A name is a channel and a kind: ``alpha_scale``, ``q_bias``, ``V_delay``, ``alpha_lag``; or the wind's direction.
"""

from __future__ import annotations

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD
from testbench.core.words import with_error
from testbench.estimators.parametric.kinematics import ACCELEROMETERS, RATES, KinematicStructure

TIMED = ("V", "alpha", "beta")
"""Channels that may come late: by a pure delay (negative: early, or the inertial unit is late), or through a lag."""
DELAY_LIMIT_S = 0.3
LAG_LIMIT_S = 1.0
LAG_LEAST_S = 1e-3
SETTLING_S = 0.5  # of timed channels at the start of a record: what they read goes back to before it

# Plausible sizes: an instrument with a larger error is broken rather than in need of calibration (estimates).
_SIZE = {
    "V_bias": 5.0,
    "alpha_bias": 5.0 * DEG_RAD,
    "beta_bias": 5.0 * DEG_RAD,
    "phi_bias": 5.0 * DEG_RAD,
    "theta_bias": 5.0 * DEG_RAD,
    "V_scale": 0.3,
    "alpha_scale": 0.5,
    "beta_scale": 0.5,
    "phi_scale": 0.2,
    "theta_scale": 0.2,
    "wind_north": 20.0,
    "wind_east": 20.0,
    "wind_down": 3.0,
}
_INSTRUMENT = {
    "V": "airspeed sensor",
    "alpha": "angle-of-attack vane",
    "beta": "sideslip vane",
    "p": "roll-rate gyro",
    "q": "pitch-rate gyro",
    "r": "yaw-rate gyro",
    "ax": "forward accelerometer",
    "ay": "lateral accelerometer",
    "az": "vertical accelerometer",
    "phi": "bank angle",
    "theta": "pitch angle",
}
_TOWARDS = {"wind_north": "towards north", "wind_east": "towards east", "wind_down": "downwards"}
_REVERSED = {"wind_north": "towards south", "wind_east": "towards west", "wind_down": "upwards"}
_IN_DEGREES = {"rad": "deg", "rad/s": "deg/s"}


def instrument(channel_name: str) -> str:
    """Return what measures a channel, e.g. "pitch-rate gyro"."""
    return _INSTRUMENT.get(channel_name, channel_name)


def plausible_size(name: str) -> float:
    """Return the size beyond which error ``name`` is not plausible, in SI units."""
    if name in _SIZE:
        return _SIZE[name]
    of, _, kind = name.rpartition("_")
    if kind == "delay":
        return DELAY_LIMIT_S
    if kind == "lag":
        return LAG_LIMIT_S
    if kind == "scale":
        return 0.1  # of a gyro
    return 3.0 * DEG_RAD if of in RATES else 1.0


def none_value(name: str) -> float:
    """Return the value of ``name`` that means no error."""
    return 1.0 if name.endswith("_scale") else 0.0


def candidates(structure: KinematicStructure) -> tuple[str, ...]:
    """Return the errors that can be sought, in the order in which they are believed when data cannot tell."""
    have = [p.name for p in structure.parameters if p.free]
    ranked = [f"{n}_bias" for n in (*RATES, *ACCELEROMETERS)]
    ranked += [f"{n}_{kind}" for kind in ("scale", "bias") for n in ("alpha", "beta", "V")]
    delays = [f"{n}_delay" for n in TIMED if n in structure.outputs]
    ranked += [*delays, *_TOWARDS]
    ranked += [f"{n}_{kind}" for kind in ("scale", "bias") for n in ("theta", "phi")]
    ranked += [f"{n}_scale" for n in RATES]
    return tuple(n for n in ranked if n in have or n in delays)


def in_words(name: str, value: float, error: float) -> str:
    """Return what an error means, e.g. "the angle-of-attack vane reads 9.8 +- 0.6 % too much"."""
    if name in _TOWARDS:
        where = _TOWARDS[name] if value >= 0.0 else _REVERSED[name]
        return f"the wind blows {with_error(abs(value), error)} m/s {where}"
    of, _, kind = name.rpartition("_")
    what = _INSTRUMENT[of]
    if kind in ("delay", "lag"):
        if kind == "lag":
            return f"the {what} lags with a time constant of {with_error(value, error)} s"
        late = "late" if value >= 0.0 else "early"
        return f"the {what} comes {with_error(abs(value), error)} s {late} against the inertial unit"
    if kind == "scale":
        off = 100.0 * (value - 1.0)
        return f"the {what} reads {with_error(abs(off), 100.0 * error)} % too {'much' if off >= 0.0 else 'little'}"
    unit = channel(of).unit
    factor = 1.0 / DEG_RAD if unit in _IN_DEGREES else 1.0
    size = with_error(abs(value) * factor, error * factor)
    return f"the {what} reads {size} {_IN_DEGREES.get(unit, unit)} too {'much' if value >= 0.0 else 'little'}"
