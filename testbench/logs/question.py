"""A question at the door, and the criteria by which values are questioned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbench.core.channels import channel
from testbench.core.constants import DEG_RAD, G0_M_S2
from testbench.core.record import FloatArray

Signal = tuple[FloatArray, FloatArray]
"""Times, s, and samples in SI units, (n,) each, without those that were not taken."""
Signals = Mapping[str, Signal]


LIMITS = {
    **dict.fromkeys(("alpha", "beta"), (-0.5 * np.pi, 0.5 * np.pi)),  # air from behind
    "theta": (-0.51 * np.pi, 0.51 * np.pi),  # by the definition of Euler angles, and rounding
    **dict.fromkeys(("phi", "psi"), (-16.0 * np.pi, 16.0 * np.pi)),  # which count on
    "p": (-20.0, 20.0),
    **dict.fromkeys("qr", (-10.0, 10.0)),
    **dict.fromkeys(("pdot", "qdot", "rdot"), (-1000.0, 1000.0)),
    **dict.fromkeys(("ax", "ay", "az"), (-32.0 * G0_M_S2, 32.0 * G0_M_S2)),  # of the widest inertial unit in autopilots
    **dict.fromkeys(("de", "da", "dr"), (-np.pi / 3.0, np.pi / 3.0)),
    "thr": (-1.5, 1.5),
    **dict.fromkeys(("V", "u", "v", "w", "Vg", "hdot"), (-700.0, 700.0)),
    "h": (-500.0, 40_000.0),
    "qbar": (-2.5e5, 2.5e5),
}
"""Channel -> the least and the greatest value, SI, of aircraft with instruments on board; judged."""
UNSTATED = {"alpha": 0.6, "beta": 0.6, "de": 0.75, "da": 0.75, "dr": 0.75}
"""Angle -> its greatest size, rad, where no unit is stated: degrees of a quiet flight look like that in rad."""
_TURNING_RAD_S = 1.0  # of bank and heading, over a whole flight
FEW = 0.01  # share of samples beyond: below it they are damaged, above it the unit is wrong
_FLOWN = 0.5  # share of the samples before which all is flight, where what comes after may be a crash
MOVING_RAD_S = 0.01  # spread of a rate of an aircraft that is not standing
FROZEN = 8  # samples without a change


def beyond(name: str, t: FloatArray, x: FloatArray, unstated: bool = False) -> NDArray[np.bool_]:
    """Return which samples (n,) are beyond what the channel may have; bank and heading may count on while it turns."""
    base = name.removesuffix("_cmd")
    if base not in LIMITS:
        return np.zeros(x.size, bool)
    low, high = (-UNSTATED[base], UNSTATED[base]) if unstated and base in UNSTATED else LIMITS[base]
    turned = _TURNING_RAD_S * float(t[-1] - t[0]) if name in ("phi", "psi") else 0.0
    return np.asarray((x < low - turned) | (x > high + turned))


def damaged(out: NDArray[np.bool_], stated: bool) -> tuple[bool, bool]:
    """Say whether samples beyond what flies are damaged rather than in another unit, and whether they are an end.

    They are few; or, where the unit is stated, all that comes after most of the flight, as of a crash.
    """
    count, first = int(np.count_nonzero(out)), int(np.argmax(out))
    at_end = first >= _FLOWN * out.size and out.size - first < 2 * count + FROZEN
    return count < FEW * out.size or (stated and at_end), at_end


@dataclass(frozen=True)
class Question:
    """An implausible value: of which channel ("t" for the times), what was got, what it means, what to set.

    ``unit`` is the unit in which the values would make sense, "" if none does; ``probability`` is that of the meaning,
    where it was weighed.
    """

    channel: str
    got: str
    means: str
    unit: str = ""
    probability: float | None = None

    def asked(self, how: Callable[[str, str], str]) -> str:
        """Return the question in words; ``how(channel, unit)`` says what to set at this door."""
        likely = "" if self.probability is None else f" ({100.0 * min(self.probability, 0.999):.3g} % likely)"
        return f"{self.channel}: {self.got}; {self.means}{likely}? {how(self.channel, self.unit)}".strip()


def shown(name: str, value: float) -> str:
    """Return a value of a channel with its unit, degrees for angles."""
    unit = channel(name).unit
    if unit.startswith("rad"):
        return f"{short(value / DEG_RAD)} {unit.replace('rad', 'deg')}"
    return f"{short(value)}" + ("" if unit == "1" else f" {unit}")


def in_unit(name: str, value: float, unit: str) -> str:
    """Ask whether a value of a channel, read in SI units, is in another unit."""
    return f"is it in {unit} ({value:.3g} {unit}, read as {value:.3g} {channel(name).unit})"


def short(value: float) -> str:
    """Return a number with three digits."""
    return f"{value:.3g}"
