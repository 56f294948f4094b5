"""Accelerometer: specific force along one body axis, anywhere on the airframe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from testbench.core.record import FloatArray
from testbench.sensors.sensor import ACCELEROMETERS, ROTATION, lever
from testbench.sensors.triad import Triad


@dataclass(frozen=True)
class Accelerometer(Triad):
    """Reads ax, ay or az at ``position_m``, or along body z at a wing station (az_wing_i), modal motion included.

    On the fuselage the airframe is rigid: a_P = a_CG + omegadot x r + omega x (omega x r). At the station of a
    flexible wing the modes' accelerations add to that (``aircraft.airframe.wing_acceleration``). What leaks in through
    ``cross_axis`` is felt at the same position, on a wing station at the centre of gravity.
    """

    KIND: ClassVar[str] = "accelerometer"
    READS: ClassVar[str] = r"ax|ay|az|az_wing_\d+"
    AXES: ClassVar[tuple[str, str, str]] = ACCELEROMETERS

    def along(self, name: str, x: Mapping[str, FloatArray]) -> FloatArray:
        """Return the specific force along another axis (n,), where the instrument sits."""
        if not any(self.position_m):
            return x[name]
        arm = lever(np.column_stack([x[n] for n in ROTATION]), self.position_m)
        return np.asarray(x[name] + arm[:, self.AXES.index(name)])
