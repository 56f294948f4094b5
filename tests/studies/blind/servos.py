"""What hidden servos, links and motors make of a command, stepped frame by frame.

Servos take a command that changes from frame to frame as a ramp over the frame, as those of the aircraft do.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

import math

import numpy as np
from scipy.signal import lfilter
from studies.blind.truth import Law

from testbench.core.record import FloatArray

_PARTS = 20  # of a frame, in which laws that have no closed form are stepped


def stages(corner_rad_s: float, count: int) -> Law:
    """Return a servo of ``count`` equal first-order stages, each stepped exactly."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        y = u
        for _ in range(count):
            y = _lagged(y, dt_s, 1.0 / corner_rad_s)
        return y

    return law


def sprung(omega_rad_s: float, zeta: float, most_rad_s2: float = math.inf) -> Law:
    """Return a servo of second order, its acceleration limited (motor current); symplectic Euler."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        h, x, v, out = dt_s / _PARTS, float(u[0]), 0.0, []
        for ramp in _ramps(u):
            for c in ramp:
                a = omega_rad_s**2 * (c - x) - 2.0 * zeta * omega_rad_s * v
                v += h * min(most_rad_s2, max(-most_rad_s2, a))
                x += h * v
            out.append(x)
        return np.array(out)

    return law


def slewing(lag_rad_s: float, down_rad_s: float, up_rad_s: float, soft: bool) -> Law:
    """Return a first-order servo whose rate saturates, hard or as a hyperbolic tangent."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        h, x, out = dt_s / _PARTS, float(u[0]), []
        for ramp in _ramps(u):
            for c in ramp:
                v = lag_rad_s * (c - x)
                most = down_rad_s if v > 0.0 else up_rad_s
                x += h * (most * math.tanh(v / most) if soft else min(most, max(-most, v)))
            out.append(x)
        return np.array(out)

    return law


def late(delay_s: float, jitter: float = 0.0, seed: int = 0) -> Law:
    """Return a link that hands every command on after a delay, which may scatter from command to command.

    A command that arrives between two frames is a ramp over one frame as every other, from one to the other of them.
    """

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        rng, t, out = np.random.default_rng(seed), np.arange(len(u)) * dt_s, np.full(len(u), float(u[0]))
        for k in np.flatnonzero(np.diff(u)) + 1:
            arrives = t[k] + delay_s * (1.0 + jitter * rng.uniform(-1.0, 1.0))
            share = np.clip((t - arrives) / dt_s + 1.0, 0.0, 1.0)
            out = (1.0 - share) * out + share * u[k]
        return out

    return law


def after_lag(lag_rad_s: float, law: Law) -> Law:
    """Return a first-order servo of the given corner, followed by ``law``."""
    return lambda u, dt_s: law(_lagged(u, dt_s, 1.0 / lag_rad_s), dt_s)


def backlash(width_rad: float) -> Law:
    """Return a link with play."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        y, out = float(u[0]), []
        for x in u.tolist():
            if x - y > 0.5 * width_rad:
                y = x - 0.5 * width_rad
            elif y - x > 0.5 * width_rad:
                y = x + 0.5 * width_rad
            out.append(y)
        return np.array(out)

    return law


def soft_play(width_rad: float, softness: float = 0.15) -> Law:
    """Return a link with play whose ends give: the surface follows faster the further it is behind."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        y, out, half = float(u[0]), [], 0.5 * width_rad
        for x in u.tolist():
            for _ in range(4):
                gap = (x - y) / half
                push = math.copysign(math.log1p(math.exp(min(50.0, (abs(gap) - 1.0) / softness))) * softness, gap)
                y += min(1.0, dt_s / 4.0 * 400.0) * push * half * (1.0 - math.exp(-abs(gap)))
            out.append(y)
        return np.array(out)

    return law


def reluctant(lag_rad_s: float, half_rad: float) -> Law:
    """Return a first-order servo that does not answer errors below a band, and only the excess above it."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        h, x, out = dt_s / _PARTS, float(u[0]), []
        for ramp in _ramps(u):
            for c in ramp:
                e = c - x
                x += h * lag_rad_s * (e - half_rad if e > half_rad else e + half_rad if e < -half_rad else 0.0)
            out.append(x)
        return np.array(out)

    return law


def scaled(gain: float, cubic: float = 0.0) -> Law:
    """Return a linkage of another ratio, which may change with the deflection: gain u (1 - cubic (u / 0.1 rad)^2)."""
    return lambda u, dt_s: np.asarray(gain * u * (1.0 - cubic * (u / 0.1) ** 2))


def bent(bend: float) -> Law:
    """Return a motor that gives more for a rise of the throttle than it loses for a fall: u (1 + bend u / 0.15)."""
    return lambda u, dt_s: np.asarray(u * (1.0 + bend * u / 0.15))


def motor(rise_s: float, fall_s: float, count: int = 1) -> Law:
    """Return a motor that takes one time to rise and another to fall, in equal stages."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        y = u
        for _ in range(count):
            x, out = float(y[0]), []
            for c in y.tolist():
                time_s = (rise_s if c > x else fall_s) / count
                x += -math.expm1(-dt_s / time_s) * (c - x)
                out.append(x)
            y = np.array(out)
        return y

    return law


def coarse(step_rad: float) -> Law:
    """Return a command link of few steps."""
    return lambda u, dt_s: np.asarray(step_rad * np.rint(u / step_rad))


def stuck(start_s: float, length_s: float) -> Law:
    """Return a link that holds the last command for a while."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        out, a, b = u.copy(), round(start_s / dt_s), round((start_s + length_s) / dt_s)
        out[a:b] = out[a]
        return out

    return law


def held_back(delay_s: float) -> Law:
    """Return a link that is late by whole frames, the nearest number of them."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        return np.concatenate([np.full(round(delay_s / dt_s), u[0]), u])[: len(u)]

    return law


def slewed(rate_rad_s: float) -> Law:
    """Return a link that hands on no faster change than this, before the servo."""

    def law(u: FloatArray, dt_s: float) -> FloatArray:
        most, x, out = rate_rad_s * dt_s, float(u[0]), []
        for wanted in u.tolist():
            x += min(most, max(-most, wanted - x))
            out.append(x)
        return np.array(out)

    return law


def _lagged(u: FloatArray, dt_s: float, time_s: float) -> FloatArray:
    a = math.exp(-dt_s / time_s)
    now = 1.0 - (1.0 - a) * time_s / dt_s  # weight of the ramp's end, of its beginning 1 - a - now
    return np.asarray(lfilter([now, 1.0 - a - now], [1.0, -a], u - u[0])) + u[0]


def _ramps(u: FloatArray) -> list[list[float]]:
    """Return the command in the middle of every part of every frame."""
    before = np.concatenate([u[:1], u[:-1]])
    middles = (np.arange(_PARTS) + 0.5) / _PARTS
    return [list(row) for row in (before[:, None] + np.outer(u - before, middles)).tolist()]
