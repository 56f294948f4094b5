"""Attitude: bank and pitch from an inertial unit that is not quite aligned with the body axes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.constants import DEG_RAD
from testbench.core.record import FloatArray
from testbench.sensors.sensor import Sensor


@dataclass(frozen=True)
class Attitude(Sensor):
    """Reads phi or theta of a unit that is mounted at small angles to the body: down as the unit sees it.

    Down has the body components g = (-sin theta, sin phi cos theta, cos phi cos theta). The unit sees C g, C the matrix
    of its Euler angles (yaw, pitch, roll in this order), and shows theta = -arcsin(x), phi = arctan2(y, z). A turned
    unit shows a bank as pitch, which a ``bias`` does not. Errors of the solution itself are bias, drift and lag.

    Args:
        mounting: its roll, pitch and yaw relative to the body, rad; in files ``mounting_deg``.
    """

    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0)

    KIND: ClassVar[str] = "attitude"
    READS: ClassVar[str] = "phi|theta"
    PLACED: ClassVar[tuple[str, ...]] = ()
    IN_FILES: ClassVar[Mapping[str, tuple[str, float]]] = {"mounting_deg": ("mounting", DEG_RAD)}

    def _kind_faults(self) -> Iterator[str]:
        yield from super()._kind_faults()
        if len(self.mounting) != 3 or not all(math.isfinite(x) and abs(x) < 0.5 for x in self.mounting):
            yield f"mounting_deg: roll, pitch and yaw below 0.5 rad are needed, got {self.mounting} rad"

    @property
    def needs(self) -> tuple[str, ...]:
        """The channels of the true record that it is computed from."""
        return ("phi", "theta") if any(self.mounting) else (self.channel,)

    def feel(self, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the angle that the unit shows (n,)."""
        if not any(self.mounting):
            return x[self.channel]
        phi, theta = x["phi"], x["theta"]
        ahead, right, down = -np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)
        (s_roll, s_pitch, s_yaw), (c_roll, c_pitch, c_yaw) = np.sin(self.mounting), np.cos(self.mounting)
        ahead, right = c_yaw * ahead + s_yaw * right, c_yaw * right - s_yaw * ahead
        ahead, down = c_pitch * ahead - s_pitch * down, c_pitch * down + s_pitch * ahead
        right, down = c_roll * right + s_roll * down, c_roll * down - s_roll * right
        return np.asarray(np.arctan2(right, down) if self.channel == "phi" else -np.arcsin(np.clip(ahead, -1.0, 1.0)))
