"""Hidden errors of sensors, in what they are and in what they read.

Shares no code with the library of effects; neither imports the other (tests/test_house_rules.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from testbench.core.record import FloatArray
from testbench.questions.gap.hidden import servos
from testbench.questions.gap.hidden.truth import Size, Truth
from testbench.sensors import Sensor


def sensor(channel: str, change: Callable[[Sensor], Sensor]) -> Truth:
    """Return the truth that changes the sensor of one channel."""
    return Truth(read=lambda s: change(s) if s.channel == channel else s)


def vane(s: Size, aircraft: str) -> Truth:
    """A vane of second order."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "alpha":
            return y
        fine = np.interp(np.arange(t[0], t[-1], (t[1] - t[0]) / 10.0), t, y)
        slow = servos.sprung(s["omega_rad_s"], 0.6)(fine, (t[1] - t[0]) / 10.0)[::10]
        noise = y - _smooth(y, 2)  # keep the reading's scatter
        return _smooth(np.append(slow, slow[-1])[: len(y)], 2) + noise

    return Truth(spoil=spoil)


def calibrated(channel: str, centre: float, s: Size) -> Truth:
    """A reading whose slope changes over the range: y + (gain - 1) (y - centre) (1 + bend (y - centre) / span).

    The noise of the electronics behind stays as it is.
    """
    span = {"V": 5.0, "alpha": 0.1, "q": 0.3}[channel]

    def spoil(name: str, y: FloatArray, t: FloatArray) -> FloatArray:
        d = _smooth(y) - centre
        return y if name != channel else np.asarray(y + (s["gain"] - 1.0) * d * (1.0 + 0.3 * d / span))

    return Truth(spoil=spoil)


def _smooth(y: FloatArray, half: int = 4) -> FloatArray:
    """Return the mean over ``half`` samples to either side."""
    width = 2 * half + 1
    return np.asarray(np.convolve(np.pad(y, half, mode="edge"), np.ones(width) / width, "valid"))


def sticky_vane(s: Size, aircraft: str) -> Truth:
    """A vane that stays where it is until the air has turned by half the play; the reading's scatter stays."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "alpha":
            return y
        smooth = _smooth(y)
        return np.asarray(servos.backlash(s["width_rad"])(smooth, t[1] - t[0]) + y - smooth)

    return Truth(spoil=spoil)


def vibration(s: Size, aircraft: str) -> Truth:
    """The engine shakes the accelerometer at one frequency."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + s["amplitude"] * np.sin(2.0 * math.pi * s["f_hz"] * t)) if channel == "az" else y

    return Truth(spoil=spoil)


def freezing(s: Size, aircraft: str) -> Truth:
    """The attitude stands still for a while in every record."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        if channel != "theta":
            return y
        out, a, b = y.copy(), int(np.searchsorted(t, 3.0)), int(np.searchsorted(t, 3.0 + s["length_s"]))
        out[a:b] = out[a]
        return out

    return Truth(spoil=spoil)


def wandering(s: Size, aircraft: str) -> Truth:
    """The attitude wanders as a sine of 11 s."""

    def spoil(channel: str, y: FloatArray, t: FloatArray) -> FloatArray:
        return np.asarray(y + s["amplitude_rad"] * np.sin(2.0 * math.pi * t / 11.0)) if channel == "theta" else y

    return Truth(spoil=spoil)
