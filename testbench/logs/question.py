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


@dataclass(frozen=True)
class Criteria:
    """Where a value is questioned. All are judged: beyond what aircraft with instruments on board do."""

    slowest_hz: float = 0.2
    fastest_hz: float = 20_000.0
    flow_angle_rad: float = 0.5 * np.pi  # air from behind
    pitch_rad: float = 0.51 * np.pi  # by the definition of Euler angles, and rounding
    turns_rad: float = 16.0 * np.pi  # of bank and heading, which count on
    turning_rad_s: float = 1.0  # of them, over a whole flight
    roll_rate_rad_s: float = 20.0
    rate_rad_s: float = 10.0
    angular_rad_s2: float = 1000.0
    force_m_s2: float = 32.0 * G0_M_S2  # the range of the widest inertial units in autopilots
    fastest_m_s: float = 700.0
    slowest_m_s: float = 3.0  # nothing that is flown for identification flies slower
    surface_rad: float = np.pi / 3.0
    unstated_flow_rad: float = 0.6  # 34 deg, where no unit is stated: degrees of a quiet flight look like that in rad
    unstated_surface_rad: float = 0.75  # 43 deg
    throttle: float = 1.5
    lowest_m: float = -500.0
    highest_m: float = 40_000.0
    pressure_pa: float = 2.5e5
    few: float = 0.01  # share of samples beyond: below it they are damaged, above it the unit is wrong
    flown: float = 0.5  # share of the samples before which all is flight, where what comes after may be a crash
    moving_rad_s: float = 0.01  # spread of a rate of an aircraft that is not standing
    follows: float = 0.9  # share of the variance that one channel must explain of another to tell its unit
    turned_rad: float = 0.75 * np.pi  # of heading, over which wind is no constant difference
    frozen: int = 8  # samples
    chance: float = 1e-6  # that a stretch without change is chance
    jump: float = 5.0  # of the usual change between samples, into and out of a stretch without change
    crossed: float = 0.25  # of the range of the channel, where the stretch lies at an end of the record


CRITERIA = Criteria()


def limits(name: str, c: Criteria) -> tuple[float, float] | None:
    """Return the least and the greatest value, SI, that a channel may have; None if there are no such."""
    base = name.removesuffix("_cmd")
    sizes = {
        "alpha": c.flow_angle_rad, "beta": c.flow_angle_rad, "theta": c.pitch_rad, "phi": c.turns_rad,
        "psi": c.turns_rad, "p": c.roll_rate_rad_s, "q": c.rate_rad_s, "r": c.rate_rad_s, "pdot": c.angular_rad_s2,
        "qdot": c.angular_rad_s2, "rdot": c.angular_rad_s2, "ax": c.force_m_s2, "ay": c.force_m_s2,
        "az": c.force_m_s2, "de": c.surface_rad, "da": c.surface_rad, "dr": c.surface_rad, "thr": c.throttle,
        "V": c.fastest_m_s, "u": c.fastest_m_s, "v": c.fastest_m_s, "w": c.fastest_m_s, "Vg": c.fastest_m_s,
        "hdot": c.fastest_m_s, "qbar": c.pressure_pa,
    }  # fmt: skip
    if base == "h":
        return c.lowest_m, c.highest_m
    return (-sizes[base], sizes[base]) if base in sizes else None


def beyond(name: str, t: FloatArray, x: FloatArray, c: Criteria) -> NDArray[np.bool_]:
    """Return which samples (n,) are beyond what the channel may have; bank and heading may count on while it turns."""
    extent = limits(name, c)
    if extent is None:
        return np.zeros(x.size, bool)
    turned = c.turning_rad_s * float(t[-1] - t[0]) if name in ("phi", "psi") else 0.0
    return np.asarray((x < extent[0] - turned) | (x > extent[1] + turned))


def damaged(out: NDArray[np.bool_], c: Criteria, stated: bool) -> tuple[bool, bool]:
    """Say whether samples beyond what flies are damaged rather than in another unit, and whether they are an end.

    They are few; or, where the unit is stated, all that comes after most of the flight, as of a crash.
    """
    count, first = int(np.count_nonzero(out)), int(np.argmax(out))
    at_end = first >= c.flown * out.size and out.size - first < 2 * count + c.frozen
    return count < c.few * out.size or (stated and at_end), at_end


@dataclass(frozen=True)
class Question:
    """A value that is hardly meant: of which channel ("t" for the times), what was got, what it means, what to set.

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
